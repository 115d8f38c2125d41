"""The loop: one blocking thread that waits for odometry, steps the controller, sends, records the tick."""

from __future__ import annotations

import contextlib
import math
import time
import traceback
from collections.abc import Callable

from pymavlink.dialects.v20 import development as mavlink

from companion.config.schema import Config
from companion.control.types import AttitudeSetpoint, Odometry
from companion.flight import authority, guards
from companion.flight.authority import Known, Reason, State
from companion.flight.engage import Engagement, Seen, plan
from companion.flight.pilot import Pilot, record_standby
from companion.flight.port import CURRENT_MODE, HEARTBEAT, Port
from companion.flight.pose import ATTITUDE_QUATERNION, LOCAL_POSITION_NED, ODOMETRY, PoseSource
from companion.flight.preflight import Preflight
from companion.flight.release import HandOver
from companion.flight.runtime import Status, Summary, quiet_memory, stop_signals
from companion.mavlink import px4
from companion.mavlink.codec import Frame, decode_cold
from companion.mavlink.link import Link, LinkError
from companion.mavlink.px4 import Mode
from companion.record.recorder import EVENT, TICK, Recorder
from companion.record.schema import pack_event

_POSE = frozenset({ODOMETRY.message_id, ATTITUDE_QUATERNION.message_id, LOCAL_POSITION_NED.message_id})
_MODE = frozenset({HEARTBEAT.message_id, CURRENT_MODE.message_id})
_CONNECTING, _CHECKING, _STANDBY, _ENGAGED, _RELEASED = State  # on its class, looking up a member costs tenfold
_HOUSEKEEPING_S = 0.1
_HEARTBEAT_S = 1.0
_FLUSH_S = 0.25  # of the log: what a kill -9 loses
_CALL_S = 0.2  # between heartbeats until the vehicle has answered
_OFFBOARD = int(Mode.OFFBOARD)
_LOCKSTEP_SILENCE_S = 15.0


