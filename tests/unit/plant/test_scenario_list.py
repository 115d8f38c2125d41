"""The list of scenarios covers what it must, and the verdict finds what does not hold."""

import inspect
import re
from pathlib import Path

import numpy as np
import pytest

from companion.commands.scenarios import report
from companion.config import load_config
from companion.config.guards.rows import GUARDS
from companion.flight.authority.states import Reason, State
from companion.flight.host.runtime import Summary
from companion.record.reader import Event, Flight, tick_dtype
from sitl.autopilot.modes import FlightMode
from sitl.scenarios import actors, faults, lies
from sitl.scenarios.index import ALL, by_name, pick
from sitl.scenarios.observer import Account, Change
from sitl.scenarios.scenario import QUADROTOR, Flown, Scenario
from sitl.scenarios.verdict import problems, worst_error_m

CONFIGS = Path(__file__).resolve().parents[3] / "config"
# No fault of vehicle, link or actors makes these: tests of the flight process do.
ELSEWHERE = {Reason.SETPOINT_INVALID, Reason.INTERNAL_ERROR, Reason.IMPLAUSIBLE}


def test_there_are_enough_of_them_with_names_of_their_own() -> None:
    assert len(ALL) >= 40
    assert len({scenario.name for scenario in ALL}) == len(ALL)
    assert all(scenario.name.isidentifier() and "\n" not in scenario.about for scenario in ALL)


def test_every_reason_to_end_control_is_covered() -> None:
    assert {scenario.reason for scenario in ALL} | ELSEWHERE == set(Reason)


def test_every_fault_of_the_vocabulary_is_used() -> None:
    used = {type(what) for scenario in ALL for what in (*scenario.before, *(w for _, w in scenario.happens))}
    vocabulary = {
        kind
        for module in (faults, actors, lies)
        for _, kind in inspect.getmembers(module, inspect.isclass)
        if kind.__module__ == module.__name__
    }
    assert used == vocabulary


@pytest.mark.parametrize("scenario", ALL, ids=[scenario.name for scenario in ALL])
def test_its_config_is_valid(scenario: Scenario) -> None:
    config = load_config(CONFIGS / scenario.base, scenario.overrides)
    assert config.plant is not None
    assert config.mission.duration_s is not None or config.mission.identification is not None, "it must end"


def test_what_safety_md_calls_shown_is_shown_by_a_scenario() -> None:
    page = (CONFIGS.parent / "docs" / "safety.md").read_text(encoding="utf-8")
    rows = [line.split("|")[1:-1] for line in page.splitlines() if line.startswith("|")]
    shown = [name for row in rows if len(row) == 4 for name in re.findall(r"`(\w+)`", row[3])]
    assert len(shown) > 25
    assert set(shown) <= {scenario.name for scenario in ALL}
    guards = {name for row in rows if len(row) == 4 for name in re.findall(r"`(\w+)`", row[1])}
    assert {guard.key for guard in GUARDS.values() if guard.row.certified} <= guards


def test_picking_by_pattern_keeps_the_order_of_the_list() -> None:
    assert pick([]) == [scenario.name for scenario in ALL]
    assert pick(["wind", "free_flight"]) == ["free_flight", "wind"]
    assert set(pick(["link_*"])) == {s.name for s in ALL if s.name.startswith("link_")}
    with pytest.raises(KeyError, match="nosuch"):
        pick(["wind", "nosuch*"])


# --- the verdict ------------------------------------------------------------------------------------------------------

SCENARIO = Scenario("one", "a flight", Reason.FENCE, stays_within_m=1.0, margin_m=1.0, error_m=0.5, by_s=4.0)
SUMMARY = Summary(Reason.FENCE, "left the fence", True, 3.0, 500)
SEEN = Account(1.5, 500, 0, 0.3, 0.6, 0.4, 0.8, 1.5, [Change(0.0, FlightMode.HOLD, True)])
CONFIG = load_config(CONFIGS / QUADROTOR)


def flight(error_m: float = 0.1) -> Flight:
    ticks = np.zeros(3, dtype=tick_dtype())
    ticks["state"] = State.ENGAGED
    ticks["position_m"][1, 0] = error_m
    return Flight(ticks, [Event(0.0, "engaged", "")])


def judged(
    scenario: Scenario = SCENARIO,
    summary: Summary = SUMMARY,
    seen: Account = SEEN,
    asked: tuple[FlightMode, ...] = (),
    error_m: float = 0.1,
) -> list[str]:
    return problems(scenario, CONFIG, summary, flight(error_m), seen, list(asked))


def test_what_holds_passes() -> None:
    assert judged() == []


@pytest.mark.parametrize(
    ("changed", "complaint"),
    [
        ({"summary": SUMMARY._replace(reason=Reason.OPERATOR)}, "ended for operator"),
        ({"summary": SUMMARY._replace(engaged=False)}, "control never began"),
        ({"summary": SUMMARY._replace(engaged_s=5.0)}, "not by 4"),
        ({"scenario": SCENARIO._replace(happens=((3.5, actors.OperatorStops()),))}, "before anything happened at 3.5"),
        ({"scenario": SCENARIO._replace(events=("reseated",))}, "no event reseated"),
        ({"asked": (FlightMode.OFFBOARD,)}, "asked for OFFBOARD"),
        (
            {
                "scenario": SCENARIO._replace(reason=Reason.MODE_CHANGED),
                "summary": SUMMARY._replace(reason=Reason.MODE_CHANGED),
                "asked": (FlightMode.HOLD,),
            },
            "asked for HOLD although control was taken",
        ),
        ({"seen": SEEN._replace(invalid_setpoints=1)}, "not finite"),
        ({"seen": SEEN._replace(thrust_most=0.95)}, "outside the limits"),
        ({"seen": SEEN._replace(largest_step_deg=1.01)}, "stepped by 1.01"),
        ({"seen": SEEN._replace(setpoints=0)}, "no set-point came"),
        ({"scenario": SCENARIO._replace(streams=False)}, "500 set-points came"),
        ({"seen": SEEN._replace(in_control_m=1.1)}, "1.10 m away in control"),
        ({"seen": SEEN._replace(in_control_m=float("nan"))}, "away in control"),
        ({"seen": SEEN._replace(farthest_m=2.1)}, "2.10 m away in all"),
        ({"seen": SEEN._replace(changes=[Change(0.0, FlightMode.RTL, True)])}, "ended in RTL"),
        ({"seen": SEEN._replace(changes=[Change(0.0, FlightMode.HOLD, False)])}, "ended disarmed"),
        ({"error_m": 0.6}, "worst error 0.60 m"),
    ],
)
def test_what_does_not_hold_is_named(changed: dict, complaint: str) -> None:
    (found,) = judged(**changed)
    assert complaint in found


def test_worst_error_counts_height_and_is_none_without_control() -> None:
    one = flight(0.3)
    one.ticks["position_ned_m"][1, 2] = 0.4
    assert worst_error_m(CONFIG, one) == pytest.approx(0.5)
    one.ticks["state"] = State.STANDBY
    assert worst_error_m(CONFIG, one) is None


def test_report_has_the_shape_of_the_contract() -> None:
    content = report([Flown("a", "fence", "fence", 0.25, (), 1.0), Flown("b", "tilt", "fence", None, ("no",), 1.0)])
    assert content == {
        "passed": 1,
        "failed": 1,
        "scenarios": [
            {"name": "a", "passed": True, "reason": "fence", "worst_error_m": 0.25},
            {"name": "b", "passed": False, "reason": "fence", "worst_error_m": None},
        ],
    }
    assert by_name("wind").name == "wind"
