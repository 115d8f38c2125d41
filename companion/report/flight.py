"""A flight folder of ours as a report: panels from the ticks, the guards' numbers, and the traffic beside them."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from companion.config import Config, load_config
from companion.config.guards.rows import GUARDS, Reason
from companion.errors import CompanionError
from companion.flight.authority.states import State
from companion.flight.guards import table
from companion.record.reader import read_flight
from companion.report import guards, traffic, verdict
from companion.report.model import (
    BAND,
    IDEAL,
    MEASURED,
    MEASURED_Y,
    REFERENCE,
    WANTED,
    Array,
    Happened,
    Limit,
    Nearness,
    Panel,
    Path3,
    Report,
    Series,
)

_BEFORE_S, _AFTER_S = 5.0, 10.0  # of stand-by and of what came after control
_UNSEEN = (
    "guards' own measurements are not recorded; theirs are computed again from the ticks",
    "guards that need more than the record holds are not drawn: estimator_steps_m, estimate_stuck_s, "
    "unexplained_motion_m_s, ground_contact, fence, clock_rate, pose_age_s, heartbeat_age_s, tick_overrun_s",
)


class ReportError(CompanionError):
    """What cannot be reported on, and why, in one line."""


def read(folder: Path) -> Report:
    """Report on a flight folder. Raises `CompanionError` with one line."""
    try:
        flight = read_flight(folder)
    except OSError as error:
        raise ReportError(f"{folder}/flight.mcap: {error.strerror}") from None
    except ValueError as error:
        raise ReportError(str(error)) from None
    config = load_config(folder / "config.yaml")
    ticks = flight.ticks if (finite := np.isfinite(flight.ticks["time_s"])).all() else flight.ticks[finite]
    engaged = np.flatnonzero(ticks["state"] == State.ENGAGED)
    began = next((event.time_s for event in flight.events if event.name == "engaged"), None)
    zero_s = float(ticks["time_s"][engaged[0] if len(engaged) else 0]) if len(ticks) else 0.0
    wall_s = began if began is not None else (flight.events[0].time_s if flight.events else zero_s)
    events = tuple(Happened(event.time_s - wall_s, event.name, event.detail) for event in flight.events)
    controlled = _picked(ticks, engaged)
    heard, missing = _traffic(folder, config)
    missing = [*flight.notes, *missing]
    panels, nearest, path = list[Panel](), list[Nearness](), None
    if len(ticks) > 1:
        last_s = float(ticks["time_s"][engaged[-1]]) if len(engaged) else math.inf
        shown_s = (ticks["time_s"] >= zero_s - _BEFORE_S) & (ticks["time_s"] <= last_s + _AFTER_S)
        shown = _picked(ticks, np.flatnonzero(shown_s))
        panels += _position(shown, shown["time_s"] - zero_s)
        path = _path(shown, zero_s)
    if len(controlled) > 50:
        control, nearest = _control(config, controlled, zero_s, heard, wall_s)
        panels += control
        missing += _UNSEEN
    else:
        missing.append("the controller was never in control: what only it knows cannot be drawn")
    if len(ticks):
        panels += _link(config, ticks, zero_s, heard, wall_s)
    facts = _facts(controlled)
    return Report(
        folder.resolve().name,
        f"flight of ours, {'hedged' if config.controller.hedging else 'standard'} MRAC, {config.vehicle.kind}",
        verdict.of_flight(events, facts, nearest, controlled, config),
        facts,
        tuple(panels),
        path,
        events + tuple(Happened(at - wall_s, "vehicle says", text) for at, text in (heard.texts if heard else [])),
        tuple(nearest),
        tuple(missing),
    )


def _picked(ticks: Array, places: Array) -> Array:
    """These ticks, without a copy where they are all in a row: half an hour of them is 200 MB."""
    if len(places) and places[-1] - places[0] + 1 == len(places):
        return ticks[places[0] : places[-1] + 1]
    return ticks[places]


def _traffic(folder: Path, config: Config) -> tuple[traffic.Traffic | None, list[str]]:
    try:
        return traffic.read(folder / "traffic.tlog", config.vehicle.system_id), []
    except OSError as error:
        return None, [f"no traffic.tlog ({error.strerror}): estimator and link are not drawn"]


def _position(ticks: Array, t: Array) -> list[Panel]:
    found = []
    for axis, (key, title, sign) in enumerate((("north", "North", 1), ("east", "East", 1), ("up", "Height", -1))):
        of = [sign * ticks[name][:, axis] for name in ("position_ned_m", "command_ned_m", "target_ned_m")]
        lines = (
            Series("measured", MEASURED, of[0]),
            Series("set-point flown", WANTED, of[1]),
            Series("target", IDEAL, of[2]),
        )
        found.append(Panel(f"position-{key}", f"{title}: position and set-point", "m", t, lines))
    return found


def _path(ticks: Array, zero_s: float) -> Path3:
    keep = np.unique(np.linspace(0, len(ticks) - 1, 1500).astype(int))
    ticks = ticks[keep]
    up = guards.directions(ticks["attitude_q_wxyz"])
    return Path3(ticks["time_s"] - zero_s, ticks["position_ned_m"], ticks["command_ned_m"], up)


def _control(
    config: Config, ticks: Array, zero_s: float, heard: traffic.Traffic | None, wall_s: float
) -> tuple[list[Panel], list[Nearness]]:
    t = ticks["time_s"] - zero_s
    looked = guards.looks(ticks)
    look_s = looked["time_s"] - zero_s
    edges = guards.certified_band(config, looked)
    values = guards.measured(config, looked, edges)
    if heard is not None and len(heard.variance_s):
        values[Reason.POSITION_VARIANCE] = np.interp(look_s, heard.variance_s - wall_s, heard.variance_m2)
    nearest, shares = guards.nearness(config, look_s, values)
    limits = table.limits(config)
    ideal = np.hypot(*(looked["position_m"] - looked["ideal_position_m"]).T)
    panels = [
        Panel(
            "tracking", "Error: distance from the reference", "m", look_s,
            (Series("from the reference tracked, in space", MEASURED, values[Reason.TRACKING_ERROR]),
             Series("from the ideal reference, horizontal", IDEAL, ideal)),
            _limit("guards.tracking_error_m", limits[Reason.TRACKING_ERROR]),
        ),
        _pair("from-setpoint", "Distance from the set-point, and the envelope certified for", "m", ticks, t,
              "position_m", config.controller.envelope.position_m),
        _pair("velocity", "Velocity, and the envelope certified for", "m/s", ticks, t,
              "velocity_m_s", config.controller.envelope.velocity_m_s),
    ]  # fmt: skip
    wanted, at = (guards.directions(looked[key]) for key in ("setpoint_q_wxyz", "attitude_q_wxyz"))
    heading = guards.headings(looked["setpoint_q_wxyz"])
    wanted, at = guards.in_frame(wanted, heading), guards.in_frame(at, heading)
    for axis, (letter, angle) in enumerate((("x", "pitch"), ("y", "roll"))):
        lines = [
            Series("measured", MEASURED, _degrees(at[:, axis])),
            Series("set-point", WANTED, _degrees(wanted[:, axis])),
        ]
        edge = edges[axis]
        if edge is not None:
            lines += [
                Series("certified, upper", BAND, _degrees(edge[1])),
                Series("certified, lower", BAND, _degrees(edge[0])),
            ]
        title = f"Attitude {letter} ({angle}): thrust direction, set-point, certified band"
        panels.append(
            Panel(f"attitude-{letter}", title, "°", look_s, tuple(lines), band=None if edge is None else (2, 3))
        )
    names = {
        "position_weight": ("Position", "1/m"),
        "velocity_weight": ("Velocity", "s/m"),
        "bias_weight": ("Bias", "g"),
    }
    for key, pairs in guards.boxes(config).items():
        name, unit = names[key]
        box = tuple(
            Limit(f"{'upper' if side else 'lower'} bound {letter}", pair[side])
            for letter, pair in zip("xy", pairs, strict=False)
            for side in (0, 1)
            if letter == "x" or pair != pairs[0]
        )
        panels.append(
            Panel(f"{key.replace('_', '-')}", f"{name} weight in its box", unit, t, _both(ticks[key], len(pairs)), box)
        )
    panels += [
        Panel("hedge", "Hedge deficit w - u: what the attitude loop lags", "g", t, _both(ticks["hedge_deficit"])),
        Panel(
            "thrust", "Thrust, and what is taken to hover", "1", t,
            (Series("set-point", WANTED, ticks["setpoint_thrust"]),
             Series("hover thrust", REFERENCE, ticks["hover_thrust"])),
            (Limit("least", config.controller.limits.thrust_min), Limit("most", config.controller.limits.thrust_max)),
        ),
        Panel(
            "guards", "Guards: share of their limit (1 is at it)", "1", look_s,
            tuple(Series(near.guard, MEASURED, shares[near.guard]) for near in nearest), kind="heat",
        ),
    ]  # fmt: skip
    return panels, nearest


def _limit(label: str, value: float) -> tuple[Limit, ...]:
    return (Limit(label, value),) if math.isfinite(value) else ()


def _degrees(along: Array) -> Array:
    angles_deg: Array = np.degrees(np.arcsin(np.clip(along, -1.0, 1.0)))
    return angles_deg


def _both(values: Array, axes: int = 2) -> tuple[Series, ...]:
    return (Series("x", MEASURED, values[:, 0]), Series("y", MEASURED_Y, values[:, 1]))[:axes]


def _pair(key: str, title: str, unit: str, ticks: Array, t: Array, field: str, bound: float) -> Panel:
    return Panel(key, title, unit, t, _both(ticks[field]), (Limit("envelope", bound), Limit("envelope", -bound)))


def _link(config: Config, ticks: Array, zero_s: float, heard: traffic.Traffic | None, wall_s: float) -> list[Panel]:
    limits = table.limits(config)
    t = ticks["time_s"] - zero_s
    interval_s = np.diff(ticks["time_s"], prepend=np.nan)
    found = []
    if heard is not None and np.isfinite(heard.variance_m2).any() and len(heard.variance_s):
        lines: tuple[Series, ...] = (Series("largest variance of position", MEASURED, heard.variance_m2),)
        limit = _limit(GUARDS[Reason.POSITION_VARIANCE].key, limits[Reason.POSITION_VARIANCE])
        found.append(
            Panel("variance", "Estimator: variance of position", "m²", heard.variance_s - wall_s, lines, limit)
        )
    if heard is not None and len(heard.status_s):
        of = zip(
            ("velocity", "horizontal position", "vertical position"), (MEASURED, WANTED, REFERENCE), heard.ratios.T,
            strict=True,
        )  # fmt: skip
        found.append(
            Panel(
                "ratios", "Estimator: innovation test ratios (above 1 it refuses the sensor)", "1",
                heard.status_s - wall_s, tuple(Series(*each) for each in of), (Limit("refused", 1.0),),
            )
        )  # fmt: skip
    lines = (
        Series("odometry received to set-point sent", MEASURED, 1e3 * ticks["latency_s"]),
        Series("odometry's interval", WANTED, 1e3 * interval_s),
    )
    found.append(Panel("tick", "Tick: answer and interval", "ms", t, lines))
    if heard is not None and len(heard.arrival_s):
        lines = (Series("odometry later than its earliest", MEASURED, 1e3 * heard.lateness_s),)
        limit = _limit("guards.link_jitter_s", 1e3 * limits[Reason.LINK_JITTER])
        found.append(
            Panel("jitter", "Link: how late odometry came (jitter)", "ms", heard.arrival_s - wall_s, lines, limit)
        )
    if heard is not None and len(heard.trip_s):
        lines = (Series("round trip beyond the shortest", MEASURED, 1e3 * heard.trip_s),)
        found.append(Panel("delay", "Link: round trips beyond the shortest", "ms", heard.trip_at_s - wall_s, lines))
    return found


def _facts(ticks: Array) -> tuple[tuple[str, float, str], ...]:
    if len(ticks) < 2:
        return (("time in control", 0.0, "s"),)
    error = np.hypot(*(ticks["position_m"] - ticks["reference_position_m"]).T)
    ideal = np.hypot(*(ticks["position_m"] - ticks["ideal_position_m"]).T)
    deficit = np.hypot(*ticks["hedge_deficit"].T)
    return (
        ("time in control", float(ticks["time_s"][-1] - ticks["time_s"][0]), "s"),
        ("RMS horizontal error from the reference tracked", _rms(error), "m"),
        ("largest horizontal error from the reference tracked", float(np.nanmax(error, initial=0.0)), "m"),
        ("RMS horizontal error from the ideal reference", _rms(ideal), "m"),
        ("RMS hedge deficit", _rms(deficit), "g"),
        ("median answer of a tick", 1e3 * float(np.nanmedian(ticks["latency_s"])), "ms"),
    )


def _rms(values: Array) -> float:
    return float(np.sqrt(np.nanmean(values**2)))
