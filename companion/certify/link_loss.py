"""What a vehicle can do at most when the companion dies: PX4 flies the last set-point for COM_OF_LOSS_T.

The bound is about a companion that dies while the vehicle is inside `controller.envelope`, with what `limits` allow it
to ask for, the attitude responses and delays that are certified, the disturbance that the bias weight may answer, and
a hover thrust as far off as `guards.hover_thrust` allows. docs/companion_dies.md derives it. Standard library only.
"""

from __future__ import annotations

import math
from collections import deque
from fractions import Fraction
from itertools import product
from typing import Final, NamedTuple

from companion.attitude_response.kind import ParametricKind
from companion.attitude_response.realisation import StateSpace
from companion.attitude_response.response import AttitudeResponse
from companion.certify.from_config import problem
from companion.config.schema import Config
from companion.control.types import GRAVITY_M_S2

PX4_DEFAULT_S: Final = 1.0  # of COM_OF_LOSS_T
REACTION_S: Final = 0.1  # of PX4, after that
_HAND_OVER_S: Final = 0.25  # from what ends control to another mode, heard and asked for
_DT_S: Final = 1e-3
_SETTLED: Final = 1e-4  # of the kernel over its largest value


class LinkLoss(NamedTuple):
    """The most that can come of it until PX4 takes over."""

    loss_time_s: float  # COM_OF_LOSS_T
    tilt_rad: float
    distance_m: float  # across, from where the companion died
    height_lost_m: float

    def __str__(self) -> str:
        tilt_deg = math.degrees(self.tilt_rad)
        return f"{tilt_deg:.0f} deg, {self.distance_m:.1f} m away, {self.height_lost_m:.1f} m lower"


class Kernel(NamedTuple):
    """The largest that the impulse response of any certified attitude loop is, by time: 1/s, every millisecond.

    `peak`: the largest that a step response becomes.
    """

    values: tuple[float, ...]
    peak: float


def proposed_s(config: Config) -> float:
    """COM_OF_LOSS_T for this config: as short as the companion's own hand-over lets it be, in tenths of a second.

    Without odometry nothing is sent, and after `guards.pose_age_s` another mode is asked for. PX4 is to act after that.
    """
    age = config.guards.pose_age_s
    stale_s = age.limit + age.timeout_s if age.enabled else 0.0
    return math.ceil(10.0 * (stale_s + _HAND_OVER_S) - 1e-9) / 10.0


def kernel(config: Config) -> Kernel:
    """Of both axes' responses together. Raises `ConfigError`."""
    responses = dict.fromkeys(axis.response for axis in problem(config).axes.values())
    values: list[float] = []
    peak = 1.0
    for response in responses:
        late = tuple(round(float(end) / _DT_S) for end in (response.delay_s.lower, response.delay_s.upper))
        for system in _systems(response):
            impulse = _impulse(system)
            total = 0.0
            for value in impulse:
                total += _DT_S * value
                peak = max(peak, total)
            held = _largest_within(impulse, late[1] - late[0])
            values += [0.0] * (late[0] + len(held) - len(values))
            for k, value in enumerate(held, late[0]):
                values[k] = max(values[k], value)
    return Kernel(tuple(values), peak)


def stated(config: Config) -> list[LinkLoss]:
    """The bound for the COM_OF_LOSS_T proposed, PX4's default, and the one in `vehicle.parameters`."""
    of, own = kernel(config), config.vehicle.parameters.get("COM_OF_LOSS_T")
    times_s = {proposed_s(config), PX4_DEFAULT_S} | ({float(own)} if own is not None else set())
    return [worst(config, time_s, of) for time_s in sorted(times_s)]


