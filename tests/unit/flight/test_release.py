"""The hand-over as a table: when the mode is asked for, by what the vehicle says meanwhile."""

from types import SimpleNamespace

import pytest

from companion.flight.release import LISTEN_S, HandOver
from companion.mavlink.px4 import Mode, Result

BEGUN_S = 100.0


def asked_at(reports_at: list[float], accepted_at: float = 9.0, mode_at: float = 9.0) -> list[float]:
    """Seconds after the beginning at which Hold is asked for. `mode_at`: a pilot's POSITION is reported from then."""
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
        if hand_over.advance(BEGUN_S + now_s) is not None:
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
