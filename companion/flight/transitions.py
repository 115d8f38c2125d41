"""Changes of authority: the transition function is asked, and the state that it names is entered."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final

from companion.control.types import Odometry
from companion.flight.authority import states as authority
from companion.flight.authority.states import Known, Reason, State
from companion.flight.guards import estimator
from companion.flight.session import Ending, Session, To
from companion.flight.vehicle_link.messages import FlownThrust, Heartbeat, LandedState, ModeReport
from companion.flight.vehicle_link.modes import BY_STICKS, Mode, mode_name
from companion.flight.vehicle_link.requests import TellHeartbeat

_CURRENT_MODE_S: Final = 2.0  # a vehicle that has not told by CURRENT_MODE what is intended by then does not know it


class Changes:
    """Moves a flight from state to state.

    `warning`: why the flight is not certified; told to the ground station at stand-by.
    """

    def __init__(self, flight: Session, warning: str | None) -> None:
        self._flight = flight
        self._warning = warning
        self._checking_since_s = 0.0
        self._told_intention = False
        self._asked_whether_armed = False

    @property
    def handlers(self) -> dict[type, Callable[[Any], None]]:
        """Of the records that tell the mode: the pilot's switch counts before the next sample does."""
        return {
            Heartbeat: self._on_heartbeat,
            ModeReport: self._on_mode_report,
            LandedState: self._on_landed_state,
            FlownThrust: self._on_flown_thrust,
        }

    def _on_landed_state(self, state: LandedState) -> None:
        flight = self._flight
        if flight.sample is not None:
            flight.plausible.on_landed_state(-flight.sample.z_m, landed=state.landed)
        offboard, now_s = flight.link.mode == Mode.OFFBOARD, flight.clock.now_s
        flight.ground.on_report(now_s, landed=state.landed, offboard=offboard, taking_off=state.taking_off)
        if flight.ground.standing and not offboard:
            flight.hovering.forget()
        if flight.state is State.ENGAGED and state.landed:
            if not self._asked_whether_armed:  # disarmed in the air it reads landed too, and that is another reason
                self._asked_whether_armed = True
                flight.link.request(TellHeartbeat())
            if flight.ground.landed(now_s):
                flight.refuse(Reason.LANDED, "the vehicle says that it has landed")
            self.decide()

    def _on_flown_thrust(self, flown: FlownThrust) -> None:
        flight = self._flight
        offboard = flight.link.mode == Mode.OFFBOARD
        flight.ground.on_thrust(flight.clock.now_s, flown.thrust, offboard=offboard)
        if flight.link.mode == Mode.TAKEOFF:  # pushed off, and climbing
            flight.hovering.forget()
        else:
            flight.hovering.on_thrust(flown.thrust, offboard=offboard)

    def _on_heartbeat(self, _: Heartbeat) -> None:
        self._flight.freshness.on_heartbeat(self._flight.clock.now_s)
        self.decide()

    def _on_mode_report(self, report: ModeReport) -> None:
        self._told_intention = self._told_intention or report.intended
        if report.changed:  # whether it is armed is told by the heartbeat alone, which may be a second old
            self._flight.link.request(TellHeartbeat())
        self.decide()

    def reseat(self, last: Odometry, sample: Odometry) -> None:
        """The estimator has counted a reset: go along with it, or end control where it is too large."""
        flight = self._flight
        jump = estimator.jump(last, sample)
        length_m, limit_m = estimator.length_m(jump), flight.limits[Reason.ESTIMATOR_JUMP]
        if length_m > limit_m:
            flight.refuse(Reason.ESTIMATOR_JUMP, f"the estimator reset, {length_m:.2f} m, more than {limit_m:g} m")
            self.decide()
            return
        flight.pilot.reseat(jump)
        flight.watch.reseat(jump, sample.time_s)
        flight.announce("reseated", f"the estimator reset, {length_m:.2f} m")

    def restart(self) -> None:
        """From here on the clock is another one."""
        flight = self._flight
        now_s = self._checking_since_s = flight.clock.now_s
        flight.freshness.on_heartbeat(now_s)
        flight.ground.restart()
        flight.preflight.begin(now_s)

    def decide(self) -> None:
        """Ask the transition function, and enter the state it names."""
        flight = self._flight
        if (flight.hands_off is not False or flight.state is State.CHECKING) and flight.link.connected:
            self._look_whose()
        state, reason = authority.advance(flight.state, self._known())
        if state is flight.state:
            return
        if state is State.CHECKING:
            self._checking_since_s = flight.clock.now_s
            flight.preflight.begin(flight.clock.now_s)
        elif state is State.STANDBY:
            self._stand_by()
        elif state is State.ENGAGED and flight.sample is not None:
            flight.pilot.take_over(flight.sample)
            flight.watch.begin(flight.sample)
            flight.engaged = True
        flight.state = state
        if reason is not None:
            fault = flight.fault
            flight.ending = fault if fault is not None and fault.reason is reason else Ending(reason)
            if reason is Reason.ON_GROUND:
                flight.ending = Ending(reason, f"{reason.meaning}; {self._doubt()}")
            return
        rate = flight.preflight.rate_hz
        detail = f"{flight.pose.message} at {rate:.0f} Hz" if rate else ""
        if flight.hands_off:
            detail += f", hands off: {self._whose()}"
        name = state.name.lower()
        flight.announce(name, detail, To.LOG | To.PERSON, line=f"{name} {detail}".strip())

    def end(self, reason: Reason, detail: str) -> None:
        """Released from outside the transition function; the first reason stays."""
        flight = self._flight
        if flight.state is not State.RELEASED:
            flight.state, flight.ending = State.RELEASED, Ending(reason, detail)

    def _known(self) -> Known:
        flight, link = self._flight, self._flight.link
        fault = None if flight.fault is None else flight.fault.reason
        if fault is None and flight.state in (State.STANDBY, State.ENGAGED):
            # Disarmed in stand-by nothing is flown by the pose. Once armed, its age counts before control begins.
            grounded = flight.state is State.STANDBY and not link.armed
            fault = flight.freshness.stale(flight.clock.now_s, grounded=grounded)
        offboard = link.mode == Mode.OFFBOARD
        if flight.state is State.STANDBY and flight.backlog.waiting:
            offboard = False  # said a while ago: what has become of it meanwhile comes later in the queue
        return Known(
            link.connected,
            flight.preflight.passed and flight.settling.settled and flight.hands_off is not None,
            offboard,
            link.armed,
            fault,
            link.killed,
            flight.hands_off is not False,
            self._doubt() is not None,
        )

    def _doubt(self) -> str | None:
        flight = self._flight
        return flight.ground.doubt(flight.clock.now_s, offboard=flight.link.mode == Mode.OFFBOARD)

    def _look_whose(self) -> None:
        """Whether OFFBOARD is somebody else's, until it is certain at stand-by that it is not."""
        flight, link = self._flight, self._flight.link
        standby = flight.state is State.STANDBY
        before, intended = flight.hands_off if standby else flight.hands_off or None, link.intended_mode
        # A vehicle that does not tell what is intended: a failsafe looks like the pilot, unless the pilot has sticks.
        patience_s = _CURRENT_MODE_S + self._checking_since_s
        untold = not self._told_intention and flight.state is not State.CONNECTING and flight.clock.now_s > patience_s
        if intended is None and untold and link.mode in BY_STICKS:
            intended = link.mode
        wanted = None if intended is None else intended == Mode.OFFBOARD
        flight.hands_off = authority.hands_off(before, link.mode == Mode.OFFBOARD, wanted, armed=link.armed)
        if flight.hands_off is None and untold:
            flight.hands_off = True
        if before and not flight.hands_off and standby:
            text = "hands on: OFFBOARD is nobody's any more"
            flight.announce("standby", text, To.LOG | To.PERSON, line="standby, no longer hands off")

    def _whose(self) -> str:
        """Why hands are off, for a person."""
        link = self._flight.link
        if link.intended_mode is None and link.mode != Mode.OFFBOARD:
            return "armed, and it does not tell whether OFFBOARD is intended; take the sticks or disarm first"
        return "OFFBOARD is flown or set already; choose another mode first"

    def _stand_by(self) -> None:
        flight = self._flight
        if flight.sample is not None:
            flight.ground_z_m = flight.sample.z_m
        flight.pose.settle()
        flight.pilot.believe_hover_thrust(flight.preflight.pinned.hover_thrust)
        pinned = flight.preflight.pinned
        if pinned.stale is not None:
            stale = pinned.stale
            flight.announce("uncertified", stale, To.LOG | To.PERSON, line=f"UNCERTIFIED FLIGHT: {stale}")
        warning = self._warning or pinned.stale
        if warning is not None:
            flight.announce("uncertified", f"UNCERTIFIED: {warning}", To.GROUND_STATION)
        lines = [*pinned.remarks(), *flight.blindness.settle(flight.told())]
        if not flight.ground.told:
            lines.append("the vehicle does not tell whether it is in the air: control does not begin before it does")
        if (flown := flight.pilot.manoeuvre) is not None:
            lines.append(f"to be flown: {flown.doublets} doublets of {flown.amplitude_deg:g} degrees")
        for line in lines:
            flight.announce("remark", line, To.LOG | To.PERSON)


def taken_by_failsafe(flight: Session) -> bool:
    """Whether OFFBOARD was taken by a failsafe of the vehicle's own: it is still what the vehicle was told to fly."""
    return flight.ending.reason is Reason.MODE_CHANGED and flight.link.intended_mode == Mode.OFFBOARD


def describe_ending(flight: Session) -> str:
    """How the flight ended, for a person."""
    if taken_by_failsafe(flight):
        return f"a failsafe of the vehicle took OFFBOARD away and flies {mode_name(flight.link.mode)}"
    if flight.ending.reason is Reason.MODE_CHANGED and flight.link.intended_mode is not None:
        return f"the pilot chose {mode_name(flight.link.mode)}"
    return flight.ending.detail or flight.watch.describe(flight.ending.reason)
