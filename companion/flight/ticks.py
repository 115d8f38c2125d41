"""The hot path: one odometry sample to one set-point, then the record, then the guards.

What must be right before a set-point goes out is done here: finite numbers, order and clock of the samples, resets of
the estimator.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from companion.control.types import AttitudeSetpoint, Odometry
from companion.flight.authority.states import Reason, State
from companion.flight.guards import table as guards
from companion.flight.host.clock import LARGEST_STEP_S
from companion.flight.pilot.pilot import record_standby
from companion.flight.session import Session
from companion.flight.transitions import Changes
from companion.flight.vehicle_link.modes import Mode
from companion.record.recorder import TICK

_, _CHECKING, _STANDBY, _ENGAGED, _RELEASED = State  # on its class, looking up a member costs tenfold
_OFFBOARD: Final = int(Mode.OFFBOARD)
_LEVEL: Final = AttitudeSetpoint(1.0, 0.0, 0.0, 0.0, 0.0)


class Ticks:
    """Takes the samples of a flight, in order. In lockstep time is the samples' own, and every one is answered."""

    def __init__(self, flight: Session, changes: Changes, restart_housekeeping: Callable[[], None]) -> None:
        self._flight, self._changes, self._restart_housekeeping = flight, changes, restart_housekeeping
        self._link, self._pilot, self._pose, self._watch = flight.link, flight.pilot, flight.pose, flight.watch
        self._clock, self._freshness, self._backlog = flight.clock, flight.freshness, flight.backlog
        self._lockstep = flight.lockstep
        self._flies = flight.config.vehicle_kind.can_fly
        self._largest_step_s = min(flight.limits[Reason.CLOCK_JUMP], LARGEST_STEP_S)
        self._resets = 0  # of the estimator, as of the last sample
        self._held, self._sent_ms = _LEVEL, -1  # the last set-point, and the sample it answered

    def on_sample(self, sample: Odometry) -> None:
        """One sample of odometry: flown in control, answered by what is safe in stand-by."""
        flight = self._flight
        last = flight.sample
        engaged = flight.state is _ENGAGED
        if self._lockstep:
            self._clock.pass_time(sample.time_s, running=flight.ticks > 0)
        if not guards.valid_pose(sample):
            if engaged:
                self._stop_for(Reason.POSE_INVALID)
            return  # out of control it is only not counted: too many of them, and the rate is below the floor
        dt = 0.0 if last is None else sample.time_s - last.time_s
        if abs(dt) > self._largest_step_s:
            if engaged:
                self._stop_for(Reason.CLOCK_JUMP)
                return
            flight.preflight.restart()
            flight.settling.restart()
            flight.delay.restart()
            dt = 0.0
        elif dt <= 0.0 and last is not None:
            return  # a copy, or out of order: the newer one has been flown
        if self._lockstep:
            self._clock.move_to(sample.time_s)
            if last is None:  # from here on time is the odometry's
                self._restart_housekeeping()
                self._changes.restart()
        flight.sample = sample
        flight.ground.on_height(sample.z_m)
        old = self._backlog.waiting and flight.is_old(sample)
        if self._pose.reset_counter != self._resets:
            self._resets = self._pose.reset_counter
            flight.settling.restart()
            if last is not None:
                flight.ground.on_reset(sample.z_m - last.z_m)
            if engaged and last is not None:
                self._changes.reseat(last, sample)
                engaged = flight.state is _ENGAGED
        if engaged and not old:
            self._fly(sample, dt)
        elif engaged:
            self._pilot.step(sample, dt)  # the vehicle went through it, with what it was told last
        else:
            if flight.state is not _RELEASED:
                flight.settling.on_sample(sample, flight.missing_solutions)
            if flight.state is _CHECKING:
                flight.preflight.on_sample(sample.time_s)
            if (flight.state is _STANDBY and not flight.hands_off and not old) or (
                self._lockstep and flight.state is not _RELEASED
            ):
                self._stand_by(sample, dt)
        # The age of the pose, which is looked at before the next sample: an estimate that has stopped grows old.
        if not old and (last is None or sample[1] != last[1] or not self._repeats(last, sample)):
            self._freshness.on_pose(self._clock.now_s)

    def answer(self, sample: Odometry) -> None:
        """In lockstep, after the end: the plant's time stands until it is answered, by what it was told last.

        That is what PX4 flies too, for as long as it waits for a stream that has ended.
        """
        if self._sent_ms != _milliseconds(sample.time_s):
            self._record(record_standby(sample, 0.0, self._held, self._send(sample, self._held), _RELEASED))

    def _repeats(self, last: Odometry, sample: Odometry) -> bool:
        """Whether the estimate has stopped. A rig may rest, held by its friction."""
        if self._flies and self._flight.state is _ENGAGED and guards.frozen(last, sample, self._pilot.tracking_error_m):
            return True
        return guards.repeats(last, sample)

    def _fly(self, sample: Odometry, dt_s: float) -> None:
        """In control: the paper's step, then out with it, then the record, then the guards."""
        flight, pilot, watch = self._flight, self._pilot, self._watch
        setpoint = pilot.step(sample, dt_s)
        if not guards.all_finite(setpoint):
            self._stop_for(Reason.SETPOINT_INVALID)
            return
        latency_s = self._send(sample, setpoint)
        self._record(pilot.record(sample, dt_s, setpoint, latency_s, flight.state))
        if sample[0] >= watch.due_s:
            flight.delay.heard(sample.time_s, self._clock.now_s)
            reason = watch.look(sample, setpoint, pilot, flight.told(), self._freshness.poses)
            if reason is not None:
                self._stop_for(reason)
                return
        if pilot.mission_over:
            self._stop_for(pilot.ending)

    def _stop_for(self, fault: Reason) -> None:
        """End control now, before another sample of the same datagram is flown."""
        self._flight.refuse(fault)
        self._changes.decide()

    def _stand_by(self, sample: Odometry, dt_s: float) -> None:
        """Stream what is safe to be switched to: the attitude as it is, the thrust that carries it.

        No thrust only while the vehicle says that it stands on the ground, or is disarmed in another mode: armed is
        told once a second, OFFBOARD at once, and a vehicle in the air must not fall in between.
        """
        flight = self._flight
        grounded = flight.ground.idle or (not self._link.armed and self._link.mode != _OFFBOARD)
        flight.hovering.on_sample(sample, dt_s, offboard=self._link.mode == _OFFBOARD)
        self._pilot.believe_hovering(flight.hovering.thrust)
        thrust = 0.0 if grounded else self._pilot.standby_thrust
        setpoint = AttitudeSetpoint(sample.qw, sample.qx, sample.qy, sample.qz, thrust)
        latency_s = self._send(sample, setpoint)
        self._record(record_standby(sample, dt_s, setpoint, latency_s, flight.state))

    def _send(self, sample: Odometry, setpoint: AttitudeSetpoint) -> float:
        """Out with the set-point; how long after its odometry came in."""
        self._flight.streamed = True
        self._held, self._sent_ms = setpoint, _milliseconds(sample[0])
        self._link.send_setpoint(self._sent_ms, setpoint)
        return 0.0 if self._lockstep else self._clock.wall_s() - self._clock.now_s

    def _record(self, tick: bytes) -> None:
        flight = self._flight
        flight.ticks += 1
        flight.tick = tick
        flight.recorder.add(TICK, self._clock.stamp_us, tick)


def _milliseconds(time_s: float) -> int:
    """As `time_boot_ms` has it."""
    return round(time_s * 1e3) & 0xFFFFFFFF
