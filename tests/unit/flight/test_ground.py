"""Where OFFBOARD began, by the vehicle's own word: PX4 says "in the air" of a vehicle on the ground that has thrust."""

from companion.flight.readiness.ground import Ground


def test_what_says_nothing_is_not_refused() -> None:
    ground = Ground(flies=True)
    assert not ground.told
    assert not ground.began_on(10.0, offboard=True)


def test_a_rig_has_no_ground() -> None:
    ground = Ground(flies=False)
    ground.on_report(1.0, landed=True, offboard=False)
    assert ground.told
    assert not ground.standing
    assert not ground.began_on(2.0, offboard=True)


def test_who_comes_to_a_vehicle_in_the_air_need_not_wait() -> None:
    ground = Ground(flies=True)
    ground.on_report(0.01, landed=False, offboard=False)
    assert not ground.began_on(0.02, offboard=True)


def test_in_the_air_is_believed_after_a_while() -> None:
    ground = Ground(flies=True)
    ground.on_report(1.0, landed=True, offboard=False)
    assert ground.began_on(2.0, offboard=False)
    ground.on_report(3.0, landed=False, offboard=False)
    assert ground.began_on(3.4, offboard=False)
    assert not ground.began_on(3.5, offboard=True)
    ground.on_report(4.0, landed=False, offboard=True)
    assert not ground.began_on(5.0, offboard=True)


def test_in_the_air_told_in_offboard_is_not_believed_however_long() -> None:
    ground = Ground(flies=True)
    ground.on_report(1.0, landed=True, offboard=False)
    for at_s in (2.0, 3.0, 10.0):
        ground.on_report(at_s, landed=False, offboard=True)
        assert ground.standing
        assert ground.began_on(at_s, offboard=True)


def test_told_a_moment_before_the_mode_is_not_believed_either() -> None:
    ground = Ground(flies=True)
    ground.on_report(1.0, landed=True, offboard=False)
    ground.on_report(2.0, landed=False, offboard=False)
    assert ground.began_on(2.1, offboard=True)
    assert ground.began_on(9.0, offboard=True), "where OFFBOARD began does not change while it lasts"
    assert not ground.began_on(9.1, offboard=False), "another mode, in the air"
    assert not ground.began_on(9.2, offboard=True)


def test_no_thrust_where_it_stands_unless_it_is_to_take_off() -> None:
    for takes_off in (False, True):
        ground = Ground(flies=True, takes_off=takes_off)
        ground.on_report(1.0, landed=True, offboard=False)
        assert ground.standing
        assert ground.idle is not takes_off
