"""From logs to the attitude response per axis: models, intervals, and the vehicle's own delay apart from the link's."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
from scipy.stats import t as student

from companion.config.estimator import VelocityError
from companion.identify import clock
from companion.identify.any_flight.information import by_information
from companion.identify.estimator import velocity_error
from companion.identify.fit import CONFIDENCE, ModelFit, choose, fit_all, fit_delay, gain, opposed
from companion.identify.logs import read_log
from companion.identify.manoeuvres import FLY, Manoeuvre, TooFewManoeuvresError, cut, find, select
from companion.identify.reading.tuning import in_force
from companion.identify.series import AXES, OURS, ClockMap, LogError, Recording

LEAST_FIT: Final = 0.9
GAIN: Final = (0.8, 1.25)
MANOEUVRES: Final = "manoeuvres"
PREDICTION: Final = "prediction_error"


class DelaySplit(NamedTuple):
    """Where the delay of one axis is spent, s, each from the same manoeuvres and with the chosen model.

    Attributes
    ----------
    total_s
        Set-point sent to attitude received, our clock.
    vehicle_s
        Set-point in force to attitude, the vehicle's clock.
    link_s, link_95_s
        Both ways together: total less vehicle, and its interval.
    """

    total_s: float
    vehicle_s: float
    link_s: float
    link_95_s: tuple[float, float]


class AxisIdentification(NamedTuple):
    """The response of one axis.

    Attributes
    ----------
    chosen
        The model taken, by cross-validation.
    models
        All of them, by name.
    gain
        Slope of measured over modelled angle.
    manoeuvres
        What was fitted: doublets, or stretches of any flight.
    delay
        None where no log tells the link's share.
    lateness_s
        How much longer the delay may be than the log shows, see `Recording.lateness_s`.
    gains
        Parameters of the attitude loop in force at the manoeuvres.
    method
        `MANOEUVRES`: least squares on clean doublets, intervals by their repetition (`fit`). `PREDICTION`: any flight,
        with a model of what disturbs it (`prediction_error`).
    """

    chosen: ModelFit
    models: dict[str, ModelFit]
    gain: float
    manoeuvres: list[Manoeuvre]
    delay: DelaySplit | None
    lateness_s: float
    method: str
    gains: dict[str, float] = {}  # noqa: RUF012 - never changed


class Identification(NamedTuple):
    """What the logs say.

    Attributes
    ----------
    paths, system_id, clock
        Logs, vehicle, and the clock that parameters are in.
    axes
        By "roll" and "pitch", those that could be identified.
    refused
        Why another could not, one line each.
    gains
        Parameters of the attitude loop in force at the manoeuvres, for comparing with the vehicle's later.
    velocity_error
        Of the estimator, where the logs tell.
    px4_version
        The vehicle's, as "1.17", for the same; None where no log tells.
    notes
        What was dropped or passed over in reading, one line each.
    """

    paths: tuple[Path, ...]
    system_id: int
    clock: str
    axes: dict[str, AxisIdentification]
    refused: dict[str, str]
    gains: dict[str, float]
    velocity_error: VelocityError | None
    px4_version: str | None = None
    notes: tuple[str, ...] = ()


def identify_log(paths: Sequence[Path], system_id: int | None = None) -> Identification:
    """Identify the attitude response from one or more logs of the same vehicle, equally tuned.

    A ULog beside a tlog of the same flight gives the vehicle's share of the delay; several logs of one kind add their
    manoeuvres up.

    Parameters
    ----------
    paths
        ULogs, tlogs or flight folders.
    system_id
        The vehicle's MAVLink system id, where it is known.

    Raises
    ------
    LogError
        One line, when no axis can be identified.
    """
    return identify([read_log(path, system_id) for path in paths])


def identify(recordings: Sequence[Recording]) -> Identification:
    """`identify_log` on what has been read already. Raises `LogError`."""
    _check_alike(recordings)
    fitted, views = _pair(recordings)
    found = [find(recording) for recording in fitted]
    where = ", ".join(str(recording.path) for recording in recordings)
    notes = tuple(f"{recording.path}: {note}" for recording in recordings for note in recording.notes)
    also = f" ({notes[0]})" if notes else ""  # a log that ends early has too few manoeuvres because it does
    axes: dict[str, AxisIdentification] = {}
    refused: dict[str, str] = {}
    for axis in AXES:
        try:
            axes[axis] = _identify(axis, [m for by_axis in found for m in by_axis[axis]], fitted, views, where)
        except LogError as error:
            refused[axis] = f"{error}{also}"
    if not axes:
        reasons = list(refused.values())
        none = f"{where}: too little excitation: {FLY.format('roll and in pitch')}{also}"
        raise LogError(none if all("no manoeuvre" in reason for reason in reasons) else reasons[0])
    gains = {name: value for axis in axes.values() for name, value in axis.gains.items()}
    paths = tuple(recording.path for recording in recordings)
    version = next((recording.px4_version for recording in recordings if recording.px4_version), None)
    estimator = velocity_error(recordings)
    return Identification(
        paths, fitted[0].system_id, fitted[0].track.clock, axes, refused, gains, estimator, version, notes
    )


_Views = dict[Path, tuple[ClockMap, Recording | None]]


def _check_alike(recordings: Sequence[Recording]) -> None:
    first = recordings[0]
    for other in recordings[1:]:
        if other.system_id != first.system_id:
            raise LogError(
                f"{other.path}: wrong vehicle: system {other.system_id}, {first.path} is of {first.system_id}"
            )
        if first.px4_version and other.px4_version and other.px4_version != first.px4_version:
            raise LogError(
                f"{other.path}: PX4 {other.px4_version}, in {first.path} it is {first.px4_version}: give logs of one"
            )


def _pair(recordings: Sequence[Recording]) -> tuple[list[Recording], _Views]:
    """The recordings to fit, and how to see each in the vehicle's clock: map, and the ULog with its attitude."""
    ours = [r for r in recordings if r.track.clock == OURS]
    vehicles = [r for r in recordings if r.track.clock != OURS]
    views: _Views = {r.path: (r.applied, None) for r in ours if r.applied is not None}
    for log in vehicles if ours else []:
        for traffic in ours:
            track = traffic.track
            applied = clock.match(track.setpoint_time_s, traffic.setpoint_q, log.track.setpoint_time_s, log.setpoint_q)
            if applied is not None:
                views[traffic.path] = (applied, log)
                break
        else:
            raise LogError(
                f"{log.path}: not the flight of {ours[0].path}: no set-point is in both: give logs of one kind, or "
                "both logs of one flight"
            )
    return ours or vehicles, views


