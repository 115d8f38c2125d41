"""What a page shows of one flight, whatever it was read from."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy.typing as npt

Array = npt.NDArray[Any]

MEASURED, MEASURED_Y, WANTED, REFERENCE, IDEAL = "measured", "measured-y", "wanted", "reference", "ideal"  # colours
BAND = "band"


class Series(NamedTuple):
    """One line: its name with the unit left to the panel, the meaning its colour stands for, values of shape (n,)."""

    label: str
    role: str
    values: Array


class Limit(NamedTuple):
    """A horizontal line that is not to be crossed."""

    label: str
    value: float


class Panel(NamedTuple):
    """Quantities of one unit over one time base, seconds from `Report.zero`.

    `kind`: "lines", or "heat" for shares of limits. `band`: places in `series` of its upper and lower edge.
    """

    id: str
    title: str
    unit: str
    time_s: Array
    series: tuple[Series, ...]
    limits: tuple[Limit, ...] = ()
    band: tuple[int, int] | None = None
    kind: str = "lines"


class Happened(NamedTuple):
    """An event, seconds from `Report.zero`."""

    time_s: float
    name: str
    detail: str


class Nearness(NamedTuple):
    """How near a guard came to its limit: the largest share of it (1 is at it), when, the value then and the limit."""

    guard: str
    share: float
    time_s: float
    value: float
    limit: float
    unit: str


class Path3(NamedTuple):
    """For the replay: shape (n,), and (n, 3) in NED, m; the thrust axis is minus body z in NED; (n, 3)."""

    time_s: Array
    position_ned_m: Array
    wanted_ned_m: Array
    up_ned: Array


class Report(NamedTuple):
    """One flight. `verdict`: paragraphs of (heading, lines); `facts`: for the comparison, (name, value, unit).

    `zero`: in words, from where its time counts.
    """

    name: str
    kind: str
    verdict: tuple[tuple[str, tuple[str, ...]], ...]
    facts: tuple[tuple[str, float, str], ...]
    panels: tuple[Panel, ...]
    path: Path3 | None
    events: tuple[Happened, ...]
    guards: tuple[Nearness, ...] = ()
    missing: tuple[str, ...] = ()
    zero: str = "where control began"
