"""The plant as the autopilot sees it: an attitude set-point and a thrust in, a pose out, one physics step at a time."""

from __future__ import annotations

import math
from collections import deque
from typing import Final, NamedTuple, Protocol

from companion.control.types import GRAVITY_M_S2
from sitl.vehicles import quadrotor, rig
from sitl.vehicles.attitude_loop import AngleGains, RateState, with_gain
from sitl.vehicles.rotation import Quaternion, euler, quaternion

Vector = tuple[float, float, float]


GROUNDED_M: Final = 1e-4  # above the ground, and not off it yet


class VehicleState(NamedTuple):
    """Truth at one instant. Local NED, body FRD, quaternion scalar first, body to NED."""

    position_ned_m: Vector
    velocity_ned_m_s: Vector
    q_wxyz: Quaternion
    rates_frd_rad_s: Vector
    specific_force_frd_m_s2: Vector


class Vehicle(Protocol):
    """What the autopilot flies."""

    hover_thrust: float  # believed by autopilot and companion; what really carries it may differ
    can_fly: bool  # False for a rig on guides: it neither takes off nor lands
    thrust_share: float  # of its thrust that battery and motors still give
    effects: quadrotor.Effects  # what acts on it from outside

    @property
    def state(self) -> VehicleState:
        """Truth now."""

    def step(self, q_wxyz: Quaternion, thrust: float) -> None:
        """Advance by one step of the physics under an attitude set-point and a normalised thrust."""

    def on_ground(self) -> bool:
        """Whether the landing gear carries the weight."""

    def follow_gains(self, ratios: Vector) -> None:
        """Turn with so much of the gain from angle to rate that it began with, about roll, pitch and yaw."""


class _Delay:
    """Set-points as they come out of a transport delay of a whole number of physics steps."""

    def __init__(self, delay_s: float, dt_s: float) -> None:
        self._queue: deque[tuple[Quaternion, float]] = deque()
        self._steps = round(delay_s / dt_s)

    def through(self, q_wxyz: Quaternion, thrust: float) -> tuple[Quaternion, float]:
        if not self._steps:
            return q_wxyz, thrust
        self._queue.append((q_wxyz, thrust))
        return self._queue.popleft() if len(self._queue) > self._steps else self._queue[0]


class _AngleDelays:
    """Set-points whose roll, pitch and yaw each come out after a delay of their own."""

    def __init__(self, delays_s: Vector, dt_s: float) -> None:
        self._steps = [round(delay_s / dt_s) for delay_s in delays_s]
        self._queues: tuple[deque[float], ...] = (deque(), deque(), deque())

    def through(self, q_wxyz: Quaternion) -> Quaternion:
        late = []
        for angle, queue, steps in zip(euler(*q_wxyz), self._queues, self._steps, strict=True):
            queue.append(angle)
            late.append(queue.popleft() if len(queue) > steps else queue[0])
        return quaternion(*late)


class Rig:
    """The ANT-X rig: north along the guide, pitch free, everything else held.

    Attributes: `push_m_s2`, a force along the guide over the mass. Wind does not reach it.
    """

    can_fly = False

    def __init__(self, params: rig.RigParams, hover_thrust: float, delay_s: float = 0.0, dt_s: float = 1e-3) -> None:
        self.hover_thrust = hover_thrust
        self.thrust_share = 1.0
        self.effects = quadrotor.CALM
        self.push_m_s2 = 0.0
        self._identified, self._dt_s = params, dt_s
        self._dynamics = rig.Dynamics(params, dt_s)
        self._state = rig.RigState(0.0, 0.0, 0.0, 0.0, RateState(0.0, 0.0))
        self._delay = _Delay(delay_s, dt_s)
        self._thrust_ratio = 0.0

    @property
    def state(self) -> VehicleState:
        s = self._state
        half = 0.5 * s.pitch_rad
        return VehicleState(
            (s.position_m, 0.0, 0.0),
            (s.velocity_m_s, 0.0, 0.0),
            (math.cos(half), 0.0, math.sin(half), 0.0),
            (0.0, s.pitch_rate_rad_s, 0.0),
            (0.0, 0.0, -GRAVITY_M_S2 * self._thrust_ratio),
        )

    def step(self, q_wxyz: Quaternion, thrust: float) -> None:
        """Only the pitch of the set-point reaches the rig. Without thrust nothing turns it: it stays as it is."""
        (w, x, y, z), thrust = self._delay.through(q_wxyz, thrust)
        self._thrust_ratio = self.thrust_share * thrust / self.hover_thrust
        if thrust <= 0.0:
            self._state = self._state._replace(velocity_m_s=0.0, pitch_rate_rad_s=0.0, further=())
            return
        if math.isnan(w):
            w, x, y, z = self.state.q_wxyz  # what is no attitude: it stays
        pitch = math.asin(min(max(2.0 * (w * y - z * x), -1.0), 1.0))
        self._state = self._dynamics.step(self._state, pitch, self._thrust_ratio, self.push_m_s2)

    def on_ground(self) -> bool:
        return False

    def follow_gains(self, ratios: Vector) -> None:
        params, (_, pitch, _) = self._identified, ratios
        changed = params._replace(
            response=with_gain(params.response, pitch), pitch_gain_1_s=pitch * params.pitch_gain_1_s
        )
        self._dynamics = rig.Dynamics(changed, self._dt_s)


