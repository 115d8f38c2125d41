"""What `companion design` says: one JSON object, or a table and what to look at."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from rich.console import Console
from rich.table import Table

from companion.certify.designing.design import Design
from companion.certify.designing.px4_reference_model import Proposal
from companion.certify.designing.velocity_error import Adaptation
from companion.certify.from_config import certificate_path
from companion.config import Config
from companion.config.estimator import VelocityError
from companion.config.vehicles import ANGLES
from companion.identify.fit import ModelFit
from companion.identify.identification import Identification
from companion.identify.series import OURS


class Designed(NamedTuple):
    """What was designed, from what, and where it was written.

    Attributes: `error`, of the estimated velocity, None where it is not known; `proposal`, None where PX4 has no
    reference model or no better settings were found; `margin`, a fraction; `link_delay_s`, both ways, as given.
    """

    out: Path
    chosen: Design
    template: Config
    identification: Identification
    error: VelocityError | None
    proposal: Proposal | None
    margin: float
    intervals: bool
    link_delay_s: float


def _limits(chosen: Design) -> str:
    if chosen.limited_by == "noise":
        return f"noise: {min(chosen.fastest_rad_s.values())} rad/s would be certified, and fly worse"
    return f"{chosen.limited_by} (axis {chosen.slowest}, {ANGLES[chosen.slowest]})"


def to_json(designed: Designed) -> dict[str, object]:
    """Of `companion design --json`."""
    chosen, proposal = designed.chosen, designed.proposal
    return {
        "config": str(designed.out),
        "certificate": str(certificate_path(designed.out)),
        "certified": True,
        "natural_frequency_rad_s": float(chosen.natural_frequency_rad_s),
        "damping_ratio": designed.template.controller.axes.x.damping_ratio,
        "position_weight_bound": [float(end) for end in chosen.position_bound],
        "velocity_weight_bound": [float(end) for end in chosen.velocity_bound],
        "adaptation_rate": float(chosen.adaptation_rate),
        "bias_adaptation_rate": float(chosen.bias_adaptation_rate),
        "lyapunov_q": None if chosen.adaptation is None else [1.0, float(chosen.adaptation.q2)],
        "velocity_error": None if designed.error is None else designed.error._asdict(),
        "fastest_natural_frequency_rad_s": {name: float(value) for name, value in chosen.fastest_rad_s.items()},
        "limited_by": chosen.limited_by,
        "limited_by_sampling": chosen.sampled,
        "cost_of_10_ms_rad_s": float(chosen.cost_of_10_ms_rad_s),
        "responses": {name: axis.chosen.named() for name, axis in designed.identification.axes.items()},
        "proposed": None
        if proposal is None
        else {
            "parameters": proposal.settings.parameters(),
            "predicted_natural_frequency_rad_s": float(proposal.fastest_rad_s),
        },
    }


def _in_words(fit: ModelFit) -> str:
    words = [
        f"{1e3 * value:.1f} ms"
        if parameter.unit == "s"
        else f"{value:.2f} rad/s"
        if parameter.unit == "rad/s"
        else f"{parameter.symbol} {value:.2f}"
        for parameter, value in zip(fit.model.described, fit.values, strict=True)
    ]
    return f"{', '.join(words)} (fit {fit.fit:.4f})"


def _estimator_rows(
    adaptation: Adaptation | None, error: VelocityError | None, template: Config
) -> Iterator[tuple[str, str]]:
    """What was chosen for the estimator, and what that leaves."""
    if error is None:
        yield "estimator", "not known: give estimator.preset; Q is the template's"
        return
    source = "measured in the log" if template.estimator is None else "the template's estimator section"
    yield "velocity error", f"{error.deviation_m_s:.2g} m/s for {error.time_s:.1f} s, {source}"
    if adaptation is None:
        yield "Q", "the template's: write lyapunov_q into its axes"
        return
    gusts_m, by_error_m = adaptation.displacement
    yield "Q", f"[1, {adaptation.q2}], {adaptation.ratio_s:.2f} m for each m/s of velocity error"
    yield "estimate corrected", "yes" if adaptation.correct else "no: nothing aids the position"
    yield "moved by gusts / velocity error", f"{gusts_m:.3f} / {by_error_m:.3f} m RMS"


def show(designed: Designed, console: Console) -> None:
    """Print it."""
    out, chosen, template, identification, error, proposal, margin, intervals, link_delay_s = designed
    table = Table(title=f"{out}", show_header=False, title_justify="left")
    table.add_column(style="bold")
    table.add_column(justify="right")
    for angle, axis in identification.axes.items():
        table.add_row(f"{angle}, {axis.chosen.model.title}", _in_words(axis.chosen))
    for name, value in chosen.fastest_rad_s.items():
        table.add_row(f"fastest reference, axis {name} ({ANGLES[name]})", f"{value} rad/s")
    table.add_row("chosen, both axes", f"{chosen.natural_frequency_rad_s} rad/s, damping ratio "
                                       f"{template.controller.axes.x.damping_ratio:g}")  # fmt: skip
    table.add_row("margin, bandwidth and delay", f"{100 * margin:g} %")
    table.add_row("limited by", _limits(chosen))
    table.add_row("10 ms more of delay would cost", f"{chosen.cost_of_10_ms_rad_s:.2f} rad/s")
    table.add_row(
        f"adaptation rate at {template.tick.floor_hz:g} Hz",
        f"{chosen.adaptation_rate}, bias {chosen.bias_adaptation_rate}"
        + (", limited by the tick" if chosen.sampled else ""),
    )
    for row in _estimator_rows(chosen.adaptation, error, template):
        table.add_row(*row)
    console.print(table)
    console.print(f"[bold green]Certified[/bold green]: {out}, {certificate_path(out)}", soft_wrap=True)
    for line in identification.notes:
        console.print(line, style="yellow", markup=False, highlight=False, soft_wrap=True)
    lateness_s = max(axis.lateness_s for axis in identification.axes.values())
    if lateness_s:
        console.print(
            f"[yellow]The log keeps a set-point every {1e3 * lateness_s:.0f} ms only: half of it was added to each "
            "delay. With the tlog of the flight beside it the delay is known.[/yellow]"
        )
    if identification.clock != OURS and not link_delay_s:
        console.print(
            "[yellow]The delay of the link is not in a ULog: give it by --link-delay, or the tlog of the flight "
            "beside it.[/yellow]"
        )
    for angle, axis in identification.axes.items() if not intervals else ():
        for key, (low, high) in axis.chosen.intervals().items():
            middle = axis.chosen.named()[key]
            if high > (1.0 + margin) * middle or low < middle / (1.0 + margin):
                console.print(
                    f"[yellow]{angle}: the interval of {key}, {low:.3g} to {high:.3g}, is wider than the margin: "
                    "fly more manoeuvres, or certify all of it with --intervals.[/yellow]"
                )
    if proposal is not None:
        _show_proposal(proposal, console)
    console.print(f"next: companion sitl {out}")


def _show_proposal(proposal: Proposal, console: Console) -> None:
    settings = ", ".join(f"{name} {value:g}" for name, value in proposal.settings.parameters().items())
    responses = "; ".join(
        f"{ANGLES[name]} {wn:.1f} rad/s, ζ {zeta:.2f}, {1e3 * delay:.0f} ms"
        for name, (wn, zeta, delay) in proposal.responses.items()
    )
    console.print(
        f"[yellow]PX4's attitude reference model costs more than it must. With {settings} about "
        f"{proposal.fastest_rad_s:.1f} rad/s would be certified ({responses} predicted). To use it, "
        "set them, fly --identify again, and design from that log.[/yellow]"
    )
