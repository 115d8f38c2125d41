"""Hostile inputs: noise, mutated real frames, frames forged in the name of others, replayed and missigned ones."""

from __future__ import annotations

import math
import random
from pathlib import Path

from companion.mavlink.codec import CRC_BYTES, Encoder, FrameParser, Layout, crc_extra, mcrf4xx
from companion.mavlink.signing import Signing

RECORDINGS = sorted((Path(__file__).resolve().parents[1] / "tests" / "data").glob("*.tlog"))
DATAGRAM_BYTES = 1400
FLOODS = {"foreign": 100_000.0, "steering": 30_000.0, "bad_signatures": 20_000.0}  # datagrams a second
TLOG_STAMP_BYTES = 8


def recorded() -> list[bytes]:
    """Frames of the recordings in tests/data, some of each message."""
    by_id: dict[int, list[bytes]] = {}
    for path in RECORDINGS:
        data = path.read_bytes()
        at = 0
        while (at := at + TLOG_STAMP_BYTES) < len(data):
            size = 12 + data[at + 1] + 13 * (data[at + 2] & 1)
            by_id.setdefault(int.from_bytes(data[at + 7 : at + 10], "little"), []).append(data[at : at + size])
            at += size
    return [frame for frames in by_id.values() for frame in frames[:: max(1, len(frames) // 40)]]


def with_crc(frame: bytearray) -> bytes:
    """The frame as if its content had always been so."""
    crc = mcrf4xx(bytes(frame[1:-CRC_BYTES]) + crc_extra(int.from_bytes(frame[7:10], "little")))
    return bytes(frame[:-CRC_BYTES]) + crc.to_bytes(2, "little")


class Attacker:
    """Makes hostile inputs.

    `genuine` are signed frames of the vehicle, to be replayed; none without a key. `attack`: `mixed`, `line` (with
    bursts of the byte that begins a frame), `replay`, or one of the floods.
    """

    def __init__(self, seed: int, genuine: list[bytes], attack: str = "mixed") -> None:
        self._random = random.Random(seed)
        self._frames = recorded()
        self._valid = [frame for frame in self._frames if FrameParser().feed(frame)]  # of messages the dialect knows
        self._genuine = genuine
        self._forger = Signing(bytes(31) + b"\x07", link_id=9)
        self._target = Encoder(Layout("SET_POSITION_TARGET_LOCAL_NED"), 250, 190)
        self._kinds = [self.noise, self.mutated, self.mutated, self.forged, self.forged, self.steered]
        if genuine:
            self._kinds += [self.replayed, self.replayed, self.unsigned, self.missigned]
        special = {
            "line": [*self._kinds, self.burst],
            "replay": [self.replayed],
            "foreign": [self.forged],
            "steering": [self.steered],
            "bad_signatures": [self.missigned],
        }
        self._kinds = special.get(attack, self._kinds)

    def one(self) -> bytes:
        return self._random.choice(self._kinds)()

    def noise(self) -> bytes:
        """Anything, often after the beginning of a frame."""
        chosen = self._random
        data = chosen.randbytes(chosen.randint(1, 60))
        return b"\xfd" + data if chosen.random() < 0.5 else data

    def burst(self) -> bytes:
        """As a line has it that something else disturbs."""
        return b"\xfd" * self._random.randint(130, 700)

    def mutated(self) -> bytes:
        """A real frame cut, spliced, or with some bits flipped; its CRC is not put right."""
        chosen, frame = self._random, bytearray(self._random.choice(self._frames))
        how = chosen.randrange(4)
        if how == 0:
            del frame[chosen.randrange(1, len(frame)) :]
        elif how == 1:
            frame[chosen.randrange(len(frame)) :] = chosen.choice(self._frames)[chosen.randrange(1, 12) :]
        else:
            for _ in range(chosen.randint(1, 8)):
                frame[chosen.randrange(1, len(frame))] ^= 1 << chosen.randrange(8)
        return bytes(frame) if bytes(frame) not in self._frames else bytes(frame[1:])

    def forged(self) -> bytes:
        """A valid frame of a system or component that is not the vehicle, with a payload of anything."""
        chosen, frame = self._random, bytearray(self._random.choice(self._valid))
        ids = (1, 1)
        while ids == (1, 1):
            ids = (chosen.choice([1, 1, 2, 255, chosen.randrange(1, 256)]), chosen.choice([1, 1, 191, 190, 240]))
        frame[5], frame[6] = ids
        if chosen.random() < 0.5:
            frame[10:-CRC_BYTES] = chosen.randbytes(len(frame) - 12)
        return with_crc(frame)

    def steered(self) -> bytes:
        """A live command of somebody who may steer, but never one that may be flown."""
        chosen = self._random
        x, y, z, yaw = (chosen.choice([math.nan, math.inf, -math.inf, 1e30, 77.0]) for _ in range(4))
        mask = chosen.choice([0x9F8, 0xDF8, 0, chosen.randrange(65536)])
        frame = self._target.encode(
            chosen.randrange(256), 0, x, y, z, *(0.0,) * 6, yaw, 0.0, mask, 1, 191, chosen.choice([1, 1, 1, 8])
        )
        return self._forger.sign(frame) if self._genuine and chosen.random() < 0.5 else frame

    def replayed(self) -> bytes:
        """A frame of the vehicle itself, a second time."""
        return self._random.choice(self._genuine)

    def unsigned(self) -> bytes:
        """A valid frame in the vehicle's name, without a signature."""
        frame = bytearray(self._random.choice(self._valid))
        frame[5], frame[6] = 1, 1
        return with_crc(frame)

    def missigned(self) -> bytes:
        """The same, signed by another key."""
        return self._forger.sign(self.unsigned())


def datagrams(attacker: Attacker, inputs: int) -> list[bytes]:
    """So many inputs, packed into datagrams; the last of each may begin a frame that never ends."""
    made, datagram = [], b""
    for _ in range(inputs):
        one = attacker.one()
        if len(datagram) + len(one) > DATAGRAM_BYTES:
            made.append(datagram)
            datagram = b""
        datagram += one
    return [*made, datagram]