def _identify(
    axis: str, manoeuvres: list[Manoeuvre], recordings: list[Recording], views: _Views, where: str
) -> AxisIdentification:
    """By clean doublets where there are enough of them, else by all that was flown."""
    try:
        kept = select(axis, manoeuvres, where)
    except TooFewManoeuvresError as error:
        chosen, models, pieces = by_information(axis, recordings, where, str(error))
        slope = _checked(axis, chosen, pieces, where)
        return AxisIdentification(chosen, models, slope, pieces, None, 0.0, PREDICTION, _in_force(axis, pieces, views))
    gains = _in_force(axis, kept, views)
    models = fit_all(kept)
    chosen = choose(models)
    slope = _checked(axis, chosen, kept, where)
    if chosen.fit < LEAST_FIT:
        raise LogError(
            f"{where}: no model explains {axis} (fit {chosen.fit:.2f} of at least {LEAST_FIT}): it is disturbed or "
            f"saturated: {FLY.format(axis)}, in calm air"
        )
    lateness = max(m.recording.lateness_s for m in kept)
    return AxisIdentification(chosen, models, slope, kept, _split(chosen, kept, views), lateness, MANOEUVRES, gains)


def _in_force(axis: str, fitted: list[Manoeuvre], views: _Views) -> dict[str, float]:
    return in_force(axis, [(m.recording, m.start_s, m.end_s) for m in fitted], views)


def _checked(axis: str, chosen: ModelFit, fitted: list[Manoeuvre], where: str) -> float:
    """The gain. Raises `LogError` where the attitude does not go where it is told."""
    if opposed(fitted):
        raise LogError(
            f"{where}: wrong sign: {axis} goes against its set-point: check the frames of both (body forward-right-"
            "down, local north-east-down) before you fly again"
        )
    slope = gain(chosen.model, chosen.values, fitted)
    if not GAIN[0] <= slope <= GAIN[1]:
        raise LogError(
            f"{where}: saturated: {axis} goes {100 * slope:.0f} % of its set-point, so a limit cuts it or it is not "
            f"what the vehicle follows: {FLY.format(axis)}, smaller"
        )
    return slope


def _split(chosen: ModelFit, manoeuvres: list[Manoeuvre], views: _Views) -> DelaySplit | None:
    """The vehicle's delay and the link's, manoeuvre by manoeuvre; None unless the model has one and both are seen."""
    if not chosen.model.delayed:
        return None
    totals, owns = [], []
    for m in manoeuvres:
        if m.recording.path not in views:
            continue
        applied, log = views[m.recording.path]
        track = clock.vehicle_track(m.recording, applied, log)
        start, end = clock.to_vehicle(applied, np.array([m.start_s, m.end_s]))
        seen = cut(m.recording, m.axis, float(start), float(end), track)
        totals.append(fit_delay(chosen.model, chosen.values, m))
        owns.append(fit_delay(chosen.model, chosen.values, seen))
    if len(totals) < 2:
        return None
    link = np.array(totals) - np.array(owns)
    half = float(student.ppf(0.5 + CONFIDENCE / 2.0, len(link) - 1) * link.std(ddof=1) / np.sqrt(len(link)))
    middle = float(link.mean())
    return DelaySplit(float(np.mean(totals)), float(np.mean(owns)), middle, (middle - half, middle + half))
