"""Free flight of `config/px4_quadrotor.yaml`: 20 % too heavy, wind with gusts, 30 ms of delay; and 20 m away.

Controller and plant are called directly, without MAVLink: the pilot at 250 Hz, the physics at 1 kHz, set-points in a
queue between them.
"""

from __future__ import annotations

import math
from collections import deque
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

from companion.attitude_response.kind import LinearResponse
from companion.certify import proof
from companion.certify.certificate import certify
from companion.certify.from_config import certificate_path, problem
from companion.certify.statement import statement
from companion.config import Config, load_config
from companion.config.vehicles import Angle
from companion.control.types import GRAVITY_M_S2, Odometry, PositionSetpoint
from companion.flight.pilot.pilot import Pilot
from sitl.vehicles import quadrotor
from sitl.vehicles.attitude_loop import AngleGains, RateGains, RateState
from sitl.vehicles.rotation import quaternion

PX4 = Path(__file__).resolve().parents[3] / "config" / "px4_quadrotor.yaml"
TOO_HEAVY = 1.2
WIND_M_S = 5.0
GUST_M_S = 2.0  # on top of it, from another direction: 1-cosine up, a second, and down again
GUST_EVERY_S = 7.0
DELAY_S = 0.03
HEADING_RAD = 0.3


class Flown(NamedTuple):
    """Every tick of a flight: time, true position, target and flown set-point, and what the pilot says."""

    time_s: np.ndarray
    position_ned_m: np.ndarray
    target_ned_m: np.ndarray
    tracking_error_m: np.ndarray
    thrust: np.ndarray
    pilot: Pilot

    def steady_m(self, until_s: float) -> float:
        """Mean distance from the target over the three seconds before."""
        last = (self.time_s >= until_s - 3.0) & (self.time_s < until_s)
        return float(np.linalg.norm(self.position_ned_m - self.target_ned_m, axis=1)[last].mean())

    def rms_m(self, from_s: float, until_s: float) -> float:
        """RMS of the tracking error."""
        then = (self.time_s >= from_s) & (self.time_s < until_s)
        return float(np.sqrt(np.mean(self.tracking_error_m[then] ** 2)))


def response(angle: Angle | None) -> LinearResponse:
    assert angle is not None
    return angle.response


def wind(time_s: float) -> tuple[float, float, float]:
    """Blowing now, NED."""
    since = (time_s - 4.0) % GUST_EVERY_S
    rise = min(since, 3.0 - since, 1.0)
    share = 0.5 * (1.0 - math.cos(math.pi * rise)) if time_s > 4.0 and rise > 0.0 else 0.0
    north, east = math.cos(0.7), math.sin(0.7)
    return (
        WIND_M_S * north + share * GUST_M_S * math.cos(1.2),
        WIND_M_S * east + share * GUST_M_S * math.sin(1.2),
        share * 0.5,
    )


def fly(
    config: Config, seconds: float, *, hedging: bool = True, steer: dict[float, PositionSetpoint] | None = None
) -> Flown:
    """A flight from hover at 5 m, wind from the first moment on."""
    assert config.plant is not None
    vehicle = config.plant.quadrotor
    assert vehicle is not None
    rates, rest = RateGains(0.0, 0.0, 0.0, 1.0, 0.0), RateState(0.0, 0.0)
    params = quadrotor.QuadrotorParams(
        TOO_HEAVY * vehicle.mass_kg, vehicle.drag_n_s2_m2, *vehicle.inertia_kg_m2, False,
        response(vehicle.roll), response(vehicle.pitch), response(vehicle.yaw),
        AngleGains(0.0, 0.0, 0.0), rates, rates, rates,
    )  # fmt: skip
    dynamics = quadrotor.Dynamics(params, 1e-3)
    level = quaternion(0.0, 0.0, HEADING_RAD)
    state = quadrotor.QuadrotorState(0, 0, -5, 0, 0, 0, *level, 0, 0, 0, rest, rest, rest)
    full_thrust_n = vehicle.mass_kg * GRAVITY_M_S2 / config.vehicle.hover_thrust
    pilot, orders = Pilot(config, hedging=hedging), dict(steer or {})
    pilot.take_over(Odometry(0.0, *state[:10]))
    on_their_way: deque[tuple[float, tuple[float, ...]]] = deque()
    attitude, thrust = level, config.vehicle.hover_thrust
    rows = []
    for k in range(round(seconds * 1000)):
        time_s = k * 1e-3
        if k % 4 == 0:
            for at_s in [at for at in orders if at <= time_s]:
                pilot.steer(orders.pop(at_s))
            setpoint = pilot.step(Odometry(time_s, *state[:10]), 0.004 if k else 0.0)
            on_their_way.append((time_s + DELAY_S, setpoint))
            rows.append((time_s, *state[:3], *pilot.target[:3], pilot.tracking_error_m, setpoint.thrust))
        while on_their_way and on_their_way[0][0] <= time_s + 1e-9:
            *turned, thrust = on_their_way.popleft()[1]
            attitude = (turned[0], turned[1], turned[2], turned[3])
        effects = quadrotor.Effects(*wind(time_s), 0.0, 0.0)
        state = dynamics.step(state, attitude, thrust * full_thrust_n, effects)
    table = np.array(rows)
    return Flown(table[:, 0], table[:, 1:4], table[:, 4:7], table[:, 7], table[:, 8], pilot)


