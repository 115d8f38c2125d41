"""Random trajectories inside the limits, plants inside the box, forces inside the bound: does one leave its tube?

    python benchmarks/tube.py [--config FILE] [--flights N] [--first N] [--disturbance M_S2] [--json]

Controller and plant alone, in pure steps, without a link. The force is a disturbance on each axis of the frame: steps,
full one way or the other, at random times, or swings near the loop's own period; the bound counts on each axis. The
estimate is the truth. A flight whose force a limit has cut is told apart, since no tube counts that. 0 if none of the
others leaves, 1 otherwise.
"""

from __future__ import annotations

import argparse
import json
import math
import random
import sys
import time
from collections import deque
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from companion.attitude_response.kind import LinearResponse
from companion.attitude_response.kinds import SecondOrder
from companion.certify.from_config import problem
from companion.certify.problem import AxisProblem
from companion.certify.tube.feed_forward import STEP_S, Asked, left_over
from companion.certify.tube.from_config import bias_of
from companion.certify.tube.tube import Tube, tube
from companion.config import Config, load_config
from companion.config.mission.flown import limits_of
from companion.control import mrac, position
from companion.control.tracking import feed
from companion.control.types import GRAVITY_M_S2, Odometry, PositionSetpoint
from companion.flight.pilot.controller_params import lead_params, position_params
from companion.trajectory.curves import Circle, Lemniscate
from companion.trajectory.feasibility import Limits, stretched
from companion.trajectory.trajectory import Trajectory
from companion.trajectory.waypoints import through
from sitl.build import quadrotor_params
from sitl.vehicles.attitude_loop import RateState
from sitl.vehicles.quadrotor import Dynamics, Effects, QuadrotorParams, QuadrotorState

TICK_S = 0.004
LONGEST_S = 25.0
SETTLED = Path(__file__).resolve().parent.parent / "config" / "trajectories.yaml"


class Flight(NamedTuple):
    """Its largest distances, and the tube it had, m."""

    number: int
    kind: str
    x_m: float
    y_m: float
    tube_x_m: float
    tube_y_m: float
    limited: bool  # a limit cut the force: what no tube counts

    @property
    def share(self) -> float:
        """Of its tube, at most."""
        return max(self.x_m / self.tube_x_m, self.y_m / self.tube_y_m)


def drawn(dice: random.Random, limits: Limits) -> tuple[str, Trajectory]:
    """A trajectory that fits."""
    kind = dice.choice(("circle", "lemniscate", "through"))
    speed = dice.uniform(0.5, min(limits.speed_m_s, 3.5))
    if kind == "circle":
        made: Trajectory = Circle(dice.uniform(1.0, 4.0), speed, 2.0, 2.0, dice.random() < 0.5, False)
    elif kind == "lemniscate":
        length = dice.uniform(3.0, 8.0)
        made = Lemniscate(length, length * dice.uniform(0.3, 0.6), speed, 2.0, 2.0, False)
    else:
        places = [(dice.uniform(-5, 5), dice.uniform(-5, 5), dice.uniform(-1, 1), 0.0) for _ in range(6)]
        made = through(places, limits)
    return kind, stretched(made, limits)


def force(dice: random.Random, bound_m_s2: float, frequency_rad_s: float) -> Iterator[float]:
    """A disturbance a tick, m/s^2, never above its bound."""
    swinging, rate = dice.random() < 0.5, frequency_rad_s * dice.uniform(0.5, 2.0)
    sign, left, k = 1.0, 0.0, 0
    while True:
        if swinging:
            yield bound_m_s2 * (1.0 if math.sin(rate * k * TICK_S) >= 0.0 else -1.0)
        else:
            if left <= 0.0:
                sign, left = dice.choice((-1.0, 1.0)), dice.uniform(0.2, 4.0)
            left -= TICK_S
            yield sign * bound_m_s2
        k += 1


def inside(axis: AxisProblem, dice: random.Random) -> LinearResponse:
    """A response in the box."""
    values = [dice.uniform(float(low), float(high)) for low, high in axis.response.dynamics.values()]  # type: ignore[misc]
    return LinearResponse(SecondOrder, tuple(values))


