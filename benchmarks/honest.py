"""Honest flights: how often does a guard end control though nobody lies?

python benchmarks/honest.py [--flights N] [--first SEED] [-j WORKERS]

Each flies the mission of `config/px4_quadrotor.yaml` for 60 s on the plant, under one of the estimators of
`sitl/world/navigation_error.py` in turn, in wind of a random strength and direction with gusts and turbulence, up to
20 % too heavy. Controller and guards are those of the flight process, fed by the plant directly: without MAVLink,
without a log. Printed are the releases by reason, and of each guard on the estimate the largest value seen, over its
limit, by estimator. Exit code 1 where more than one flight in a thousand is released by one of them.
"""

from __future__ import annotations

import argparse
import math
import sys
import time
from collections import Counter
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from random import Random
from typing import Final, NamedTuple

from companion.config import Config, load_config
from companion.config.guards.rows import Reason
from companion.control.types import AttitudeSetpoint, Odometry
from companion.flight.guards import table
from companion.flight.guards.look import Told
from companion.flight.guards.table import WATCHED
from companion.flight.guards.watch import Watch
from companion.flight.pilot.pilot import Pilot
from sitl.autopilot.autopilot import Autopilot
from sitl.autopilot.modes import FlightMode
from sitl.build import World, build_world
from sitl.world.navigation_error import PRESETS

CONFIG: Final = Path(__file__).resolve().parents[1] / "config" / "px4_quadrotor.yaml"
WATCHING: Final = (  # the estimate
    Reason.ESTIMATE_STUCK,
    Reason.VELOCITY_CONSISTENCY,
    Reason.ESTIMATOR_STEPS,
    Reason.POSITION_SLIDE,
    Reason.HEIGHT_SLIDE,
    Reason.UNEXPLAINED_MOTION,
)
FLOWN_S: Final = 60.0
ALLOWED: Final = 1e-3
SAMPLE_US: Final = 8_000
ALTITUDE_M: Final = 5.0
SETTLE_S: Final = 10.0
GOOD: Final = Told(0.0, (0.02, 0.02, 0.005), resets_counted=True, round_trip_s=0.005, jitter_s=0.001, clock_rate=1.0)


class Flown(NamedTuple):
    """One flight: estimator, why it was released or None, the largest value over its limit of each of `WATCHING`."""

    preset: str
    seed: int
    reason: Reason | None
    at_s: float
    largest: tuple[float, ...]


def config_of(seed: int) -> tuple[str, Config]:
    """(estimator, config) of a flight."""
    random = Random(f"honest {seed}")
    preset = list(PRESETS)[seed % len(PRESETS)]
    speed, towards = random.uniform(0.0, 4.5), random.uniform(0.0, math.tau)
    north, east = speed * math.cos(towards), speed * math.sin(towards)
    share = random.uniform(0.0, 0.4)  # of the mean wind, in gusts of a second's rise
    gust = (
        f"{{peak_ned_m_s: [{share * north:.2f}, {share * east:.2f}, {random.uniform(-0.5, 0.5):.2f}], rise_s: 1, "
        f"hold_s: 1, every_s: {random.uniform(5.0, 10.0):.1f}}}"
    )
    overrides = [
        f"plant.seed={seed}",
        f"plant.sensors={{preset: {preset}}}",
        f"estimator={{preset: {preset}}}",
        f"plant.mismatch={{mass: {random.uniform(1.0, 1.2):.3f}}}",
        f"plant.wind={{mean_ned_m_s: [{north:.2f}, {east:.2f}, 0], gust: {gust}, "
        f"turbulence: {{wind_at_20_ft_m_s: {random.uniform(1.0, 10.0):.1f}, altitude_m: 6}}}}",
    ]
    if preset == "optical_flow":  # nothing aids its position: there is nothing to correct by
        overrides.append("controller.estimate_correction=null")
    return preset, load_config(CONFIG, tuple(overrides))


