"""An estimate that lies in one quantity, and the ground, flown: what ends control, and how far the vehicle truly went.

On commit 9cadbff each of these flew on to the end of its mission: with north and its velocity stuck 97 m away, with the
position stuck 184 m, under steps of 0.45 m a second 10 m, under a slide of 0.3 m/s 18 m, of 1 m/s in height 63 m; a
variance with gaps, a failed odometry, a slow content, a running reset counter and a fast clock were flown through. A
vehicle 20 % too heavy sank by 0.23 m at the take-over, with an MPC_THR_HOVER of 0.15 it left its fence, and a landing
had no reason of its own.
"""

from pathlib import Path

import pytest

from sitl.scenarios.catalogue.ground import GROUND
from sitl.scenarios.catalogue.lies import LIES
from sitl.scenarios.flight import Bases, fly
from sitl.scenarios.index import by_name
from sitl.scenarios.scenario import QUADROTOR

BASES = Bases({QUADROTOR: Path(__file__).resolve().parents[2] / "config" / QUADROTOR})


@pytest.mark.parametrize("name", [scenario.name for scenario in LIES if scenario.name != "honest"])
def test_it_is_found_before_the_vehicle_is_three_metres_beyond_its_fence(name: str, tmp_path: Path) -> None:
    flown = fly(by_name(name), BASES, tmp_path / name)
    assert flown.problems == ()
    assert flown.in_control_m is not None
    assert flown.in_control_m < 5.0


@pytest.mark.parametrize("name", [scenario.name for scenario in GROUND])
def test_it_flies_where_it_flies_with_the_thrust_that_carries_it(name: str, tmp_path: Path) -> None:
    """Of a take-over with the wrong weight or a wrong MPC_THR_HOVER: within 5 cm."""
    assert fly(by_name(name), BASES, tmp_path / name).problems == ()
