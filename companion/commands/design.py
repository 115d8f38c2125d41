"""`companion design`: from a flight log to a config that is certified to fly, and what limits it."""

from __future__ import annotations

import argparse
import json
from collections.abc import Mapping
from decimal import Decimal
from pathlib import Path
from typing import Any, Final, NamedTuple

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

from companion.attitude_response.kinds import SECOND_ORDER_DELAY
from companion.certify.bandwidth import largest_delay
from companion.certify.certificate import RAYS, certify, certify_for_a_link, without_delay
from companion.certify.designing.design import Design, design
from companion.certify.designing.px4_reference_model import Proposal, propose, settings_of
from companion.certify.from_config import certificate_path, problem
from companion.certify.problem import Problem
from companion.certify.statement import Json
from companion.commands.options import ConfigFile, add_anyway, add_json, add_logs, refuse_slips
from companion.commands.tables.design_report import Designed, show, to_json
from companion.config import Config, ConfigError, load_text
from companion.config.edit import KeyPath, added, edited, flow, key_paths
from companion.config.estimator import VelocityError
from companion.config.numbers import shortest
from companion.config.vehicles import ANGLES
from companion.identify.identification import Identification, identify_log
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
    anyway: bool
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
    add_anyway(parser)
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
        namespace.anyway,
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
    template = ConfigFile(arguments.template, (), arguments.anyway).load()
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
    designed = edited(with_response, _changes(with_response, chosen, template), drop_figures=True)
    adaptation = chosen.adaptation
    if adaptation is not None and adaptation.correct and template.controller.estimate_correction is None:
        designed = added(designed, "controller", "estimate_correction", "{}")
    config = load_text(designed, out, out.parent)
    if not arguments.anyway:
        refuse_slips(config, out)
    certificate = _certificate(problem(config))
    if certificate is None:
        console.print("[bold red]Not certified[/bold red] after all: give a larger --margin.")
        return 1
    _write(out, designed)
    _write(certificate_path(out), json.dumps(certificate, indent=1) + "\n")
    proposal = _proposal(stated, identification, Decimal(str(arguments.margin)))
    designed_as = Designed(
        out, chosen, template, identification, error, proposal, arguments.margin, arguments.intervals,
        arguments.link_delay,
    )  # fmt: skip
    if arguments.json:
        print(json.dumps(to_json(designed_as)))
    else:
        show(designed_as, console)
    return 0


def _proposal(stated: Problem, identification: Identification, margin: Decimal) -> Proposal | None:
    """PX4's settings to set before the next identification, where they would help."""
    gains = {axis: f"MC_{angle.upper()}_P" for axis, angle in ANGLES.items() if axis in stated.axes}
    now, responses = settings_of(identification.gains), {}
    for axis in gains:
        chosen = identification.axes[ANGLES[axis]].chosen
        if chosen.model is SECOND_ORDER_DELAY:
            wn, zeta, delay = chosen.values
            responses[axis] = wn, zeta, delay
    if now is None or responses.keys() != gains.keys() or not identification.gains.keys() >= set(gains.values()):
        return None
    p_1_s = {axis: identification.gains[gain] for axis, gain in gains.items()}
    return propose(stated.axes, responses, p_1_s, now, margin)


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
    text = edited(text, changes, notes, drop_figures=True)
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
            ("adaptation_rate", f"{{hedged: {chosen.adaptation_rate}, standard: {shortest(standard)}}}"),
        ):
            path = ("controller", "axes", axis, key)
            if path in known:
                changes[path] = value
        if chosen.adaptation is not None and ("controller", "axes", axis, "lyapunov_q") in known:
            changes["controller", "axes", axis, "lyapunov_q"] = f"[1, {chosen.adaptation.q2}]"
    if controller.bias is not None:
        standard = controller.bias.adaptation_rate.standard
        rates = f"{{hedged: {chosen.bias_adaptation_rate}, standard: {shortest(standard)}}}"
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
