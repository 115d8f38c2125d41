"""The transition function, as a table: the pilot comes before everything."""

import math

import pytest

from companion.config.guards import Guards, GuardSection
from companion.control.types import AttitudeSetpoint, Odometry
from companion.flight import guards
from companion.flight.authority import MEANING, TAKEN, Known, Reason, State, advance
from companion.mavlink.px4 import Mode

OFFBOARD, HOLD = int(Mode.OFFBOARD), int(Mode.HOLD)
NOTHING = Known(connected=False, checked=False, mode=0, armed=False, fault=None)
FLYING = Known(connected=True, checked=True, mode=OFFBOARD, armed=True, fault=None)


@pytest.mark.parametrize(
    ("state", "known", "expected", "reason"),
    [
        (State.CONNECTING, NOTHING, State.CONNECTING, None),
        (State.CONNECTING, FLYING, State.CHECKING, None),
        (State.CONNECTING, NOTHING._replace(fault=Reason.NO_VEHICLE), State.RELEASED, Reason.NO_VEHICLE),
        (State.CHECKING, FLYING._replace(checked=False), State.CHECKING, None),
        (State.CHECKING, FLYING, State.STANDBY, None),
        (State.CHECKING, FLYING._replace(fault=Reason.RATE_TOO_LOW), State.RELEASED, Reason.RATE_TOO_LOW),
        (State.STANDBY, FLYING._replace(armed=False), State.STANDBY, None),
        (State.STANDBY, FLYING._replace(mode=HOLD), State.STANDBY, None),
        (State.STANDBY, FLYING, State.ENGAGED, None),
        (State.STANDBY, FLYING._replace(fault=Reason.POSE_STALE), State.RELEASED, Reason.POSE_STALE),
        (State.ENGAGED, FLYING, State.ENGAGED, None),
        (State.ENGAGED, FLYING._replace(mode=HOLD), State.RELEASED, Reason.MODE_CHANGED),
        (State.ENGAGED, FLYING._replace(armed=False), State.RELEASED, Reason.DISARMED),
        (State.ENGAGED, FLYING._replace(fault=Reason.POSE_STALE), State.RELEASED, Reason.POSE_STALE),
        (State.ENGAGED, FLYING._replace(mode=HOLD, fault=Reason.POSE_STALE), State.RELEASED, Reason.MODE_CHANGED),
        (State.ENGAGED, FLYING._replace(armed=False, fault=Reason.OPERATOR), State.RELEASED, Reason.DISARMED),
        (State.RELEASED, FLYING, State.RELEASED, None),
    ],
)
def test_transitions(state: State, known: Known, expected: State, reason: Reason | None) -> None:
    assert advance(state, known) == (expected, reason)


def test_every_reason_has_a_meaning() -> None:
    assert set(MEANING) == set(Reason)
    assert {Reason.MODE_CHANGED, Reason.DISARMED} == TAKEN


def test_guards_have_limits_and_can_be_switched_off() -> None:
    on = guards.limits(Guards())
    assert guards.broken(on, 0.2, 2.9) is None
    assert guards.broken(on, 0.26, 0.0) is Reason.POSE_STALE
    assert guards.broken(on, 0.0, 3.1) is Reason.HEARTBEAT_LOST
    off = guards.limits(Guards(pose_age_s=GuardSection(enabled=False, limit=0.1)))
    assert guards.broken(off, 100.0, 0.0) is None


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("place", range(5))
def test_not_a_number_is_seen_in_every_place(bad: float, place: int) -> None:
    values = [0.5] * 5
    assert guards.all_finite(AttitudeSetpoint(*values))
    values[place] = bad
    assert not guards.all_finite(AttitudeSetpoint(*values))


@pytest.mark.parametrize("q", [(0.0, 0.0, 0.0, 0.0), (2.0, 0.0, 0.0, 0.0), (math.nan, 0.0, 0.0, 0.0)])
def test_a_pose_without_a_unit_quaternion_is_not_valid(q: tuple[float, float, float, float]) -> None:
    good = Odometry(1.0, 0.1, 0.2, -1.0, 0.0, 0.0, 0.0, 0.6, 0.0, 0.8, 0.0)
    assert guards.valid_pose(good)
    assert not guards.valid_pose(good._replace(qw=q[0], qx=q[1], qy=q[2], qz=q[3]))
    assert not guards.valid_pose(good._replace(vy_m_s=math.inf))
