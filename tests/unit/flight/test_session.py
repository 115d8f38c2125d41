"""Every attribute of a flight's session has one writer: where a number is from is read off one place."""

import ast
from collections import defaultdict
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from companion.config import load_config
from companion.flight.authority.states import Reason
from companion.flight.session import Ending, Session

ROOT = Path(__file__).resolve().parents[3]
FLIGHT = ROOT / "companion" / "flight"
NAMES = {"flight", "session"}  # what a session is called where it is used


def written(tree: ast.AST) -> list[str]:
    """Attributes of a session that are assigned: `flight.x = ...`, `self._flight.x += ...`."""
    targets: list[ast.expr] = []
    for node in ast.walk(tree):
        if isinstance(node, ast.Assign):
            targets += node.targets
        elif isinstance(node, ast.AugAssign | ast.AnnAssign):
            targets.append(node.target)
    flat = [part for t in targets for part in (t.elts if isinstance(t, ast.Tuple) else [t])]
    found = []
    for target in flat:
        if isinstance(target, ast.Attribute):
            owner = target.value
            name = owner.id if isinstance(owner, ast.Name) else getattr(owner, "attr", "")
            if name.lstrip("_") in NAMES:
                found.append(target.attr)
    return found


def test_each_attribute_is_written_by_one_file() -> None:
    writers: dict[str, set[str]] = defaultdict(set)
    for path in sorted(FLIGHT.rglob("*.py")):
        for attribute in written(ast.parse(path.read_text(encoding="utf-8"))):
            writers[attribute].add(path.name)
    assert writers, "nothing was found: the names have changed"
    assert {attribute: files for attribute, files in writers.items() if len(files) > 1} == {}


class Wire:
    stream = False
    name = "wire"

    def send(self, data: bytes) -> None: ...


def session(config: str = "antx_rig", *, bench: bool = False) -> Session:
    recorder: Any = SimpleNamespace(add=lambda *_: None)
    wire: Any = Wire()
    loaded = load_config(ROOT / "config" / f"{config}.yaml")
    return Session(loaded, wire, recorder, hedging=True, lockstep=True, bench=bench, print_line=lambda _: None)


def test_on_the_bench_there_is_no_ground_to_begin_on() -> None:
    for bench in (False, True):
        ground = session("px4_quadrotor", bench=bench).ground
        ground.on_report(1.0, landed=True, offboard=False)
        assert (ground.doubt(2.0, offboard=True) is None) is bench


def test_an_ending_carries_its_own_text_and_the_first_one_stays() -> None:
    flight = session()
    flight.refuse(Reason.RATE_TOO_LOW, "ODOMETRY at 3 Hz")
    flight.refuse(Reason.OPERATOR)
    assert flight.fault == Ending(Reason.RATE_TOO_LOW, "ODOMETRY at 3 Hz")
    stopped = session()
    stopped.refuse(Reason.OPERATOR)
    stopped.refuse(Reason.ENGAGE_REFUSED, "the vehicle did not arm")
    assert stopped.fault == Ending(Reason.OPERATOR, "")
