"""The guards' numbers once more, from the ticks: how near each came to its limit.

The record does not hold what a guard measured, so it is computed here at the guards' own 50 looks a second, by the
formulas of `companion/flight/guards/measures.py` over whole arrays: half an hour of flight in a fraction of a second.
"""

from __future__ import annotations

import math

import numpy as np
from scipy.signal import lfilter, ss2tf

from companion.config import Config
from companion.config.attitude import ResponseSection
from companion.config.controller import interval
from companion.config.guards.rows import GUARDS, Reason
from companion.flight.guards import table
from companion.flight.guards.attitude_response import ends
from companion.flight.guards.look import PERIOD_S
from companion.report.model import Array, Nearness

_ON_BOUND = 1e-6  # of a bound's width
LOOK_S = PERIOD_S


def looks(ticks: Array) -> Array:
    """The ticks at which the guards looked, about: one every 20 ms."""
    time_s = ticks["time_s"]
    grid = np.arange(time_s[0], time_s[-1] + 1e-9, LOOK_S)
    return ticks[np.clip(np.searchsorted(time_s, grid + 1e-6, side="right") - 1, 0, len(ticks) - 1)]


def directions(q: Array) -> Array:
    """Thrust direction, NED, of quaternions of shape (n, 4): minus the body's z axis; (n, 3)."""
    w, x, y, z = q.T
    return -np.stack([2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)], axis=1)


def in_frame(vectors: Array, heading_rad: Array) -> Array:
    """North and east turned into the control frame: (n, 2)."""
    c, s = np.cos(heading_rad), np.sin(heading_rad)
    north, east = vectors[:, 0], vectors[:, 1]
    return np.stack([c * north + s * east, -s * north + c * east], axis=1)


def headings(q: Array) -> Array:
    """Yaw of quaternions of shape (n, 4)."""
    w, x, y, z = q.T
    yaw: Array = np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
    return yaw


def band(section: ResponseSection | None, measured: Array, wanted: Array) -> Array | None:
    """What the certified responses answer to set-points given every look, north and east: (responses, n, 2).

    None for a response that is not watched. As in `companion.flight.guards.attitude_response`, each corner of the
    intervals is a linear response that begins at rest where the vehicle is.
    """
    corners = ends(section)
    if not corners:
        return None
    steps = np.arange(len(wanted))
    answers = np.empty((len(corners), len(wanted), 2))
    for place, corner in enumerate(corners):
        move = corner.kind.step(corner.values, LOOK_S)
        size = 2 + corner.kind.further
        a = np.array([move(tuple(unit), 0.0) for unit in np.eye(size)]).T
        b = np.array(move((0.0,) * size, 1.0))[:, None]
        numerator, denominator = ss2tf(a, b, np.eye(1, size), np.zeros((1, 1)))
        then = np.clip(np.floor(steps + 0.5 - corner.delay_s / LOOK_S).astype(int), -1, None)
        given = np.where((then >= 0)[:, None], wanted[then], measured[0]) - measured[0]
        answers[place] = lfilter(numerator[0], denominator, given, axis=0) + measured[0]
    return answers


def certified_band(config: Config, looked: Array) -> list[tuple[Array, Array] | None]:
    """(lower, upper) of the thrust direction along x and y of the control frame, (n,) each; None: unwatched."""
    measured, wanted = (directions(looked[key])[:, :2] for key in ("attitude_q_wxyz", "setpoint_q_wxyz"))
    heading = headings(looked["setpoint_q_wxyz"])
    found: list[tuple[Array, Array] | None] = []
    for axis, section in enumerate((config.attitude.x, config.attitude.y)):
        answers = band(section, measured, np.nan_to_num(wanted))
        if answers is None:
            found.append(None)
            continue
        along = np.stack([in_frame(answer, heading)[:, axis] for answer in answers])
        found.append((along.min(axis=0), along.max(axis=0)))
    return found


def _leaky(increments: Array, leak_s: float) -> Array:
    keep = leak_s / (leak_s + LOOK_S)
    return np.asarray(lfilter([keep], [1.0, -keep], np.nan_to_num(increments), axis=0))


def _averaged(values: Array, over_s: float, start: float) -> Array:
    blend = LOOK_S / over_s
    return np.asarray(lfilter([blend], [1.0, blend - 1.0], np.nan_to_num(values) - start)) + start