def ends_of_stairs(config: Config, until_s: float) -> list[float]:
    """When each stair is left for the next."""
    return [*(w.at_s for w in config.mission.waypoints[1:] if w.at_s < until_s), until_s]


def test_stairs_with_wrong_mass_wind_gusts_and_delay() -> None:
    """Acceptance of the free flight: steady error below 0.05 m on every stair, tracking RMS below 0.15 m."""
    config = load_config(PX4)
    duration_s = config.mission.duration_s
    assert duration_s is not None
    flown = fly(config, duration_s)
    steady = [flown.steady_m(end_s) for end_s in ends_of_stairs(config, duration_s)]
    assert len(steady) == 6
    assert max(steady) < 0.05
    assert flown.rms_m(0.0, duration_s) < 0.15
    assert flown.pilot.hover_thrust == pytest.approx(TOO_HEAVY * 0.49, rel=0.05)
    limits = config.controller.limits
    assert limits.thrust_min < flown.thrust.min() < flown.thrust.max() < limits.thrust_max


def test_standard_mrac_on_the_same_stairs_is_worse_and_unstable_at_the_hedged_rate() -> None:
    config, until_s = load_config(PX4), 18.0
    as_fast = load_config(PX4, ("controller.bias.adaptation_rate.standard=3",))
    hedged, standard = (fly(config, until_s, hedging=hedging) for hedging in (True, False))
    unstable = fly(as_fast, until_s, hedging=False)
    first_s = 5.0  # the wind has been found
    assert standard.rms_m(first_s, until_s) > 3.0 * hedged.rms_m(first_s, until_s)
    assert standard.steady_m(until_s) > 2.0 * hedged.steady_m(until_s)
    assert unstable.rms_m(first_s, until_s) > 0.3
    assert unstable.steady_m(until_s) > 0.2


def test_twenty_metres_away_it_flies_as_at_the_start() -> None:
    """The same stair at home and 20 m away, at the same moment of a gust."""
    config = load_config(PX4, ("mission.waypoints=[]",))
    home, away = PositionSetpoint(0.0, 0.0, -5.0, HEADING_RAD), PositionSetpoint(16.0, 12.0, -5.0, HEADING_RAD)
    orders = {
        14.0: home._replace(x_m=1.0),
        21.0: away,
        42.0: away._replace(x_m=17.0),
    }
    flown = fly(config, 49.0, steer=orders)
    assert math.dist(flown.position_ned_m[-1], (17.0, 12.0, -5.0)) < 0.1
    assert flown.rms_m(42.0, 49.0) == pytest.approx(flown.rms_m(14.0, 21.0), abs=0.002)
    assert flown.steady_m(49.0) == pytest.approx(flown.steady_m(21.0), abs=0.002)
    assert flown.steady_m(49.0) < 0.05
    assert flown.rms_m(21.0, 42.0) < 0.05  # on the way too


def test_anchored_at_engagement_the_check_refuses_an_envelope_of_twenty_metres() -> None:
    """The same rates: certified when the anchor goes along, refused for the regressors of 20 m when it does not."""
    config = load_config(PX4)
    certificate, reason = proof.load(certificate_path(PX4))
    assert not reason
    verdict = proof.verify(certificate, statement(problem(config)))
    assert verdict.ok, verdict.reason

    far = ("controller.anchor=engage", "controller.envelope.position_m=22")
    stairs = "mission.waypoints=[{at_s: 2, offset_ned_m: [20, 0, 0]}]"
    refused = problem(load_config(PX4, (*far, stairs)))
    unsafe = certify(refused, 2)
    assert unsafe is not None  # the attitude loop is as good as before
    verdict = proof.verify(unsafe, statement(refused))
    assert not verdict.ok
    assert "adaptation rate 1 of axis x is not below" in verdict.reason
