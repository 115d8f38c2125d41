"""mavsdk 4 for what is not flying: firmware version and health, over our own link.

It is attached to our bytes by `raw://` and fed only what is not hot: a frame goes through its parser, its threads and
its callbacks, which at 250 Hz costs more than our whole tick. What it wants to send is put into a queue by its threads
and leaves through our link from ours. Never its `offboard` plugin, which resends the last set-point from a thread of
its own, and never `arm_force`; nor its `param`, which waits for 3 s for each parameter that a vehicle lacks. Its
heartbeat, which a raw connection cannot be told to do without, is dropped: the vehicle knows the companion by one
heartbeat, the flying process's, and must not miss a tool's when that has ended.
"""

from __future__ import annotations

import contextlib
import queue
import threading
import time
from collections.abc import Iterator
from typing import Any, Final, NamedTuple

from pymavlink.dialects.v20 import development as mavlink

from companion.errors import printable
from companion.mavlink.client import Client
from companion.mavlink.codec import HEADER_BYTES, Frame
from companion.mavlink.link import LinkError
from companion.mavlink.tool_server import COLD

_HEARTBEAT: Final = mavlink.MAVLINK_MSG_ID_HEARTBEAT.to_bytes(3, "little")
_MESSAGE_ID: Final = slice(7, HEADER_BYTES)
_SYSTEM_S: Final = 5.0
_HEALTH_S: Final = 4.0


class Firmware(NamedTuple):
    """AUTOPILOT_VERSION."""

    version: tuple[int, int, int]
    kind: str  # dev, alpha, beta, rc or release
    git_hash: str

    def __str__(self) -> str:
        commit = f" {self.git_hash[:8]}" if self.git_hash.strip("0") else ""
        return f"{'.'.join(map(str, self.version))} {self.kind}{commit}"


class Attachment:
    """mavsdk behind a byte queue: `feed` it frames, take what it wants to send from `outgoing`.

    Attributes: `suppressed` heartbeats of its own that were not sent.
    """

    def __init__(self, system_id: int, component_id: int) -> None:
        import mavsdk  # noqa: PLC0415 - native code that only this class needs

        mavsdk.log_subscribe(lambda *_: True)  # it writes to stdout, which is ours
        self.suppressed = 0
        self._queue: queue.SimpleQueue[bytes] = queue.SimpleQueue()
        self._mavsdk = mavsdk.Mavsdk(mavsdk.Configuration.create_manual(system_id, component_id, False))
        self._mavsdk.subscribe_raw_bytes_to_be_sent(self._put)
        result = self._mavsdk.add_any_connection("raw://")
        if result is not mavsdk.ConnectionResult.SUCCESS:
            self.close()
            raise LinkError(f"mavsdk: {result.name.lower()}")

    def feed(self, frames: list[Frame]) -> None:
        """Hand over what is not hot."""
        data = b"".join(frame.raw for frame in frames if frame.message_id in COLD)
        if data:
            self._mavsdk.pass_received_raw_bytes(data)

    def outgoing(self) -> Iterator[bytes]:
        """Frames to be sent, each once; heartbeats are left out."""
        with contextlib.suppress(queue.Empty):
            while True:
                frame = self._queue.get_nowait()
                if frame[_MESSAGE_ID] == _HEARTBEAT:
                    self.suppressed += 1
                else:
                    yield frame

    def system(self, timeout_s: float) -> Any | None:
        """The autopilot, once its heartbeat has been fed."""
        return self._mavsdk.first_autopilot(timeout_s)

    def close(self) -> None:
        """Stop its threads."""
        self._mavsdk.destroy()

    def _put(self, data: bytes) -> None:
        self._queue.put(data)


class Services:
    """The vehicle's services, for the length of a `with`. Raises `LinkError` where the link goes or nobody answers.

    A thread of ours carries the bytes, so that mavsdk's blocking calls can be made from any other.
    """

    def __init__(self, client: Client) -> None:
        self._client = client
        self._attachment = Attachment(*client.ids)
        self._stop = threading.Event()
        self._error: LinkError | None = None
        self._thread = threading.Thread(target=self._carry, name="services", daemon=True)
        self._system: Any = None
        self._plugins: dict[Any, Any] = {}

    def __enter__(self) -> Services:
        if self._client.heartbeat is not None:
            self._attachment.feed([self._client.heartbeat])  # the next is a second away
        self._thread.start()
        try:
            self._system = self._attachment.system(_SYSTEM_S)
            self._check()
            if self._system is None:
                raise LinkError(f"{self._client.name}: mavsdk found no autopilot")
        except BaseException:
            self.__exit__()
            raise
        return self

    def __exit__(self, *_: object) -> None:
        self._plugins.clear()
        self._stop.set()
        self._thread.join()
        self._attachment.close()

    @property
    def system(self) -> Any:
        """mavsdk's System, for its other plugins."""
        return self._system

    def firmware(self) -> Firmware:
        """The firmware's version."""
        from mavsdk.plugins.info import Info, InfoError  # noqa: PLC0415

        try:
            told = self._plugin(Info).get_version()
        except InfoError as error:
            raise LinkError(f"{self._client.name}: the vehicle does not tell its version ({error})") from None
        version = (told.flight_sw_major, told.flight_sw_minor, told.flight_sw_patch)
        kind = type(told).FlightSoftwareVersionType(told.flight_sw_version_type).name.lower()
        return Firmware(version, kind, printable(str(told.flight_sw_git_hash)))

    def health(self) -> dict[str, bool]:
        """What the vehicle says of its sensors, its estimate and whether it can be armed."""
        from mavsdk.plugins.telemetry import Telemetry  # noqa: PLC0415

        telemetry = self._plugin(Telemetry)
        until_s = time.monotonic() + _HEALTH_S
        while not telemetry.health_all_ok() and time.monotonic() < until_s:
            self._check()
            time.sleep(0.05)
        told = telemetry.health()
        names = {
            "gyroscope": told.is_gyrometer_calibration_ok,
            "accelerometer": told.is_accelerometer_calibration_ok,
            "magnetometer": told.is_magnetometer_calibration_ok,
            "local position": told.is_local_position_ok,
            "global position": told.is_global_position_ok,
            "home": told.is_home_position_ok,
            "armable": told.is_armable,
        }
        return {name: bool(good) for name, good in names.items()}

    def _plugin(self, kind: Any) -> Any:
        if kind not in self._plugins:
            self._plugins[kind] = kind(self._system)
        return self._plugins[kind]

    def _check(self) -> None:
        if self._error is not None:
            raise self._error

    def _carry(self) -> None:
        """Bytes both ways, until told to stop."""
        try:
            while not self._stop.is_set():
                self._attachment.feed(self._client.frames())
                for frame in self._attachment.outgoing():
                    self._client.forward(frame)
        except LinkError as error:
            self._error = error
