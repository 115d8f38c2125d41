"""What pilots, autopilots, operators and other MAVLink clients do to a flight: the other half of the vocabulary."""

from __future__ import annotations

import math
from typing import Final, NamedTuple

from pymavlink.dialects.v20 import development as mavlink

from sitl.autopilot.modes import STICK_MODES, FlightMode, custom_mode
from sitl.autopilot.navigator import Home
from sitl.autopilot.request_faults import Answer
from sitl.scenarios.run import ScenarioRun
from sitl.vehicles.vehicle import Vector

_STREAMED_S: Final = 3.0
_POSITION_AND_YAW: Final = 0x9F8  # POSITION_TARGET_TYPEMASK: velocity, acceleration and yaw rate ignored


class PilotTakes(NamedTuple):
    """The pilot chooses a mode by switch; stick modes come with sticks."""

    mode: FlightMode

    def happen(self, run: ScenarioRun) -> None:
        commander = run.autopilot.commander
        commander.manual_control = commander.manual_control or self.mode in STICK_MODES
        commander.request(
            self.mode, run.autopilot.time_us, force=self.mode in (FlightMode.LAND, FlightMode.TERMINATION)
        )
        run.autopilot.follow_mode()


class SticksMove(NamedTuple):
    """The pilot moves the sticks, in whatever mode: so far, so fast. What that does, PX4's parameters decide."""

    travel_percent: float
    speed_1_s: float

    def happen(self, run: ScenarioRun) -> None:
        run.autopilot.commander.sticks_moved(run.autopilot.time_us, self.travel_percent, self.speed_1_s)
        run.autopilot.follow_mode()


class PilotArms(NamedTuple):
    """The pilot arms on the ground, as soon as it is in a mode."""

    mode: FlightMode

    def happen(self, run: ScenarioRun) -> None:
        commander = run.autopilot.commander
        armed = False

        def arm(_: float) -> None:
            nonlocal armed
            if not armed and commander.mode is self.mode:
                armed = commander.arm(run.autopilot.time_us)

        run.each_step(arm)


class LiftsOffAndSwitches(NamedTuple):
    """The pilot arms, lifts off, and chooses OFFBOARD at a height above the ground, as soon as somebody streams."""

    height_m: float

    def happen(self, run: ScenarioRun) -> None:
        autopilot, asked = run.autopilot, False

        def fly(elapsed_s: float) -> None:
            nonlocal asked
            if asked or elapsed_s < _STREAMED_S:
                return
            now_us = autopilot.time_us
            if not autopilot.commander.armed and autopilot.commander.arm(now_us):
                autopilot.home = Home(autopilot.estimate().position_ned_m, autopilot.estimate().q_wxyz, now_us)
                autopilot.commander.request(FlightMode.TAKEOFF, now_us)
                autopilot.follow_mode()
            asked = autopilot.truth().position_ned_m[2] < -self.height_m
            if asked:
                autopilot.commander.request(FlightMode.OFFBOARD, now_us)
                autopilot.follow_mode()

        run.each_step(fly)


class PilotDisarms(NamedTuple):
    """The pilot disarms in the air."""

    def happen(self, run: ScenarioRun) -> None:
        run.autopilot.commander.disarm(run.autopilot.time_us, "pilot", force=True)


class PilotKills(NamedTuple):
    """The kill switch: motors stop, the mode stays."""

    def happen(self, run: ScenarioRun) -> None:
        run.autopilot.commander.kill(run.autopilot.time_us)


class FailSafe(NamedTuple):
    """PX4 takes over by itself, as for a low battery; OFFBOARD stays what the user intends."""

    mode: FlightMode

    def happen(self, run: ScenarioRun) -> None:
        run.autopilot.commander.forced_failsafe = self.mode


class Recover(NamedTuple):
    """PX4's own failsafe is over: what the user intends flies again."""

    def happen(self, run: ScenarioRun) -> None:
        run.autopilot.commander.forced_failsafe = None


class AnswerTo(NamedTuple):
    """From now on PX4 takes requests for a mode in its own way."""

    mode: FlightMode
    answer: Answer
    late_s: float = 1.0

    def happen(self, run: ScenarioRun) -> None:
        run.request_faults.answers[self.mode] = self.answer
        run.request_faults.late_us = round(1e6 * self.late_s)


class AnswerToArming(NamedTuple):
    """From now on PX4 takes requests to arm in its own way."""

    answer: Answer

    def happen(self, run: ScenarioRun) -> None:
        run.request_faults.arming = self.answer


