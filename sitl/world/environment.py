"""What acts on the vehicle from outside, and what wears it down: wind, battery, motors. Ten milliseconds a step."""

from __future__ import annotations

import math
from random import Random
from typing import Final, NamedTuple

from sitl.vehicles.quadrotor import CALM, Effects
from sitl.vehicles.vehicle import Vehicle
from sitl.world.wind import STILL, Dryden, Gust, Vector, dryden, dryden_step, gusty, turbulent

STEP_S: Final = 0.01


class Turbulence(NamedTuple):
    """Dryden turbulence: its intensity as the wind speed at 20 ft, and the altitude it is taken at."""

    wind_at_20_ft_m_s: float
    altitude_m: float


class Wind(NamedTuple):
    """Steady wind (where it blows to, NED), gusts and turbulence upon it."""

    mean_ned_m_s: Vector = (0.0, 0.0, 0.0)
    gust: Gust | None = None
    turbulence: Turbulence | None = None


class Environment:
    """Steps everything that changes slowly against the physics, and hands it to the vehicle.

    Attributes: `wind_ned_m_s` blowing now; `sag_1_s`, thrust lost a second by a battery that runs down; `motors`, the
    share of its thrust that the vehicle still has; `roll_bias_rad`, `pitch_bias_rad`, how far a failing motor turns it.
    """

    def __init__(self, vehicle: Vehicle, random: Random, wind: Wind | None = None, sag_1_s: float = 0.0) -> None:
        self._vehicle = vehicle
        self._random = random
        self._dryden: Dryden | None = None
        self._turbulence = STILL
        self._along = (1.0, 0.0)
        self._wind: Wind | None = None
        self._battery = 1.0
        self.sag_1_s = sag_1_s
        self.motors = 1.0
        self.roll_bias_rad = self.pitch_bias_rad = 0.0
        self.wind_ned_m_s: Vector = (0.0, 0.0, 0.0)
        if wind is not None:
            self.blow(wind)

    def blow(self, wind: Wind) -> None:
        """Another wind from now on; turbulence that there was goes on changing smoothly."""
        self._wind = wind
        north, east, down = wind.mean_ned_m_s
        speed = math.hypot(north, east)
        if speed > 0.0:
            self._along = (north / speed, east / speed)
        turbulence = wind.turbulence
        self._dryden = (
            None
            if turbulence is None
            else dryden(turbulence.wind_at_20_ft_m_s, turbulence.altitude_m, math.hypot(speed, down), STEP_S)
        )

    def step(self, now_us: int) -> None:
        """One step of `STEP_S`, at a simulated time."""
        if self._wind is not None:
            self.wind_ned_m_s = self._blowing(self._wind, 1e-6 * now_us)
        self._battery = max(self._battery - STEP_S * self.sag_1_s, 0.0)
        self._vehicle.thrust_share = self._battery * self.motors
        effects = Effects(*self.wind_ned_m_s, self.roll_bias_rad, self.pitch_bias_rad)
        self._vehicle.effects = CALM if effects == CALM else effects

    def _blowing(self, wind: Wind, time_s: float) -> Vector:
        blowing = wind.mean_ned_m_s if wind.gust is None else gusty(wind.mean_ned_m_s, wind.gust, time_s)
        if self._dryden is not None:
            normal = self._random.gauss
            noise = (normal(0, 1), normal(0, 1), normal(0, 1), normal(0, 1), normal(0, 1))
            self._turbulence, turbulence = dryden_step(self._dryden, self._turbulence, noise)
            blowing = turbulent(blowing, self._along, turbulence)
        return blowing
