"""An autopilot on its wires: simulated time moves, what falls due on the way is sent, what has come is answered.

When time moves is decided elsewhere: `sitl.wire.realtime` keeps up with the wall clock, `sitl.wire.lockstep` waits for
the companion.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from sitl.autopilot.autopilot import Autopilot
from sitl.messages.log_card import GrowingLog, Log, LogFile
from sitl.messages.services import Services
from sitl.messages.streams import Profile, Streams
from sitl.messages.telemetry import Telemetry
from sitl.wire.ports import Port
from sitl.wire.signed_port import SignedPort
from sitl.wire.wire import Channels, Wire

FIXED_EPOCH_US: Final = 1_700_000_000_000_000  # where SYSTEM_TIME must not depend on the day


class Plant:
    """An autopilot and the wires that it is heard on.

    Args:
        epoch_us: what SYSTEM_TIME says at simulated time zero.
        logs: what LOG_REQUEST_LIST finds.
    Attributes: `odometry_sent` on all wires.
    """

    def __init__(self, autopilot: Autopilot, epoch_us: int, logs: Sequence[LogFile] = ()) -> None:
        self.autopilot = autopilot
        self.wires: list[Wire] = []
        self.odometry_sent = 0
        self._epoch_us = epoch_us
        self._logs: list[Log] = list(logs)
        self._writing: GrowingLog | None = None

    def add(self, port: Port, profile: Profile, channels: Channels | None = None) -> Wire:
        """One more wire. `channels`: what its frames meet on their way."""
        autopilot = self.autopilot
        system_id = autopilot.parameters.integer("MAV_SYS_ID")
        component_id = autopilot.parameters.integer("MAV_COMP_ID")
        telemetry = Telemetry(autopilot, system_id, component_id, self._epoch_us)
        streams = Streams(telemetry, profile, autopilot.time_us)
        services = Services(autopilot, telemetry, streams, system_id, component_id, self._logs)
        wire = Wire(port, streams, services, channels)
        for other in self.wires:
            other.neighbours.append(wire)
            wire.neighbours.append(other)
        self.wires.append(wire)
        return wire

    def advance(self, to_us: int) -> None:
        """Move simulated time, sending what falls due on the way at its own time, ODOMETRY after the others."""
        autopilot, wires = self.autopilot, self.wires
        outgoing: list[list[bytes]] = [[] for _ in wires]
        while True:
            due = min([wire.due_us for wire in wires])
            if due > to_us:
                break
            autopilot.advance(due)
            for wire, frames in zip(wires, outgoing, strict=True):
                streams = wire.streams
                streams.others(due, frames)
                if streams.odometry_due_us <= due:
                    self.odometry_sent += streams.odometry(due, frames)
                if wire.channels is not None:
                    wire.send_due(frames, due)
                    frames.clear()
        autopilot.advance(to_us)
        if autopilot.commander.armed is not (self._writing is not None):
            self._log()
        if autopilot.notices:
            self.send_notices()
        for wire, frames in zip(wires, outgoing, strict=True):
            if frames:
                wire.send(frames, to_us)
            if wire.channels is not None:
                wire.push()
            if wire.services.logs.sending:
                wire.services.send_logs(to_us)
                wire.flush(to_us)

    def _log(self) -> None:
        """Armed, a log is begun: the first of the directory, so that the others' ids move. Disarmed, it is whole."""
        if self._writing is None:
            self._writing = GrowingLog(self.autopilot.now_us, self._epoch_us)
            self._logs.insert(0, self._writing)
            return
        whole = LogFile(self._writing.data, self._writing.time_utc_s)
        self._logs[:] = [whole if log is self._writing else log for log in self._logs]
        self._writing = None

    def receive_all(self, wires: Sequence[Wire] | None = None) -> None:
        """Take what has come on these wires, on all of them by default."""
        came = False
        for wire in wires or self.wires:
            while data := wire.port.receive():
                came = True
                wire.handle(data, self.autopilot.time_us)
                if wire.services.new_signing_key is not None:
                    self._sign(wire.services.new_signing_key)
                    wire.services.new_signing_key = None
        if came:
            self.send_notices()

    def _sign(self, key: bytes) -> None:
        """From here on every wire is signed by `key`, or none is where it has no bytes."""
        for wire in self.wires:
            bare = wire.port.bare if isinstance(wire.port, SignedPort) else wire.port
            wire.port = SignedPort(bare, key) if key else bare

    def send_notices(self) -> None:
        """Status texts to ground stations, parameters that one link changed to the others."""
        notices = self.autopilot.notices
        for wire in self.wires:
            if wire.services.ground_station_seen:
                for notice in notices:
                    wire.services.send_status_text(notice.severity, notice.text)
            for changed in wire.services.changed:
                for other in self.wires:
                    if other is not wire:
                        other.services.send_parameter(changed)
            wire.services.changed.clear()
        notices.clear()
        for wire in self.wires:
            wire.flush(self.autopilot.time_us)