class FlightProcess:
    """One flight: from the first heartbeat to a release with a named reason.

    `lockstep`: time is the odometry's own, and every sample is answered, so that a flight is a function of its inputs.
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
        on_status: Callable[[Status], None] | None = None,
        say: Callable[[str], None] = lambda _: None,
    ) -> None:
        self._config = config
        self._recorder = recorder
        self._lockstep = lockstep
        self._warning = warning
        self._on_status = on_status
        self._say = say
        self._port = Port(config, link, recorder)
        self._guards = guards.limits(config.guards)
        self._pilot = Pilot(config, hedging=config.controller.hedging if hedging is None else hedging)
        ids = (config.vehicle.system_id, config.vehicle.component_id)
        self._ids = ids
        self._engagement = Engagement(plan(*ids, can_fly=config.vehicle.kind == "quadrotor")) if engage else None
        self._pose = PoseSource()
        self._preflight = Preflight(config, self._pose)
        self._state = _CONNECTING
        self._fault: Reason | None = None
        self._reason = Reason.OPERATOR
        self._detail = ""
        self._streamed = self._engaged = False
        self._stamp_us = 0  # of what came last, and of the answer to it
        self._largest_step_s = min(self._guards.pose_age_s, 1.0)
        self._sample: Odometry | None = None
        self._ground_z_m = 0.0
        self._ticks = 0
        self._began_wall_s = time.monotonic()
        self._now_s = 0.0 if lockstep else self._began_wall_s
        self._pose_at_s = self._heartbeat_at_s = self._now_s
        self._next = {"housekeeping": 0.0, "heartbeat": 0.0, "flush": 0.0}

    def stop(self, reason: Reason = Reason.OPERATOR) -> None:
        """Ask for a release; safe from a signal handler."""
        self._fault = reason

    def run(self) -> Summary:
        """Fly. Returns when control has ended and, where it was ours to end, Hold has been asked for."""
        if self._warning is not None:
            self._event("uncertified", self._warning)
        self._event(_CONNECTING.name.lower(), f"link, waiting for vehicle {self._ids[0]}/{self._ids[1]}")
        with quiet_memory(), stop_signals(self.stop):
            try:
                self._loop()
            except LinkError as error:
                self._end(Reason.LINK_LOST, str(error))
            except Exception as error:  # whatever it was, the vehicle is handed back and the log tells
                self._end(Reason.INTERNAL_ERROR, f"{type(error).__name__}: {error}")
                self._event("traceback", traceback.format_exc())
            with contextlib.suppress(LinkError):
                self._let_go(self._reason)
        detail = self._detail or authority.MEANING[self._reason]
        self._event(f"released_{self._reason.value}", detail)
        self._say(f"released: {self._reason.value} ({detail})")
        return Summary(self._reason, detail, self._engaged, self._pilot.elapsed_s, self._ticks)

    def _loop(self) -> None:
        """Until control has ended."""
        heard_s = self._began_wall_s
        while self._state is not _RELEASED:
            data = self._port.receive()
            wall_s = time.monotonic()
            if not self._lockstep:
                self._now_s = wall_s
            self._watch()  # before what has come is believed: after a pause of ours it is stale
            if data:
                heard_s = wall_s
                self._stamp_us = self._time_us()
                for frame in self._port.frames(data, self._stamp_us):
                    self._take(frame)
            elif self._lockstep:
                self._silence(wall_s - heard_s)
            clock_s = wall_s if self._sample is None else self._now_s
            if clock_s >= self._next["housekeeping"]:
                self._housekeep(clock_s, wall_s)

    def _end(self, reason: Reason, detail: str) -> None:
        """Released from outside the transition function; the first reason stays."""
        if self._state is not _RELEASED:
            self._state, self._reason, self._detail = _RELEASED, reason, detail

    # -- what comes in ------------------------------------------------------------------------------------------------

    def _take(self, frame: Frame) -> None:
        """One frame of the vehicle."""
        if self._state is _RELEASED and not self._lockstep:
            return  # by a frame before this one
        number = frame.message_id
        if number in _POSE:
            sample = self._pose.take(frame)
            if sample is not None:
                self._tick(sample)
        elif number in _MODE:
            mode = self._port.mode
            if self._port.note(frame):
                self._heartbeat_at_s = self._now_s
            elif (
                self._port.mode != mode
            ):  # whether it is armed is told by the heartbeat alone, which may be a second old
                self._port.send(px4.request_message(*self._ids, HEARTBEAT.message_id), self._time_us())
            self._decide()  # the pilot's switch counts before the next sample does
        elif number == mavlink.MAVLINK_MSG_ID_COMMAND_ACK and self._engagement is not None:
            answer = decode_cold(frame)
            self._engagement.acknowledged(answer.command, answer.result)

    def _tick(self, sample: Odometry) -> None:
        """The hot path: one odometry sample to one set-point."""
        last = self._sample
        engaged = self._state is _ENGAGED
        if not guards.valid_pose(sample):
            if engaged:
                self._stop_for(Reason.POSE_INVALID)
            return  # out of control it is only not counted: too many of them, and the rate is below the floor
        dt = 0.0 if last is None else sample.time_s - last.time_s
        if abs(dt) > self._largest_step_s:
            if engaged:
                self._stop_for(Reason.CLOCK_JUMP)
                return
            self._preflight.restart()
            dt = 0.0
        elif dt <= 0.0 and last is not None:
            return  # a copy, or out of order: the newer one has been flown
        if self._lockstep:
            if last is None:
                self._next = dict.fromkeys(self._next, 0.0)  # from here on time is the odometry's
            self._now_s = sample.time_s
            self._stamp_us = self._time_us()
        self._sample = sample
        self._pose_at_s = self._now_s
        if engaged:
            self._fly(sample, dt)
            return
        if self._state is _CHECKING:
            self._preflight.take(sample.time_s)
        if self._state is _STANDBY or self._lockstep:
            self._stand_by(sample, dt)

    def _fly(self, sample: Odometry, dt_s: float) -> None:
        """In control: the paper's step, then out with it, then the record."""
        setpoint = self._pilot.step(sample, dt_s)
        if not guards.all_finite(setpoint):
            self._stop_for(Reason.SETPOINT_INVALID)
            return
        latency_s = self._send(sample, setpoint)
        self._record(self._pilot.record(sample, dt_s, setpoint, latency_s, self._state))
        if self._pilot.mission_over:
            self._stop_for(Reason.MISSION_COMPLETE)

    def _stop_for(self, fault: Reason) -> None:
        """End control now, before another sample of the same datagram is flown."""
        self._fault = self._fault or fault
        self._decide()

    def _stand_by(self, sample: Odometry, dt_s: float) -> None:
        """Stream what is safe to be switched to: the attitude as it is, hover thrust.

        No thrust only while the vehicle is disarmed in another mode: armed is told once a second, OFFBOARD at once, and
        a vehicle in the air must not fall in between.
        """
        grounded = not self._port.armed and self._port.mode != _OFFBOARD
        thrust = 0.0 if grounded else self._config.vehicle.hover_thrust
        setpoint = AttitudeSetpoint(sample.qw, sample.qx, sample.qy, sample.qz, thrust)
        latency_s = self._send(sample, setpoint)
        self._record(record_standby(sample, dt_s, setpoint, latency_s, self._state))

    def _send(self, sample: Odometry, setpoint: AttitudeSetpoint) -> float:
        """Out with the set-point; how long after its odometry came in."""
        self._streamed = True
        self._port.send_setpoint(round(sample.time_s * 1e3) & 0xFFFFFFFF, *setpoint, self._stamp_us)
        return 0.0 if self._lockstep else time.monotonic() - self._now_s

    def _record(self, tick: bytes) -> None:
        self._ticks += 1
        self._recorder.add(TICK, self._stamp_us, tick)

    # -- what goes on beside it ---------------------------------------------------------------------------------------

    def _known(self) -> Known:
        fault = self._fault
        if fault is None and self._state in (_STANDBY, _ENGAGED):
            fault = guards.broken(self._guards, self._now_s - self._pose_at_s, self._now_s - self._heartbeat_at_s)
        return Known(self._port.connected, self._preflight.passed, self._port.mode, self._port.armed, fault)

    def _housekeep(self, clock_s: float, wall_s: float) -> None:
        """Everything slow, at 10 Hz."""
        now = self._now_s
        self._next["housekeeping"] = clock_s + _HOUSEKEEPING_S
        if clock_s >= self._next["heartbeat"]:
            self._next["heartbeat"] = clock_s + (_HEARTBEAT_S if self._port.connected else _CALL_S)
            status = mavlink.MAV_STATE_ACTIVE if self._state is _ENGAGED else mavlink.MAV_STATE_STANDBY
            self._port.send(px4.heartbeat(status), self._time_us())
        if self._state is _CONNECTING:
            if wall_s - self._began_wall_s > self._config.link.connect_timeout_s:
                self._refuse(
                    Reason.NO_VEHICLE,
                    f"no heartbeat of vehicle {self._ids[0]}/{self._ids[1]} within "
                    f"{self._config.link.connect_timeout_s:g} s: check the link and vehicle.system_id",
                )
        elif self._state is _CHECKING:
            self._check(now)
        elif self._state is _STANDBY and self._engagement is not None:
            self._engage()
        if self._on_status is not None:
            rate = self._preflight.rate_hz
            self._on_status(
                Status(self._state, self._port.mode, self._port.armed, self._pilot.elapsed_s, rate, self._pilot.error_m)
            )
        if clock_s >= self._next["flush"]:  # seldom: waking the writer costs as much as ten ticks
            self._next["flush"] = clock_s + _FLUSH_S
            self._recorder.flush()

    def _check(self, now_s: float) -> None:
        for request in self._preflight.requests(now_s, heard=self._sample is not None):
            self._port.send(request, self._time_us())
        failed = self._preflight.failed(now_s)
        if failed is not None:
            self._refuse(Reason.RATE_TOO_LOW, failed)

    def _engage(self) -> None:
        sample = self._sample
        if sample is None or self._engagement is None:
            return
        speed = math.sqrt(sample.vx_m_s**2 + sample.vy_m_s**2 + sample.vz_m_s**2)
        seen = Seen(self._port.mode, self._port.armed, speed, self._ground_z_m - sample.z_m)
        message, failed = self._engagement.advance(self._now_s, seen)
        if message is not None:
            self._port.send(message, self._time_us())
        if failed is not None:
            self._refuse(Reason.ENGAGE_REFUSED, f"the vehicle did not {failed}")

    def _refuse(self, reason: Reason, detail: str) -> None:
        self._fault, self._detail = reason, detail

    def _silence(self, silent_s: float) -> None:
        """In lockstep time stands still without the plant, so its silence is measured by the wall."""
        if self._port.connected and silent_s > _LOCKSTEP_SILENCE_S:
            self._refuse(Reason.HEARTBEAT_LOST, f"the plant has been silent for {silent_s:.0f} s of wall time")

    # -- changes of authority -----------------------------------------------------------------------------------------

    def _watch(self) -> None:
        """Decide, unless nothing can have changed: in control, only time passes between two messages."""
        now = self._now_s
        if (
            self._state is not _ENGAGED
            or self._fault is not None
            or now - self._pose_at_s > self._guards.pose_age_s
            or now - self._heartbeat_at_s > self._guards.heartbeat_age_s
        ):
            self._decide()

    def _decide(self) -> None:
        """Ask the transition function, and enter the state it names."""
        state, reason = authority.advance(self._state, self._known())
        if state is self._state:
            return
        if state is _CHECKING:
            self._preflight.begin(self._now_s)
        elif state is _STANDBY and self._sample is not None:
            self._ground_z_m = self._sample.z_m
            self._pose.settle()
            if self._warning is not None:
                self._tell(f"companion: UNCERTIFIED: {self._warning}")
        elif state is _ENGAGED and self._sample is not None:
            self._pilot.take_over(self._sample)
            self._engaged = True
        self._state = state
        if reason is not None:
            self._reason = reason
            return
        rate = self._preflight.rate_hz
        detail = f"{self._pose.message} at {rate:.0f} Hz" if rate else ""
        self._event(state.name.lower(), detail)
        self._say(f"{state.name.lower()} {detail}".strip())

    def _let_go(self, reason: Reason) -> None:
        """Hold, unless somebody else has control; then silence, which PX4's own failsafe understands."""
        if not self._streamed or reason in authority.TAKEN or self._port.mode != Mode.OFFBOARD:
            return
        self._tell(f"companion: {reason.value}")
        hand_over = HandOver(self._port, self._ids, self._clock_s())
        gave_up_s = time.monotonic() + _LOCKSTEP_SILENCE_S
        while not hand_over.over(self._clock_s()) and time.monotonic() < gave_up_s:
            request = hand_over.advance(self._clock_s())
            if request is not None:
                self._port.send(request, self._time_us())
            for frame in self._port.frames(self._port.receive(), self._time_us()):
                if frame.message_id in _MODE:
                    self._port.note(frame)
                elif frame.message_id == mavlink.MAVLINK_MSG_ID_COMMAND_ACK:
                    answer = decode_cold(frame)
                    if answer.command == mavlink.MAV_CMD_DO_SET_MODE:
                        hand_over.acknowledged(answer.result)
                elif self._lockstep:
                    self._take(frame)  # the plant's time moves only when it is answered

    def _tell(self, text: str) -> None:
        """A warning to the ground station, cut to what a STATUSTEXT holds."""
        message = mavlink.MAVLink_statustext_message(mavlink.MAV_SEVERITY_WARNING, text.encode()[:50])
        self._port.send(message, self._time_us())

    def _clock_s(self) -> float:
        """Now, for waiting: the samples' own time in lockstep."""
        return self._now_s if self._lockstep else time.monotonic()

    def _event(self, name: str, detail: str) -> None:
        self._recorder.add(EVENT, self._time_us(), pack_event(name, detail))

    def _time_us(self) -> int:
        """Time stamp of records: wall clock, or the samples' own in lockstep."""
        return round(self._now_s * 1e6) if self._lockstep else time.time_ns() // 1000
