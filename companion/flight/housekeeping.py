"""Everything slow, ten times a second beside the loop: heartbeats, the check before stand-by, engagement, requests."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final

from companion.flight.authority.states import Reason, State
from companion.flight.guards.settling import PATIENCE_S
from companion.flight.host.runtime import Status
from companion.flight.host.service import Notifier
from companion.flight.readiness.engage import Engagement, Seen
from companion.flight.session import Session, To
from companion.flight.vehicle_link.link_delay import INTERVAL_S
from companion.flight.vehicle_link.messages import Answer, EstimatorStatus, Firmware, Parameter
from companion.flight.vehicle_link.modes import Mode

PERIOD_S: Final = 0.1
_HEARTBEAT_S: Final = 1.0
_CALL_S: Final = 0.2  # between heartbeats until the vehicle has answered
_FLUSH_S: Final = 0.25  # of the log: what a kill -9 loses
_CLOCK_OFF: Final = 0.03  # share by which the vehicle's clock may differ from ours; a simulated PX4's is 2 % slow
_CLOCK_OFF_S: Final = 3.0  # for so long, before somebody is told


class Housekeeping:
    """Attribute: `due_s`, on the clock that `run_due` is called with."""

    def __init__(
        self,
        flight: Session,
        engagement: Engagement | None,
        notifier: Notifier | None,
        on_status: Callable[[Status], None] | None,
    ) -> None:
        self._flight = flight
        self._notifier = notifier
        self._engagement = engagement
        self._rival_told = self._clock_told = self._pose_told = False
        self._unsettled_since_s: float | None = None
        self._clock_off_s: float | None = None  # since when
        self._on_status = on_status
        self._heartbeat_s = self._flush_s = self._timesync_s = 0.0
        self.due_s = 0.0

    def restart(self) -> None:
        """From here on the clock is another one."""
        self.due_s = self._heartbeat_s = self._flush_s = self._timesync_s = 0.0

    @property
    def handlers(self) -> dict[type, Callable[[Any], None]]:
        """Of the records that can wait until the set-point is out."""
        return {
            EstimatorStatus: self._on_estimator_status,
            Parameter: self._on_parameter,
            Firmware: self._on_firmware,
            Answer: self._on_answer,
        }

    def _on_estimator_status(self, status: EstimatorStatus) -> None:
        self._flight.estimator.on_status(status.flags, self._flight.clock.elapsed_s())

    def _on_firmware(self, firmware: Firmware) -> None:
        self._flight.preflight.pinned.on_firmware(firmware.version)

    def _on_parameter(self, parameter: Parameter) -> None:
        self._flight.plausible.on_parameter(parameter)
        if self._flight.preflight.pinned.on_parameter(parameter):
            self._parameter_changed()

    def _on_answer(self, answer: Answer) -> None:
        if self._engagement is not None:
            self._engagement.on_answer(answer.command, answer.result)

    def run_due(self, clock_s: float, wall_s: float) -> None:
        """What is due at `clock_s`."""
        flight = self._flight
        state, link = flight.state, flight.link
        self.due_s = clock_s + PERIOD_S
        if clock_s >= self._heartbeat_s:
            self._heartbeat_s = clock_s + (_HEARTBEAT_S if link.connected else _CALL_S)
            alarmed = state is State.ENGAGED and flight.watch.alarmed
            link.send_heartbeat(state, alarmed=alarmed)
        if state is State.CONNECTING:
            self._connect(wall_s)
        elif state is State.CHECKING:
            self._check()
        elif state is State.STANDBY and self._engagement is not None and not flight.backlog.waiting:
            self._engage(self._engagement)
        if flight.plausible.refused is not None and state in (State.CHECKING, State.STANDBY):
            flight.refuse(Reason.IMPLAUSIBLE, flight.plausible.refused)
        self._look_for_blindness(state)
        self._look_at_clock(clock_s)
        if state is State.STANDBY:
            self._look_at_pose()
        rival = link.rival()
        if rival is not None:
            self._meet(rival)
        if flight.sample is not None and state is not State.RELEASED and clock_s >= self._timesync_s:
            self._timesync_s = clock_s + INTERVAL_S
            link.measure_delay()
        if state is State.ENGAGED and flight.tick:
            link.send_values(flight.tick)
        if self._notifier is not None:
            self._notify(self._notifier, wall_s)
        if self._on_status is not None:
            pilot, rate = flight.pilot, flight.preflight.rate_hz
            self._on_status(Status(state, link.mode, link.armed, pilot.elapsed_s, rate, pilot.error_m))
        if clock_s >= self._flush_s:  # seldom: waking the writer costs as much as ten ticks
            self._flush_s = clock_s + _FLUSH_S
            flight.recorder.flush()

    def _look_for_blindness(self, state: State) -> None:
        """Forget what is too old, and tell or refuse where a guard has gone blind with it."""
        flight, now_s = self._flight, self._flight.clock.elapsed_s()
        flight.blindness.forget(now_s)
        ready = state in (State.STANDBY, State.ENGAGED)
        for reason, text, ends_control in flight.blindness.look(flight.told(), now_s, ready=ready):
            flight.announce("blind", text, To.EVERYBODY)
            if ends_control is not None:
                flight.refuse(reason, ends_control)

    def _look_at_clock(self, clock_s: float) -> None:
        """A clock that runs otherwise than ours is not jitter, and somebody should know, once."""
        rate = self._flight.delay.clock_rate
        if not abs(rate - 1.0) > _CLOCK_OFF:  # not a number is not known
            self._clock_off_s = None
            return
        self._clock_off_s = clock_s if self._clock_off_s is None else self._clock_off_s
        if clock_s - self._clock_off_s >= _CLOCK_OFF_S and not self._clock_told:
            self._clock_told = True
            text = f"the vehicle's clock runs at {rate:.2f} of ours"
            self._flight.announce("clock_rate", text, To.EVERYBODY)

    def _look_at_pose(self) -> None:
        """Disarmed, a pose that does not come is waited for."""
        flight = self._flight
        stale = not flight.link.armed and flight.freshness.pose_stale(flight.clock.now_s)
        if stale is not self._pose_told:
            self._pose_told = stale
            text = "no odometry any more: nothing is sent until it comes" if stale else "odometry comes again"
            flight.announce("pose_wait", text, To.LOG | To.PERSON)

    def _parameter_changed(self) -> None:
        """Somebody has set what the certificate is for: never begin with it; in control it is too late but to tell."""
        flight = self._flight
        stale = flight.preflight.pinned.stale
        text = stale or "the vehicle's parameters are again what the certificate is for"
        flight.announce("parameter_changed", text, To.LOG | To.PERSON)
        short = "certificate stale" if stale else "certificate valid again"
        flight.announce("parameter_changed", short, To.GROUND_STATION)
        refused = flight.preflight.refused()
        if refused is not None and flight.state is State.STANDBY:
            flight.refuse(Reason.CERTIFICATE_STALE, refused)

    def _meet(self, rival: str) -> None:
        """Somebody else flies this vehicle: never begin; in control only tell, for to let go would make it theirs."""
        flight = self._flight
        if not self._rival_told:
            self._rival_told = True
            flight.announce("second_companion", rival, To.EVERYBODY)
        if flight.state in (State.CHECKING, State.STANDBY):
            flight.refuse(Reason.SECOND_COMPANION, f"{rival}: stop it, or give one of them another vehicle")

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
        if wall_s - flight.clock.began_wall_s > patience_s:
            flight.refuse(Reason.NO_VEHICLE, flight.link.no_vehicle(patience_s))

    def _check(self) -> None:
        flight = self._flight
        now_s = flight.clock.now_s
        asked = flight.preflight.requests(now_s, heard=flight.sample is not None)
        for request in [*asked, *flight.plausible.requests(now_s)]:
            flight.link.request(request)
        refused = flight.preflight.refused()
        if refused is not None:
            flight.refuse(Reason.CERTIFICATE_STALE, refused)
        if flight.preflight.passed and not flight.settling.settled:
            self._wait_for_estimate()
        failed = flight.preflight.failed(flight.clock.now_s)
        if failed is not None:
            flight.refuse(Reason.RATE_TOO_LOW, failed)

    def _wait_for_estimate(self) -> None:
        flight, now_s = self._flight, self._flight.clock.now_s
        if self._unsettled_since_s is None:
            self._unsettled_since_s = now_s
            flight.announce("settling", "waiting for the estimate to settle", To.LOG | To.PERSON)
        elif now_s - self._unsettled_since_s > PATIENCE_S:
            flight.refuse(Reason.NOT_SETTLED)

    def _engage(self, engagement: Engagement) -> None:
        flight, sample = self._flight, self._flight.sample
        on_ground = not flight.link.armed and flight.link.mode == Mode.OFFBOARD  # what the engagement itself refuses
        if flight.hands_off and not on_ground:  # what flies OFFBOARD is not ours to engage, now or after it has landed
            self._engagement = None
            return
        if sample is None or (not flight.link.armed and flight.freshness.pose_stale(flight.clock.now_s)):
            return
        seen = Seen(
            flight.link.mode,
            flight.link.armed,
            flight.speed_m_s,
            flight.ground_z_m - sample.z_m,
            flight.settling.settled,
        )
        request, failed = engagement.advance(flight.clock.now_s, seen)
        if request is not None:
            flight.link.request(request)
        if failed is not None:
            flight.refuse(Reason.ENGAGE_REFUSED, f"the vehicle did not {failed}")
