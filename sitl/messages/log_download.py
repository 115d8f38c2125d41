"""The vehicle's logs on one link, as PX4 serves them (`mavlink/mavlink_log_handler.cpp`).

Every 10 ms at most, and then as one burst, whatever was asked for: on UDP PX4 knows no free buffer, so that a large
request fills the receiver's socket before its reader wakes up. Data is served only once the logs have been listed, no
request is checked for its target, an empty card and an unknown log are answered with silence, a request for no bytes
with one packet, and the order of the list is the directory's, not that of time. A log that is being written is listed
with the size of the moment and served as far as it has come. Each request for the list has the card looked through
anew, and none of it comes before that is done; what has been asked meanwhile begins it again. LOG_ERASE is not obeyed
while armed: here the plant is kinder than PX4, which deletes.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final

from pymavlink.dialects.v20 import development as mavlink

from companion.mavlink.codec import Layout
from sitl.messages.log_card import Log

DATA_BYTES: Final = 90
LOG_DATA: Final = Layout("LOG_DATA")

_SEND_INTERVAL_US: Final = 10_000
_BURST_BYTES: Final = 256 * 1024
_PACKET_BYTES: Final = 12 + 97  # PX4 counts frame and payload

Encode = Callable[..., bytes]


class LogDownload:
    """What one link answers about the logs.

    Attributes: `logs` of the vehicle, in the order of its directory; `sending` whether there is something to send.
    """

    def __init__(self, logs: list[Log]) -> None:
        self.logs = logs  # shared by the links: erased on one, they are gone on all
        self._listed = False
        self._list_next: int | None = None
        self._log: bytes = b""
        self._id = 0
        self._offset = self._end = 0
        self._next_us = 0
        self._seek = False  # the card is to be looked through

    @property
    def sending(self) -> bool:
        """Whether a list or data is on its way."""
        return self._list_next is not None or self._offset < self._end

    def request_list(self, message: Any) -> None:
        """LOG_REQUEST_LIST. PX4 takes no notice of `end`."""
        self._listed = True
        self._end = self._offset
        self._list_next = message.start if message.start < len(self.logs) else None
        self._seek = True

    def request_data(self, message: Any) -> None:
        """LOG_REQUEST_DATA: a new one takes the place of the last."""
        self._list_next = None
        self._end = self._offset
        if not self._listed or message.id >= len(self.logs):
            return
        log = self.logs[message.id].data
        if message.ofs < len(log):
            self._log, self._id = log, message.id
            self._offset, self._end = message.ofs, min(message.ofs + max(message.count, 1), len(log))

    def request_end(self, _: Any) -> None:
        """LOG_REQUEST_END."""
        self._list_next, self._end = None, self._offset

    def erase(self, *, armed: bool) -> None:
        """LOG_ERASE, unless armed."""
        if not armed:
            self.request_end(None)
            self.logs.clear()

    def send(self, now_us: int, pack: Callable[[Any], bytes], encode_data: Encode) -> list[bytes]:
        """The frames of one burst; none before its time. `pack` frames a message, `encode_data` takes wire values."""
        if now_us < self._next_us and not self._seek:
            return []
        self._next_us = now_us + _SEND_INTERVAL_US
        if self._list_next is not None and self._seek:
            self._seek = False
            self._next_us = now_us + max(round(1e6 * sum(log.seek_s for log in self.logs)), _SEND_INTERVAL_US)
            return []
        if self._list_next is not None:
            first, self._list_next = self._list_next, None
            return [pack(self._entry(index)) for index in range(first, len(self.logs)) if self.logs[index].told]
        frames = []
        budget = _BURST_BYTES
        while self._offset < self._end and budget > 0:
            # PX4 sends whole packets: what lies behind the end of the request comes along.
            chunk = self._log[self._offset : self._offset + DATA_BYTES]
            frames.append(encode_data(self._offset, self._id, len(chunk), *chunk.ljust(DATA_BYTES, b"\0")))
            self._offset += len(chunk)
            budget -= _PACKET_BYTES
        return frames

    def _entry(self, index: int) -> Any:
        log = self.logs[index]
        return mavlink.MAVLink_log_entry_message(
            id=index, num_logs=len(self.logs), last_log_num=len(self.logs), time_utc=log.time_utc_s, size=len(log.data)
        )
