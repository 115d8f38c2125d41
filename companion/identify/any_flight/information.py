"""The response of an axis from whatever was flown, if it tells enough: judged by its information, not by its shape."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np

from companion.attitude_response.kinds import MODELS
from companion.identify.any_flight.prediction_error import fit_by_prediction
from companion.identify.any_flight.stretches import PIECE_S, alike, liveliest, stretches
from companion.identify.fit import ModelFit
from companion.identify.manoeuvres import FLY, Manoeuvre
from companion.identify.series import Floats, LogError, Recording

FEWEST: Final = 10  # pieces: their scatter is known to a quarter then
LEAST_MOVEMENT_RAD: Final = np.radians(0.3)  # of the set-point, RMS about its mean: less, and dead bands answer
WIDEST: Final = 0.4  # half of an interval over the value: beyond it a value is hardly told from another
WIDEST_DELAY_S: Final = 0.04
_PLAINLY: Final = 2.0  # standard errors


class Informed(NamedTuple):
    """Models fitted to pieces of one axis, and the one chosen."""

    chosen: ModelFit
    models: dict[str, ModelFit]
    pieces: list[Manoeuvre]


def by_information(axis: str, recordings: Sequence[Recording], where: str, too_few: str) -> Informed:
    """Fit all that was flown in an axis.

    Parameters
    ----------
    axis, recordings
        "roll" or "pitch", and the logs.
    where, too_few
        Names of the logs, and why there were no doublets to fit, for the message.

    Raises
    ------
    LogError
        Where that tells too little: how much is missing, and what to fly.
    """
    pieces = liveliest(alike([piece for recording in recordings for piece in stretches(recording, axis)]))
    moved = max((_movement(piece) for piece in pieces), default=0.0)
    if moved < LEAST_MOVEMENT_RAD:
        raise LogError(too_few)
    if len(pieces) < FEWEST:
        raise LogError(
            f"{where}: not enough information in {axis}: {sum(m.end_s - m.start_s for m in pieces):.0f} s of flight "
            f"without a gap, a limit, a quick turn or a tilt beyond 35 deg, {FEWEST * PIECE_S:.0f} s are wanted: fly "
            f"longer, or {FLY.format(axis)}"
        )
    fitted = {model.name: fit_by_prediction(model, pieces) for model in MODELS}
    chosen = _choose(fitted)
    _check_enough(axis, chosen, pieces, where)
    return Informed(chosen, {name: fit for name, (fit, _) in fitted.items()}, pieces)


def _choose(fitted: dict[str, tuple[ModelFit, Floats]]) -> ModelFit:
    """The simplest model that predicts pieces it has not seen no plainly worse than the best does."""
    best = min((unseen for _, unseen in fitted.values()), key=lambda unseen: float(unseen.sum()))
    for fit, unseen in fitted.values():
        worse = unseen - best
        if worse.mean() <= _PLAINLY * worse.std(ddof=1) / math.sqrt(len(worse)):
            return fit
    raise AssertionError("the best is no worse than itself")


def _check_enough(axis: str, fit: ModelFit, pieces: Sequence[Manoeuvre], where: str) -> None:
    """Raise `LogError` for a parameter that is known too badly; the interval shrinks with the root of what is flown."""
    worst, what = 0.0, ""
    for parameter, value, (_, high) in zip(fit.model.described, fit.values, fit.interval_95, strict=True):
        half, relative = high - value, parameter.unit != "s"
        share = half / (WIDEST * value if relative else WIDEST_DELAY_S)
        if not share <= worst:
            known = f"{100 * half / value:.0f} %" if relative else f"{1e3 * half:.0f} ms"
            most = f"{100 * WIDEST:.0f} %" if relative else f"{1e3 * WIDEST_DELAY_S:.0f} ms"
            worst, what = share, f"{parameter.key} is known to ± {known} only, ± {most} is wanted"
    if not worst <= 1.0:
        flown_s = len(pieces) * PIECE_S
        raise LogError(
            f"{where}: not enough information in {axis}: {what} (95 %, from {flown_s:.0f} s of flight): about "
            f"{worst**2:.1f} times as much of the same, or {FLY.format(axis)}"
        )


def _movement(piece: Manoeuvre) -> float:
    inside = piece.setpoint_rad[piece.setpoint_time_s >= piece.start_s]
    return float(inside.std()) if len(inside) else 0.0
