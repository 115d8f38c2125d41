"""The one fake PX4: what it says it is, and how it answers. On what it is heard is decided by who uses it.

It knows no physics and no clock. `harness.virtual_flight` and `harness.process_flight` fly `companion run` against it,
`tests/sitl/test_replay.py` plays recordings with it, `benchmarks/autopilot.py` times answers with it.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, Final

from pymavlink.dialects.v20 import development as mavlink

from companion.flight.readiness.parameters import GAINS
from sitl.autopilot.parameters import PX4_DEFAULTS, Px4Version

OFFBOARD: Final = 6 << 16
HOLD: Final = 4 << 16 | 3 << 24
POSITION: Final = 3 << 16
RETURN: Final = 4 << 16 | 5 << 24
LAND: Final = 4 << 16 | 6 << 24
_ASKS_VERSION: Final = (mavlink.MAV_CMD_REQUEST_MESSAGE, mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION)


class FakeAutopilot:
    """An autopilot of system 1, component 1.

    Attributes: `mode` and `intended` (where it is not the mode), `armed`, `status` are what it says of itself;
    `switches`, whether its pilot switches to OFFBOARD as soon as there is a stream to fly; `obeys`, whether it does
    what DO_SET_MODE asks; `pilot_after_hold`, whether its pilot chooses Position right after; `answers`, what it is
    about to say; `heard`, what it was told.
    """

    def __init__(self) -> None:
        self.mav = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
        self._parser = mavlink.MAVLink(None)
        self._parser.robust_parsing = True
        self.mode = HOLD
        self.intended: int | None = None
        self.armed = True
        self.status: int = mavlink.MAV_STATE_ACTIVE
        self.switches = self.obeys = True
        self.pilot_after_hold = False
        self.parameters = {name: float(PX4_DEFAULTS[Px4Version.V1_17][name]) for name in GAINS}
        self.version: tuple[int, int, int] | None = (1, 17, 0)
        self.answers: list[Any] = []
        self.heard: list[Any] = []

    def hear(self, data: bytes) -> None:
        """Bytes from the companion."""
        for message in self._parser.parse_buffer(data) or []:
            self.heard.append(message)
            self.react(message)

    def react(self, message: Any) -> None:
        """Answer and obey."""
        kind = message.get_type()
        if kind == "SET_ATTITUDE_TARGET" and self.switches:
            self.switches, self.mode = False, OFFBOARD
        if kind == "PARAM_REQUEST_READ" and message.param_id in self.parameters:
            name, value = message.param_id.encode(), self.parameters[message.param_id]
            self.answers.append(mavlink.MAVLink_param_value_message(name, value, mavlink.MAV_PARAM_TYPE_REAL32, 1, 0))
        if kind == "COMMAND_LONG" and self.version is not None and (message.command, message.param1) == _ASKS_VERSION:
            self.answers.append(autopilot_version(self.version))
        if kind == "COMMAND_LONG" and self.obeys:
            if message.command == mavlink.MAV_CMD_DO_SET_MODE:
                self.mode = int(message.param2) << 16 | int(message.param3) << 24
            self.answers.append(mavlink.MAVLink_command_ack_message(message.command, mavlink.MAV_RESULT_ACCEPTED))
            if message.command == mavlink.MAV_CMD_DO_SET_MODE and self.pilot_after_hold:
                self.mode = POSITION

    def pack(self, message: Any) -> bytes:
        """A message as a frame, numbered."""
        frame = bytes(message.pack(self.mav))
        self.mav.seq = self.mav.seq + 1 & 255
        return frame

    def heartbeat(self) -> Any:
        """HEARTBEAT of a quadrotor."""
        base = mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED | mavlink.MAV_MODE_FLAG_SAFETY_ARMED * self.armed
        kind, autopilot = mavlink.MAV_TYPE_QUADROTOR, mavlink.MAV_AUTOPILOT_PX4
        return mavlink.MAVLink_heartbeat_message(kind, autopilot, base, self.mode, self.status, 3)

    def current_mode(self) -> Any:
        """CURRENT_MODE."""
        return mavlink.MAVLink_current_mode_message(0, self.mode, self.mode if self.intended is None else self.intended)

    def of_kind(self, kind: str) -> list[Any]:
        """What it heard of one message."""
        return [message for message in self.heard if message.get_type() == kind]

    def setpoints(self) -> list[Any]:
        """The SET_ATTITUDE_TARGETs heard."""
        return self.of_kind("SET_ATTITUDE_TARGET")

    def commands(self, *numbers: int) -> list[Any]:
        """The COMMAND_LONGs of these numbers heard."""
        return [message for message in self.of_kind("COMMAND_LONG") if message.command in numbers]

    def statuses(self) -> list[int]:
        """The companion's own system statuses, in order of appearance."""
        return list(dict.fromkeys(message.system_status for message in self.of_kind("HEARTBEAT")))


