"""The figures of the certificate beside those of the design: both bounds by degree, without and with delay.

Every bandwidth printed was proven exactly at that number, and is verified once more here.
"""

import time
from decimal import Decimal
from functools import partial

from companion.attitude_response.exact import decimal, interval
from companion.attitude_response.kinds import FirstOrder
from companion.attitude_response.response import AttitudeResponse
from companion.certify.bandwidth import minimum_bandwidth, with_bandwidth
from companion.certify.closed_loop import axis_vertices
from companion.certify.falsify import unstable_bandwidth
from companion.certify.problem import AxisProblem
from companion.certify.proof import check

CASES = {"simulation": ("4", "1.8", "0.65", "5.5"), "rig": ("2.3", "0.55", "0.35", "3")}
FIGURES = {
    ("simulation", "0"): ({2: 5.697, 4: 5.398, 6: 5.262, 8: 5.165}, 5.02),
    ("rig", "0"): ({2: 2.904, 4: 2.743, 6: 2.667, 8: 2.614}, 2.525),
    ("rig", "0.02"): ({2: 3.25, 4: 3.03, 6: 2.94}, None),
    ("rig", "0.05"): ({2: 3.88, 4: 3.57, 6: 3.48}, None),
    ("simulation", "0.02"): ({2: 7.01, 4: 6.50, 6: 6.34}, None),
}


def main() -> None:
    worst = 0.0
    for (case, delay), (figures, unstable) in FIGURES.items():
        wn, position, velocity, bandwidth = CASES[case]
        upper = decimal(position), decimal(velocity)
        response = AttitudeResponse(FirstOrder(interval(bandwidth)), interval(delay))
        axis = AxisProblem(decimal(wn), Decimal("0.7"), (-upper[0], -upper[1]), upper, response)
        print(f"{case}, delay {delay} s")
        below: float | None = None
        for degree, figure in figures.items():
            start = time.perf_counter()
            found = minimum_bandwidth(axis, degree, below=below)
            seconds = time.perf_counter() - start
            assert found is not None
            assert check(found.proof, axis_vertices(with_bandwidth(axis, found.value))) == ""
            below = float(found.value)
            worst = max(worst, abs(below / figure - 1))
            print(
                f"  degree {degree}    {below:7.4f}  design {figure:6.3f}  {below / figure - 1:+.2%}  {seconds:.2f} s"
            )
        start = time.perf_counter()
        shown = unstable_bandwidth(partial(with_bandwidth, axis), below or 1.0)
        assert shown is not None
        line = f"  unstable    {shown[0]:7.4f}"
        if unstable is not None:
            worst = max(worst, abs(float(shown[0]) / unstable - 1))
            line += f"  design {unstable:6.3f}  {float(shown[0]) / unstable - 1:+.2%}"
        print(f"{line}  {time.perf_counter() - start:.2f} s")
        phases = zip(shown[1].weights, shown[1].durations_s, strict=True)
        print("    " + ", ".join(f"W = ({p:+g}, {v:+g}) for {t:.4f} s" for (p, v), t in phases))
    print(f"largest deviation {worst:.2%}")


if __name__ == "__main__":
    main()
