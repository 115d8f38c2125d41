"""Flights that nobody made for identification, in the plant: sticks in Stabilized and Position mode, and a mission.

Flown on the plant's autopilot in memory, with the estimate of a GPS, wind with turbulence, and a torque disturbance
that holds the attitude off its set-point, so that in a closed position loop set-point and disturbance depend on each
other. PX4's own position controller (`sitl.autopilot.position_control`) flies Position mode and the mission; what
PX4 makes of sticks and waypoints is a set-point whose acceleration and jerk are limited (docs.px4.io, MPC_ACC_HOR,
MPC_JERK_MAX, MPC_JERK_AUTO).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from random import Random
from typing import Final, NamedTuple

import numpy as np

from companion.config import load_config
from companion.identify.series import VEHICLE, Recording, Track, angles
from sitl.autopilot.autopilot import Autopilot
from sitl.autopilot.modes import FlightMode
from sitl.autopilot.position_control import PositionControlSetpoint
from sitl.build import World, build_world
from sitl.vehicles.rotation import quaternion

KINDS: Final = ("stabilized", "position", "mission")
DURATION_S: Final = {"stabilized": 90.0, "position": 120.0, "mission": 240.0}
CONTROL_S: Final = 0.01  # the plant's control step: a set-point stands for so long
_CONFIG: Final = Path(__file__).resolve().parents[2] / "config" / "px4_quadrotor.yaml"
_ALTITUDE_M: Final = 20.0
_ACCELERATION_M_S2: Final = 3.0
_JERK_M_S3: Final = {"position": 8.0, "mission": 4.0}
_PERIODS_S: Final = ((0.05, 0.05), (0.02, 0.02), (0.01, 0.01))  # of logged set-points and attitudes


class Truth(NamedTuple):
    """Of one axis."""

    natural_frequency_rad_s: float
    damping_ratio: float
    delay_s: float


class Flight(NamedTuple):
    """A log as it would be read, and what is true of the vehicle."""

    recording: Recording
    truth: dict[str, Truth]


def drawn(chance: Random) -> dict[str, Truth]:
    """A vehicle at random: between a heavy lifter and a racer that still hovers on PX4's position gains."""
    delay_s = 1e-3 * chance.randint(10, 45)
    return {
        axis: Truth(round(chance.uniform(6.0, 14.0), 2), round(chance.uniform(0.6, 1.3), 2), delay_s)
        for axis in ("roll", "pitch")
    }


def fly(kind: str, seed: int, duration_s: float, truth: dict[str, Truth] | None = None) -> Flight:
    """One flight of `duration_s`. The same seed gives the same flight; `truth` left out is drawn from it."""
    chance = Random(f"{seed} {kind}")
    truth = truth or drawn(chance)
    world = _world(truth, chance)
    autopilot, environment = world.autopilot, world.environment
    assert environment is not None
    autopilot.start_in_air(_ALTITUDE_M, settle_s=10.0)
    steer = {"stabilized": _sticks_to_attitude, "position": _sticks_to_velocity, "mission": _mission}[kind](chance)
    deviation, time_s = math.radians(chance.uniform(0.2, 0.8)), chance.uniform(0.2, 0.8)
    left = math.exp(-CONTROL_S / time_s)
    drive = deviation * math.sqrt(1.0 - left * left)
    setpoints, attitudes = [], []
    begun_us = autopilot.time_us
    for tick in range(round(duration_s / CONTROL_S)):
        environment.roll_bias_rad = left * environment.roll_bias_rad + drive * chance.gauss(0.0, 1.0)
        environment.pitch_bias_rad = left * environment.pitch_bias_rad + drive * chance.gauss(0.0, 1.0)
        steer(autopilot, tick * CONTROL_S)
        if tick == 0:
            assert autopilot.commander.request(FlightMode.OFFBOARD, autopilot.time_us)
        autopilot.advance(begun_us + round(1e6 * CONTROL_S) * (tick + 1))
        setpoints.append(autopilot.setpoint.q_wxyz)
        attitudes.append(autopilot.estimate().q_wxyz)
    assert autopilot.commander.mode is FlightMode.OFFBOARD
    assert not autopilot.vehicle.on_ground()
    return Flight(_logged(kind, np.array(setpoints), np.array(attitudes), chance.choice(_PERIODS_S)), truth)


def _world(truth: dict[str, Truth], chance: Random) -> World:
    axes = [
        f"plant.quadrotor.{axis}={{natural_frequency_rad_s: {wn}, damping_ratio: {damping}, delay_s: {delay_s}}}"
        for axis, (wn, damping, delay_s) in truth.items()
    ]
    mean = f"[{chance.uniform(-4, 4):.2f}, {chance.uniform(-4, 4):.2f}, 0]"
    settings = (
        *axes,
        f"plant.seed={chance.randrange(1 << 30)}",
        "plant.setpoint_delay_s=0",
        f"plant.sensors={{preset: gps, attitude_deg: {chance.uniform(0.02, 0.15):.3f}, correlation_s: 0.3}}",
        f"plant.wind={{mean_ned_m_s: {mean}, turbulence: {{wind_at_20_ft_m_s: 7.7, altitude_m: 6}}}}",
    )
    return build_world(load_config(_CONFIG, settings), complete=True)


_Steer = Callable[[Autopilot, float], None]