def worst(config: Config, loss_time_s: float, of: Kernel | None = None) -> LinkLoss:
    """The bound for one COM_OF_LOSS_T. Raises `ConfigError`."""
    values, peak = kernel(config) if of is None else of
    controller, one_axis = config.controller, config.vehicle_kind.one_axis
    limits, envelope, hover = controller.limits, controller.envelope, config.vehicle.hover_thrust
    tilt = math.radians(limits.tilt_deg)
    # Roll and pitch together, as the length of a vector: a little more than the tilt they make.
    angle = tilt if one_axis else math.sqrt(2.0) * math.acos(math.sqrt(math.cos(tilt)))
    gain = _DT_S * sum(values)  # from the largest angle asked for to the largest flown
    duration_s = loss_time_s + REACTION_S
    most = 1.0 if one_axis else limits.thrust_max / hover  # specific force over g
    off = 0.0 if one_axis else config.guards.hover_thrust.limit
    asked = GRAVITY_M_S2 * most * math.sin(tilt)
    if limits.acceleration_m_s2 is not None:
        asked = min(asked, limits.acceleration_m_s2)
    asked *= tilt / math.sin(tilt)  # on its way there the angle is that share of the whole, the force at most
    moved = done = 0.0
    for k in range(round(duration_s / _DT_S)):
        done = min(done + (_DT_S * values[k] if k < len(values) else 0.0), gain)
        force = asked * min(done, peak) + GRAVITY_M_S2 * most * angle * (gain - done)
        moved += _DT_S * (duration_s - k * _DT_S) * force
    disturbance = 0.0 if controller.bias is None else GRAVITY_M_S2 * controller.bias.bound
    speed = envelope.velocity_m_s * (1.0 if one_axis else math.sqrt(2.0))
    distance = speed * duration_s + moved / (1.0 - off) + 0.5 * disturbance * duration_s**2
    lost = 0.0
    if not one_axis and controller.altitude is not None:
        lift = limits.thrust_min / hover * math.cos(min(gain * angle, 0.5 * math.pi)) / (1.0 + off)
        sinking = controller.altitude.velocity_limit_m_s
        lost = sinking * duration_s + 0.5 * GRAVITY_M_S2 * (1.0 - lift) * duration_s**2
    return LinkLoss(loss_time_s, gain * angle, distance, lost)


def _systems(response: AttitudeResponse) -> list[StateSpace]:
    """Responses of the box: its corners, and of a few numbers what lies half way between."""
    dynamics = response.dynamics
    if not isinstance(dynamics, ParametricKind):
        return dynamics.corners()
    sides = [
        sorted({Fraction(side.lower), (Fraction(side.lower) + Fraction(side.upper)) / 2, Fraction(side.upper)})
        for side in dynamics.intervals()
    ]
    return [dynamics.realise(*values) for values in product(*sides)]


def _impulse(system: StateSpace) -> list[float]:
    """The impulse response in the middle of each millisecond, until nothing is left."""
    a = [[float(entry) for entry in row] for row in system.a]
    c = [float(entry) for entry in system.c]
    state = [float(entry) for entry in system.b]

    def slope(x: list[float]) -> list[float]:
        return [sum(entry * value for entry, value in zip(row, x, strict=True)) for row in a]

    def advance(x: list[float], by_s: float) -> list[float]:  # fourth order of the exponential
        term, total = x, list(x)
        for order in range(1, 5):
            term = [by_s / order * value for value in slope(term)]
            total = [value + part for value, part in zip(total, term, strict=True)]
        return total

    state = advance(state, 0.5 * _DT_S)
    found, largest, quiet = [], 0.0, 0
    while quiet < 100:
        value = sum(entry * part for entry, part in zip(c, state, strict=True))
        found.append(value)
        largest = max(largest, abs(value))
        quiet = quiet + 1 if abs(value) < _SETTLED * largest else 0
        state = advance(state, _DT_S)
    return found


def _largest_within(values: list[float], width: int) -> list[float]:
    """By time, the largest magnitude of the last `width` steps: of all delays in an interval."""
    held: list[float] = []
    window: deque[tuple[int, float]] = deque()
    for k in range(len(values) + width):
        if k < len(values):
            value = abs(values[k])
            while window and window[-1][1] <= value:
                window.pop()
            window.append((k, value))
        while window and window[0][0] < k - width:
            window.popleft()
        held.append(window[0][1] if window else 0.0)
    return held
