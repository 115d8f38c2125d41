"""A clock of ours that was set in flight: found and undone by the vehicle's own time, which nobody sets.

Between two records our clock runs on by as much as the vehicle's does. Where it jumps instead, and the difference of
both clocks before and after differs by the same, it was set; where the vehicle's time jumps as well, it is a gap.
"""

from __future__ import annotations

import itertools
from typing import Final

import numpy as np
import numpy.typing as npt

from companion.identify.series import Floats

_FORWARD_S: Final = 0.1  # between two records; less is no step that matters
_BACK_S: Final = 0.02
_LONE: Final = 3  # records with a time of their own that differs from all around them
_SAMPLES: Final = 20  # of the vehicle's time, on either side
_AGREE_S: Final = 0.1
_FAR_S: Final = 10.0  # from the first or the last records to all others


def undone(
    time_s: Floats, stamped: npt.NDArray[np.int64], stamps_s: Floats, notes: list[str]
) -> tuple[Floats, npt.NDArray[np.bool_]]:
    """Times of records without the steps of the clock, and which of them have a time that can be believed.

    Parameters
    ----------
    time_s
        Shape (n,), of all records, as recorded.
    stamped, stamps_s
        Shape (m,): which records carry the vehicle's time, in order, and that time.
    notes
        Takes a line for what was found.
    """
    edges = np.flatnonzero((np.diff(time_s) > _FORWARD_S) | (np.diff(time_s) < -_BACK_S)) + 1
    good = _not_alone(time_s, edges)
    if not good.all():
        notes.append(f"{(~good).sum()} of {len(time_s)} records dropped: their time is not that of those around them")
    kept, mended, steps = np.flatnonzero(good), time_s.copy(), list[tuple[float, float]]()
    jumps = np.diff(time_s[kept])
    stamped, difference = stamped[good[stamped]], (time_s[stamped] - stamps_s)[good[stamped]]
    for at in np.flatnonzero((jumps > _FORWARD_S) | (jumps < -_BACK_S)).tolist():
        first = int(kept[at + 1])
        middle = int(np.searchsorted(stamped, first))
        before, after = difference[max(middle - _SAMPLES, 0) : middle], difference[middle : middle + _SAMPLES]
        if not len(before) or not len(after):
            continue
        step = float(np.median(after) - np.median(before))
        if abs(step) > _FORWARD_S and abs(step - jumps[at]) < _AGREE_S:
            mended[first:] -= step
            steps.append((step, float(mended[first] - mended[kept[0]])))
    if steps:
        step, at_s = steps[0]
        more = f" and {len(steps) - 1} times more" if len(steps) > 1 else ""
        notes.append(
            f"our clock was set {'forward' if step > 0.0 else 'back'} by {abs(step):.2f} s at {at_s:.2f} s from the "
            f"first record{more}: undone by the vehicle's own time"
        )
    return mended, good


def _not_alone(time_s: Floats, edges: npt.NDArray[np.intp]) -> npt.NDArray[np.bool_]:
    """All but the few records between two jumps that lead back to where the time was."""
    good = np.ones(len(time_s), bool)
    bounds = [0, *edges.tolist(), len(time_s)]
    last_s: float | None = None
    for a, b in itertools.pairwise(bounds):
        following_s = time_s[b] if b < len(time_s) else None
        if b - a <= _LONE and len(bounds) > 2:
            if last_s is None:
                lone = following_s is not None and not 0.0 <= following_s - time_s[b - 1] <= _FAR_S
            elif following_s is None:
                lone = not 0.0 <= time_s[a] - last_s <= _FAR_S
            else:
                lone = not last_s <= time_s[a] <= following_s and -_BACK_S <= following_s - last_s <= 1.0
            if lone:
                good[a:b] = False
                continue
        last_s = float(time_s[b - 1])
    return good
