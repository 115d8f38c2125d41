"""Companions that die in flight: how far the vehicle goes until PX4 takes over, beside what `companion check` says.

python benchmarks/dying_companion.py [--config FILE] [--deaths N] [--loss-time S] [--workers N] [--seed N]

Controller and plant, no MAVLink. Each flight begins anywhere in the envelope: position, velocity, tilt, weights, bias,
mass within the hover guard, a wind within the bias bound. At ten random moments of it the plant is copied, and flies on
with the set-point of that tick for COM_OF_LOSS_T and what PX4 needs after it. Counted are deaths inside
`controller.envelope`. Exit code 1 where one is outside the bound, or the bound is above twice the worst.
"""

from __future__ import annotations

import argparse
import copy
import math
import sys
import time
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from pathlib import Path
from random import Random
from typing import NamedTuple

from companion.certify import link_loss
from companion.config import Config, load_config
from companion.control import position
from companion.control.types import GRAVITY_M_S2, Odometry, PositionSetpoint
from companion.flight.pilot.controller_params import hover_params, position_params
from sitl.build import quadrotor_params
from sitl.vehicles.quadrotor import Effects
from sitl.vehicles.rotation import quaternion
from sitl.vehicles.vehicle import Quadrotor

ROOT = Path(__file__).resolve().parents[1]
DEATHS_A_FLIGHT = 10
FLIGHT_S = 1.5
DT_S = 0.004  # of controller and plant
HEIGHT_M = 50.0


class Worst(NamedTuple):
    """Of some deaths: the largest of each, and how many counted and did not."""

    tilt_rad: float = 0.0
    distance_m: float = 0.0
    height_lost_m: float = 0.0
    counted: int = 0
    outside: int = 0  # of the envelope

    def with_(self, other: Worst) -> Worst:
        return Worst(
            max(self.tilt_rad, other.tilt_rad),
            max(self.distance_m, other.distance_m),
            max(self.height_lost_m, other.height_lost_m),
            self.counted + other.counted,
            self.outside + other.outside,
        )


def begin(
    config: Config, random: Random
) -> tuple[Quadrotor, position.PositionParams, position.PositionState, Odometry]:
    """A vehicle and its controller somewhere in the envelope."""
    plant = config.plant
    assert plant is not None
    assert plant.quadrotor is not None
    assert config.controller.altitude is not None
    envelope, limits, hover = config.controller.envelope, config.controller.limits, config.vehicle.hover_thrust
    off = config.guards.hover_thrust.limit
    weight = random.choice([1.0, random.uniform(1.0 - off, 1.0 + off)])
    believed = quadrotor_params(plant.quadrotor)
    vehicle = Quadrotor(
        believed._replace(mass_kg=weight * believed.mass_kg),
        hover,
        plant.setpoint_delay_s,
        dt_s=DT_S,
        thrust_factor=1.0 / weight,
    )
    bias = 0.0 if config.controller.bias is None else config.controller.bias.bound
    force_n = random.uniform(0.0, bias) * GRAVITY_M_S2 * weight * believed.mass_kg
    wind_m_s = math.sqrt(force_n / believed.drag_n_s2_m2) if believed.drag_n_s2_m2 else 0.0
    heading = random.uniform(-math.pi, math.pi)
    speed, reach, sinking = envelope.velocity_m_s, envelope.position_m, config.controller.altitude.velocity_limit_m_s
    tilt = math.radians(limits.tilt_deg) * math.sqrt(random.random())
    lean = random.uniform(-math.pi, math.pi)
    q = quaternion(tilt * math.sin(lean), tilt * math.cos(lean), 0.0)
    north, east = random.uniform(-speed, speed), random.uniform(-speed, speed)
    ahead, aside = random.uniform(-reach, reach), random.uniform(-reach, reach)
    if random.random() < 0.5:  # all the same way: what the bound is about
        north, east = (math.copysign(speed * random.uniform(0.7, 1.0), random.random() - 0.5) for _ in range(2))
        ahead, aside = (math.copysign(reach * random.random(), way) for way in (north, east))
        heading = math.atan2(east, north)
        q = quaternion(tilt * math.sin(heading), -tilt * math.cos(heading), 0.0)
    vehicle.effects = Effects(wind_m_s * math.cos(heading), wind_m_s * math.sin(heading), 0.0, 0.0, 0.0)
    vehicle.lift_to(-HEIGHT_M)
    vehicle._state = vehicle._state._replace(
        vx_m_s=north, vy_m_s=east,
        vz_m_s=random.uniform(-sinking, sinking), qw=q[0], qx=q[1], qy=q[2], qz=q[3],
    )  # fmt: skip
    params = position_params(config, hedging=True)._replace(hover=hover_params(config, hover))
    sample = seen(vehicle, 0.0)

    def weights(of: position.mrac.AxisParams) -> tuple[float, float]:
        return (
            random.uniform(of.position_weight_lower, of.position_weight_upper),
            random.uniform(of.velocity_weight_lower, of.velocity_weight_upper),
        )

    state = position.engage(params, sample, 0.0, weights(params.x), weights(params.y), hover)
    target = PositionSetpoint(ahead, aside, -HEIGHT_M + random.uniform(-2.0, 2.0), 0.0)
    state = state._replace(
        x=state.x._replace(bias_weight=random.uniform(-bias, bias)),
        y=state.y._replace(bias_weight=random.uniform(-bias, bias)),
        flown=target,
    )
    return vehicle, params, state, sample


