"""`--engage` as a table of what is seen and what is asked: the pilot ends it, and nothing is repeated once agreed."""

from pymavlink.dialects.v20 import development as mavlink

from companion.flight.readiness.engage import Engagement, Seen, plan
from companion.flight.vehicle_link.requests import Arm
from companion.mavlink.px4 import Mode, Result

ARM, SET_MODE = mavlink.MAV_CMD_COMPONENT_ARM_DISARM, mavlink.MAV_CMD_DO_SET_MODE
GROUND = Seen(Mode.POSITION, False, 0.0, 0.0)


class Vehicle:
    """Walks an engagement along; keeps (time, command, mode asked for)."""

    def __init__(self, *, can_fly: bool = True) -> None:
        self.engagement = Engagement(plan(can_fly=can_fly))
        self.asked: list[tuple[float, int, int]] = []
        self.failed: str | None = None

    def see(self, now_s: float, seen: Seen) -> None:
        request, failed = self.engagement.advance(now_s, seen)
        self.failed = self.failed or failed
        if request is not None:
            asked = (ARM, 0) if isinstance(request, Arm) else (SET_MODE, int(request.mode))
            self.asked.append((now_s, *asked))

    def accept(self, command: int) -> None:
        self.engagement.on_answer(command, Result.ACCEPTED)


def up_to_hover() -> Vehicle:
    vehicle = Vehicle()
    vehicle.see(0.0, GROUND)
    vehicle.accept(ARM)
    vehicle.see(1.0, GROUND._replace(armed=True))
    vehicle.accept(SET_MODE)
    vehicle.see(1.2, Seen(Mode.TAKEOFF, True, 0.5, 0.1))
    assert [(command, mode) for _, command, mode in vehicle.asked] == [(ARM, 0), (SET_MODE, Mode.TAKEOFF)]
    return vehicle


def test_the_whole_way() -> None:
    vehicle = up_to_hover()
    vehicle.see(5.0, Seen(Mode.HOLD, True, 0.1, 1.0))
    assert vehicle.asked[-1][1:] == (SET_MODE, Mode.OFFBOARD)
    vehicle.see(5.2, Seen(Mode.OFFBOARD, True, 0.1, 1.0))
    vehicle.see(60.0, Seen(Mode.HOLD, True, 0.1, 1.0))  # the end of the flight is none of its business
    assert vehicle.failed is None
    assert len(vehicle.asked) == 3


def test_a_rig_does_not_take_off() -> None:
    vehicle = Vehicle(can_fly=False)
    vehicle.see(0.0, GROUND)
    vehicle.see(0.1, GROUND._replace(armed=True))
    assert [(command, mode) for _, command, mode in vehicle.asked] == [(ARM, 0), (SET_MODE, Mode.OFFBOARD)]


def test_unanswered_requests_are_repeated_and_accepted_ones_are_not() -> None:
    vehicle = Vehicle()
    for k in range(20):
        vehicle.see(0.1 * k, GROUND)
    assert [round(at, 1) for at, *_ in vehicle.asked] == [0.0, 0.5, 1.0, 1.5]
    vehicle.accept(ARM)
    for k in range(20, 45):
        vehicle.see(0.1 * k, GROUND)
    assert len(vehicle.asked) == 4
    vehicle.see(5.1, GROUND)
    assert vehicle.failed == "arm within 5 s: accepted"


def test_a_refusal_is_told_by_its_last_answer() -> None:
    vehicle = Vehicle()
    vehicle.see(0.0, GROUND)
    vehicle.accept(ARM)
    vehicle.engagement.on_answer(ARM, Result.TEMPORARILY_REJECTED)
    vehicle.see(6.0, GROUND)
    assert vehicle.failed == "arm within 5 s: temporarily_rejected"


def test_a_pilot_who_takes_over_during_take_off_keeps_the_vehicle() -> None:
    vehicle = up_to_hover()
    vehicle.see(2.0, Seen(Mode.ALTITUDE, True, 0.5, 0.5))
    assert vehicle.failed == "hover: somebody chose another mode"
    assert len(vehicle.asked) == 2


def test_a_disarm_on_the_way_is_not_undone() -> None:
    vehicle = up_to_hover()
    vehicle.see(2.0, Seen(Mode.TAKEOFF, False, 0.0, 0.0))
    assert vehicle.failed == "hover: somebody disarmed it"
    assert len(vehicle.asked) == 2


def test_an_armed_vehicle_is_not_touched() -> None:
    vehicle = Vehicle()
    vehicle.see(0.0, Seen(Mode.POSITION, True, 1.0, 5.0))
    assert vehicle.failed is not None
    assert not vehicle.asked


def test_a_vehicle_that_reads_offboard_already_is_not_armed() -> None:
    """It does so after it has landed by itself: armed, it would fly on."""
    vehicle = Vehicle()
    vehicle.see(0.0, Seen(Mode.OFFBOARD, False, 0.0, 0.0))
    assert vehicle.failed is not None
    assert "choose another mode first" in vehicle.failed
    assert not vehicle.asked


def test_the_mode_in_which_it_began_is_an_override_once_it_has_left_it() -> None:
    """The sticks in the take-off put it back into POSITION; later the pilot parks it in Hold."""
    vehicle = up_to_hover()
    vehicle.see(2.0, Seen(Mode.POSITION, True, 1.0, 2.0))
    assert vehicle.failed == "hover: somebody chose another mode"
    assert len(vehicle.asked) == 2


def test_a_pilot_who_takes_it_back_while_offboard_is_asked_for_keeps_it() -> None:
    vehicle = up_to_hover()
    vehicle.see(5.0, Seen(Mode.HOLD, True, 0.1, 1.0))
    vehicle.engagement.on_answer(SET_MODE, Result.TEMPORARILY_REJECTED)
    vehicle.see(5.1, Seen(Mode.POSITION, True, 0.1, 1.0))
    assert vehicle.failed == "change to OFFBOARD: somebody chose another mode"
    assert len(vehicle.asked) == 3


def test_a_mode_chosen_while_it_armed_is_not_overruled() -> None:
    vehicle = Vehicle()
    vehicle.see(0.0, GROUND)
    vehicle.see(0.1, Seen(Mode.STABILIZED, True, 0.0, 0.0))
    assert vehicle.failed == "arm: somebody chose another mode"
    assert len(vehicle.asked) == 1


def test_the_mode_in_which_it_began_is_none_while_it_has_not_left_it() -> None:
    vehicle = Vehicle()
    vehicle.see(0.0, GROUND)
    vehicle.see(0.1, GROUND._replace(armed=True))
    vehicle.see(0.9, GROUND._replace(armed=True))
    assert vehicle.failed is None
    assert [command for _, command, _ in vehicle.asked] == [ARM, SET_MODE, SET_MODE]
