"""The stretches of a log in which the attitude followed set-points, whoever made them, whatever their shape."""

from __future__ import annotations

import itertools
from typing import Final

import numpy as np
import numpy.typing as npt
from scipy.interpolate import Akima1DInterpolator

from companion.identify.manoeuvres import GAP_S, LARGEST_RAD, SATURATED_SHARE, Manoeuvre, cut, saturated_share
from companion.identify.series import Floats, Recording

PIECE_S: Final = 5.0  # many times what the attitude and its disturbance remember: the pieces are nearly independent
_SETTLE_S: Final = 1.0  # after a mode was entered, or anything else that the response does not explain
_SHORTEST_S: Final = 2.5
_PERIOD_S: Final = 0.02  # of the samples fitted: the quickest response takes several
_SAMPLES: Final = 40  # of a piece; after averaging there are more than the disturbance's model remembers
_MOST: Final = 60  # pieces: those that move most, five minutes of them
_COUPLING_RAD_S: Final = np.radians(4.0)  # yaw rate times tilt: what a turn moves roll and pitch by, past the response
_TURN_S: Final = 0.3
_INTERPOLATED_S: Final = 0.015  # a log that keeps a set-point so seldom
_FINER: Final = 5
_WHITE: Final = 1.5**-0.5  # of the deviation of white noise from the mean of its neighbours


def stretches(recording: Recording, axis: str) -> list[Manoeuvre]:
    """Pieces of about `PIECE_S` without a gap, a limit, a quick turn, or an angle beyond the linear range, as flown."""
    spans = recording.following if recording.in_flight is None else recording.in_flight
    return [piece for start_s, end_s in spans for piece in _pieces(recording, axis, float(start_s), float(end_s))]


def liveliest(pieces: list[Manoeuvre]) -> list[Manoeuvre]:
    """The `_MOST` whose set-points move most, in the order flown: work is bounded by samples."""
    if len(pieces) <= _MOST:
        return pieces
    movement = [float(np.sum(np.diff(piece.setpoint_rad) ** 2)) for piece in pieces]
    return [pieces[i] for i in np.sort(np.argsort(movement)[-_MOST:])]


def alike(pieces: list[Manoeuvre]) -> list[Manoeuvre]:
    """Those sampled about as often as most: the model of the disturbance counts in samples."""
    periods_s = [float(np.median(np.diff(piece.time_s))) for piece in pieces]
    middle = float(np.median(periods_s)) if pieces else 0.0
    return [piece for piece, period_s in zip(pieces, periods_s, strict=True) if 0.8 < period_s / middle < 1.25]


def seldom(piece: Manoeuvre) -> bool:
    """Whether the log keeps set-points so seldom that they are samples of a curve rather than steps."""
    return piece.recording.lateness_s > _INTERPOLATED_S


def curves(piece: Manoeuvre) -> tuple[Manoeuvre, Manoeuvre]:
    """Set-points as two curves through the samples kept, smooth (Akima) and straight: what lies between is unknown.

    The smooth one is nearer to what sticks and controllers make; the difference of the two is how far it may be off.
    """
    time_s, setpoint_rad = piece.setpoint_time_s, piece.setpoint_rad
    if len(time_s) < 3:
        return piece, piece
    places = np.arange(len(time_s))
    edges_s = np.interp(np.arange(_FINER * (len(time_s) - 1) + 1) / _FINER, places, time_s)
    middles_s = 0.5 * (edges_s[:-1] + edges_s[1:])
    smooth, straight = Akima1DInterpolator(time_s, setpoint_rad)(middles_s), np.interp(middles_s, time_s, setpoint_rad)
    return (
        piece._replace(setpoint_time_s=edges_s[:-1], setpoint_rad=smooth),
        piece._replace(setpoint_time_s=edges_s[:-1], setpoint_rad=straight),
    )


def roughened(piece: Manoeuvre) -> Manoeuvre:
    """The smooth curve with as much again of what the log does not resolve: how far samples are off their neighbours.

    Taken backwards in time: of the same size and spectrum, and no echo of the set-points.
    """
    off = piece.setpoint_rad.copy()
    off[1:-1] -= 0.5 * (piece.setpoint_rad[:-2] + piece.setpoint_rad[2:])
    off[[0, -1]] = 0.0
    return curves(piece._replace(setpoint_rad=piece.setpoint_rad + _WHITE * off[::-1]))[0]


def _pieces(recording: Recording, axis: str, start_s: float, end_s: float) -> list[Manoeuvre]:
    good, at = [], start_s
    for a, b in _unusable(recording, start_s, end_s):
        good.append((at, a))
        at = max(at, b)
    good.append((at, end_s))
    found = []
    for a, b in good:
        first = a + _SETTLE_S
        if b - first < _SHORTEST_S:
            continue
        for p, q in itertools.pairwise(np.linspace(first, b, max(round((b - first) / PIECE_S), 1) + 1)):
            piece = _thinned(cut(recording, axis, float(p), float(q)))
            if len(piece.time_s) >= _SAMPLES and saturated_share(recording, p, q) <= SATURATED_SHARE:
                found.append(piece)
    return found


def _unusable(recording: Recording, start_s: float, end_s: float) -> list[tuple[float, float]]:
    """From when to when something else than the response shows, in order."""
    track = recording.track
    series = ((track.setpoint_time_s, GAP_S["set-points"]), (track.attitude_time_s, GAP_S["attitude"]))
    found = [gap for time_s, longest_s in series for gap in _gaps(time_s, start_s, end_s, longest_s)]
    inside = (track.setpoint_time_s >= start_s) & (track.setpoint_time_s < end_s)
    steep = (np.abs(track.setpoint_rad) > LARGEST_RAD).any(axis=1)
    time_s = track.setpoint_time_s[inside & (steep | _turns(recording))].tolist()
    return sorted(found + list(zip(time_s, time_s, strict=True)))


def _turns(recording: Recording) -> npt.NDArray[np.bool_]:
    """Where the heading set-point turns while the vehicle tilts, shape (n,).

    A turn takes the tilt from roll to pitch by itself, and the response has no part in it.
    """
    w, x, y, z = recording.setpoint_q.astype(np.float64).T
    yaw = np.unwrap(np.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z)))
    time_s = recording.track.setpoint_time_s
    rate = (np.interp(time_s, time_s, yaw) - np.interp(time_s - _TURN_S, time_s, yaw)) / _TURN_S
    return np.asarray(np.abs(rate) * np.hypot(*recording.track.setpoint_rad.T) > _COUPLING_RAD_S)


def _gaps(time_s: Floats, start_s: float, end_s: float, longest_s: float) -> list[tuple[float, float]]:
    """From when to when there was no sample for too long."""
    within = time_s[(time_s >= start_s) & (time_s <= end_s)]
    edges = np.concatenate([[start_s], within, [end_s]])
    return [(float(edges[i]), float(edges[i + 1])) for i in np.flatnonzero(np.diff(edges) > longest_s)]


def _thinned(piece: Manoeuvre) -> Manoeuvre:
    """Every so-manieth sample, so that they are about `_PERIOD_S` apart."""
    if len(piece.time_s) < 2:
        return piece
    every = max(round(_PERIOD_S / float(np.median(np.diff(piece.time_s)))), 1)
    return piece._replace(time_s=piece.time_s[::every], measured_rad=piece.measured_rad[::every])
