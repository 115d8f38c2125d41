"""The figures of the certificate beside those of the design: both bounds by rays, without and with the true delay.

Every bandwidth printed was proven exactly at that number, and is verified once more here.
"""

import time
from decimal import Decimal
from functools import partial

from companion.attitude_response.exact import decimal, interval
from companion.attitude_response.kinds import FirstOrder
from companion.attitude_response.response import AttitudeResponse
from companion.certify.bandwidth import minimum_bandwidth_by_rays, with_bandwidth
from companion.certify.closed_loop import axis_channel
from companion.certify.falsify import unstable_bandwidth
from companion.certify.piecewise.sector_proof import check_sectors
from companion.certify.problem import AxisProblem

CASES = {"simulation": ("4", "1.8", "0.65", "5.5"), "rig": ("2.3", "0.55", "0.35", "3")}
FIGURES = {  # by rays, none for one quadratic function; and what is unstable
    ("simulation", "0"): ({0: 5.698, 8: 5.15, 16: 5.10, 32: 5.055}, 5.027),
    ("rig", "0"): ({0: 2.904, 8: 2.62, 16: 2.566, 32: 2.546}, 2.533),
    ("rig", "0.02"): ({0: 3.236, 8: 2.889, 16: 2.844}, None),
    ("rig", "0.05"): ({0: 3.880, 8: 3.436, 16: 3.389}, None),
    ("simulation", "0.02"): ({0: 6.998, 8: 6.250, 16: 6.179}, None),
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
        for count, figure in figures.items():
            start = time.perf_counter()
            found = minimum_bandwidth_by_rays(axis, count, below=below)
            seconds = time.perf_counter() - start
            assert found is not None
            assert check_sectors(found.proof, axis_channel(with_bandwidth(axis, found.value))) == ""
            below = float(found.value)
            worst = max(worst, abs(below / figure - 1))
            print(
                f"  rays {count:>2}     {below:7.4f}  design {figure:6.3f}  {below / figure - 1:+.2%}  {seconds:.2f} s"
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
