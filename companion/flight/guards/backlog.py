"""What was queued while this process did not run is old: it may end control, but begins nothing and asks for nothing.

The process was stopped, the computer slept, or it was busy. Meanwhile the vehicle went on, and PX4 may have acted on
the silence (COM_OF_LOSS_T, 1 s); the queue still says otherwise. A sample of the odometry tells how far the queue has
been heard: its time stamp must have moved on as far as our clock has.
"""

from __future__ import annotations

import math
from typing import Final

PAUSE_S: Final = 0.1  # between two turns of the loop, which waits 0.02 s and ticks in less
_SLACK_S: Final = 0.02  # one sample may come later than another
_DRIFT: Final = 0.05  # share by which the vehicle's clock may differ from what is known of it
_PATIENCE_S: Final = 2.0  # after which no queue is left, whatever the clocks say


class Backlog:
    """Attribute: `waiting`, whether what comes may still be from before the process ran again."""

    def __init__(self) -> None:
        self.waiting = False
        self._late_s = math.inf
        self._woke_s = 0.0
        self._caught_up = False
        self._heard_s = self._sample_s = math.nan

    def turn(self, now_s: float, heard_s: float, sample_s: float) -> float:
        """A turn of the loop begins. Returns for how long the process did not run, 0 where it did.

        `heard_s`, when the newest sample was heard that was not old, and `sample_s`, its time stamp; NaN without one.
        """
        late_s, self._late_s = self._late_s, now_s + PAUSE_S
        if now_s > late_s:
            self._caught_up = False
            if not self.waiting:
                self.waiting = True
                self._heard_s, self._sample_s = heard_s, sample_s
            self._woke_s = now_s
            return now_s - late_s + PAUSE_S
        if self._caught_up:  # what came together with that sample may be older than it
            self.waiting = self._caught_up = False
        return 0.0

    def is_old(self, sample_s: float, now_s: float, clock_rate: float) -> bool:
        """Whether a sample that is heard now was queued; to be asked while `waiting`.

        `clock_rate`: seconds of the vehicle in one of ours, NaN where that is not known.
        """
        passed_s = now_s - self._heard_s
        expected_s = passed_s if math.isnan(clock_rate) else passed_s * clock_rate
        behind_s = expected_s - (sample_s - self._sample_s)
        if behind_s > _SLACK_S + _DRIFT * passed_s and now_s - self._woke_s < _PATIENCE_S:
            return True
        self._caught_up = True
        return False