def seen(vehicle: Quadrotor, time_s: float) -> Odometry:
    truth = vehicle.state
    return Odometry(time_s, *truth.position_ned_m, *truth.velocity_ned_m_s, *truth.q_wxyz)


def die(vehicle: Quadrotor, setpoint: tuple[float, ...], duration_s: float) -> Worst:
    """What a copy of the vehicle does under the last set-point."""
    ghost = copy.copy(vehicle)
    ghost._delay = copy.deepcopy(vehicle._delay)
    q, thrust = (setpoint[0], setpoint[1], setpoint[2], setpoint[3]), setpoint[4]
    x0, y0, z0 = ghost._state[:3]
    tilt, distance, lost = 0.0, 0.0, 0.0
    for _ in range(round(duration_s / DT_S)):
        ghost.step(q, thrust)
        x, y, z, _, _, _, _, qx, qy, _ = ghost._state[:10]
        tilt = max(tilt, 2.0 * (qx * qx + qy * qy))  # one less its cosine
        distance = max(distance, (x - x0) ** 2 + (y - y0) ** 2)
        lost = max(lost, z - z0)
    return Worst(math.acos(1.0 - tilt), math.sqrt(distance), lost, 1)


def fly(config: Config, duration_s: float, seed: str) -> Worst:
    """One flight, and its deaths."""
    random = Random(seed)
    vehicle, params, state, sample = begin(config, random)
    envelope, altitude = config.controller.envelope, config.controller.altitude
    assert altitude is not None
    target = state.flown
    ticks = round(FLIGHT_S / DT_S)
    deaths = {random.randrange(ticks) for _ in range(DEATHS_A_FLIGHT)}
    found = Worst()
    for k in range(ticks):
        if random.random() < DT_S / 0.5:  # every half second on average, somewhere else
            away = [random.uniform(-envelope.position_m, envelope.position_m) for _ in range(2)]
            target = PositionSetpoint(
                sample.x_m + away[0], sample.y_m + away[1], sample.z_m + random.uniform(-2, 2), 0.0
            )
        state, output = position.step(params, state, sample, target, DT_S)
        if k in deaths:
            at, down = output.measured, vehicle.state.velocity_ned_m_s[2]
            inside = (
                max(abs(at.x_m), abs(at.y_m)) <= envelope.position_m
                and max(abs(at.vx_m_s), abs(at.vy_m_s)) <= envelope.velocity_m_s
                and down <= altitude.velocity_limit_m_s
            )
            found = found.with_(die(vehicle, output.setpoint, duration_s) if inside else Worst(outside=1))
        vehicle.step(output.setpoint[:4], output.setpoint.thrust)
        sample = seen(vehicle, (k + 1) * DT_S)
    return found


def fly_some(config: Config, duration_s: float, seeds: list[str]) -> Worst:
    found = Worst()
    for seed in seeds:
        found = found.with_(fly(config, duration_s, seed))
    return found


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--config", type=Path, default=ROOT / "config" / "px4_quadrotor.yaml")
    parser.add_argument("--deaths", type=int, default=10_000)
    parser.add_argument("--loss-time", type=float, default=link_loss.PX4_DEFAULT_S, help="COM_OF_LOSS_T, s")
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--seed", type=int, default=1)
    arguments = parser.parse_args()
    config = load_config(arguments.config)
    bound = link_loss.worst(config, arguments.loss_time)
    duration_s = arguments.loss_time + link_loss.REACTION_S
    flights = math.ceil(arguments.deaths / DEATHS_A_FLIGHT)
    seeds = [f"{arguments.seed} {k}" for k in range(flights)]
    began_s = time.perf_counter()
    if arguments.workers > 1:
        with ProcessPoolExecutor(arguments.workers) as pool:
            parts = [seeds[k :: 8 * arguments.workers] for k in range(8 * arguments.workers)]
            results = list(pool.map(partial(fly_some, config, duration_s), parts))
    else:
        results = [fly_some(config, duration_s, seeds)]
    worst = Worst()
    for result in results:
        worst = worst.with_(result)
    print(
        f"{arguments.config.name}, COM_OF_LOSS_T {arguments.loss_time:g} s: {flights} flights, {worst.counted} deaths, "
        f"{worst.outside} more outside the envelope, {time.perf_counter() - began_s:.0f} s"
    )
    print(f"{'':12} {'worst seen':>10} {'bound':>8} {'ratio':>6}")
    missed = 0
    for name, saw, most, unit in (
        ("tilt", math.degrees(worst.tilt_rad), math.degrees(bound.tilt_rad), "deg"),
        ("distance", worst.distance_m, bound.distance_m, "m"),
        ("height lost", worst.height_lost_m, bound.height_lost_m, "m"),
    ):
        verdict = "OUTSIDE" if saw > most else "loose" if most > 2.0 * saw else ""
        missed += bool(verdict)
        print(f"{name:12} {saw:10.2f} {most:8.2f} {most / saw:6.2f} {unit} {verdict}")
    return 1 if missed else 0


if __name__ == "__main__":
    sys.exit(main())
