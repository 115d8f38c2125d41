"""The transition function, as tables: the pilot comes before everything."""

import pytest
from pymavlink.dialects.v20 import development as mavlink

from companion.config.guards.declaration import Group
from companion.flight.authority.states import (
    ORDINARY,
    TAKEN,
    Known,
    Reason,
    State,
    advance,
    hands_off,
)
from companion.flight.vehicle_link.modes import BY_STICKS, killed
from companion.mavlink.px4 import Mode

OFFBOARD, HOLD, RETURN = int(Mode.OFFBOARD), int(Mode.HOLD), int(Mode.RETURN)
NOTHING = Known(connected=False, checked=False, offboard=False, armed=False, fault=None)
FLYING = Known(connected=True, checked=True, offboard=True, armed=True, fault=None)
KILLED = FLYING._replace(killed=True)


@pytest.mark.parametrize(
    ("state", "known", "expected", "reason"),
    [
        (State.CONNECTING, NOTHING, State.CONNECTING, None),
        (State.CONNECTING, FLYING, State.CHECKING, None),
        (State.CONNECTING, NOTHING._replace(fault=Reason.NO_VEHICLE), State.RELEASED, Reason.NO_VEHICLE),
        (State.CHECKING, FLYING._replace(checked=False), State.CHECKING, None),
        (State.CHECKING, FLYING, State.STANDBY, None),
        (State.CHECKING, FLYING._replace(hands_off=True), State.STANDBY, None),
        (State.CHECKING, FLYING._replace(fault=Reason.RATE_TOO_LOW), State.RELEASED, Reason.RATE_TOO_LOW),
        (State.STANDBY, FLYING._replace(armed=False), State.STANDBY, None),
        (State.STANDBY, FLYING._replace(offboard=False), State.STANDBY, None),
        (State.STANDBY, FLYING, State.ENGAGED, None),
        (State.STANDBY, KILLED, State.STANDBY, None),
        (State.STANDBY, FLYING._replace(hands_off=True), State.STANDBY, None),
        (State.STANDBY, FLYING._replace(on_ground=True), State.RELEASED, Reason.ON_GROUND),
        (State.STANDBY, FLYING._replace(on_ground=True, offboard=False), State.STANDBY, None),
        (State.STANDBY, FLYING._replace(on_ground=True, hands_off=True), State.STANDBY, None),
        (State.ENGAGED, FLYING._replace(on_ground=True), State.ENGAGED, None),
        (State.STANDBY, FLYING._replace(fault=Reason.POSE_STALE), State.RELEASED, Reason.POSE_STALE),
        (State.ENGAGED, FLYING, State.ENGAGED, None),
        (State.ENGAGED, FLYING._replace(offboard=False), State.RELEASED, Reason.MODE_CHANGED),
        (State.ENGAGED, FLYING._replace(armed=False), State.RELEASED, Reason.DISARMED),
        (State.ENGAGED, KILLED, State.RELEASED, Reason.KILLED),
        (State.ENGAGED, KILLED._replace(offboard=False, armed=False, fault=Reason.TILT), State.RELEASED, Reason.KILLED),
        (State.ENGAGED, FLYING._replace(fault=Reason.POSE_STALE), State.RELEASED, Reason.POSE_STALE),
        (State.ENGAGED, FLYING._replace(offboard=False, fault=Reason.POSE_STALE), State.RELEASED, Reason.MODE_CHANGED),
        (State.ENGAGED, FLYING._replace(armed=False, fault=Reason.OPERATOR), State.RELEASED, Reason.DISARMED),
        (State.RELEASED, FLYING, State.RELEASED, None),
        (State.RELEASED, FLYING._replace(fault=Reason.OPERATOR), State.RELEASED, None),
    ],
)
def test_transitions(state: State, known: Known, expected: State, reason: Reason | None) -> None:
    assert advance(state, known) == (expected, reason)


@pytest.mark.parametrize("fault", Reason)
def test_every_fault_ends_control_and_none_goes_before_the_pilot(fault: Reason) -> None:
    assert advance(State.ENGAGED, FLYING._replace(fault=fault)) == (State.RELEASED, fault)
    for pilot, reason in (({"offboard": False}, Reason.MODE_CHANGED), ({"armed": False}, Reason.DISARMED)):
        assert advance(State.ENGAGED, FLYING._replace(fault=fault, **pilot)) == (State.RELEASED, reason)


@pytest.mark.parametrize(
    ("before", "mode", "intended", "armed", "expected"),
    [
        (None, HOLD, HOLD, True, False),  # in another mode because it was told so: stream, and wait for the switch
        (None, HOLD, None, True, None),  # not told yet what it was told
        (None, HOLD, None, False, False),  # disarmed: nothing to disturb
        (None, OFFBOARD, OFFBOARD, False, True),  # landed by itself and disarmed: armed, it would fly on
        (None, OFFBOARD, None, False, True),
        (None, HOLD, OFFBOARD, False, True),
        (None, OFFBOARD, None, True, True),  # flown by somebody, perhaps ourselves before a restart
        (None, OFFBOARD, OFFBOARD, True, True),
        (None, RETURN, OFFBOARD, True, True),  # its failsafe flies; a stream would bring OFFBOARD back
        (True, RETURN, OFFBOARD, True, True),
        (True, RETURN, None, True, True),  # a heartbeat alone does not tell a failsafe from a pilot
        (True, RETURN, RETURN, True, False),
        (True, HOLD, HOLD, True, False),
        (True, OFFBOARD, OFFBOARD, False, True),
        (True, HOLD, HOLD, False, False),
        (True, HOLD, None, False, False),
        (False, OFFBOARD, OFFBOARD, True, False),  # the pilot's switch, after we were ready
    ],
)
def test_hands_off_what_flew_offboard_before_us(
    before: bool | None, mode: int, intended: int | None, armed: bool, expected: bool | None
) -> None:
    wanted = None if intended is None else intended == OFFBOARD
    assert hands_off(before, mode == OFFBOARD, wanted, armed=armed) is expected


def test_only_sticks_tell_a_pilot_from_a_failsafe() -> None:
    assert {Mode.MANUAL, Mode.STABILIZED, Mode.ACRO, Mode.ALTITUDE, Mode.POSITION} < BY_STICKS
    assert {Mode.ALTITUDE_CRUISE, Mode.POSITION_SLOW} < BY_STICKS
    assert not {Mode.OFFBOARD, Mode.HOLD, Mode.RETURN, Mode.LAND, Mode.EXTERNAL_1, Mode.ORBIT} & BY_STICKS


def test_kill_and_termination_show_in_the_system_status_or_the_mode() -> None:
    assert killed(OFFBOARD, mavlink.MAV_STATE_FLIGHT_TERMINATION)
    assert killed(int(Mode.TERMINATION), mavlink.MAV_STATE_ACTIVE)
    assert not killed(OFFBOARD, mavlink.MAV_STATE_ACTIVE)
    assert not killed(HOLD, mavlink.MAV_STATE_CRITICAL)


def test_every_reason_has_a_meaning_and_its_place() -> None:
    assert all(reason.meaning and "\n" not in reason.meaning for reason in Reason)
    assert {reason.group for reason in Reason} == set(Group)
    assert {Reason.MODE_CHANGED, Reason.DISARMED, Reason.KILLED} == TAKEN
    assert {Reason.MISSION_COMPLETE, Reason.OPERATOR, Reason.MODE_CHANGED, Reason.DISARMED} == ORDINARY