class AlreadyInOffboard(NamedTuple):
    """The companion died in flight and comes back: OFFBOARD is intended, PX4's failsafe flies."""

    def happen(self, run: ScenarioRun) -> None:
        autopilot = run.autopilot
        autopilot.commander.user_mode = FlightMode.OFFBOARD
        autopilot.commander.update(autopilot.time_us)
        autopilot.follow_mode()


# --- the companion itself -----------------------------------------------------------------------------------------


class Stall(NamedTuple):
    """The companion's process does not get to run for a while; for real time only."""

    for_s: float

    def happen(self, run: ScenarioRun) -> None:
        assert run.companion is not None
        run.companion.stall(self.for_s)


class Overrun(NamedTuple):
    """One of the companion's ticks takes too long; for real time only."""

    for_s: float

    def happen(self, run: ScenarioRun) -> None:
        assert run.companion is not None
        run.companion.overrun(self.for_s)


class Unplug(NamedTuple):
    """The companion's end of the link is pulled."""

    def happen(self, run: ScenarioRun) -> None:
        assert run.companion is not None
        run.companion.unplug()


class OperatorStops(NamedTuple):
    """Ctrl-C."""

    def happen(self, run: ScenarioRun) -> None:
        assert run.companion is not None
        assert run.process is not None
        run.companion.before_next(run.process.stop)


class Steer(NamedTuple):
    """A MAVLink client commands a place and a heading; NED from where OFFBOARD began."""

    offset_ned_m: Vector
    yaw_deg: float = math.nan
    type_mask: int = _POSITION_AND_YAW
    frame: int = mavlink.MAV_FRAME_LOCAL_NED

    def happen(self, run: ScenarioRun) -> None:
        start = run.observer.start_ned_m
        place = [a + b for a, b in zip(start, self.offset_ned_m, strict=True)]
        system, component = run.companion_ids
        run.send_from_ground_station(
            mavlink.MAVLink_set_position_target_local_ned_message(
                run.autopilot.time_us // 1000, system, component, self.frame, self.type_mask, *place,
                0.0, 0.0, 0.0, 0.0, 0.0, 0.0, math.radians(self.yaw_deg), 0.0,
            )
        )  # fmt: skip


class SetParameter(NamedTuple):
    """Somebody sets a parameter of the vehicle, and PX4 tells it to everybody."""

    name: str
    value: float

    def happen(self, run: ScenarioRun) -> None:
        vehicle = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
        message = mavlink.MAVLink_param_value_message(
            self.name.encode(), self.value, mavlink.MAV_PARAM_TYPE_REAL32, 1, 0
        )
        run.channels.down.put(bytes(message.pack(vehicle)), run.autopilot.time_us)


class Rival(NamedTuple):
    """Somebody else flies the vehicle: a companion of the same name, or another system that streams set-points."""

    same_name: bool

    def happen(self, run: ScenarioRun) -> None:
        system, component = run.companion_ids if self.same_name else (42, 195)
        rival = mavlink.MAVLink(None, srcSystem=system, srcComponent=component)
        level = [1.0, 0.0, 0.0, 0.0]
        due_s = 0.0

        def stream(elapsed_s: float) -> None:
            nonlocal due_s
            if elapsed_s < due_s:
                return
            due_s = elapsed_s + 0.1
            message = (
                mavlink.MAVLink_heartbeat_message(18, mavlink.MAV_AUTOPILOT_INVALID, 0, 0, 3, 3)
                if self.same_name
                else mavlink.MAVLink_set_attitude_target_message(0, 1, 1, 7, level, 0.0, 0.0, 0.0, 0.49)
            )
            run.channels.down.put(bytes(message.pack(rival)), run.autopilot.time_us)

        run.each_step(stream)


class Forge(NamedTuple):
    """Another system on the wire claims the modes of an autopilot, so many times a control step, for a while."""

    frames: int
    for_s: float

    def happen(self, run: ScenarioRun) -> None:
        imposter = mavlink.MAVLink(None, srcSystem=7, srcComponent=1)
        hold = custom_mode(FlightMode.HOLD)

        def forge(elapsed_s: float) -> None:
            for _ in range(self.frames if elapsed_s < self.for_s else 0):
                for message in (
                    mavlink.MAVLink_heartbeat_message(2, mavlink.MAV_AUTOPILOT_PX4, 81, hold, 3, 3),
                    mavlink.MAVLink_current_mode_message(0, hold, hold),
                ):
                    run.channels.down.put(bytes(message.pack(imposter)), run.autopilot.time_us)

        run.each_step(forge)
