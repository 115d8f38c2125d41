"""What `companion check` prints: the verdict in a sentence, and a table for each axis."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any, Final

from rich.table import Table

from companion.certify.link_loss import LinkLoss

if TYPE_CHECKING:  # the solver takes most of a second to import
    from companion.certify.assessment import Assessment, AxisAssessment

ANGLES: Final = {"x": "pitch", "y": "roll"}


def table(name: str, axis: AxisAssessment, assessment: Assessment, opinion: tuple[str, str] | None) -> Table:
    """What is known of one axis. `opinion`: a row for the second one."""
    from companion.certify.assessment import slowest_ticks_hz  # noqa: PLC0415

    rows = Table(title=f"axis {name} ({ANGLES.get(name, name)})", show_header=False, title_justify="left")
    rows.add_column(style="bold")
    rows.add_column(justify="right")
    tuned = float(axis.tuned_bandwidth_rad_s)
    rows.add_row("attitude bandwidth, as tuned", f"{tuned:.3f} rad/s")
    best: float | None = None
    by_degree = {f"degree {degree}": found for degree, found in axis.minimum_bandwidth.items() if degree > 2}
    by_rays = {f"{n} sectors" if n else "a quadratic function": c for n, c in axis.minimum_bandwidth_by_rays.items()}
    for method, certified in (by_rays | by_degree).items():
        if certified is not None:
            value = float(certified.value)
            best = value if best is None else min(best, value)
            enough = "[green]enough[/green]" if value <= tuned else "[red]more than tuned[/red]"
            rows.add_row(f"needed in continuous time, by {method}", f"{value:.3f} rad/s  {enough}")
    if opinion is not None:
        rows.add_row(*opinion)
    if axis.unstable_below is not None:
        found = "proven unstable below" if not axis.delay_s else "unstable below, by an approximant of the delay"
        rows.add_row(found, f"{float(axis.unstable_below[0]):.3f} rad/s")
    if best is not None:
        rows.add_row("margin", f"{100.0 * (tuned / best - 1.0):+.1f} %")
    limit = "none" if axis.maximum_delay is None else f"{1e3 * float(axis.maximum_delay.value):.1f} ms"
    rows.add_row("delay, as configured / certified up to", f"{1e3 * float(axis.delay_s):.1f} ms / {limit}")
    ticks = slowest_ticks_hz(assessment)
    if assessment.certificate is not None:
        told = f"{ticks[name]:g} Hz or faster" if ticks and name in ticks else "not proven"
        rows.add_row("tick, certified at", told)
    if name in assessment.adaptation_rates:
        rate, largest = assessment.adaptation_rates[name]
        enough = "[green]below[/green]" if rate < largest else "[red]above[/red]"
        rows.add_row("adaptation rate / stable up to", f"{rate:g} / {_rate(largest)}  {enough}")
    fastest = axis.fastest_reference
    rows.add_row(
        "fastest certified reference model", "none" if fastest is None else f"{float(fastest.value):.3f} rad/s"
    )
    return rows


def link_loss(bounds: Sequence[LinkLoss], proposed_s: float, config_has: float | None) -> Table:
    """What can come of a companion that dies, by COM_OF_LOSS_T."""
    rows = Table(title="if the companion dies, at most, until PX4 takes over", title_justify="left")
    for heading in ("COM_OF_LOSS_T", "tilt", "distance", "height lost"):
        rows.add_column(heading, justify="right")
    for bound in bounds:
        time_s = bound.loss_time_s
        names = {proposed_s: "proposed", config_has: "in the config", 1.0: "PX4's default"}
        name = next(text for known_s, text in names.items() if known_s == time_s)
        rows.add_row(
            f"{time_s:g} s, {name}",
            f"{math.degrees(bound.tilt_rad):.0f} deg",
            f"{bound.distance_m:.1f} m",
            f"{bound.height_lost_m:.1f} m",
        )
    return rows


def _rate(limit: float) -> str:
    return f"{limit:.0f}" if limit >= 10.0 else f"{limit:.2g}"


def verdict(assessment: Assessment) -> str:
    """One sentence."""
    from companion.certify.assessment import delay_intervals  # noqa: PLC0415

    if assessment.certified:
        delayed = any(upper > 0.0 for _, upper in (delay_intervals(assessment) or {}).values())
        by = f"on {assessment.rays} sectors" if assessment.rays else f"of degree {assessment.degree}"
        return (
            f"[bold green]Certified[/bold green] by a Lyapunov function {by}, "
            "verified exactly: no adaptation inside the bounds can destabilise this attitude loop"
            + (", whatever its constant delay within the interval." if delayed else ".")
        )
    for name, (rate, limit) in assessment.adaptation_rates.items():
        if rate >= limit:
            return (
                f"[bold red]Not certified[/bold red]: axis {name}'s adaptation rate {rate:g} is not below "
                f"{_rate(limit)}, where sampling makes it unstable; lower it, tick faster or fly a smaller envelope."
            )
    for name, rate_hz in assessment.growing.items():
        return (
            f"[bold red]Not certified[/bold red]: axis {name} grows when its command is held over a tick at "
            f"{rate_hz:g} Hz; raise tick.floor_hz."
        )
    for name, axis in assessment.axes.items():
        if axis.attack is not None:
            growth = axis.attack.spectral_radius
            return (
                f"[bold red]Not certified[/bold red], and it cannot be: axis {name} has an adaptation inside its "
                f"bounds, a switching of {sum(axis.attack.durations_s):.2f} s, that grows {growth:.3g}-fold a period."
            )
    return (
        "[bold red]Not certified[/bold red] by anything tried: tune the attitude loop faster, cut the delay, or slow "
        "the reference model down."
    )


def tube_lines(found: dict[str, Any]) -> Iterator[str]:
    """For a person."""
    for name, tube_m in found["tube_m"].items():
        told = found["tube"][name]
        weights = told["proof"]["weights"]
        yield (
            f"{name}: within {tube_m:.3g} m of the trajectory, {told['m_per_m_s2']:.3g} m for each m/s2: "
            f"{told['disturbance_m_s2']:g} of disturbance and {told['feed_forward_m_s2']:.2g} that is fed forward wrong"
        )
        yield f"   weights {weights}" + (f"; bias {told['proof']['bias']}" if "bias" in told["proof"] else "")