def measured(config: Config, looked: Array, edges: list[tuple[Array, Array] | None]) -> dict[Reason, Array]:
    """What each guard that the ticks suffice for measured, in the units of `companion.flight.guards`; (n,) each."""
    one_axis = config.vehicle_kind.one_axis
    thrust, wanted = directions(looked["attitude_q_wxyz"]), directions(looked["setpoint_q_wxyz"])
    error = looked["position_m"] - looked["reference_position_m"]
    down = looked["position_ned_m"][:, 2] - looked["reference_z_m"]
    envelope = config.controller.envelope
    at, speed = np.abs(looked["position_m"]), np.abs(looked["velocity_m_s"])
    if one_axis:
        at, speed = at[:, :1], speed[:, :1]
    position, velocity = looked["position_ned_m"], looked["velocity_ned_m_s"]
    moved = np.diff(position, axis=0, prepend=position[:1])
    slid = moved - LOOK_S * 0.5 * (velocity + np.vstack([velocity[:1], velocity[:-1]]))
    short, long = np.abs(_leaky(slid, 2.0)), np.abs(_leaky(slid, 10.0))
    lift = -thrust[:, 2] * looked["setpoint_thrust"] / looked["hover_thrust"]
    along = in_frame(thrust, headings(looked["setpoint_q_wxyz"]))
    outside = [
        np.maximum(low - along[:, axis], along[:, axis] - high)
        for axis, edge in enumerate(edges)
        if edge is not None
        for low, high in [edge]
    ]
    found = {
        Reason.TILT: np.arccos(np.clip(-thrust[:, 2], -1.0, 1.0)),
        Reason.TILT_ERROR: np.arccos(np.clip((thrust * wanted).sum(axis=1), -1.0, 1.0)),
        Reason.TRACKING_ERROR: np.abs(error[:, 0]) if one_axis else np.sqrt((error**2).sum(axis=1) + down**2),
        Reason.ENVELOPE: np.maximum(at.max(axis=1) / envelope.position_m, speed.max(axis=1) / envelope.velocity_m_s),
        Reason.VELOCITY_CONSISTENCY: np.linalg.norm(_leaky(slid, 0.5), axis=1),
        Reason.POSITION_SLIDE: np.maximum(long[:, :2].max(axis=1), 3.2 * short[:, :2].max(axis=1)),
        Reason.HEIGHT_SLIDE: np.maximum(long[:, 2], 2.0 * short[:, 2]),
        Reason.HOVER_THRUST: np.abs(_averaged(lift, 1.0, 1.0) - 1.0),
        Reason.THRUST_SATURATION: _averaged(looked["thrust_limited"].astype(float), 1.0, 0.0),
        Reason.WEIGHTS_ON_BOUND: weights_on_bound(config, looked),
        Reason.FLIGHT_TIME: looked["time_s"] - looked["time_s"][0],
    }
    if outside:
        found[Reason.ATTITUDE_RESPONSE] = np.maximum(np.max(outside, axis=0), 0.0)
    return found


def boxes(config: Config) -> dict[str, list[tuple[float, float]]]:
    """Bounds of each weight's projection by tick field, a pair an axis."""
    axes = [axis for axis in (config.controller.axes.x, config.controller.axes.y) if axis is not None]
    found = {
        "position_weight": [interval(axis.position_weight_bound) for axis in axes],
        "velocity_weight": [interval(axis.velocity_weight_bound) for axis in axes],
    }
    if config.controller.bias is not None:
        found["bias_weight"] = [interval(config.controller.bias.bound)] * len(axes)
    return found


def weights_on_bound(config: Config, looked: Array) -> Array:
    """How many adaptive weights rest on a bound; (n,)."""
    count = np.zeros(len(looked))
    for key, pairs in boxes(config).items():
        for axis, (low, high) in enumerate(pairs):
            slack = _ON_BOUND * (high - low)
            count += (looked[key][:, axis] <= low + slack) | (looked[key][:, axis] >= high - slack)
    return count


def nearness(config: Config, time_s: Array, values: dict[Reason, Array]) -> tuple[list[Nearness], dict[str, Array]]:
    """(how near each guard came, nearest first; share of its limit over time by the guard's key).

    Of a guard that is off, or has no limit in this flight, there is none.
    """
    limits = table.limits(config)
    found, shares = [], dict[str, Array]()
    for reason, measured_values in values.items():
        key, _, row = GUARDS[reason]
        limit = limits[reason]
        if not math.isfinite(limit) or not np.isfinite(measured_values).any():
            continue
        share = measured_values / limit if limit > 0.0 else np.where(measured_values > limit, 1.0 + measured_values, 0)
        worst = int(np.nanargmax(share))
        unit = {"m_s": "m/s", "m2": "m²", "hz": "Hz"}.get(row.unit, row.unit)
        found.append(
            Nearness(
                key, float(share[worst]), float(time_s[worst]), float(measured_values[worst]) / row.scale,
                limit / row.scale, unit,
            )
        )  # fmt: skip
        shares[key] = share
    return sorted(found, key=lambda near: -near.share), shares
