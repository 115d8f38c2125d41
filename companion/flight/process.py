"""The loop: one blocking thread that waits for odometry, steps the controller, sends, records the tick.

What must be right before a set-point goes out is done here; changes of authority are `changes`, what is slow is
`housekeeping`, the guards that may come after the set-point are `watch`.
"""

from __future__ import annotations

import contextlib
import math
import time
import traceback
from collections.abc import Callable

from companion.config.schema import Config
from companion.control.types import AttitudeSetpoint, Odometry
from companion.flight import guards
from companion.flight.authority import Reason, State
from companion.flight.changes import Changes, ending, taken_by_failsafe
from companion.flight.engage import Engagement, plan
from companion.flight.guests import Guests
from companion.flight.housekeeping import Housekeeping
from companion.flight.live import LiveCommands
from companion.flight.pilot import record_standby
from companion.flight.port import CURRENT_MODE, HEARTBEAT
from companion.flight.pose import ATTITUDE_QUATERNION, LOCAL_POSITION_NED, ODOMETRY
from companion.flight.release import let_go
from companion.flight.runtime import Status, Summary, quiet_memory, stop_signals
from companion.flight.service import Notifier
from companion.flight.shared import Flight
from companion.mavlink.codec import Frame
from companion.mavlink.link import Link, LinkError
from companion.mavlink.px4 import Mode
from companion.mavlink.sharing import Door
from companion.record.recorder import TICK, Recorder

_POSE = frozenset({ODOMETRY.message_id, ATTITUDE_QUATERNION.message_id, LOCAL_POSITION_NED.message_id})
_MODE = frozenset({HEARTBEAT.message_id, CURRENT_MODE.message_id})
_CONNECTING, _CHECKING, _STANDBY, _ENGAGED, _RELEASED = State  # on its class, looking up a member costs tenfold
_OFFBOARD = int(Mode.OFFBOARD)
_LOCKSTEP_SILENCE_S = 15.0
_LEVEL = AttitudeSetpoint(1.0, 0.0, 0.0, 0.0, 0.0)
_LARGEST_STEP_S = 1.0  # between two samples of one clock, where no guard says otherwise