def autopilot_version(version: tuple[int, int, int]) -> Any:
    """AUTOPILOT_VERSION of a release."""
    major, minor, patch = version
    number = major << 24 | minor << 16 | patch << 8 | 255
    return mavlink.MAVLink_autopilot_version_message(0, number, 0, 0, 0, [0] * 8, [0] * 8, [0] * 8, 0, 0, 0)


class ScriptedAutopilot(FakeAutopilot):
    """Says every 10 ms what it is told to say.

    Attributes: `pose`, messages by the vehicle's time in microseconds; `heartbeats`, `tells_mode`, `tells_estimator`,
    `answers_timesync`, which of them it says at all; `late_s`, of its answers to TIMESYNC; `now_s` since it began;
    `heartbeat_every` and `mode_every` how many periods; `loss_s` (COM_OF_LOSS_T), after which without a set-point in
    OFFBOARD it flies Return; `answered`, set-points heard as (when, the sample answered), seconds.
    """

    PERIOD_S: Final = 0.01

    def __init__(self) -> None:
        super().__init__()
        self.pose: Callable[[int], list[Any]] = odometry
        self.heartbeats = self.tells_mode = self.answers_timesync = True
        self.tells_estimator = False
        self.late_s = 0.0
        self.now_s = 0.0
        self.heartbeat_every, self.mode_every = 20, 5
        self.loss_s = math.inf
        self.answered: list[tuple[float, float]] = []
        self._timesync: list[tuple[float, Any]] = []
        self._count = 0

    @property
    def time_us(self) -> int:
        """The vehicle's clock."""
        return round(self.now_s * 1e6)

    def react(self, message: Any) -> None:
        super().react(message)
        if message.get_type() == "SET_ATTITUDE_TARGET":
            self.answered.append((self.now_s, 1e-3 * message.time_boot_ms))
        if message.get_type() == "TIMESYNC" and self.answers_timesync:
            self._timesync.append((self.now_s + self.late_s, mavlink.MAVLink_timesync_message(1, message.ts1)))

    def words(self) -> list[bytes]:
        """What it says at `now_s`, a datagram each; to be asked for once a period."""
        if self.mode == OFFBOARD and self.answered and self.now_s - self.answered[-1][0] > self.loss_s:
            self.mode, self.intended = RETURN, OFFBOARD
        due = [answer for due_s, answer in self._timesync if due_s <= self.now_s]
        self._timesync = [entry for entry in self._timesync if entry[0] > self.now_s]
        words = [*self.pose(self.time_us), *self.answers, *due]
        self.answers.clear()
        if self._count % self.heartbeat_every == 0 and self.heartbeats:
            words.append(self.heartbeat())
        if self._count % 20 == 0 and self.tells_estimator:
            words.append(mavlink.MAVLink_estimator_status_message(0, 0b1101111111, *[0.1] * 8))
        if self._count % self.mode_every == 0 and self.tells_mode:
            words.append(self.current_mode())
        self._count += 1
        return [self.pack(word) for word in words]


def odometry(time_us: int, x: float = 0.0, resets: int = 0, variance: float = 0.01) -> list[Any]:
    """A vehicle that hovers at x."""
    pose, velocity = [variance] * 21, [math.nan] * 21
    q = [1, 0, 0, 0]
    return [mavlink.MAVLink_odometry_message(time_us, 1, 1, x, 0, 0, q, 0, 0, 0, 0, 0, 0, pose, velocity, resets)]


def position_and_attitude(time_us: int) -> list[Any]:
    """The same without ODOMETRY."""
    ms = time_us // 1000
    return [
        mavlink.MAVLink_attitude_quaternion_message(ms, 1, 0, 0, 0, 0, 0, 0),
        mavlink.MAVLink_local_position_ned_message(ms, 0, 0, 0, 0, 0, 0),
    ]


class Forged(mavlink.MAVLink_heartbeat_message):
    """A heartbeat of another system that claims Hold."""

    def __init__(self, sender: Any) -> None:
        super().__init__(2, 12, 0, HOLD, 4, 3)
        self.sender = sender

    def pack(self, _: Any) -> bytes:
        return bytes(super().pack(self.sender))
