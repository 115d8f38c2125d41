"""Where OFFBOARD began, by evidence: PX4 says "in the air" of a vehicle on the ground that has thrust."""

import math

import pytest

from companion.flight.readiness.ground import Ground

HOVER = 0.49


def stood(*, takes_off: bool = False) -> Ground:
    """A vehicle that has been seen on the ground, at z = -0.2 m."""
    ground = Ground(flies=True, hover_thrust=HOVER, takes_off=takes_off)
    ground.on_report(1.0, landed=True, offboard=False)
    ground.on_height(-0.2)
    return ground


def flying(ground: Ground, at_s: float = 3.0, *, up_m: float = 2.0, thrust: float = HOVER) -> Ground:
    """The same, lifted off at `at_s`, and at its height."""
    ground.on_thrust(at_s, thrust, offboard=False)
    ground.on_report(at_s, landed=False, offboard=False)
    ground.on_height(-0.2 - up_m)
    return ground


def test_a_rig_has_no_ground() -> None:
    ground = Ground(flies=False, hover_thrust=HOVER)
    ground.on_report(1.0, landed=True, offboard=False)
    assert ground.told
    assert not ground.standing
    assert not ground.landed(9.0)
    assert ground.doubt(2.0, offboard=True) is None


def test_what_says_nothing_is_refused() -> None:
    ground = Ground(flies=True, hover_thrust=HOVER)
    assert not ground.told
    assert "does not tell" in str(ground.doubt(10.0, offboard=True))


def test_who_comes_to_a_vehicle_in_the_air_need_not_wait_but_thrust_must_agree() -> None:
    for thrust, doubt in ((None, "neither"), (0.12, "carries nothing"), (math.nan, "neither"), (0.45, None)):
        ground = Ground(flies=True, hover_thrust=HOVER)
        ground.on_report(0.01, landed=False, offboard=False)
        if thrust is not None:
            ground.on_thrust(0.01, thrust, offboard=False)
        found = ground.doubt(0.02, offboard=True)
        assert found is None if doubt is None else doubt in str(found)


def test_in_the_air_is_believed_after_a_while() -> None:
    ground = stood()
    assert ground.doubt(2.0, offboard=False)
    flying(ground, 3.0)
    assert ground.doubt(3.4, offboard=False)
    assert ground.doubt(3.5, offboard=True) is None
    ground.on_report(4.0, landed=False, offboard=True)
    assert ground.doubt(5.0, offboard=True) is None


def test_in_the_air_told_in_offboard_is_not_believed_however_long() -> None:
    ground = stood()
    for at_s in (2.0, 3.0, 10.0):
        ground.on_report(at_s, landed=False, offboard=True)
        ground.on_thrust(at_s, HOVER, offboard=True)
        assert ground.standing
        assert ground.doubt(at_s, offboard=True)


def test_told_a_moment_before_the_mode_is_not_believed_either() -> None:
    ground = flying(stood(), 2.0)
    assert ground.doubt(2.1, offboard=True)
    assert ground.doubt(9.0, offboard=True), "where OFFBOARD began does not change while it lasts"
    assert ground.doubt(9.1, offboard=False) is None, "another mode, in the air"
    assert ground.doubt(9.2, offboard=True) is None


@pytest.mark.parametrize(("up_m", "thrust"), [(0.1, HOVER), (-0.1, HOVER), (2.0, 0.12), (0.0, 0.12)])
def test_left_flying_on_the_ground_it_is_not_believed(up_m: float, thrust: float) -> None:
    """After OFFBOARD on the ground a real PX4 says so for ever: thrust 0.12, its height up to a metre off."""
    assert flying(stood(), up_m=up_m, thrust=thrust).doubt(60.0, offboard=True)


def test_below_where_it_stood_it_may_fly() -> None:
    assert flying(stood(), up_m=-5.0).doubt(60.0, offboard=True) is None


def test_a_reset_of_the_height_is_no_climb() -> None:
    ground = flying(stood(), up_m=0.1)
    ground.on_reset(-3.0)
    ground.on_height(-3.3)
    assert ground.doubt(9.0, offboard=True)


def test_taking_off_is_no_evidence_but_where_the_companion_asked_for_it() -> None:
    """PX4 says so 2.5 s before it has left the ground."""
    for takes_off in (False, True):
        ground = stood(takes_off=takes_off)
        ground.on_report(3.0, landed=False, offboard=False, taking_off=True)
        assert ground.standing is not takes_off


def test_no_thrust_where_it_stands_unless_it_is_to_take_off() -> None:
    for takes_off in (False, True):
        assert stood(takes_off=takes_off).idle is not takes_off


def test_who_lifts_off_and_switches_at_once_does_not_fall() -> None:
    """Until the vehicle says that it is in the air, what PX4 flies tells that it pushes off."""
    ground = stood()
    ground.on_thrust(1.5, 0.12, offboard=False)
    assert ground.idle
    ground.on_thrust(2.0, 0.5, offboard=False)
    assert ground.standing
    assert not ground.idle
    ground.on_thrust(2.1, 0.0, offboard=True)
    assert not ground.idle, "what we stream is no evidence"


def test_it_has_landed_when_it_has_said_so_for_a_while() -> None:
    ground = flying(stood())
    assert not ground.landed(3.0)
    ground.on_report(10.0, landed=True, offboard=True)
    assert not ground.landed(10.2), "disarmed in the air it says so too"
    assert ground.landed(10.31)
    ground.on_report(10.4, landed=False, offboard=True)
    assert not ground.landed(11.0)