class FlightProcess:
    """One flight: from the first heartbeat to a release with a named reason.

    `lockstep`: time is the odometry's own, and every sample is answered, so that a flight is a function of its inputs.
    `warning`: why no certificate covers it; `uncertified`: go on where the vehicle's gains are not the certified ones;
    `door`: where tools may come in and ask the vehicle.
    """

    def __init__(
        self,
        config: Config,
        link: Link,
        recorder: Recorder,
        *,
        hedging: bool | None = None,
        engage: bool = False,
        lockstep: bool = False,
        warning: str | None = None,
        uncertified: bool = False,
        door: Door | None = None,
        notifier: Notifier | None = None,
        on_status: Callable[[Status], None] | None = None,
        say: Callable[[str], None] = lambda _: None,
    ) -> None:
        hedging = config.controller.hedging if hedging is None else hedging
        self._flight = flight = Flight(
            config, link, recorder, hedging=hedging, lockstep=lockstep, uncertified=uncertified, say=say
        )
        self._port, self._pilot, self._pose, self._watch = flight.port, flight.pilot, flight.pose, flight.watch
        self._limits = flight.limits
        self._lockstep = lockstep
        self._warning = warning
        self._notifier = notifier
        self._guests = None if door is None else Guests(flight, door)
        self._changes = Changes(flight, warning)
        steps = plan(*flight.ids, can_fly=config.vehicle.kind == "quadrotor")
        self._keeping = Housekeeping(flight, Engagement(steps) if engage else None, notifier, on_status)
        self._live = LiveCommands(flight)
        self._flies = config.vehicle.kind == "quadrotor"
        self._largest_step_s = min(self._limits.clock_jump_s, _LARGEST_STEP_S)
        self._fresh_until_s = -math.inf  # in control: before then neither pose nor heartbeat can be stale
        self._resets = 0  # of the estimator, as of the last sample
        self._held, self._sent_ms = _LEVEL, -1  # the last set-point, and the sample it answered
        self._last_s = 0.0  # in lockstep: time stamp of the last sample, of whatever kind

    def stop(self, reason: Reason = Reason.OPERATOR) -> None:
        """Ask for a release; safe from a signal handler."""
        self._flight.fault = reason

    def run(self) -> Summary:
        """Fly. Returns when control has ended and, where it was ours to end, the release mode has been asked for."""
        flight = self._flight
        if self._warning is not None:
            flight.event("uncertified", self._warning)
        flight.event(_CONNECTING.name.lower(), "link, waiting for vehicle {}/{}".format(*flight.ids))
        with quiet_memory(), stop_signals(self.stop):
            try:
                self._loop()
            except LinkError as error:
                self._changes.end(Reason.LINK_LOST, str(error))
            except Exception as error:  # whatever it was, the vehicle is handed back and the log tells
                self._changes.end(Reason.INTERNAL_ERROR, f"{type(error).__name__}: {error}")
                flight.event("traceback", traceback.format_exc())
            if self._notifier is not None:
                self._notifier.stopping(flight.reason.value)
            with contextlib.suppress(LinkError):
                let_go(flight, self._take)
        detail = ending(flight)
        if not self._lockstep:  # there, how many came after the end is chance
            flight.event("traffic", flight.port.tally())
        flight.event(f"released_{flight.reason.value}", detail)
        flight.say(f"released: {flight.reason.value} ({detail})")
        return Summary(
            flight.reason, detail, flight.engaged, self._pilot.elapsed_s, flight.ticks, taken_by_failsafe(flight)
        )

    def _loop(self) -> None:
        """Until control has ended."""
        flight, port, keeping = self._flight, self._port, self._keeping
        heard_s = flight.began_wall_s
        overrun_s = self._limits.tick_overrun_s
        while flight.state is not _RELEASED:
            data = port.receive()
            wall_s = time.monotonic()
            if not self._lockstep:
                flight.now_s = wall_s
            if flight.state is not _ENGAGED or flight.fault is not None or flight.now_s > self._fresh_until_s:
                self._look_at_ages()  # before what has come is believed: after a pause of ours it is stale
            if data:
                heard_s = wall_s
                flight.stamp_us = flight.time_us()
                frames = port.frames(data, flight.stamp_us)
                for frame in frames:
                    self._take(frame)
                if port.steering:
                    self._live.take()
            elif self._lockstep:
                self._silence(wall_s - heard_s)
            if self._guests is not None:
                self._guests.turn(frames if data else ())
            clock_s = flight.passed_s if self._lockstep and flight.sample is not None else wall_s
            if clock_s >= keeping.due_s:
                keeping.keep(clock_s, wall_s)
            if time.monotonic() - wall_s > overrun_s and flight.state is _ENGAGED and not self._lockstep:
                flight.refuse(Reason.TICK_OVERRUN, f"a tick took {time.monotonic() - wall_s:.3f} s")

    def _look_at_ages(self) -> None:
        """Decide, unless nothing can have changed: in control, only time passes between two messages.

        What has been heard stays fresh until a time that later messages can only put off, so it is looked up no more
        often than that.
        """
        flight, limits = self._flight, self._limits
        now = flight.now_s
        if (
            flight.state is not _ENGAGED
            or flight.fault is not None
            or now - flight.pose_at_s > limits.pose_age_s
            or now - flight.heartbeat_at_s > limits.heartbeat_age_s
        ):
            self._fresh_until_s = -math.inf
            self._changes.decide()
        else:
            self._fresh_until_s = min(
                flight.pose_at_s + limits.pose_age_s, flight.heartbeat_at_s + limits.heartbeat_age_s
            )

    # -- what comes in ------------------------------------------------------------------------------------------------

    def _take(self, frame: Frame) -> None:
        """One frame of the vehicle."""
        if self._flight.state is _RELEASED and not self._lockstep:
            return  # by a frame before this one
        number = frame[0]
        if number in _POSE:
            sample = self._pose.take(frame)
            if sample is not None:
                self._tick(sample)
                if self._lockstep and self._flight.state is _RELEASED:
                    self._answer(sample)
        elif number in _MODE:
            self._changes.hear(frame)
        else:
            self._keeping.take(frame)

    def _tick(self, sample: Odometry) -> None:
        """The hot path: one odometry sample to one set-point."""
        flight = self._flight
        last = flight.sample
        engaged = flight.state is _ENGAGED
        if self._lockstep:
            self._pass_time(sample.time_s)
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
            flight.delay.restart()
            dt = 0.0
        elif dt <= 0.0 and last is not None:
            return  # a copy, or out of order: the newer one has been flown
        if self._lockstep:
            flight.now_s = sample.time_s
            flight.stamp_us = flight.time_us()
            if last is None:  # from here on time is the odometry's
                self._keeping.restart()
                self._changes.restart()
        flight.sample = sample
        if self._pose.reset_counter != self._resets:
            self._resets = self._pose.reset_counter
            if engaged and last is not None:
                self._changes.reseat(last, sample)
                engaged = flight.state is _ENGAGED
        if engaged:
            self._fly(sample, dt)
        else:
            if flight.state is _CHECKING:
                flight.preflight.take(sample.time_s)
            if (flight.state is _STANDBY and not flight.aloof) or (self._lockstep and flight.state is not _RELEASED):
                self._stand_by(sample, dt)
        # The age of the pose, which is looked at before the next sample: an estimate that has stopped grows old.
        if last is None or sample[1] != last[1] or not self._repeats(last, sample):
            flight.pose_at_s = flight.now_s

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
            reason = watch.look(sample, setpoint, pilot, flight.ticks, flight.now_s - sample.time_s)
            if reason is not None:
                self._stop_for(reason)
                return
        if pilot.mission_over:
            self._stop_for(pilot.ending)

    def _pass_time(self, sample_s: float) -> None:
        """In lockstep time is the samples', as far as it passes at all."""
        flight = self._flight
        flight.passed_s += min(max(sample_s - self._last_s, 0.0), _LARGEST_STEP_S) if flight.ticks else 0.0
        self._last_s = sample_s

    def _answer(self, sample: Odometry) -> None:
        """In lockstep, after the end: the plant's time stands until it is answered, by what it was told last.

        That is what PX4 flies too, for as long as it waits for a stream that has ended.
        """
        if self._sent_ms != _milliseconds(sample.time_s):
            self._record(record_standby(sample, 0.0, self._held, self._send(sample, self._held), _RELEASED))

    def _stop_for(self, fault: Reason) -> None:
        """End control now, before another sample of the same datagram is flown."""
        self._flight.fault = self._flight.fault or fault
        self._changes.decide()

    def _stand_by(self, sample: Odometry, dt_s: float) -> None:
        """Stream what is safe to be switched to: the attitude as it is, hover thrust.

        No thrust only while the vehicle is disarmed in another mode: armed is told once a second, OFFBOARD at once, and
        a vehicle in the air must not fall in between.
        """
        grounded = not self._port.armed and self._port.mode != _OFFBOARD
        thrust = 0.0 if grounded else self._pilot.hover_thrust
        setpoint = AttitudeSetpoint(sample.qw, sample.qx, sample.qy, sample.qz, thrust)
        latency_s = self._send(sample, setpoint)
        self._record(record_standby(sample, dt_s, setpoint, latency_s, self._flight.state))

    def _send(self, sample: Odometry, setpoint: AttitudeSetpoint) -> float:
        """Out with the set-point; how long after its odometry came in."""
        flight = self._flight
        flight.streamed = True
        self._held, self._sent_ms = setpoint, _milliseconds(sample[0])
        self._port.send_setpoint(self._sent_ms, *setpoint, flight.stamp_us)
        return 0.0 if self._lockstep else time.monotonic() - flight.now_s

    def _record(self, tick: bytes) -> None:
        flight = self._flight
        flight.ticks += 1
        flight.tick = tick
        flight.recorder.add(TICK, flight.stamp_us, tick)

    def _silence(self, silent_s: float) -> None:
        """In lockstep time stands still without the plant, so its silence is measured by the wall."""
        if self._port.connected and silent_s > _LOCKSTEP_SILENCE_S:
            self._flight.refuse(Reason.HEARTBEAT_LOST, f"the plant has been silent for {silent_s:.0f} s of wall time")


def _milliseconds(time_s: float) -> int:
    """As `time_boot_ms` has it."""
    return round(time_s * 1e3) & 0xFFFFFFFF
