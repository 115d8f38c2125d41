"""Commands to the autopilot on one link: long, int and SET_MODE; what concerns the link itself is done here.

Source: PX4 `mavlink_receiver.cpp`, https://mavlink.io/en/services/command.html
"""

from __future__ import annotations

import math
from typing import Any, Final, Protocol

from pymavlink.dialects.v20 import development as mavlink

from companion.mavlink.codec import Frame
from companion.mavlink.px4 import Result
from sitl.autopilot import commands
from sitl.autopilot.autopilot import Autopilot
from sitl.autopilot.commands import VehicleCommand
from sitl.autopilot.parameters import Px4Version
from sitl.messages.available_modes import available_modes
from sitl.messages.streams import NEVER_US, Streams

ANY: Final = 0
_LINK_COMMANDS: Final = frozenset({510, 511, 512})
_TO_ANY_COMPONENT: Final = frozenset({519, 520})  # in v1.17, as the requests below: v1.18 does not know them
_LEGACY_REQUESTS: Final = {
    410: mavlink.MAVLINK_MSG_ID_HOME_POSITION,
    519: 300,  # PROTOCOL_VERSION: PX4 sends it, the dialect has dropped it, so it is denied here
    520: mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION,
}


class Answering(Protocol):
    """The link's side: where answers go."""

    address: tuple[int, int]
    replies: list[bytes]
    ignored: int

    def for_us(self, message: Any) -> bool:
        """Whether a message is for this autopilot."""

    def send(self, message: Any) -> None:
        """Queue a pymavlink message."""


class Commands:
    """What is answered to commands on a link.

    Attributes:
        odometry_requested: whether somebody asked for ODOMETRY by SET_MESSAGE_INTERVAL, and it runs.
    """

    def __init__(self, link: Answering, autopilot: Autopilot, streams: Streams) -> None:
        self._link = link
        self._autopilot = autopilot
        self._streams = streams
        self._legacy = autopilot.parameters.version is Px4Version.V1_17
        self.odometry_requested = False

    def on_set_mode(self, frame: Frame, message: Any) -> None:
        """A SET_MODE."""
        if message.target_system != self._link.address[0]:
            self._link.ignored += 1
            return
        main, sub = message.custom_mode >> 16 & 255, message.custom_mode >> 24 & 255
        result = commands.set_mode(self._autopilot, message.base_mode, main, sub)
        self._acknowledge(frame, mavlink.MAV_CMD_DO_SET_MODE, result)

    def on_command_long(self, frame: Frame, message: Any) -> None:
        """A COMMAND_LONG."""
        self._execute(frame, message, message.param5, message.param6, message.param7)

    def on_command_int(self, frame: Frame, message: Any) -> None:
        """A COMMAND_INT."""
        unset = message.x == 0x7FFFFFFF and message.y == 0x7FFFFFFF
        x, y = (math.nan, math.nan) if unset else (1e-7 * message.x, 1e-7 * message.y)
        self._execute(frame, message, x, y, message.z)

    def _execute(self, frame: Frame, message: Any, p5: float, p6: float, p7: float) -> None:
        command = VehicleCommand(
            message.command, message.param1, message.param2, message.param3, message.param4, p5, p6, p7
        )  # fmt: skip
        to_any = (
            self._legacy
            and command.number in _TO_ANY_COMPONENT
            and message.target_system in (self._link.address[0], ANY)
        )
        if not to_any and not self._link.for_us(message):
            return
        if command.number in _LINK_COMMANDS or (self._legacy and command.number in _LEGACY_REQUESTS):
            self._acknowledge(frame, command.number, self._link_command(command))
            return
        for result in commands.execute(self._autopilot, command):
            self._acknowledge(frame, command.number, result)

    def _link_command(self, command: VehicleCommand) -> Result:
        if command.number == mavlink.MAV_CMD_SET_MESSAGE_INTERVAL:
            return self._set_message_interval(command)
        if command.number == mavlink.MAV_CMD_GET_MESSAGE_INTERVAL:
            return self._send_interval(command.p1)
        if command.number == mavlink.MAV_CMD_REQUEST_MESSAGE:
            if _number(command.p1) == mavlink.MAVLINK_MSG_ID_MESSAGE_INTERVAL:
                return self._send_interval(command.p2)
            if _number(command.p1) == mavlink.MAVLINK_MSG_ID_AVAILABLE_MODES:
                return self._send_modes(command.p2)
            return self._request(_number(command.p1))
        return self._request(_LEGACY_REQUESTS[command.number])

    def _set_message_interval(self, command: VehicleCommand) -> Result:
        if any(_number(p) not in (0, -1) for p in (command.p3, command.p4, command.p7)):
            return Result.FAILED  # PX4 knows neither response targets nor the other parameters
        message_id = _number(command.p1)
        known = self._streams.set_interval(message_id, command.p2, self._autopilot.time_us)
        if known and message_id == mavlink.MAVLINK_MSG_ID_ODOMETRY:
            self.odometry_requested = self._streams.odometry_due_us < NEVER_US
        return Result.ACCEPTED if known else Result.FAILED

    def _send_interval(self, message_id: float) -> Result:
        number = _number(message_id)
        interval = self._streams.interval_us(number)
        self._link.send(
            mavlink.MAVLink_message_interval_message(message_id=max(number, 0) & 0xFFFF, interval_us=interval)
        )
        return Result.ACCEPTED

    def _send_modes(self, index: float) -> Result:
        modes = available_modes(index, self._autopilot.parameters.version)
        for mode in modes:
            self._link.send(mode)
        return Result.ACCEPTED if modes else Result.DENIED

    def _request(self, message_id: int) -> Result:
        frame = self._streams.request(message_id)
        if frame is None:
            return Result.DENIED
        self._link.replies.append(frame)
        return Result.ACCEPTED

    def _acknowledge(self, frame: Frame, command: int, result: Result) -> None:
        self._link.send(
            mavlink.MAVLink_command_ack_message(
                command=command,
                result=int(result),
                progress=0,
                result_param2=0,
                target_system=frame.system_id,
                target_component=frame.component_id,
            )
        )


def _number(parameter: float) -> int:
    """A command parameter that carries a whole number; -1 for one that carries none."""
    return round(parameter) if -1e9 < parameter < 1e9 else -1