def sample_of(autopilot: Autopilot) -> Odometry:
    """What ODOMETRY tells now."""
    position, velocity, q_wxyz, _, _ = autopilot.estimate()
    return Odometry(1e-6 * autopilot.time_us, *position, *velocity, *q_wxyz)


def take_off(world: World, level: AttitudeSetpoint) -> Odometry:
    """In the air, Hold settled, then OFFBOARD: the sample at which control begins."""
    autopilot = world.autopilot
    autopilot.start_in_air(ALTITUDE_M, SETTLE_S)
    sample = sample_of(autopilot)
    autopilot.on_attitude_target((sample.qw, sample.qx, sample.qy, sample.qz), level.thrust)
    autopilot.commander.request(FlightMode.OFFBOARD, autopilot.time_us)
    autopilot.follow_mode()
    assert autopilot.commander.mode is FlightMode.OFFBOARD
    return sample


def flown(seed: int) -> Flown:
    """One flight, from the first set-point to the end of the mission or a release."""
    preset, config = config_of(seed)
    limits = table.limits(config)
    pilot, watch = Pilot(config, hedging=True), Watch(config, limits)
    world = build_world(config)
    autopilot = world.autopilot
    last = take_off(world, AttitudeSetpoint(1.0, 0.0, 0.0, 0.0, config.vehicle.hover_thrust))
    pilot.take_over(last)
    watch.begin(last)
    places = [WATCHED.index(reason) for reason in WATCHING]
    largest = [0.0] * len(places)
    ticks = 0
    while True:
        autopilot.advance(autopilot.time_us + SAMPLE_US)
        sample = sample_of(autopilot)
        setpoint = pilot.step(sample, sample.time_s - last.time_s)
        last = sample
        autopilot.on_attitude_target(setpoint[:4], setpoint.thrust)
        ticks += 1
        if sample.time_s >= watch.due_s:
            reason = watch.look(sample, setpoint, pilot, GOOD, ticks)
            largest = [max(had, watch.last[place]) for had, place in zip(largest, places, strict=True)]
            if reason is not None or pilot.elapsed_s >= FLOWN_S:
                shares = tuple(value / limits[r] for value, r in zip(largest, WATCHING, strict=True))
                return Flown(preset, seed, reason, pilot.elapsed_s, shares)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--flights", type=int, default=1000)
    parser.add_argument("--first", type=int, default=0, help="seed of the first one")
    parser.add_argument("-j", type=int, default=1, help="worker processes")
    arguments = parser.parse_args()
    began_s = time.monotonic()
    reasons: Counter[Reason] = Counter()
    worst: dict[str, list[float]] = {preset: [0.0] * len(WATCHING) for preset in PRESETS}
    with ProcessPoolExecutor(arguments.j) as pool:
        seeds = range(arguments.first, arguments.first + arguments.flights)
        for one in pool.map(flown, seeds, chunksize=4):
            worst[one.preset] = [max(pair) for pair in zip(worst[one.preset], one.largest, strict=True)]
            if one.reason is not None:
                reasons[one.reason] += 1
                print(f"seed {one.seed}: {one.preset}: {one.reason} after {one.at_s:.1f} s", flush=True)
    print("largest value over its limit")
    print(f"{'':20}" + "".join(f"{preset:>16}" for preset in PRESETS))
    for place, reason in enumerate(WATCHING):
        print(f"{reason:20}" + "".join(f"{worst[preset][place]:16.2f}" for preset in PRESETS))
    lied = sum(reasons[reason] for reason in WATCHING)
    told = ", ".join(f"{count} for {reason}" for reason, count in reasons.most_common()) or "none"
    wall_s = time.monotonic() - began_s
    print(f"{arguments.flights} flights of {FLOWN_S:g} s, {wall_s:.0f} s; released: {told}")
    allowed = math.ceil(ALLOWED * arguments.flights)
    print(f"{lied} for a guard on the estimate, at most {allowed}: {'met' if lied <= allowed else 'MISSED'}")
    return 0 if lied <= allowed else 1


if __name__ == "__main__":
    sys.exit(main())
