"""`companion check`: is this config certified, by what margin, what does delay cost, and how fast could it be?"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Mapping
from decimal import Decimal
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

from companion.certify import link_loss as bounds
from companion.certify import proof
from companion.certify.from_config import problem
from companion.certify.polynomial.polynomial_proof import MAX_DEGREE
from companion.certify.problem import AxisProblem, Problem
from companion.certify.statement import statement
from companion.commands.options import ConfigFile, add_anyway, add_config, add_json, config_file
from companion.commands.tables.check_report import ANGLES, link_loss, table, tube_lines, verdict
from companion.config import Config, ConfigError

if TYPE_CHECKING:  # the solver takes most of a second to import, which --verify need not wait for
    from companion.certify.assessment import Assessment
    from companion.certify.second_opinion import Opinions

DISTURBANCE_M_S2 = 0.5
"""Taken where none is given: 2 m/s of gusts on an airframe of 1 kg."""
PICTURES = (".png", ".svg", ".pdf")


class Arguments(NamedTuple):
    """Of `companion check`."""

    config: ConfigFile
    degree: int
    sectors: int
    all_degrees: bool
    quick: bool
    out: Path | None
    verify: Path | None
    plot: Path | None
    second_opinion: bool
    json: bool
    disturbance_m_s2: float | None  # with --trajectory alone


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of `companion check`."""
    add_anyway(parser)
    add_config(parser)
    effort = parser.add_mutually_exclusive_group()
    effort.add_argument("--quick", action="store_true", help="the verdict alone: no margin, no delay budget")
    effort.add_argument(
        "--second-opinion",
        action="store_true",
        help="also the needed bandwidth by cvxpy and SCS, as the paper states it, without delay",
    )
    parser.add_argument(
        "--sectors",
        type=int,
        choices=(0, 8, 16, 32),
        default=32,
        help="most sectors of the function (default: 32)",
    )
    parser.add_argument(
        "--degree", type=int, default=2, help="highest degree of a polynomial, without a delay alone (default: 2)"
    )
    parser.add_argument(
        "--all-degrees", action="store_true", help="the needed bandwidth by each degree and by all sectors"
    )
    parser.add_argument("--out", type=Path, metavar="FILE", help="write the certificate, if there is one")
    parser.add_argument("--verify", type=Path, metavar="FILE", help="only verify this certificate against the config")
    parser.add_argument("--plot", type=Path, metavar="FILE.png", help="draw the needed bandwidth against delay")
    parser.add_argument(
        "--trajectory",
        dest="mission",
        metavar="NAME|FILE",
        help="also how far from this trajectory a disturbance drives it, as `companion sitl --mission` takes it",
    )
    parser.add_argument("--speed", type=float, metavar="M_S", help="of a circle or lemniscate (default: 1)")
    parser.add_argument("--stretch", action="store_true", help="slow a trajectory that asks for too much until it fits")
    parser.add_argument(
        "--disturbance",
        type=float,
        metavar="M_S2",
        help=f"of wind, load and all else, on an axis (default: {DISTURBANCE_M_S2:g})",
    )
    add_json(parser)


def parse(namespace: argparse.Namespace) -> Arguments:
    """The arguments as a typed record."""
    return Arguments(
        config_file(namespace),
        namespace.degree,
        namespace.sectors,
        namespace.all_degrees,
        namespace.quick,
        namespace.out,
        namespace.verify,
        namespace.plot,
        namespace.second_opinion,
        namespace.json,
        _disturbance(namespace),
    )


def _disturbance(namespace: argparse.Namespace) -> float | None:
    given: float | None = namespace.disturbance
    if namespace.mission is None:
        if given is not None or namespace.stretch:
            raise ConfigError("--disturbance, --stretch: they are of a --trajectory, name one")
        return None
    return DISTURBANCE_M_S2 if given is None else given


