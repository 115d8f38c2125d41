"""How old what we hear is, and how late what we say: the delay and the jitter of the link.

A TIMESYNC request carries our time in `ts1` and zero in `tc1`; PX4 sends `ts1` back with its own time in `tc1`
(`mavlink_timesync.cpp`), which makes a round trip: the delay that the link adds between an attitude and the answer to
it. PX4's own requests (`tc1` zero) are left unanswered: it would use the offset for the time stamps of what we send,
and it believes none of ours.

Jitter is lateness: how much older than the youngest a sample is when it comes, and how much longer than the shortest a
round trip takes. Where time is the samples' own (lockstep) only the second can be seen. A vehicle whose clock runs slow
- a simulated PX4 on a busy machine, or one that was told to be slow - sends samples that seem to grow old: how fast its
clock runs is in the answers, and is not counted as lateness.

Source: https://mavlink.io/en/services/timesync.html
"""

from __future__ import annotations

import math
from collections import deque
from typing import Any, Final

from pymavlink.dialects.v20 import development as mavlink

from companion.mavlink.codec import Frame, Layout

TIMESYNC: Final = Layout("TIMESYNC")
INTERVAL_S: Final = 0.2

_THEIRS: Final = TIMESYNC.index("tc1")
_OURS: Final = TIMESYNC.index("ts1")
_KEPT: Final = 50  # requests that may still be answered: ten seconds of them
_SMOOTH: Final = 0.5  # of a new round trip in the delay
_CREEP: Final = 0.05  # seconds a second by which the least is forgotten
_CLOCK_ANSWERS: Final = 11  # two seconds of them: over these the vehicle's clock is set beside ours
_LEAST_CLOCK_S: Final = 0.6
_PUNCTUAL_S: Final = 0.02  # an answer later than this says little about a clock
_PLAUSIBLE: Final = 2.0  # times slower or faster than ours: anything else is no clock
_FADE_S: Final = 0.5  # in which a lateness is forgotten


class LinkDelay:
    """Round trips and lateness of one link.

    Attributes: `round_trip_s`, smoothed; `jitter_s`, the lateness of the last half second; NaN until known, the first
    again once it is forgotten; `clock_rate`, seconds of the vehicle in a second of ours, NaN until known.
    """

    def __init__(self) -> None:
        self._sent: deque[int] = deque(maxlen=_KEPT)
        self._least_lag_s = self._least_trip_s = math.inf
        self._at_s = -math.inf
        self._answered_s = -math.inf
        self._clocks: deque[tuple[float, float]] = deque(maxlen=_CLOCK_ANSWERS)  # ours, theirs
        self.clock_rate = math.nan
        self.round_trip_s = math.nan
        self.jitter_s = math.nan

    def request(self, now_s: float) -> Any:
        """A TIMESYNC request to send now."""
        self._sent.append(round(now_s * 1e9) or 1)
        return mavlink.MAVLink_timesync_message(0, self._sent[-1])

    def answered(self, frame: Frame, now_s: float) -> None:
        """A TIMESYNC of the vehicle: an answer to a request of ours, or a request of its own, which is left alone."""
        values = TIMESYNC.unpack(frame.payload)
        if values[_THEIRS] == 0 or values[_OURS] not in self._sent:
            return
        self._sent.remove(values[_OURS])  # a copy of the answer says nothing new
        self._answered_s = now_s
        trip_s = now_s - values[_OURS] * 1e-9
        before_s = trip_s if math.isnan(self.round_trip_s) else self.round_trip_s
        self.round_trip_s = before_s + _SMOOTH * (trip_s - before_s)
        self._least_trip_s = min(trip_s, self._least_trip_s + _CREEP * INTERVAL_S)
        self._late(trip_s - self._least_trip_s, now_s)
        if trip_s - self._least_trip_s <= _PUNCTUAL_S:
            self._compare_clocks(now_s - 0.5 * trip_s, values[_THEIRS] * 1e-9)

    def heard(self, sample_s: float, now_s: float) -> None:
        """A sample of that time stamp came now."""
        lag_s = now_s - sample_s
        passed_s = max(now_s - self._at_s, 0.0) if self._least_lag_s < math.inf else 0.0
        slow = 0.0 if math.isnan(self.clock_rate) else max(1.0 - self.clock_rate, 0.0)
        self._least_lag_s = min(lag_s, self._least_lag_s + (_CREEP + slow) * passed_s)
        self._late(lag_s - self._least_lag_s, now_s)

    def forget(self, before_s: float) -> None:
        """What has not been answered since then is not known any more."""
        if self._answered_s < before_s:
            self.round_trip_s = math.nan

    def restart(self) -> None:
        """The vehicle's clock began anew."""
        self._least_lag_s = math.inf
        self._clocks.clear()
        self.clock_rate = math.nan

    def _compare_clocks(self, ours_s: float, theirs_s: float) -> None:
        """One reading of both clocks, as well as half a round trip tells."""
        self._clocks.append((ours_s, theirs_s))
        began_s, theirs_began_s = self._clocks[0]
        passed_s = ours_s - began_s
        if passed_s >= _LEAST_CLOCK_S:
            rate = (theirs_s - theirs_began_s) / passed_s
            self.clock_rate = rate if 1.0 / _PLAUSIBLE <= rate <= _PLAUSIBLE else math.nan

    def _late(self, late_s: float, now_s: float) -> None:
        """Keep the worst, fading."""
        passed_s = max(now_s - self._at_s, 0.0)
        self._at_s = max(now_s, self._at_s)
        kept_s = 0.0 if math.isnan(self.jitter_s) else self.jitter_s / (1.0 + passed_s / _FADE_S)
        self.jitter_s = max(late_s, kept_s)