def _sticks_to_attitude(chance: Random) -> _Steer:
    """A pilot in Stabilized: now and then a tilt of up to 15 degrees, else levelled against the drift he sees."""
    wanted, until, tilt = [0.0, 0.0], 0.0, [0.0, 0.0]

    def steer(autopilot: Autopilot, now_s: float) -> None:
        nonlocal until, wanted
        state = autopilot.estimate()
        (x, y, z), (vx, vy, vz) = state.position_ned_m, state.velocity_ned_m_s
        if now_s >= until:
            until = now_s + chance.uniform(0.4, 1.5)
            wanted = [math.radians(chance.uniform(-15.0, 15.0)) if chance.random() < 0.6 else 0.0 for _ in "xy"]
        back = (-0.02 * y - 0.06 * vy, 0.02 * x + 0.06 * vx)  # what the pilot sees, late and roughly
        for place in range(2):  # a thumb takes a tenth of a second or two
            aim = max(min(wanted[place] + back[place], 0.4), -0.4)
            tilt[place] += CONTROL_S / 0.12 * (aim - tilt[place])
        climb = 0.6 * (-_ALTITUDE_M - z) - 0.8 * vz
        thrust = autopilot.vehicle.hover_thrust * (1.0 - climb / 9.81) / (math.cos(tilt[0]) * math.cos(tilt[1]))
        autopilot.on_attitude_target(quaternion(tilt[0], tilt[1], 0.0), min(max(thrust, 0.2), 0.9))

    return steer


class _Smooth:
    """Position, velocity and acceleration that follow a wanted velocity, within an acceleration and a jerk."""

    def __init__(self, jerk_m_s3: float) -> None:
        self.position, self.velocity, self.acceleration = [0.0, 0.0], [0.0, 0.0], [0.0, 0.0]
        self._jerk = jerk_m_s3

    def step(self, wanted_m_s: tuple[float, float]) -> None:
        for i, wanted in enumerate(wanted_m_s):
            a, j, dt = self.acceleration[i], self._jerk, CONTROL_S
            missing = wanted - self.velocity[i] - 0.5 * a * abs(a) / j  # after the acceleration has been taken off
            aim = math.copysign(min(_ACCELERATION_M_S2, math.sqrt(j * abs(missing))), missing)
            a += min(max(aim - a, -j * dt), j * dt)
            self.acceleration[i] = a
            self.velocity[i] += a * dt
            self.position[i] += self.velocity[i] * dt

    def fly(self, autopilot: Autopilot, yaw_rad: float) -> None:
        (x, y), (vx, vy), (ax, ay) = self.position, self.velocity, self.acceleration
        autopilot.on_position_target(
            PositionControlSetpoint((x, y, -_ALTITUDE_M), (vx, vy, 0.0), (ax, ay, 0.0)), yaw_rad
        )


def _sticks_to_velocity(chance: Random) -> _Steer:
    """A pilot in Position mode: sticks pushed and let go, up to 5 m/s, back when 40 m away."""
    smooth, until = _Smooth(_JERK_M_S3["position"]), 0.0
    wanted = (0.0, 0.0)

    def steer(autopilot: Autopilot, now_s: float) -> None:
        nonlocal until, wanted
        if now_s >= until:
            until = now_s + chance.uniform(0.8, 3.0)
            speeds = [chance.uniform(-5.0, 5.0) if chance.random() < 0.6 else 0.0 for _ in "xy"]
            far = [abs(p) > 40.0 for p in smooth.position]
            north, east = (
                -math.copysign(4.0, p) if out else speed
                for p, out, speed in zip(smooth.position, far, speeds, strict=True)
            )
            wanted = (north, east)
        smooth.step(wanted)
        smooth.fly(autopilot, 0.0)

    return steer


def _mission(chance: Random) -> _Steer:
    """Legs of 10 to 30 m at 4 m/s with turns at their ends, the nose along the leg."""
    smooth = _Smooth(_JERK_M_S3["mission"])
    target, yaw = [0.0, 0.0], 0.0

    def steer(autopilot: Autopilot, now_s: float) -> None:
        nonlocal target, yaw
        to = [t - p for t, p in zip(target, smooth.position, strict=True)]
        far = math.hypot(*to)
        if far < 2.0:
            angle, length = chance.uniform(-math.pi, math.pi), chance.uniform(10.0, 30.0)
            target = [target[0] + length * math.cos(angle), target[1] + length * math.sin(angle)]
            if math.hypot(*target) > 100.0:
                target = [0.0, 0.0]
            to = [t - p for t, p in zip(target, smooth.position, strict=True)]
            far = math.hypot(*to)
        speed = min(4.0, 0.8 * far)
        smooth.step((speed * to[0] / far, speed * to[1] / far))
        turn = math.remainder(math.atan2(to[1], to[0]) - yaw, math.tau)
        yaw += min(max(turn, -0.6 * CONTROL_S), 0.6 * CONTROL_S)
        smooth.fly(autopilot, yaw)

    return steer


def _logged(kind: str, setpoint_q: np.ndarray, attitude_q: np.ndarray, periods_s: tuple[float, float]) -> Recording:
    """As a ULog would have it, at the rates of a logging profile."""
    time_s = (CONTROL_S * np.arange(len(setpoint_q))).astype(np.float64)
    every, each = (round(period_s / CONTROL_S) for period_s in periods_s)
    held, measured = setpoint_q[::every].astype(np.float32), attitude_q[each - 1 :: each]
    attitude_s = (time_s + CONTROL_S)[each - 1 :: each]
    track = Track(VEHICLE, time_s[::every], angles(held), attitude_s, angles(measured))
    flown = np.array([[0.0, attitude_s[-1]]])
    return Recording(
        Path(f"{kind}.ulg"), "ULog", 1, track, np.empty((0, 2)), held, periods_s[0], np.empty(0), attitude_s, None, {},
        in_flight=flown,
    )  # fmt: skip
