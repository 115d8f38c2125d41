"""Each quantity of an estimate by itself: what has stopped, and what may stand still."""

import math
from random import Random

import pytest

from companion.control.types import Odometry
from companion.flight.guards import stuck
from companion.flight.guards.stuck import NAMES

UP = (0.0, 0.0, -1.0)
FIELDS = {name: ((f"{name}_m",) if len(name) == 1 else (f"{name}_m_s",)) for name in NAMES[:6]}
FIELDS["attitude"] = ("qw", "qx", "qy", "qz")


def flying(random: Random, time_s: float) -> Odometry:
    """A sample of a vehicle that moves a little."""
    x, y, z, vx, vy, vz, tilt = (random.gauss(0.0, 0.02) for _ in range(7))
    return Odometry(time_s, x, y, z - 3.0, vx, vy, vz, math.cos(tilt), 0.7 * math.sin(tilt), 0.6 * math.sin(tilt),
                    0.3 * math.sin(tilt))  # fmt: skip


def worst_s(*stopped: str, every: int = 0, wanted_turns: float = 0.5, seconds: float = 0.4) -> dict[str, float]:
    """For how long each quantity has not changed, after some have stopped; `every`: looks at which they move on."""
    random = Random(1)
    state = stuck.start(flying(random, 10.0), UP)
    kept = state.last
    for k in range(1, round(seconds / 0.02) + 1):
        sample = flying(random, 10.0 + 0.02 * k)
        if every and k % every == 0:
            kept = sample
        frozen = {field: getattr(kept, field) for name in stopped for field in FIELDS[name]}
        turn = wanted_turns * 0.02 * k
        state = stuck.step(state, sample._replace(**frozen), (math.sin(turn), 0.0, -math.cos(turn)))
    return dict(zip(NAMES, state.for_s, strict=True))


@pytest.mark.parametrize("name", NAMES)
def test_each_is_seen_to_stop_by_itself(name: str) -> None:
    found = worst_s(name)
    assert found.pop(name) > 0.25
    assert set(found.values()) == {0.0}


def test_position_and_velocity_of_one_axis_are_seen_to_stop_together() -> None:
    assert worst_s("x", "vx")["x"] > 0.25


def test_all_at_once_are_seen_too() -> None:
    assert min(worst_s(*NAMES)[name] for name in ("x", "y", "z", "attitude")) > 0.25


def test_one_new_value_among_many_old_ones_wipes_nothing_out() -> None:
    assert worst_s("y", every=10, seconds=1.0)["y"] > 0.5  # five times a second


def test_what_moves_has_not_stopped() -> None:
    assert set(worst_s(seconds=2.0).values()) == {0.0}
    assert worst_s("x", every=2, seconds=2.0)["x"] < 0.1  # as often the same as not


def test_what_is_at_rest_may_stay_as_it_is() -> None:
    rest = Odometry(10.0, 1.0, 2.0, -3.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0)
    state = stuck.start(rest, UP)
    for k in range(1, 100):
        state = stuck.step(state, rest._replace(time_s=10.0 + 0.02 * k), UP)
    assert set(state.for_s) == {0.0}
    cruising = rest._replace(vx_m_s=1.5)
    state = stuck.start(cruising, UP)
    for k in range(1, 100):  # y, z and attitude stand still, and the velocity is the same: it goes where it says
        state = stuck.step(state, cruising._replace(time_s=10.0 + 0.02 * k, x_m=1.0 + 0.03 * k), UP)
    assert set(state.for_s) == {0.0}


def test_a_counted_reset_has_not_stopped_anything() -> None:
    rest = Odometry(10.0, 1.0, 2.0, -3.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0)
    state = stuck.start(rest, UP)
    state = stuck.step(state, rest._replace(time_s=10.02, x_m=1.4), UP, reset=True)
    for k in range(2, 50):
        state = stuck.step(state, rest._replace(time_s=10.0 + 0.02 * k, x_m=1.4), UP)
    assert set(state.for_s) == {0.0}
