"""What each guard measures, 50 times a second and after the set-point has gone: one entry of `MEASURES` a guard.

Everything here is in the vehicle's own time, so that a pause of ours is not taken for one of the vehicle's. A measure
answers with one number in the unit of ours that its row in `companion/config/guards/rows.py` names; not a number where
it cannot be seen, which is past no limit.
"""

from __future__ import annotations

import math
from collections import deque
from typing import Final

from companion.config.attitude import link_share_s
from companion.config.estimator import PRESETS
from companion.config.guards.rows import Reason
from companion.config.mission.identifying import LINK_DELAY_S
from companion.config.schema import Config
from companion.control import attitude
from companion.control.types import GRAVITY_M_S2
from companion.flight.guards.attitude_response import ResponseBand, ends
from companion.flight.guards.look import PERIOD_S, Look, Measure, Measured, Told, stateless
from companion.flight.guards.propagation import LONG_S

_SATURATION_S: Final = 1.0  # over which its share is taken
_LIFT_S: Final = 1.0  # and the average of the thrust
_CARRIED_RAD_S: Final = 5.0
_CARRIED_BLEND: Final = 1.0 - math.exp(-_CARRIED_RAD_S * PERIOD_S)
_RATE_WINDOW: Final = 26  # looks, half a second
_RATE_TOLERANCE: Final = 1.01  # how well a rate is known
_DEVIATIONS: Final = 6.0  # that an estimator may slide by; east of north by GPS they are five


# --- where the estimator thinks the vehicle is ------------------------------------------------------------------------


class Variance:
    """The largest that is told, m²; without end where one is told no more that was."""

    def __init__(self, _: Config) -> None:
        self._told = False

    def __call__(self, look: Look) -> float:
        north, east, down = look.told.variance_ned_m2
        if north > 0.0 and east > 0.0 and down > 0.0:  # not a number is not
            self._told = True
            return max(north, east, down)
        if self._told:
            return math.inf
        return max((variance for variance in (north, east, down) if variance > 0.0), default=math.nan)


def largest_slide_m(config: Config) -> float:
    """What the estimator of the config is wrong by, six times; of one that aids by GPS where it does not say.

    The velocity's error, of deviation s and time T, is what position slides by. Summed with a leak of tau it has a
    deviation of ``s tau sqrt(T / (T + tau))``.
    """
    given = config.guards.position_slide_m.limit
    error = PRESETS["gps"] if config.estimator is None else config.estimator.velocity_error
    return given or _DEVIATIONS * error.deviation_m_s * LONG_S * math.sqrt(error.time_s / (error.time_s + LONG_S))


def most_steps_m(config: Config) -> float:
    """Twice what one may be."""
    return config.guards.estimator_steps_m.limit or 2.0 * config.guards.estimator_jump_m.limit


# --- what the companion is told ---------------------------------------------------------------------------------------


class PoseRate:
    """Rate of what is new in the odometry over the last half second, Hz."""

    def __init__(self, _: Config) -> None:
        self._seen: deque[tuple[float, int]] = deque(maxlen=_RATE_WINDOW)

    def __call__(self, look: Look) -> float:
        self._seen.append((look.sample.time_s, look.poses))
        first_s, first = self._seen[0]
        if len(self._seen) < _RATE_WINDOW:
            return math.nan
        return (look.poses - first) / (look.sample.time_s - first_s)


def least_rate_hz(config: Config) -> float:
    """The rate that the certificate is for, as well as a rate is known."""
    return (config.guards.pose_rate_hz.limit or config.tick.floor_hz) / _RATE_TOLERANCE


def longest_delay_s(config: Config) -> float:
    """What the certified delay leaves to the link.

    Without end only where neither config nor certificate knows of a delay: in lockstep, or uncertified. Where the
    response is being identified nothing is certified: what the loop then flown bears.
    """
    if config.mission.identification is not None:
        return config.guards.link_delay_s.limit or LINK_DELAY_S
    return config.guards.link_delay_s.limit or link_share_s(config.attitude) or math.inf


def longest_jitter_s(config: Config) -> float:
    """Never above the delay that is certified for the link: a delay that varies is certified at no rate."""
    return min(config.guards.link_jitter_s.limit, longest_delay_s(config))


# --- how it flies -----------------------------------------------------------------------------------------------------


def outside_fence(config: Config) -> Measure:
    """1 outside, 0 inside."""
    fence = config.guards.fence
    if not fence.enabled:
        return lambda _: math.nan
    return lambda look: float(fence.outside(look.offset_ned_m) is not None)


def tilt_rad(look: Look) -> float:
    """Of the thrust direction, from the vertical."""
    return math.acos(min(max(-look.thrust_ned[2], -1.0), 1.0))


def tilt_error_rad(look: Look) -> float:
    """From the thrust direction wanted to the one measured."""
    (north, east, down), (wanted_n, wanted_e, wanted_d) = look.thrust_ned, look.wanted_thrust_ned
    return math.acos(min(max(north * wanted_n + east * wanted_e + down * wanted_d, -1.0), 1.0))


def outside_band_rad(config: Config) -> Measure:
    """How far the attitude loop's answer lies outside the band of the certified responses."""
    response = ResponseBand(config.attitude.x, config.attitude.y)

    def measure(look: Look) -> float:
        qw, qx, qy, qz, _ = look.setpoint
        heading_rad = attitude.yaw(qw, qx, qy, qz)
        return response.advance(look.sample.time_s, heading_rad, look.thrust_ned[:2], look.wanted_thrust_ned[:2])

    return measure