class Quadrotor:
    """The 6-DoF quadrotor, on flat ground at z = 0 until its thrust lifts it.

    Args: `params` of the physics, for steps of `dt_s`; `thrust_factor`, thrust at a set-point over what `hover_thrust`
    and the mass of the config imply; `angle_delays_s`, of roll, pitch and yaw, on top of `delay_s`.
    """

    can_fly = True

    def __init__(
        self,
        params: quadrotor.QuadrotorParams,
        hover_thrust: float,
        delay_s: float = 0.0,
        dt_s: float = 1e-3,
        thrust_factor: float = 1.0,
        angle_delays_s: Vector = (0.0, 0.0, 0.0),
    ) -> None:
        self.hover_thrust = hover_thrust
        self.thrust_share = 1.0
        self.effects = quadrotor.CALM
        self._params, self._dt_s = params, dt_s
        self._dynamics = quadrotor.Dynamics(params, dt_s)
        self._weight_n = params.mass_kg * GRAVITY_M_S2
        self._full_thrust_n = thrust_factor * params.mass_kg * GRAVITY_M_S2 / hover_thrust
        self._thrust_n = 0.0
        rest = RateState(0.0, 0.0)
        self._state = quadrotor.QuadrotorState(
            0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, rest, rest, rest
        )
        self._delay = _Delay(delay_s, dt_s)
        self._angle_delays = _AngleDelays(angle_delays_s, dt_s) if any(angle_delays_s) else None

    @property
    def state(self) -> VehicleState:
        s = self._state
        return VehicleState(
            (s.x_m, s.y_m, s.z_m),
            (s.vx_m_s, s.vy_m_s, s.vz_m_s),
            (s.qw, s.qx, s.qy, s.qz),
            (s.p_rad_s, s.q_rad_s, s.r_rad_s),
            (0.0, 0.0, -self._thrust_n / self._params.mass_kg),
        )

    def step(self, q_wxyz: Quaternion, thrust: float) -> None:
        q_wxyz, thrust = self._delay.through(q_wxyz, thrust)
        if self._angle_delays is not None:
            q_wxyz = self._angle_delays.through(q_wxyz)
        self._thrust_n = thrust_n = thrust * self.thrust_share * self._full_thrust_n
        if self._state.z_m >= -GROUNDED_M:
            if thrust_n <= self._weight_n:
                self._rest()
                return
            s = self._state
            _, _, yaw = euler(*(q_wxyz if q_wxyz[0] == q_wxyz[0] else (s.qw, s.qx, s.qy, s.qz)))
            q_wxyz = quaternion(0.0, 0.0, yaw)  # the ground keeps it level until it is off
        self._state = state = self._dynamics.step(self._state, q_wxyz, thrust_n, self.effects)
        if state.z_m > 0.0:
            self._state = state._replace(z_m=0.0)
            self._rest()

    def lift_to(self, z_m: float) -> None:
        """Put it into the air, level and at rest, so that a flight need not begin with a take-off."""
        self._rest()
        self._state = self._state._replace(z_m=z_m)

    def _rest(self) -> None:
        s = self._state
        _, _, yaw = euler(s.qw, s.qx, s.qy, s.qz)
        qw, qx, qy, qz = quaternion(0.0, 0.0, yaw)
        rest = RateState(0.0, 0.0)
        self._state = quadrotor.QuadrotorState(
            s.x_m, s.y_m, s.z_m, 0.0, 0.0, 0.0, qw, qx, qy, qz, 0.0, 0.0, 0.0, rest, rest, rest
        )

    def on_ground(self) -> bool:
        return self._state.z_m >= -GROUNDED_M

    def follow_gains(self, ratios: Vector) -> None:
        params, gains, (roll, pitch, yaw) = self._params, self._params.angle_gains, ratios
        changed = params._replace(
            roll=with_gain(params.roll, roll),
            pitch=with_gain(params.pitch, pitch),
            yaw=with_gain(params.yaw, yaw),
            angle_gains=AngleGains(roll * gains.roll_1_s, pitch * gains.pitch_1_s, yaw * gains.yaw_1_s),
        )
        self._dynamics = quadrotor.Dynamics(changed, self._dt_s)
