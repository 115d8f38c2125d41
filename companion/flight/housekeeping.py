"""Everything slow, ten times a second beside the loop: heartbeats, the check before stand-by, engagement, requests."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from pymavlink.dialects.v20 import development as mavlink

from companion.flight.authority.states import Reason, State
from companion.flight.host.runtime import Status
from companion.flight.host.service import Notifier
from companion.flight.readiness.engage import Engagement, Seen
from companion.flight.readiness.parameters import PARAM_VALUE
from companion.flight.session import Session
from companion.flight.vehicle_link.estimator_status import ESTIMATOR_STATUS
from companion.flight.vehicle_link.ground_station import GroundStation, system_status
from companion.flight.vehicle_link.link_delay import INTERVAL_S, TIMESYNC
from companion.mavlink import px4
from companion.mavlink.codec import Frame, decode_cold
from companion.mavlink.px4 import Mode

PERIOD_S: Final = 0.1
_HEARTBEAT_S: Final = 1.0
_CALL_S: Final = 0.2  # between heartbeats until the vehicle has answered
_FLUSH_S: Final = 0.25  # of the log: what a kill -9 loses


class Housekeeping:
    """Attribute: `due_s`, on the clock that `keep` is called with."""

    def __init__(
        self,
        flight: Session,
        engagement: Engagement | None,
        notifier: Notifier | None,
        on_status: Callable[[Status], None] | None,
    ) -> None:
        self._flight = flight
        self._notifier = notifier
        self._ground_station = GroundStation(one_axis=flight.config.vehicle_kind.one_axis)
        self._engagement = engagement
        self._met = False
        self._on_status = on_status
        self._heartbeat_s = self._flush_s = self._timesync_s = 0.0
        self.due_s = 0.0

    def restart(self) -> None:
        """From here on the clock is another one."""
        self.due_s = self._heartbeat_s = self._flush_s = self._timesync_s = 0.0

    def take(self, frame: Frame) -> None:
        """A frame of the vehicle that tells neither pose nor mode."""
        flight, number = self._flight, frame.message_id
        if number == TIMESYNC.message_id:
            flight.delay.answered(frame, flight.clock_s())
        elif number == ESTIMATOR_STATUS.message_id:
            flight.estimator.on_frame(frame, flight.clock_s())
        elif number == PARAM_VALUE:
            if flight.preflight.told(frame):
                self._parameter_changed()
        elif number == mavlink.MAVLINK_MSG_ID_COMMAND_ACK and self._engagement is not None:
            answer = decode_cold(frame)
            self._engagement.acknowledged(answer.command, answer.result)

    def keep(self, clock_s: float, wall_s: float) -> None:
        """What is due at `clock_s`."""
        flight = self._flight
        state, port = flight.state, flight.port
        self.due_s = clock_s + PERIOD_S
        if clock_s >= self._heartbeat_s:
            self._heartbeat_s = clock_s + (_HEARTBEAT_S if port.connected else _CALL_S)
            alarmed = state is State.ENGAGED and flight.watch.alarmed
            flight.send(px4.heartbeat(mavlink.MAV_STATE_CRITICAL if alarmed else system_status(state)))
        if state is State.CONNECTING:
            self._connect(wall_s)
        elif state is State.CHECKING:
            self._check()
        elif state is State.STANDBY and self._engagement is not None:
            self._engage(self._engagement)
        self._look_for_blindness(state)
        if port.rival is not None:
            self._meet(port.rival)
        if flight.sample is not None and state is not State.RELEASED and clock_s >= self._timesync_s:
            self._timesync_s = clock_s + INTERVAL_S
            flight.send(flight.delay.request(flight.clock_s()))
        if state is State.ENGAGED and flight.tick:
            for message in self._ground_station.messages(flight.tick):
                flight.send(message)
        if self._notifier is not None:
            self._notify(self._notifier, wall_s)
        if self._on_status is not None:
            pilot, rate = flight.pilot, flight.preflight.rate_hz
            self._on_status(Status(state, port.mode, port.armed, pilot.elapsed_s, rate, pilot.error_m))
        if clock_s >= self._flush_s:  # seldom: waking the writer costs as much as ten ticks
            self._flush_s = clock_s + _FLUSH_S
            flight.recorder.flush()

    def _look_for_blindness(self, state: State) -> None:
        """Forget what is too old, and tell or refuse where a guard has gone blind with it."""
        flight, now_s = self._flight, self._flight.clock_s()
        flight.blindness.forget(now_s)
        ready = state in (State.STANDBY, State.ENGAGED)
        for reason, text, ends_control in flight.blindness.look(flight.told(), now_s, ready=ready):
            flight.event("blind", text)
            flight.say(text)
            flight.tell(f"companion: {text}")
            if ends_control is not None:
                flight.refuse(reason, ends_control)

    def _parameter_changed(self) -> None:
        """Somebody has set what the certificate is for: never begin with it; in control it is too late but to tell."""
        flight = self._flight
        text = flight.preflight.stale or "the vehicle's parameters are again what the certificate is for"
        flight.event("parameter_changed", text)
        flight.say(text)
        flight.tell("companion: certificate stale" if flight.preflight.stale else "companion: certificate valid again")
        refused = flight.preflight.refused()
        if refused is not None and flight.state is State.STANDBY:
            flight.refuse(Reason.CERTIFICATE_STALE, refused)

    def _meet(self, rival: str) -> None:
        """Somebody else flies this vehicle: never begin; in control only tell, for to let go would make it theirs."""
        flight = self._flight
        if not self._met:
            self._met = True
            flight.event("second_companion", rival)
            flight.say(rival)
            flight.tell(f"companion: {rival}")
        if flight.state in (State.CHECKING, State.STANDBY):
            flight.refuse(Reason.SECOND_COMPANION, f"{rival}: stop it, or give one of them another vehicle")
        flight.port.rival = None

    def _notify(self, notifier: Notifier, wall_s: float) -> None:
        """Readiness is stand-by; the watchdog is fed by ticks once there are any to come."""
        flight = self._flight
        if flight.state in (State.STANDBY, State.ENGAGED):
            notifier.ready(flight.state.name.lower())
        else:
            notifier.status(flight.state.name.lower())
        notifier.feed(wall_s, flight.ticks, due=flight.state is State.ENGAGED)

    def _connect(self, wall_s: float) -> None:
        flight = self._flight
        patience_s = flight.config.link.connect_timeout_s
        if wall_s - flight.began_wall_s > patience_s:
            system, component = flight.ids
            doubt = flight.port.doubt()
            flight.refuse(
                Reason.NO_VEHICLE,
                f"no heartbeat of vehicle {system}/{component} within {patience_s:g} s: "
                "check the link and vehicle.system_id" + (f" ({doubt})" if doubt else ""),
            )

    def _check(self) -> None:
        flight = self._flight
        for request in flight.preflight.requests(flight.now_s, heard=flight.sample is not None):
            flight.send(request)
        refused = flight.preflight.refused()
        if refused is not None:
            flight.refuse(Reason.CERTIFICATE_STALE, refused)
        failed = flight.preflight.failed(flight.now_s)
        if failed is not None:
            flight.refuse(Reason.RATE_TOO_LOW, failed)

    def _engage(self, engagement: Engagement) -> None:
        flight, sample = self._flight, self._flight.sample
        on_ground = not flight.port.armed and flight.port.mode == Mode.OFFBOARD  # what the engagement itself refuses
        if flight.aloof and not on_ground:  # what flies OFFBOARD is not ours to engage, now or after it has landed
            self._engagement = None
            return
        if sample is None:
            return
        seen = Seen(flight.port.mode, flight.port.armed, flight.speed_m_s, flight.ground_z_m - sample.z_m)
        message, failed = engagement.advance(flight.now_s, seen)
        if message is not None:
            flight.send(message)
        if failed is not None:
            flight.refuse(Reason.ENGAGE_REFUSED, f"the vehicle did not {failed}")
