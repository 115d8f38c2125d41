"""An estimate that lies in one quantity, flown: what ends control, and how far the vehicle has truly gone by then.

On commit 9cadbff each of these flew on to the end of its mission: with north and its velocity stuck 97 m away, with the
position stuck 184 m, under steps of 0.45 m a second 10 m, under a slide of 0.3 m/s 18 m, of 1 m/s in height 63 m; a
variance with gaps, a failed odometry, a slow content, a running reset counter and a fast clock were flown through.
"""

from pathlib import Path

import pytest

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
