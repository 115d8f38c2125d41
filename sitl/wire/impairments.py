"""What a radio does to frames on their way: delay, jitter, loss, bursts of it, copies, overtaking, flipped bits.

One `Channel` a direction, on simulated time. Frames are impaired one by one, as PX4 sends a datagram a message.
"""

from __future__ import annotations

import heapq
from random import Random
from typing import Final, NamedTuple

HEADER_BYTES: Final = 10
NEVER_US: Final = 1 << 62


class Impairments(NamedTuple):
    """How bad a direction is; probabilities are per frame.

    Frames keep their order under jitter, as on a queue; only `reordering` lets one be overtaken. Bursts follow the
    Gilbert-Elliott chain: from good to bad with `burst_begins`, back with `burst_ends`; in the bad state all is lost.
    """

    delay_s: float = 0.0
    jitter_s: float = 0.0  # uniform, on top of the delay
    loss: float = 0.0
    burst_begins: float = 0.0
    burst_ends: float = 1.0
    duplication: float = 0.0
    reordering: float = 0.0
    overtaken_by_s: float = 0.02  # how much later a frame arrives that is overtaken
    corruption: float = 0.0  # one to eight flipped bits


NOTHING: Final = Impairments()

Delivery = tuple[bytes, bool]
"""A frame that arrives, and whether it is intact."""


class Channel:
    """One direction of a link. `put` frames in, ask what has `arrived`.

    Attributes: `impairments`, replaced as a whole; `muted`, ids of messages that get lost, all of them where it holds
    `ALL`; `keep_one_in`, how many of a message's frames there are to one that passes; `lost`, `corrupted` so far;
    `due_us`, when the next frame arrives.
    """

    ALL: Final = -1

    def __init__(self, random: Random, impairments: Impairments | None = None) -> None:
        self._random = random
        self._queue: list[tuple[int, int, bytes, bool]] = []
        self._count = 0
        self._last_us = 0
        self._bad = False
        self._passed: dict[int, int] = {}
        self.due_us = NEVER_US
        self.impairments = impairments or NOTHING
        self.muted: set[int] = set()
        self.keep_one_in: dict[int, int] = {}
        self.lost = 0
        self.corrupted = 0

    @property
    def impairments(self) -> Impairments:
        """What happens to frames."""
        return self._impairments

    @impairments.setter
    def impairments(self, how: Impairments) -> None:
        self._impairments = how
        self._harmless = how == NOTHING

    @property
    def prompt(self) -> bool:
        """Whether nothing is on its way, and nothing takes any time."""
        how = self._impairments
        return not (self._queue or how.delay_s or how.jitter_s or how.reordering)

    @property
    def transparent(self) -> bool:
        """Whether nothing is on its way, and what is sent arrives at once as it is."""
        return self._harmless and not (self._queue or self.muted or self.keep_one_in)

    def pass_through(self, now_us: int) -> None:
        """Frames are sent past the queue, while it is transparent: what follows must not overtake them."""
        self._last_us = max(now_us, self._last_us)

    def put(self, frame: bytes, now_us: int) -> None:
        """One frame is sent."""
        if self._harmless and not (self.muted or self.keep_one_in):
            self._last_us = max(now_us, self._last_us)
            self._enqueue(self._last_us, frame, True)
            return
        how, chance = self._impairments, self._random.random
        if self._gets_lost(frame, how):
            self.lost += 1
            return
        copies = 1 + (how.duplication > 0.0 and chance() < how.duplication)
        for _ in range(copies):
            due = now_us + round(1e6 * (how.delay_s + (how.jitter_s * chance() if how.jitter_s else 0.0)))
            if how.reordering > 0.0 and chance() < how.reordering:
                due += round(1e6 * how.overtaken_by_s)
            else:
                due = self._last_us = max(due, self._last_us)
            intact = not (how.corruption > 0.0 and chance() < how.corruption)
            self._enqueue(due, frame if intact else self._corrupt(frame), intact)

    def _enqueue(self, due_us: int, frame: bytes, intact: bool) -> None:
        self._count += 1
        heapq.heappush(self._queue, (due_us, self._count, frame, intact))
        self.due_us = self._queue[0][0]

    def arrived(self, now_us: int) -> list[Delivery]:
        """What has arrived by now, in order of arrival."""
        deliveries: list[Delivery] = []
        if self.due_us > now_us:
            return deliveries
        queue = self._queue
        while queue and queue[0][0] <= now_us:
            _, _, frame, intact = heapq.heappop(queue)
            deliveries.append((frame, intact))
        self.due_us = queue[0][0] if queue else NEVER_US
        return deliveries

    def _gets_lost(self, frame: bytes, how: Impairments) -> bool:
        if how.burst_begins > 0.0:
            self._bad = (
                self._random.random() >= how.burst_ends if self._bad else self._random.random() < how.burst_begins
            )
            if self._bad:
                return True
        if how.loss > 0.0 and self._random.random() < how.loss:
            return True
        if not self.muted and not self.keep_one_in:
            return False
        number = int.from_bytes(frame[7:HEADER_BYTES], "little")
        if self.ALL in self.muted or number in self.muted:
            return True
        one_in = self.keep_one_in.get(number)
        if one_in is None:
            return False
        self._passed[number] = passed = self._passed.get(number, -1) + 1
        return passed % one_in != 0

    def _corrupt(self, frame: bytes) -> bytes:
        self.corrupted += 1
        broken = bytearray(frame)
        for place in self._random.sample(range(8 * len(broken)), self._random.randint(1, 8)):  # distinct: never undone
            broken[place >> 3] ^= 1 << (place & 7)
        return bytes(broken)
