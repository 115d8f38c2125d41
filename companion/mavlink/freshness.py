"""Who holds the key now: a vehicle is believed once it has answered a question that nobody could know before.

A signature proves who made a frame and not when, and the protocol's own rule lets a stream begin that is up to a minute
old: a recording would be believed by a companion that has just started. So each link of the vehicle (system, component,
link id) begins with its answer to a TIMESYNC request whose `ts1` is a random number of ours: PX4 sends it back, signed
(`mavlink_timesync.cpp`, v1.17 and v1.18). From then on its stamps must grow, as the protocol has it. A vehicle whose
stamps are behind takes them from the request, which is signed too.

Others cannot be asked, since few ground stations answer. Their frames must be newer than this process, than all they
have said over any link before, and than what has been kept of an earlier run.

Source: https://mavlink.io/en/guide/message_signing.html and https://mavlink.io/en/services/timesync.html
"""

from __future__ import annotations

import secrets
from collections.abc import Callable, Mapping
from typing import Final

from companion.mavlink.codec import Frame, Layout
from companion.mavlink.signing import MINUTE, Signing, Stream

TIMESYNC: Final = Layout("TIMESYNC")
_HEARTBEAT: Final = Layout("HEARTBEAT").message_id
_OURS: Final = TIMESYNC.index("ts1")
_NONCE_BITS: Final = 62  # `ts1` is a signed number, and never zero
_NONCE_S: Final = 2.0  # one question for so long: a recording that asks for one in between does not spoil the last
_ASK_AGAIN_S: Final = 0.2  # once there is a vehicle
_ECHO: Final = MINUTE // 6  # ten seconds: what goes by our own name and is older is our own


class FreshSigning(Signing):
    """Signing for one who believes a single vehicle, and others only what they say now.

    `kept`: the newest stamps of streams as of an earlier run. Attributes, besides those of `Signing`: `unproven`, whole
    frames in the vehicle's name over a link that has not answered; `proven`, whether any link has; `wanted`, whether
    somebody is to be asked.
    """

    def __init__(
        self,
        key: bytes,
        vehicle: tuple[int, int],
        own: tuple[int, int],
        *,
        kept: Mapping[Stream, int] | None = None,
        clock: Callable[[], int] | None = None,
    ) -> None:
        super().__init__(key, clock=clock)
        self.unproven = 0
        self.proven = self.wanted = False
        self._vehicle, self._own = vehicle, own
        self._kept = dict(kept or {})
        self._stamp = self._began = max(self._clock(), *self._kept.values(), 0)
        self._newest: dict[tuple[int, int], int] = {}  # of those who are not the vehicle
        self._nonces: list[int] = []
        self._nonce_s = self._asked_s = 0.0

    @property
    def refused(self) -> int:
        """Frames that were not believed."""
        return super().refused + self.unproven

    def stamps(self) -> dict[Stream, int]:
        """The newest of each stream, to be kept for the next run."""
        own: Stream = (*self._own, self._link[0])
        return self._kept | self._streams | {own: self._stamp}

    def challenge(self, now_s: float) -> int | None:
        """A number for `ts1` of a TIMESYNC request, to be sent now to whoever was heard last; None for not now."""
        self.wanted = False
        if self.proven and now_s - self._asked_s < _ASK_AGAIN_S:
            return None
        self._asked_s = now_s
        if not self._nonces or now_s - self._nonce_s >= _NONCE_S:
            self._nonce_s = now_s
            self._nonces = [secrets.randbits(_NONCE_BITS) | 1, *self._nonces[:1]]
        return self._nonces[0]

    def _stale(self, stream: Stream, stamp: int) -> bool:
        sender = stream[:2]
        if sender == self._vehicle:
            return False  # its answer is what counts
        patience = _ECHO if sender == self._own else MINUTE
        return stamp <= self._newest.get(sender, self._began) or stamp + patience < max(self._stamp, self._clock())

    def _begins(self, stream: Stream, stamp: int, frame: Frame) -> bool:
        sender = stream[:2]
        if sender != self._vehicle:
            return True
        if self._answers(frame) and stamp > self._kept.get(stream, 0):
            self.proven = True
            return True
        self.unproven += 1
        self.wanted = self.wanted or frame.message_id == _HEARTBEAT
        return False

    def _remember(self, stream: Stream, stamp: int) -> None:
        if stream[:2] == self._vehicle:
            self._streams[stream] = stamp
        else:  # of whatever link: it is always looked at as if it began
            self._newest[stream[:2]] = stamp

    def _answers(self, frame: Frame) -> bool:
        return frame.message_id == TIMESYNC.message_id and TIMESYNC.unpack(frame.payload)[_OURS] in self._nonces
