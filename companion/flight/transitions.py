"""Changes of authority: the transition function is asked, and the state that it names is entered."""

from __future__ import annotations

from typing import Final

from companion.control.types import Odometry
from companion.flight.authority import states as authority
from companion.flight.authority.states import Known, Reason, State
from companion.flight.guards import estimator
from companion.flight.guards import table as guards
from companion.flight.session import Session
from companion.flight.vehicle_link.port import CURRENT_MODE, HEARTBEAT
from companion.mavlink import px4
from companion.mavlink.codec import Frame
from companion.mavlink.px4 import Mode, mode_name

_CURRENT_MODE_S: Final = 2.0  # a vehicle that has not told by CURRENT_MODE what is intended by then does not know it
_RESETS_LIMIT: Final = 2.0  # of guards.estimator_jump_m, for all resets within a minute


class Changes:
    """Moves a flight from state to state.

    `warning`: why the flight is not certified; told to the ground station at stand-by.
    """

    def __init__(self, flight: Session, warning: str | None) -> None:
        self._flight = flight
        self._warning = warning
        self._checking_since_s = 0.0
        self._resets = estimator.Resets()
        self._told_intention = False

    def hear(self, frame: Frame) -> None:
        """A HEARTBEAT or CURRENT_MODE: the pilot's switch counts before the next sample does."""
        flight, port = self._flight, self._flight.port
        mode = port.mode
        if port.note(frame):
            flight.heartbeat_at_s = flight.now_s
        elif frame.message_id == CURRENT_MODE.message_id:
            self._told_intention = self._told_intention or port.intended_mode is not None
            if port.mode != mode:  # whether it is armed is told by the heartbeat alone, which may be a second old
                flight.send(px4.request_message(*flight.ids, HEARTBEAT.message_id))
        self.decide()

    def reseat(self, last: Odometry, sample: Odometry) -> None:
        """The estimator has counted a reset: go along with it, or end control where it is too large."""
        flight = self._flight
        jump = estimator.jump(last, sample)
        length_m, limit_m = estimator.length_m(jump), flight.limits[Reason.ESTIMATOR_JUMP]
        total_m = self._resets.add(sample.time_s, length_m)
        if length_m > limit_m:
            too_much = f"the estimator reset, {length_m:.2f} m, more than {limit_m:g} m"
        elif total_m > _RESETS_LIMIT * limit_m:
            too_much = (
                f"the estimator's resets within {estimator.RESETS_S:g} s add up to {total_m:.2f} m, "
                f"more than {_RESETS_LIMIT * limit_m:g} m"
            )
        else:
            flight.pilot.reseat(jump)
            flight.watch.reseat(jump)
            flight.event("reseated", f"the estimator reset, {length_m:.2f} m")
            return
        flight.refuse(Reason.ESTIMATOR_JUMP, too_much)
        self.decide()

    def restart(self) -> None:
        """From here on the clock is another one."""
        flight = self._flight
        flight.heartbeat_at_s = self._checking_since_s = flight.now_s
        flight.preflight.begin(flight.now_s)

    def decide(self) -> None:
        """Ask the transition function, and enter the state it names."""
        flight = self._flight
        if (flight.aloof is not False or flight.state is State.CHECKING) and flight.port.connected:
            self._look_whose()
        state, reason = authority.advance(flight.state, self._known())
        if state is flight.state:
            return
        if state is State.CHECKING:
            self._checking_since_s = flight.now_s
            flight.preflight.begin(flight.now_s)
        elif state is State.STANDBY:
            self._stand_by()
        elif state is State.ENGAGED and flight.sample is not None:
            flight.pilot.take_over(flight.sample, flight.preflight.hover_thrust)
            flight.watch.begin(flight.sample)
            flight.engaged = True
        flight.state = state
        if reason is not None:
            flight.reason = reason
            flight.detail = flight.detail if reason is flight.fault else ""
            return
        rate = flight.preflight.rate_hz
        detail = f"{flight.pose.message} at {rate:.0f} Hz" if rate else ""
        if flight.aloof:
            detail += f", hands off: {self._whose()}"
        flight.event(state.name.lower(), detail)
        flight.say(f"{state.name.lower()} {detail}".strip())

    def end(self, reason: Reason, detail: str) -> None:
        """Released from outside the transition function; the first reason stays."""
        flight = self._flight
        if flight.state is not State.RELEASED:
            flight.state, flight.reason, flight.detail = State.RELEASED, reason, detail

    def _known(self) -> Known:
        flight, port = self._flight, self._flight.port
        fault = flight.fault
        if fault is None and flight.state in (State.STANDBY, State.ENGAGED):
            now = flight.now_s
            fault = guards.stale(flight.limits, now - flight.pose_at_s, now - flight.heartbeat_at_s)
        return Known(
            port.connected,
            flight.preflight.passed and flight.aloof is not None,
            port.mode,
            port.armed,
            fault,
            authority.killed(port.mode, port.system_status),
            flight.aloof is not False,
        )

    def _look_whose(self) -> None:
        """Whether OFFBOARD is somebody else's, until it is certain at stand-by that it is not."""
        flight, port = self._flight, self._flight.port
        standby = flight.state is State.STANDBY
        before, intended = flight.aloof if standby else flight.aloof or None, port.intended_mode
        # A vehicle that does not tell what is intended: a failsafe looks like the pilot, unless the pilot has sticks.
        patience_s = _CURRENT_MODE_S + self._checking_since_s
        untold = not self._told_intention and flight.state is not State.CONNECTING and flight.now_s > patience_s
        if intended is None and untold and port.mode in authority.BY_STICKS:
            intended = port.mode
        flight.aloof = authority.hands_off(before, port.mode, intended, armed=port.armed)
        if flight.aloof is None and untold:
            flight.aloof = True
        if before and not flight.aloof and standby:
            flight.event("standby", "hands on: OFFBOARD is nobody's any more")
            flight.say("standby, no longer hands off")

    def _whose(self) -> str:
        """Why hands are off, for a person."""
        port = self._flight.port
        if port.intended_mode is None and port.mode != Mode.OFFBOARD:
            return "armed, and it does not tell whether OFFBOARD is intended; take the sticks or disarm first"
        return "OFFBOARD is flown or set already; choose another mode first"

    def _stand_by(self) -> None:
        flight = self._flight
        if flight.sample is not None:
            flight.ground_z_m = flight.sample.z_m
        flight.pose.settle()
        flight.pilot.believe_hover_thrust(flight.preflight.hover_thrust)
        if flight.preflight.stale is not None:
            flight.event("uncertified", flight.preflight.stale)
            flight.say(f"UNCERTIFIED FLIGHT: {flight.preflight.stale}")
        warning = self._warning or flight.preflight.stale
        if warning is not None:
            flight.tell(f"companion: UNCERTIFIED: {warning}")
        lines = [*flight.preflight.remarks(), *flight.blindness.settle(flight.told())]
        if (flown := flight.pilot.manoeuvre) is not None:
            lines.append(f"to be flown: {flown.doublets} doublets of {flown.amplitude_deg:g} degrees")
        for line in lines:
            flight.event("remark", line)
            flight.say(line)


def taken_by_failsafe(flight: Session) -> bool:
    """Whether OFFBOARD was taken by a failsafe of the vehicle's own: it is still what the vehicle was told to fly."""
    return flight.reason is Reason.MODE_CHANGED and flight.port.intended_mode == Mode.OFFBOARD


def ending(flight: Session) -> str:
    """How the flight ended, for a person."""
    if taken_by_failsafe(flight):
        return f"a failsafe of the vehicle took OFFBOARD away and flies {mode_name(flight.port.mode)}"
    if flight.reason is Reason.MODE_CHANGED and flight.port.intended_mode is not None:
        return f"the pilot chose {mode_name(flight.port.mode)}"
    return flight.detail or flight.watch.describe(flight.reason)