def run(arguments: Arguments) -> int:
    """Run the pre-flight check. 0 certified, 1 not certified. Raises `ConfigError` for bad input."""
    config = arguments.config.load()
    stated = problem(config)
    if not 2 <= arguments.degree <= MAX_DEGREE or arguments.degree % 2:
        raise ConfigError(f"--degree {arguments.degree}: it must be even, from 2 to {MAX_DEGREE}")
    _refuse_what_does_not_go_together(arguments)
    if arguments.verify is not None:
        return _verify(arguments.verify, stated, as_json=arguments.json)
    from companion.certify.assess import verdict_of  # noqa: PLC0415
    from companion.certify.assessment import to_json  # noqa: PLC0415

    console = Console(stderr=arguments.json)
    assessment = verdict_of(stated, arguments.degree, arguments.sectors)
    if arguments.out is not None:
        _write(assessment.certificate if assessment.certified else None, arguments.out)
    if assessment.certified:
        console.print(verdict(assessment))
        if arguments.out is not None:
            console.print(f"certificate: {arguments.out}")
    if not arguments.quick:
        assessment = _assess(stated, assessment, arguments, console)
    if arguments.out is not None and assessment.certified:
        _write_for_a_link(stated, assessment, arguments, console)
    if arguments.plot is not None:
        _plot(stated, arguments.plot, console)
    opinions = _second_opinions(stated, console) if arguments.second_opinion else {}
    tubes = {}
    if arguments.disturbance_m_s2 is not None:
        from companion.certify.tube.from_config import tube_json  # noqa: PLC0415

        with console.status("tube"):
            tubes = tube_json(config, stated, arguments.disturbance_m_s2)
    if arguments.json:
        told = {"second_opinion": {name: opinion._asdict() for name, opinion in opinions.items()}} if opinions else {}
        print(json.dumps(to_json(assessment) | told | {"link_loss": _link_loss_json(config)} | tubes))
    for name, axis in assessment.axes.items():
        console.print(table(name, axis, assessment, _row(opinions[name]) if name in opinions else None))
    if not arguments.quick:
        own = config.vehicle.parameters.get("COM_OF_LOSS_T")
        console.print(link_loss(bounds.stated(config), bounds.proposed_s(config), own))
    for line in tube_lines(tubes) if tubes else ():
        console.print(line)
    if not assessment.certified:  # the reason may need the attack
        console.print(verdict(assessment))
    return 0 if assessment.certified else 1


def _link_loss_json(config: Config) -> dict[str, object]:
    told = [bound._asdict() for bound in bounds.stated(config)]
    return {"proposed_s": bounds.proposed_s(config), "bounds": told}


def _refuse_what_does_not_go_together(arguments: Arguments) -> None:
    """At once, and not after half a minute of work. Raises `ConfigError`."""
    further = {
        "--out": arguments.out,
        "--plot": arguments.plot,
        "--all-degrees": arguments.all_degrees,
        "--second-opinion": arguments.second_opinion,
    }
    if arguments.verify is not None and (given := [option for option, value in further.items() if value]):
        raise ConfigError(f"--verify: it only verifies, leave out {' and '.join(given)}")
    if arguments.quick and arguments.all_degrees:
        raise ConfigError("--quick: it is the verdict alone, leave out --all-degrees")
    path = arguments.plot
    if path is not None and path.suffix.lower() not in PICTURES:
        raise ConfigError(f"{path}: cannot write the picture: call it FILE{', FILE'.join(PICTURES)}")
    if path is not None and not path.parent.is_dir():
        raise ConfigError(f"{path}: cannot write the picture: no such folder")


def _assess(stated: Problem, known: Assessment, arguments: Arguments, console: Console) -> Assessment:
    from companion.certify.assess import assess  # noqa: PLC0415

    columns = (TextColumn("{task.description:<38}"), BarColumn(), TimeElapsedColumn())
    with Progress(*columns, console=console, transient=True) as progress:
        task = progress.add_task("margin", total=1.0)
        return assess(
            stated,
            arguments.degree,
            arguments.all_degrees,
            True,
            lambda fraction, text: progress.update(task, completed=fraction, description=text),
            arguments.sectors,
            known,
        )


