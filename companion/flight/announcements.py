"""What is told, and to whom: the log, the person at the terminal, the ground station."""

from __future__ import annotations

from collections.abc import Callable
from enum import Flag, auto

from companion.flight.host.clock import Clock
from companion.flight.vehicle_link.link import VehicleLink
from companion.record.recorder import EVENT, Recorder
from companion.record.schema import pack_event


class To(Flag):
    """Who is told."""

    LOG = auto()
    PERSON = auto()
    GROUND_STATION = auto()
    EVERYBODY = LOG | PERSON | GROUND_STATION


class Announcements:
    """Tells what happens in a flight. `print_line` takes a line for the person and never waits."""

    def __init__(self, recorder: Recorder, clock: Clock, link: VehicleLink, print_line: Callable[[str], None]) -> None:
        self._recorder = recorder
        self._clock = clock
        self._link = link
        self._print_line = print_line

    def announce(self, kind: str, text: str, to: To = To.LOG, *, line: str | None = None) -> None:
        """Tell `text`, in the log as an event of that kind; `line` replaces it for person and ground station.

        The ground station is told in a STATUSTEXT, which holds 50 characters, the sender's name among them.
        """
        if To.LOG in to:
            self._recorder.add(EVENT, self._clock.time_us(), pack_event(kind, text))
        line = text if line is None else line
        if To.PERSON in to:
            self._print_line(line)
        if To.GROUND_STATION in to:
            self._link.warn(f"companion: {line}")
