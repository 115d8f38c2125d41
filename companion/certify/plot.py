"""Picture: the bandwidth that delay asks for, quadratic and by sectors, beside what is unstable."""

from collections.abc import Callable, Mapping, Sequence
from decimal import Decimal
from functools import partial
from pathlib import Path
from typing import NamedTuple

from companion.certify.bandwidth import minimum_bandwidth_by_rays, tuned_bandwidth, with_bandwidth, with_delay
from companion.certify.falsify import unstable_bandwidth
from companion.certify.problem import AxisProblem
from companion.processes import Processes


class DelayCurves(NamedTuple):
    """Bandwidths in rad/s over delays in s; None where nothing was found.

    Attributes
    ----------
    delays_s
        Transport delays.
    needed
        Least certified bandwidth by rays, none for a quadratic function, one value a delay.
    unstable
        Bandwidth proven unstable, one value a delay.
    """

    delays_s: tuple[float, ...]
    needed: Mapping[int, tuple[float | None, ...]]
    unstable: tuple[float | None, ...]


def delay_curves(
    problem: AxisProblem,
    delays_s: Sequence[Decimal],
    counts: Sequence[int] = (0, 8, 16),
    progress: Callable[[float], None] | None = None,
) -> DelayCurves:
    """Both bounds of the bandwidth over a range of delays.

    Parameters
    ----------
    problem
        Axis; its own delay is replaced.
    delays_s
        Delays in s.
    counts
        Rays, rising; none for a quadratic function.
    progress
        Called with the fraction done.
    """
    points = []
    with Processes(elsewhere=len(delays_s) > 1) as processes:
        begun = [processes.call(_at_delay, with_delay(problem, delay), tuple(counts)) for delay in delays_s]
        for index, result in enumerate(begun):
            points.append(result())
            if progress is not None:
                progress((index + 1) / len(delays_s))
    needed = {count: tuple(values[place] for values, _ in points) for place, count in enumerate(counts)}
    return DelayCurves(tuple(float(d) for d in delays_s), needed, tuple(unstable for _, unstable in points))


def _at_delay(delayed: AxisProblem, counts: tuple[int, ...]) -> tuple[list[float | None], float | None]:
    """Needed bandwidth by count, and what is found unstable, rad/s."""
    needed: list[float | None] = []
    below: float | None = None
    for count in counts:
        found = minimum_bandwidth_by_rays(delayed, count, below=below)
        below = float(found.value) if found else below
        needed.append(float(found.value) if found else None)
    shown = unstable_bandwidth(partial(with_bandwidth, delayed), below or 2 * float(tuned_bandwidth(delayed.response)))
    return needed, float(shown[0]) if shown else None


def plot_delay(problem: AxisProblem, curves: DelayCurves, path: Path | str, name: str = "") -> None:
    """Draw the curves and the tuned point of one axis into a PNG file.

    Parameters
    ----------
    problem
        Axis, for its tuned bandwidth and delay.
    curves
        From `delay_curves`.
    path
        File to write.
    name
        Name of the axis, for the title.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg  # noqa: PLC0415
    from matplotlib.figure import Figure  # noqa: PLC0415

    tuned, delay_ms = float(tuned_bandwidth(problem.response)), 1e3 * float(problem.response.delay_s.upper)
    milliseconds = [1e3 * d for d in curves.delays_s]
    unstable = [float("nan") if v is None else v for v in curves.unstable]
    figure = Figure(figsize=(7.2, 4.6), dpi=150, layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.add_subplot()

    axes.fill_between(milliseconds, 0, unstable, color="#d9534f", alpha=0.25, linewidth=0)
    axes.plot(milliseconds, unstable, color="#b52b27", linewidth=1.2, label="unstable below")
    shades = [str(0.6 * i / max(1, len(curves.needed) - 1)) for i in reversed(range(len(curves.needed)))]
    for (count, values), shade in zip(curves.needed.items(), shades, strict=True):
        method = f"{count} sectors" if count else "quadratic"
        line = [float("nan") if v is None else v for v in values]
        axes.plot(
            milliseconds,
            line,
            color=shade,
            marker=".",
            linewidth=1.6,
            label=f"certified above, {method}",
        )
    axes.plot(
        [delay_ms], [tuned], "*", color="#1f5fbf", markersize=15, label=f"tuned: {tuned:g} rad/s, {delay_ms:g} ms"
    )

    finite = [v for values in (*curves.needed.values(), curves.unstable) for v in values if v is not None]
    axes.set_ylim(max(0.0, 0.6 * min([tuned, *finite])), 1.08 * max([tuned, *finite]))
    axes.set_xlim(min(milliseconds) - 1, max(milliseconds) + 1)
    axes.set_xlabel("transport delay (ms)")
    axes.set_ylabel("attitude bandwidth (rad/s)")
    axes.set_title(f"Delay raises the attitude bandwidth that is needed{': axis ' + name if name else ''}", fontsize=11)
    axes.grid(alpha=0.3)
    axes.legend(frameon=False, fontsize=9, loc="upper left")
    figure.savefig(path)
