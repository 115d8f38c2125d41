"""`companion design`: from a flight log to a config that is certified to fly, and what limits it."""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterator, Mapping
from decimal import Decimal
from pathlib import Path
from typing import Any, Final, NamedTuple

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn
from rich.table import Table

from companion.certify.bandwidth import largest_delay
from companion.certify.certificate import RAYS, certify, certify_for_a_link, without_delay
from companion.certify.design import Design, design
from companion.certify.from_config import certificate_path, problem
from companion.certify.problem import Problem
from companion.certify.statement import Json
from companion.certify.velocity_error import Adaptation
from companion.commands.options import add_json, add_logs
from companion.config import Config, ConfigError, load_config, load_text
from companion.config.edit import KeyPath, added, edited, flow, key_paths
from companion.config.estimator import VelocityError
from companion.config.vehicles import ANGLES
from companion.identify.fit import ModelFit
from companion.identify.identification import Identification, identify_log
from companion.identify.series import OURS
from companion.identify.write import note, response

_REFERENCE_MODEL_RAD_S: Final = 50.0  # PX4's default
_SEARCH_RAYS: Final = (0, 8)  # 16 give 1 % more for twice the work


class Arguments(NamedTuple):
    """Of `companion design`."""

    logs: list[Path]
    template: Path
    out: Path
    margin: float
    intervals: bool
    link_delay: float
    force: bool
    json: bool


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of `companion design`."""
    add_logs(parser)
    parser.add_argument("--template", type=Path, required=True, metavar="CONFIG", help="everything but the response")
    parser.add_argument("--out", type=Path, required=True, metavar="CONFIG", help="the config to write")
    parser.add_argument("--margin", type=float, default=0.1, help="in hand, of bandwidth and delay (default: 0.1)")
    parser.add_argument("--intervals", action="store_true", help="certify the whole of the identified intervals")
    parser.add_argument("--link-delay", type=float, default=0.0, metavar="S", help="both ways, where no log has it")
    parser.add_argument("--force", action="store_true", help="replace what --out names")
    add_json(parser)


def parse(namespace: argparse.Namespace) -> Arguments:
    """The arguments as a typed record."""
    return Arguments(
        namespace.logs,
        namespace.template,
        namespace.out,
        namespace.margin,
        namespace.intervals,
        namespace.link_delay,
        namespace.force,
        namespace.json,
    )


def run(arguments: Arguments) -> int:
    """Identify, design, write config and certificate. 0 done, 1 nothing certified. Raises `ConfigError`."""
    out = arguments.out
    if out.exists() and not arguments.force:
        raise ConfigError(f"{out}: exists: choose another name, or --force")
    if not 0.0 <= arguments.margin < 1.0:
        raise ConfigError(f"--margin {arguments.margin:g}: a fraction from 0 to below 1, as in 0.1 for 10 %")
    if not out.parent.is_dir():
        raise ConfigError(f"{out}: cannot write: no such folder")
    template = load_config(arguments.template)
    if not 0.0 <= arguments.link_delay < 0.5:
        raise ConfigError(f"--link-delay {arguments.link_delay:g}: seconds, both ways together, from 0 to below 0.5")
    identification = identify_log(arguments.logs, template.vehicle.system_id)
    text = arguments.template.read_text(encoding="utf-8")
    with_response = _with_response(text, template, identification, arguments)
    stated = problem(load_text(with_response, out, out.parent))
    console = Console(stderr=arguments.json)
    error = identification.velocity_error if template.estimator is None else template.estimator.velocity_error
    # An axis that does not write Q keeps that of the schema: there is no place to put another.
    with_q = all(("controller", "axes", axis, "lyapunov_q") in key_paths(text) for axis in _axes_written(text))
    chosen = _design(stated, arguments, error if with_q else None, console)
    if chosen is None:
        console.print("[bold red]Nothing certified[/bold red]: tune the attitude loop faster, or cut the delay.")
        return 1
    designed = edited(with_response, _changes(with_response, chosen, template))
    adaptation = chosen.adaptation
    if adaptation is not None and adaptation.correct and template.controller.estimate_correction is None:
        designed = added(designed, "controller", "estimate_correction", "{}")
    certificate = _certificate(problem(load_text(designed, out, out.parent)))
    if certificate is None:
        console.print("[bold red]Not certified[/bold red] after all: give a larger --margin.")
        return 1
    _write(out, designed)
    _write(certificate_path(out), json.dumps(certificate, indent=1) + "\n")
    if arguments.json:
        print(json.dumps(_to_json(chosen, template, identification, error, out)))
    else:
        _show(chosen, template, identification, error, arguments, console)
    return 0


def _certificate(designed: Problem) -> Mapping[str, Json] | None:
    """As `companion check --out` would write it: with a delay for the link where the design has none."""
    certificate, axes = certify(designed), without_delay(designed)
    if certificate is None or not axes:
        return certificate
    largest = {name: each.value for name in axes if (each := largest_delay(designed.axes[name], RAYS[:2]))}
    found = certify_for_a_link(designed, largest, RAYS[1])
    return certificate if found is None else found[0]


def _with_response(text: str, template: Config, identification: Identification, arguments: Arguments) -> str:
    """The template with the identified responses, in its plant too, and with the gains they were identified at."""
    changes: dict[KeyPath, str] = {}
    notes: dict[KeyPath, str] = {}
    known = key_paths(text)
    for axis, angle in ANGLES.items():
        section = getattr(template.attitude, axis)
        if section is None:
            continue
        if angle not in identification.axes:
            raise ConfigError(identification.refused[angle])
        found = identification.axes[angle]
        # A log that keeps a set-point every so often shows each later than it was in force, by half of that on average.
        more_s = arguments.link_delay + 0.5 * found.lateness_s
        values = dict(response(found)) if arguments.intervals else _rounded(found.chosen.named())
        values["delay_s"] = _plus(values.get("delay_s", 0.0), more_s)
        changes["attitude", axis] = flow({"pade_order": section.pade_order, **values})
        notes["attitude", axis] = note(identification, found)
        plant = ("plant", template.vehicle.kind, angle)
        if plant in known:
            flown = _rounded(found.chosen.named())
            own_s = max(flown.get("delay_s", 0.0) - _reference_model_s(template, identification), 0.0)
            changes[plant] = flow({**flown, "delay_s": _plus(own_s, more_s)})
    if ("plant", "setpoint_delay_s") in known:
        changes["plant", "setpoint_delay_s"] = "0"  # it is in the responses
    stated: dict[str, str] = {}
    if identification.gains:
        stated["parameters"] = flow(identification.gains)
    if identification.px4_version is not None:
        stated["px4_version"] = f'"{identification.px4_version}"'
    changes |= {("vehicle", key): value for key, value in stated.items() if ("vehicle", key) in known}
    text = edited(text, changes, notes)
    for key, value in stated.items():
        if ("vehicle", key) not in known:
            text = added(text, "vehicle", key, value)
    return text


def _reference_model_s(template: Config, identification: Identification) -> float:
    """By how much a plant of PX4 v1.18 is late by itself: 2 / MC_REF_W_N, which the identified delay has in it."""
    if template.plant is None or template.plant.px4_version == "1.17":
        return 0.0
    return 2.0 / identification.gains.get("MC_REF_W_N", _REFERENCE_MODEL_RAD_S)


def _design(stated: Problem, arguments: Arguments, error: VelocityError | None, console: Console) -> Design | None:
    columns = (TextColumn("{task.description:<36}"), BarColumn(), TimeElapsedColumn())
    with Progress(*columns, console=console, transient=True) as progress:
        task = progress.add_task("designing", total=1.0)
        return design(
            stated,
            Decimal(str(arguments.margin)),
            _SEARCH_RAYS,
            lambda fraction, text: progress.update(task, completed=fraction, description=text),
            error,
        )


def _axes_written(text: str) -> list[str]:
    """The axes that have keys of their own: an alias has none."""
    known = key_paths(text)
    return [axis for axis in ("x", "y") if ("controller", "axes", axis, "natural_frequency_rad_s") in known]


def _changes(text: str, chosen: Design, template: Config) -> dict[KeyPath, str]:
    """The chosen numbers by key; an axis that is an alias of the other has none of its own."""
    known = key_paths(text)
    changes: dict[KeyPath, str] = {}
    controller = template.controller
    standard = controller.axes.x.adaptation_rate.standard
    for axis in ("x", "y"):
        for key, value in (
            ("natural_frequency_rad_s", f"{chosen.natural_frequency_rad_s}"),
            ("position_weight_bound", _interval(chosen.position_bound)),
            ("velocity_weight_bound", _interval(chosen.velocity_bound)),
            ("adaptation_rate", f"{{hedged: {chosen.adaptation_rate}, standard: {standard:g}}}"),
        ):
            path = ("controller", "axes", axis, key)
            if path in known:
                changes[path] = value
        if chosen.adaptation is not None and ("controller", "axes", axis, "lyapunov_q") in known:
            changes["controller", "axes", axis, "lyapunov_q"] = f"[1, {chosen.adaptation.q2}]"
    if controller.bias is not None:
        rates = f"{{hedged: {chosen.bias_adaptation_rate}, standard: {controller.bias.adaptation_rate.standard:g}}}"
        changes["controller", "bias", "adaptation_rate"] = rates
    return changes


def _interval(bound: tuple[Decimal, Decimal]) -> str:
    return f"[{bound[0]}, {bound[1]}]"


def _rounded(values: dict[str, float]) -> dict[str, Any]:
    return {key: float(f"{value:.4g}") for key, value in values.items()}


def _plus(delay: Any, more_s: float) -> Any:
    return [round(end + more_s, 6) for end in delay] if isinstance(delay, list) else round(delay + more_s, 6)


def _write(path: Path, text: str) -> None:
    try:
        path.write_text(text, encoding="utf-8")
    except OSError as error:
        raise ConfigError(f"{path}: cannot write: {error.strerror}") from None


def _limits(chosen: Design) -> str:
    if chosen.limited_by == "noise":
        return f"noise: {min(chosen.fastest_rad_s.values())} rad/s would be certified, and fly worse"
    return f"{chosen.limited_by} (axis {chosen.slowest}, {ANGLES[chosen.slowest]})"


def _to_json(
    chosen: Design, template: Config, identification: Identification, error: VelocityError | None, out: Path
) -> dict[str, object]:
    return {
        "config": str(out),
        "certificate": str(certificate_path(out)),
        "certified": True,
        "natural_frequency_rad_s": float(chosen.natural_frequency_rad_s),
        "damping_ratio": template.controller.axes.x.damping_ratio,
        "position_weight_bound": [float(end) for end in chosen.position_bound],
        "velocity_weight_bound": [float(end) for end in chosen.velocity_bound],
        "adaptation_rate": float(chosen.adaptation_rate),
        "bias_adaptation_rate": float(chosen.bias_adaptation_rate),
        "lyapunov_q": None if chosen.adaptation is None else [1.0, float(chosen.adaptation.q2)],
        "velocity_error": None if error is None else error._asdict(),
        "fastest_natural_frequency_rad_s": {name: float(value) for name, value in chosen.fastest_rad_s.items()},
        "limited_by": chosen.limited_by,
        "limited_by_sampling": chosen.sampled,
        "cost_of_10_ms_rad_s": float(chosen.cost_of_10_ms_rad_s),
        "responses": {name: axis.chosen.named() for name, axis in identification.axes.items()},
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


def _show(
    chosen: Design,
    template: Config,
    identification: Identification,
    error: VelocityError | None,
    arguments: Arguments,
    console: Console,
) -> None:
    table = Table(title=f"{arguments.out}", show_header=False, title_justify="left")
    table.add_column(style="bold")
    table.add_column(justify="right")
    for angle, axis in identification.axes.items():
        table.add_row(f"{angle}, {axis.chosen.model.title}", _in_words(axis.chosen))
    for name, value in chosen.fastest_rad_s.items():
        table.add_row(f"fastest reference, axis {name} ({ANGLES[name]})", f"{value} rad/s")
    table.add_row("chosen, both axes", f"{chosen.natural_frequency_rad_s} rad/s, damping ratio "
                                       f"{template.controller.axes.x.damping_ratio:g}")  # fmt: skip
    table.add_row("margin, bandwidth and delay", f"{100 * arguments.margin:g} %")
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
    console.print(
        f"[bold green]Certified[/bold green]: {arguments.out}, {certificate_path(arguments.out)}", soft_wrap=True
    )
    lateness_s = max(axis.lateness_s for axis in identification.axes.values())
    if lateness_s:
        console.print(
            f"[yellow]The log keeps a set-point every {1e3 * lateness_s:.0f} ms only: half of it was added to each "
            "delay. With the tlog of the flight beside it the delay is known.[/yellow]"
        )
    if identification.clock != OURS and not arguments.link_delay:
        console.print(
            "[yellow]The delay of the link is not in a ULog: give it by --link-delay, or the tlog of the flight "
            "beside it.[/yellow]"
        )
    for angle, axis in identification.axes.items() if not arguments.intervals else ():
        for key, (low, high) in axis.chosen.intervals().items():
            middle = axis.chosen.named()[key]
            if high > (1.0 + arguments.margin) * middle or low < middle / (1.0 + arguments.margin):
                console.print(
                    f"[yellow]{angle}: the interval of {key}, {low:.3g} to {high:.3g}, is wider than the margin: "
                    "fly more manoeuvres, or certify all of it with --intervals.[/yellow]"
                )
    console.print(f"next: companion sitl {arguments.out}")