def widest_band_rad(config: Config) -> float:
    """No limit where the response is being identified: nobody has certified one yet."""
    measuring = config.mission.identification is not None
    return math.inf if measuring else math.radians(config.guards.attitude_response_deg.limit)


def no_band(config: Config, _: Told) -> bool:
    """A transfer function is not watched."""
    axes = (config.attitude.x, config.attitude.y)
    return any(axis is not None and not ends(axis) for axis in axes)


class Lift:
    """How far the vertical thrust flown is on average from the one believed to hover, over it."""

    def __init__(self, _: Config) -> None:
        self._lift = 1.0

    def __call__(self, look: Look) -> float:
        lift = -look.thrust_ned[2] * look.setpoint.thrust / look.hover_thrust
        self._lift += (lift - self._lift) * PERIOD_S / _LIFT_S
        return abs(self._lift - 1.0)


class Carried:
    """Share of the weight that the thrust carries: in the air l + v'/g = 1, z down, with l the lift over the weight.

    Both sides pass the same low-pass, as in `companion.control.hover`.
    """

    def __init__(self, config: Config) -> None:
        self._flies = config.vehicle_kind.can_fly
        self._lift = 1.0
        self._velocity_m_s: float | None = None

    def __call__(self, look: Look) -> float:
        if not self._flies:
            return math.nan
        before_m_s = look.began.vz_m_s if self._velocity_m_s is None else self._velocity_m_s
        if look.jumped is not None:
            before_m_s += look.jumped.vz_m_s
        lift = -look.thrust_ned[2] * look.setpoint.thrust / look.hover_thrust
        self._lift += _CARRIED_BLEND * (lift - self._lift)
        velocity_m_s = before_m_s + _CARRIED_BLEND * (look.sample.vz_m_s - before_m_s)
        self._velocity_m_s = velocity_m_s
        return self._lift + _CARRIED_RAD_S * (look.sample.vz_m_s - velocity_m_s) / GRAVITY_M_S2


class Saturation:
    """Share of the last second's looks with thrust at its limit."""

    def __init__(self, _: Config) -> None:
        self._share = 0.0

    def __call__(self, look: Look) -> float:
        self._share += (look.output.thrust_limited - self._share) * PERIOD_S / _SATURATION_S
        return self._share


def envelope_used(config: Config) -> Measure:
    """Largest share of the envelope: of its distance, or of its speed."""
    envelope, one_axis = config.controller.envelope, config.vehicle_kind.one_axis
    position_m, velocity_m_s = envelope.position_m, envelope.velocity_m_s

    def measure(look: Look) -> float:
        at_x, vx, _, at_y, vy, _ = look.output.measured
        if one_axis:
            at_y = vy = 0.0
        return max(max(abs(at_x), abs(at_y)) / position_m, max(abs(vx), abs(vy)) / velocity_m_s)

    return measure


# What is not told at stand-by is told in this order; the order of the checks is that of the rows.
MEASURES: Final = {
    Reason.ESTIMATOR_FLAGS: Measured(
        stateless(lambda look: look.told.missing_flags), blind=lambda _, told: math.isnan(told.missing_flags)
    ),
    Reason.POSITION_VARIANCE: Measured(Variance, blind=lambda _, told: any(map(math.isnan, told.variance_ned_m2))),
    Reason.ESTIMATOR_JUMP: Measured(blind=lambda _, told: not told.resets_counted),
    Reason.ESTIMATE_STUCK: Measured(stateless(lambda look: max(look.stopped_s))),
    Reason.VELOCITY_CONSISTENCY: Measured(stateless(lambda look: look.apart.drift_m)),
    Reason.ESTIMATOR_STEPS: Measured(stateless(lambda look: look.steps_m), limit=most_steps_m),
    Reason.POSITION_SLIDE: Measured(stateless(lambda look: look.apart.slide_m), limit=largest_slide_m),
    Reason.HEIGHT_SLIDE: Measured(stateless(lambda look: look.apart.height_slide_m)),
    Reason.UNEXPLAINED_MOTION: Measured(stateless(lambda look: look.apart.unexplained_m_s)),
    Reason.CLOCK_RATE: Measured(stateless(lambda look: look.told.clock_rate)),
    Reason.LINK_DELAY: Measured(
        stateless(lambda look: look.told.round_trip_s),
        limit=longest_delay_s,
        blind=lambda _, told: math.isnan(told.round_trip_s),
    ),
    Reason.LINK_JITTER: Measured(stateless(lambda look: look.told.jitter_s), limit=longest_jitter_s),
    Reason.POSE_RATE: Measured(PoseRate, limit=least_rate_hz),
    Reason.FENCE: Measured(outside_fence, limit=lambda _: 0.5),
    Reason.TILT: Measured(stateless(tilt_rad)),
    Reason.ATTITUDE_RESPONSE: Measured(outside_band_rad, limit=widest_band_rad, blind=no_band),
    Reason.TILT_ERROR: Measured(stateless(tilt_error_rad)),
    Reason.LANDED: Measured(Carried),
    Reason.HOVER_THRUST: Measured(Lift),
    Reason.THRUST_SATURATION: Measured(Saturation),
    Reason.WEIGHTS_ON_BOUND: Measured(stateless(lambda look: look.weights_on_bound)),
    Reason.TRACKING_ERROR: Measured(stateless(lambda look: look.tracking_error_m)),
    Reason.ENVELOPE: Measured(envelope_used, limit=lambda _: 1.0),
    Reason.FLIGHT_TIME: Measured(stateless(lambda look: look.elapsed_s)),
}