def _second_opinions(stated: Problem, console: Console) -> dict[str, Opinions]:
    from companion.certify.second_opinion import second_opinion  # noqa: PLC0415

    known: dict[AxisProblem, Opinions] = {}
    with console.status("second opinion"):
        for axis in stated.axes.values():
            if axis not in known:  # identical axes are asked about once
                known[axis] = second_opinion(axis)
    return {name: known[axis] for name, axis in stated.axes.items()}


def _row(opinions: Opinions) -> tuple[str, str]:
    both = " / ".join("none" if b is None else f"{b:.3f}" for b in (opinions.ours_rad_s, opinions.theirs_rad_s))
    return f"quadratic without delay, ours / {opinions.solver}", f"{both} rad/s"


def _verify(path: Path, stated: Problem, *, as_json: bool) -> int:
    """Verify a certificate file against the config, with the standard library alone."""
    certificate, reason = proof.load(path)
    if reason:
        raise ConfigError(reason)
    answer = proof.verify(certificate, statement(stated))
    if as_json:
        print(json.dumps({"verified": answer.ok, "reason": answer.reason}))
    else:
        print(answer.reason, file=sys.stdout if answer.ok else sys.stderr)
    return 0 if answer.ok else 1


def _write(certificate: Mapping[str, object] | None, path: Path) -> None:
    """The certificate, to `path`; nothing is written where there is none, and no stale one is left."""
    try:
        if certificate is not None:
            path.write_text(json.dumps(certificate, indent=1) + "\n", encoding="utf-8")
        else:
            path.unlink(missing_ok=True)
    except OSError as error:
        raise ConfigError(f"{path}: cannot write the certificate: {error.strerror}") from None


def _write_for_a_link(stated: Problem, assessment: Assessment, arguments: Arguments, console: Console) -> None:
    """Where the config has no delay, the certificate of one that a link may have, in place of that of none."""
    from companion.certify.certificate import certify_for_a_link, without_delay  # noqa: PLC0415

    axes = without_delay(stated)
    if not axes or arguments.out is None:
        return
    if arguments.quick:
        console.print("It covers no delay of a link: `companion run` wants the certificate written without --quick.")
        return
    largest = {name: each.value for name in axes if (each := assessment.axes[name].maximum_delay) is not None}
    with console.status("delay of the link"):
        found = certify_for_a_link(stated, largest, arguments.sectors)
    if found is None:
        console.print("It covers no delay of a link, and none can be certified: `companion run` will not take it.")
        return
    certificate, upper_s = found
    _write(certificate, arguments.out)
    console.print(
        f"It covers every constant delay of the link up to {1e3 * float(upper_s):g} ms, which flight watches."
    )


def _plot(stated: Problem, path: Path, console: Console) -> None:
    """The picture of the axis with the slower attitude loop."""
    from companion.certify.plot import delay_curves, plot_delay  # noqa: PLC0415

    name = min(stated.axes, key=lambda n: stated.axes[n].response.dynamics.bandwidth())
    axis = stated.axes[name]
    longest = max(Decimal("0.06"), 2 * axis.response.delay_s.upper)
    delays = [(longest * k / 6).quantize(Decimal("0.0001")) for k in range(7)]
    with Progress(console=console, transient=True) as progress:
        task = progress.add_task("delay curves", total=1.0)
        few = len(axis.response.dynamics.corners()) == 1
        curves = delay_curves(
            axis, delays, (0, 8, 16) if few else (0, 8), progress=lambda done: progress.update(task, completed=done)
        )
    try:
        plot_delay(axis, curves, path, f"{name} ({ANGLES.get(name, name)})")
    except (OSError, ValueError) as error:
        raise ConfigError(f"{path}: cannot write the picture: {error}") from None
