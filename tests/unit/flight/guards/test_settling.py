"""Control waits for an estimate that was seen unsettled, and for none that was not."""

from __future__ import annotations

import math
from pathlib import Path

from companion.config import load_config
from companion.control.types import Odometry
from companion.flight.guards.settling import Settling

CONFIG = Path(__file__).resolve().parents[4] / "config" / "px4_quadrotor.yaml"


def settling(*overrides: str) -> Settling:
    return Settling(load_config(CONFIG, overrides))


def see(watched: Settling, seconds: tuple[float, float], slide_m_s: float, missing: float = 0.0) -> bool:
    """Position that slides by so much a second while the velocity says nothing of it."""
    for k in range(round(seconds[0] * 50), round(seconds[1] * 50)):
        watched.on_sample(Odometry(0.02 * k, 0.02 * k * slide_m_s, 0, 0, 0, 0, 0, 1, 0, 0, 0), missing)
    return watched.settled


def test_an_estimate_that_agrees_with_itself_is_not_waited_for() -> None:
    assert see(settling(), (0.0, 0.04), 0.0)
    assert see(settling(), (0.0, 3.0), 0.3), "what EKF2 shows with GPS in steady flight"
    assert see(settling(), (0.0, 3.0), 0.0, math.nan), "flags that are not told are the blind guards' business"


def test_one_that_slides_is_waited_for_until_it_has_rested_for_the_timeout() -> None:
    watched = settling()
    assert not see(watched, (0.0, 3.0), 1.5)
    state = see(watched, (3.0, 4.0), 0.0)
    assert not state
    assert see(watched, (4.0, 6.5), 0.0)


def test_one_with_a_solution_missing_is_waited_for() -> None:
    watched = settling()
    assert not see(watched, (0.0, 1.0), 0.0, 1.0)
    assert not see(watched, (1.0, 2.5), 0.0)
    assert see(watched, (2.5, 3.5), 0.0)


def test_switched_off_it_waits_for_nothing() -> None:
    assert see(settling("guards.estimate_settled_m.enabled=false"), (0.0, 3.0), 5.0, 3.0)
