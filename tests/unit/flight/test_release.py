"""The hand-over as a table: when the mode is asked for, by what the vehicle says meanwhile."""

import itertools
from types import SimpleNamespace

import pytest

from companion.flight.release import LISTEN_S, HandOver
from companion.flight.vehicle_link.requests import SetMode, TellHeartbeat
from companion.mavlink.px4 import Mode, Result

BEGUN_S = 100.0


def asked_at(
    reports_at: list[float], accepted_at: float = 9.0, mode_at: float = 9.0, *, answers: bool = False
) -> list[float]:
    """Seconds after the beginning at which Hold is asked for.

    `mode_at`: a pilot's POSITION is reported from then; `answers`: a heartbeat comes when it is asked for.
    """
    link = SimpleNamespace(mode=int(Mode.OFFBOARD), mode_reports=7)
    hand_over = HandOver(link, Mode.HOLD, BEGUN_S)  # type: ignore[arg-type]
    asked = []
    for k in range(200):
        now_s = 0.01 * k
        link.mode_reports = 7 + sum(at <= now_s for at in reports_at)
        if now_s >= mode_at:
            link.mode = int(Mode.POSITION)
        if now_s >= accepted_at:
            hand_over.on_answer(Result.ACCEPTED)
        if hand_over.over(BEGUN_S + now_s):
            break
        request = hand_over.advance(BEGUN_S + now_s)
        if isinstance(request, TellHeartbeat) and answers:
            reports_at = [*reports_at, now_s + 0.02]
        if isinstance(request, SetMode):
            asked.append(round(now_s, 2))
    return asked


def test_a_report_since_the_release_began_is_waited_for() -> None:
    """A heartbeat alone tells the mode once a second: the pilot may have switched 0.9 s ago."""
    assert asked_at([0.6], accepted_at=0.7) == [0.6]
    assert asked_at([0.6], mode_at=0.6) == []


def test_where_the_mode_is_told_often_it_is_asked_for_after_a_moment() -> None:
    often = [0.05 * k for k in range(1, 40)]
    assert asked_at(often, accepted_at=0.2) == [pytest.approx(LISTEN_S, abs=0.011)]
    assert len(asked_at(often)) > 3  # not accepted: again and again


def test_a_vehicle_that_says_nothing_is_asked_once_and_blindly() -> None:
    assert asked_at([]) == [pytest.approx(1.2, abs=0.011)]


def test_where_the_mode_comes_twice_a_second_nobody_waits_for_it() -> None:
    """CURRENT_MODE of a real PX4 while it stays: Hold was asked for up to 0.5 s late."""
    seldom = [0.45, 0.95, 1.45, 1.95]
    asked = asked_at(seldom, answers=True)
    assert asked[0] == pytest.approx(LISTEN_S, abs=0.011)
    assert max(b - a for a, b in itertools.pairwise(asked)) < 0.27
    assert asked_at(seldom, answers=True, mode_at=0.05) == []