def fly(number: int, config: Config, axes: dict[str, AxisProblem], tubes: dict[str, Tube], bound_m_s2: float) -> Flight:
    """One flight, by its number alone."""
    dice = random.Random(number)
    lead = lead_params(config)
    limits = limits_of(config.mission, config.controller, config.attitude, config.vehicle.hover_thrust)
    kind, trajectory = drawn(dice, limits)
    params = position_params(config, hedging=True)._replace(lead=lead)
    section = config.plant.quadrotor
    assert section is not None
    base: QuadrotorParams = quadrotor_params(section)
    plant = Dynamics(base._replace(pitch=inside(axes["x"], dice), roll=inside(axes["y"], dice), cascade=False), TICK_S)
    low, high = axes["x"].response.delay_s
    late = max(1, math.floor(dice.uniform(float(low), float(high)) / TICK_S))
    pushes = [force(dice, bound_m_s2, params.x.natural_frequency_rad_s) for _ in range(2)]
    begin = trajectory.at(0.0)
    rest = RateState(0.0, 0.0)
    state = QuadrotorState(*begin[:3], 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, rest, rest, rest)
    hover = config.vehicle.hover_thrust
    nominal = mrac.nominal_weights(params.x), mrac.nominal_weights(params.y)
    control = position.engage(params, Odometry(0.0, *state[:10]), 0.0, *nominal, hover)
    flown = deque([((1.0, 0.0, 0.0, 0.0), hover)] * late)
    farthest, limited = [0.0, 0.0], False
    drag, mass = base.drag_n_s2_m2, base.mass_kg
    asked: list[list[Asked]] = [[], []]
    duration = min(trajectory.duration_s, LONGEST_S)
    for k in range(int(duration / TICK_S)):
        at = trajectory.at(k * TICK_S)
        target = PositionSetpoint(at.x_m, at.y_m, at.z_m, 0.0)
        control, out = position.step(
            params, control, Odometry(k * TICK_S, *state[:10]), target, TICK_S if k else 0.0, at
        )
        limited = limited or out.limited
        wanted = out.setpoint
        flown.append(((wanted.qw, wanted.qx, wanted.qy, wanted.qz), wanted.thrust))
        attitude, thrust = flown.popleft()
        push = [next(each) for each in pushes]
        size = math.hypot(*push)
        air = math.sqrt(mass / (drag * size)) if size else 0.0  # the wind whose drag is that force
        wind = Effects(state.vx_m_s + air * push[0], state.vy_m_s + air * push[1], state.vz_m_s, 0.0, 0.0)
        state = plant.step(state, attitude, thrust / hover * mass * GRAVITY_M_S2, wind)
        after = trajectory.at((k + 1) * TICK_S)
        farthest = [max(farthest[0], abs(state.x_m - after.x_m)), max(farthest[1], abs(state.y_m - after.y_m))]
    for k in range(int(duration / STEP_S)):
        at = trajectory.at(k * STEP_S)
        fed = feed(at, lead, 1.0, 0.0, GRAVITY_M_S2)
        for place, acceleration in enumerate((at.ax_m_s2, at.ay_m_s2)):
            asked[place].append(Asked(acceleration, GRAVITY_M_S2 * fed[place]))
    wide = [
        tubes[name].m_per_m_s2 * (bound_m_s2 + left_over(axes[name], asked[place]))
        for place, name in enumerate(("x", "y"))
    ]
    return Flight(number, kind, farthest[0], farthest[1], wide[0], wide[1], limited)


def main() -> int:
    """Fly and tell."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--config", type=Path, default=SETTLED)
    parser.add_argument("--flights", type=int, default=10)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--disturbance", type=float, default=0.5, metavar="M_S2")
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE", dest="overrides")
    given = parser.parse_args()
    config = load_config(given.config, tuple(given.overrides))
    axes = dict(problem(config).axes)
    tubes: dict[str, Tube] = {}
    known: dict[AxisProblem, Tube] = {}
    for name, axis in axes.items():
        if axis not in known:
            known[axis] = tube(axis, bias_of(config, name, axis), bound_bias=False)
        tubes[name] = known[axis]
    began, flights = time.process_time(), []
    for number in range(given.first, given.first + given.flights):
        flights.append(fly(number, config, axes, tubes, given.disturbance))
    seconds = time.process_time() - began
    worst = max(flights, key=lambda flight: flight.share)
    told = {
        "flights": len(flights),
        "left": [flight.number for flight in flights if flight.share > 1.0 and not flight.limited],
        "limited": sum(flight.limited for flight in flights),
        "left_limited": [flight.number for flight in flights if flight.share > 1.0 and flight.limited],
        "worst": worst._asdict() | {"share": worst.share},
        "m_per_m_s2": tubes["x"].m_per_m_s2,
        "weights": tubes["x"].proof["weights"],
        "cpu_s_a_flight": seconds / len(flights),
    }
    if given.json:
        print(json.dumps(told))
    else:
        for key, value in told.items():
            print(f"{key}: {value}")
    return 1 if told["left"] else 0


if __name__ == "__main__":
    sys.exit(main())
