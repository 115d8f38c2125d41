"""A flight folder back into arrays."""

from __future__ import annotations

import io
import struct
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from mcap.exceptions import McapError
from mcap.reader import make_reader
from zstandard import ZstdError

from companion.record import schema


class Event(NamedTuple):
    """A named event and when it happened."""

    time_s: float
    name: str
    detail: str


class Flight(NamedTuple):
    """What `flight.mcap` holds.

    `ticks` is a structured array, one row a tick, with the fields of `companion.record.schema`: shape (n,) for single
    values, (n, k) for vectors.
    """

    ticks: npt.NDArray[Any]
    events: list[Event]


def tick_dtype() -> np.dtype[Any]:
    """The tick record as a numpy type, CDR header left out."""
    floats: list[Any] = [(f.name, "<f8", (f.size,)) if f.size > 1 else (f.name, "<f8") for f in schema.FLOATS]
    return np.dtype(floats + [(f.name, "u1") for f in schema.FLAGS])


def read_flight(folder: Path) -> Flight:
    """Read `flight.mcap` of a flight folder. Raises `OSError` or `ValueError` with a one-line reason."""
    path = folder / "flight.mcap"
    ticks: list[bytes] = []
    events: list[Event] = []
    try:
        data = io.BytesIO(path.read_bytes())  # whose only errors are those of its content
        for _, channel, message in make_reader(data, validate_crcs=True).iter_messages(log_time_order=False):
            if channel.topic == schema.TICK_TOPIC:
                ticks.append(message.data[len(schema.CDR_HEADER) :])
            elif channel.topic == schema.EVENT_TOPIC:
                events.append(Event(message.log_time * 1e-9, *schema.unpack_event(message.data)))
    except (McapError, ZstdError, KeyError, struct.error, MemoryError, OverflowError) as error:
        raise ValueError(f"{path}: not a readable flight log ({error})") from None
    return Flight(np.frombuffer(b"".join(ticks), dtype=tick_dtype()), events)
