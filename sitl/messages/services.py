"""What the autopilot answers on one link: parameters, missions, time; commands are `link_commands`.

Source: PX4 `mavlink_receiver.cpp`.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final

from fastcrc.crc16 import mcrf4xx
from pymavlink.dialects.v20 import development as mavlink

from companion.mavlink.codec import CRC_BYTES, HEADER_BYTES, Encoder, Frame, Layout, decode_cold
from sitl.autopilot.autopilot import Autopilot, Notice
from sitl.autopilot.modes import Severity
from sitl.autopilot.parameters import HASH_NAME, Px4Version, WireParameter
from sitl.autopilot.position_control import PositionControlSetpoint
from sitl.messages.file_transfer import FileTransfer
from sitl.messages.link_commands import ANY, Commands
from sitl.messages.log_card import Log
from sitl.messages.log_download import LOG_DATA, LogDownload
from sitl.messages.streams import Streams
from sitl.messages.telemetry import Telemetry

Reply = Callable[[Frame, Any], None]

_SETPOINT: Final = Layout("SET_ATTITUDE_TARGET")
_SETPOINT_ID: Final = _SETPOINT.message_id
_POSITION_IGNORE: Final = 0x007  # POSITION_TARGET_TYPEMASK
_VELOCITY_IGNORE: Final = 0x038
_ACCELERATION_IGNORE: Final = 0x1C0


class Services:
    """Everything one link answers to.

    Attributes:
        address: system and component of this autopilot.
        replies: frames to be sent, in order; the owner of the link takes them.
        setpoint_ms: `time_boot_ms` of the last SET_ATTITUDE_TARGET that was for this autopilot.
        commands: what is answered to commands.
        ground_station_seen: whether a ground station's heartbeat came by; only then PX4 sends STATUSTEXT.
        changed: parameters set on this link, for the other links to tell.
        new_signing_key: taken by SETUP_SIGNING, of no bytes where signing was ended; the owner of the link acts on it.
        ignored: frames that were not for this autopilot, or that nobody handles.
        logs: what is being downloaded; the owner of the link calls `send_logs` while it is `sending`.
    """

    def __init__(
        self,
        autopilot: Autopilot,
        telemetry: Telemetry,
        streams: Streams,
        system_id: int,
        component_id: int,
        logs: list[Log] | None = None,
    ) -> None:
        self._autopilot = autopilot
        self._telemetry = telemetry
        self._streams = streams
        self._system = system_id
        self._component = component_id
        self.address = (system_id, component_id)
        self._systems = (system_id, ANY)
        self._components = (component_id, ANY)
        self._unpack_setpoint = _SETPOINT.unpack
        self._on_attitude_target = autopilot.on_attitude_target
        self.logs = LogDownload([] if logs is None else logs)
        self._files = FileTransfer(self.logs.logs, mav_log=autopilot.parameters.version is not Px4Version.V1_17)
        self._encode_log_data = Encoder(LOG_DATA, system_id, component_id).encode
        self.replies: list[bytes] = []
        self.commands = Commands(self, autopilot, streams)
        self.changed: list[WireParameter] = []
        self.new_signing_key: bytes | None = None
        self.setpoint_ms = -1
        self.ground_station_seen = False
        self.ignored = 0
        self._handlers: dict[int, Reply] = {
            mavlink.MAVLINK_MSG_ID_HEARTBEAT: self._heartbeat,
            mavlink.MAVLINK_MSG_ID_PING: self._ping,
            mavlink.MAVLINK_MSG_ID_SET_MODE: self.commands.on_set_mode,
            mavlink.MAVLINK_MSG_ID_PARAM_REQUEST_READ: self._param_read,
            mavlink.MAVLINK_MSG_ID_PARAM_REQUEST_LIST: self._param_list,
            mavlink.MAVLINK_MSG_ID_PARAM_SET: self._param_set,
            mavlink.MAVLINK_MSG_ID_MISSION_REQUEST_LIST: self._mission_list,
            mavlink.MAVLINK_MSG_ID_MISSION_COUNT: self._mission_count,
            mavlink.MAVLINK_MSG_ID_MISSION_CLEAR_ALL: self._mission_clear,
            mavlink.MAVLINK_MSG_ID_COMMAND_INT: self.commands.on_command_int,
            mavlink.MAVLINK_MSG_ID_COMMAND_LONG: self.commands.on_command_long,
            mavlink.MAVLINK_MSG_ID_TIMESYNC: self._timesync,
            mavlink.MAVLINK_MSG_ID_SET_POSITION_TARGET_LOCAL_NED: self._position_target,
            mavlink.MAVLINK_MSG_ID_FILE_TRANSFER_PROTOCOL: self._file_transfer,
            mavlink.MAVLINK_MSG_ID_LOG_REQUEST_LIST: lambda _, message: self.logs.request_list(message),
            mavlink.MAVLINK_MSG_ID_LOG_REQUEST_DATA: lambda _, message: self.logs.request_data(message),
            mavlink.MAVLINK_MSG_ID_LOG_REQUEST_END: lambda _, message: self.logs.request_end(message),
            mavlink.MAVLINK_MSG_ID_LOG_ERASE: lambda _, __: self.logs.erase(armed=autopilot.commander.armed),
        }
        if autopilot.parameters.version is not Px4Version.V1_17:  # there SETUP_SIGNING does nothing
            self._handlers[mavlink.MAVLINK_MSG_ID_SETUP_SIGNING] = self._setup_signing

    def handle(self, frame: Frame) -> None:
        """Take one frame; what there is to answer stands in `replies`."""
        if frame.message_id == _SETPOINT_ID:
            time_ms, q0, q1, q2, q3, _, _, yaw_rate, thrust, system, component, mask = self._unpack_setpoint(
                frame.payload
            )
            if system in self._systems and component in self._components:
                self.setpoint_ms = time_ms
                self._on_attitude_target((q0, q1, q2, q3), thrust, mask, yaw_rate)
            else:
                self.ignored += 1
            return
        handler = self._handlers.get(frame.message_id)
        own_echo = frame.system_id == self._system and frame.component_id == self._component
        if handler is None or own_echo:
            self.ignored += 1
            return
        handler(frame, decode_cold(frame))

    def send(self, message: Any) -> None:
        """Queue a pymavlink message."""
        self.replies.append(self._telemetry.pack(message, self._streams.next_sequence()))

    def send_status_text(self, severity: Severity, text: str) -> None:
        """Queue a STATUSTEXT."""
        self.send(mavlink.MAVLink_statustext_message(severity=int(severity), text=text.encode()[:50]))

    def send_parameter(self, parameter: WireParameter | None) -> None:
        """Queue a PARAM_VALUE; nothing for `None`."""
        if parameter is None:
            return
        message = mavlink.MAVLink_param_value_message(
            param_id=parameter.name.encode(),
            param_value=0.0,
            param_type=int(parameter.type),
            param_count=parameter.total,
            param_index=parameter.place & 0xFFFF,
        )
        frame = self._telemetry.pack(message, self._streams.next_sequence())
        body = frame[1:HEADER_BYTES] + parameter.raw + frame[HEADER_BYTES + 4 : -CRC_BYTES]
        crc = mcrf4xx(bytes([message.crc_extra]), mcrf4xx(body))
        self.replies.append(frame[:1] + body + crc.to_bytes(CRC_BYTES, "little"))

    def send_logs(self, now_us: int) -> None:
        """Queue the next burst of a log, if its time has come."""

        def pack(message: Any) -> bytes:
            return self._telemetry.pack(message, self._streams.next_sequence())

        def encode(*values: int) -> bytes:
            return self._encode_log_data(self._streams.next_sequence(), *values)

        self.replies += self.logs.send(now_us, pack, encode)

    # --- services ---------------------------------------------------------------------------------------------------

    def for_us(self, message: Any) -> bool:
        """Whether a message is for this autopilot; counted in `ignored` if not."""
        ours = message.target_system == self._system and message.target_component in (self._component, ANY)
        self.ignored += not ours
        return ours

    def _heartbeat(self, _: Frame, message: Any) -> None:
        if message.type == mavlink.MAV_TYPE_GCS:
            self.ground_station_seen = True
        elif message.type == mavlink.MAV_TYPE_ONBOARD_CONTROLLER:
            self._autopilot.on_companion_heartbeat()

    def _ping(self, frame: Frame, message: Any) -> None:
        if message.target_system == ANY and message.target_component == ANY:
            self.send(
                mavlink.MAVLink_ping_message(
                    time_usec=message.time_usec,
                    seq=message.seq,
                    target_system=frame.system_id,
                    target_component=frame.component_id,
                )
            )

    def _timesync(self, _: Frame, message: Any) -> None:
        if message.tc1 == 0:
            self.replies.append(self._telemetry.timesync_reply(self._streams.next_sequence(), message.ts1))

    def _position_target(self, _: Frame, message: Any) -> None:
        """A set-point by position, with its velocity and acceleration where they are not ignored; the plant flies no
        other."""
        ours = message.target_system in self._systems and message.target_component in self._components
        mask = message.type_mask
        if not ours or message.coordinate_frame != mavlink.MAV_FRAME_LOCAL_NED or mask & _POSITION_IGNORE:
            self.ignored += 1
            return
        still = (0.0, 0.0, 0.0)
        self._autopilot.on_position_target(
            PositionControlSetpoint(
                (message.x, message.y, message.z),
                still if mask & _VELOCITY_IGNORE else (message.vx, message.vy, message.vz),
                still if mask & _ACCELERATION_IGNORE else (message.afx, message.afy, message.afz),
            ),
            None if mask & mavlink.POSITION_TARGET_TYPEMASK_YAW_IGNORE else message.yaw,
        )

    def _file_transfer(self, frame: Frame, message: Any) -> None:
        if self.for_us(message):
            payload = self._files.answer(bytes(message.payload), self._autopilot.time_us)
            self.send(
                mavlink.MAVLink_file_transfer_protocol_message(0, frame.system_id, frame.component_id, list(payload))
            )

    def _param_read(self, frame: Frame, message: Any) -> None:
        if self.for_us(message):
            parameters = self._autopilot.parameters
            by_name = message.param_index < 0
            found = parameters.wire(message.param_id) if by_name else parameters.wire_at(message.param_index)
            self.send_parameter(found)
            if found is None and self._autopilot.parameters.version is not Px4Version.V1_17:  # which is silent
                error = mavlink.MAV_PARAM_ERROR_DOES_NOT_EXIST
                place = -1 if by_name else message.param_index
                name = message.param_id.encode() if by_name else b""
                self.send(mavlink.MAVLink_param_error_message(frame.system_id, frame.component_id, name, place, error))

    def _param_list(self, _: Frame, message: Any) -> None:
        if self.for_us(message):
            parameters = self._autopilot.parameters
            self.send_parameter(parameters.wire(HASH_NAME))
            for name in parameters:
                self.send_parameter(parameters.wire(name))

    def _param_set(self, frame: Frame, message: Any) -> None:
        if self.for_us(message):
            raw = frame.payload[:4].ljust(4, b"\0")
            stored = self._autopilot.parameters.set_wire(message.param_id, raw, message.param_type)
            if stored is not None:
                self.send_parameter(stored)
                self.changed.append(stored)

    def _setup_signing(self, _: Frame, message: Any) -> None:
        """A key of zeros ends signing; where it is on, only what is signed comes this far.

        Source: `mavlink_main.cpp`, `mavlink_sign_control.cpp` of v1.18.
        """
        if not self.for_us(message):
            return
        if self._autopilot.commander.armed:
            self._autopilot.notices.append(Notice(Severity.CRITICAL, "MAVLink signing: rejected while armed"))
            return
        key = bytes(message.secret_key)
        blank = not any(key) and message.initial_timestamp == 0
        self.new_signing_key = b"" if blank else key
        text = "MAVLink signing disabled" if blank else "MAVLink signing key accepted"
        self._autopilot.notices.append(Notice(Severity.INFO, text))

    def _mission_list(self, frame: Frame, message: Any) -> None:
        if self.for_us(message):
            self.send(
                mavlink.MAVLink_mission_count_message(
                    target_system=frame.system_id,
                    target_component=frame.component_id,
                    count=0,
                    mission_type=message.mission_type,
                )
            )

    def _mission_count(self, frame: Frame, message: Any) -> None:
        if self.for_us(message):
            kind = mavlink.MAV_MISSION_ACCEPTED if message.count == 0 else mavlink.MAV_MISSION_NO_SPACE
            self._mission_ack(frame, message, kind)

    def _mission_clear(self, frame: Frame, message: Any) -> None:
        if self.for_us(message):
            self._mission_ack(frame, message, mavlink.MAV_MISSION_ACCEPTED)

    def _mission_ack(self, frame: Frame, message: Any, kind: int) -> None:
        self.send(
            mavlink.MAVLink_mission_ack_message(
                target_system=frame.system_id,
                target_component=frame.component_id,
                type=kind,
                mission_type=message.mission_type,
            )
        )
