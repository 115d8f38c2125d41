"""The compiled closed loop flies as the flight process does on the plant."""

from pathlib import Path

import numpy as np
import pytest
from harness import lockstep_flight
from harness.equal_flights import FLIGHTS, EqualFlight

from companion.config import load_config
from companion.flight.authority.states import Reason
from sitl.campaign import loop

pytest.importorskip("numba")

from sitl.campaign.flight import fly
from sitl.campaign.takeover import CampaignError, take_over

ROOT = Path(__file__).resolve().parents[2]
STEP = ("mission.duration_s=4", "mission.waypoints=[{at_s: 0.5, offset_ned_m: [0.2, 0.1, -0.2]}]")


@pytest.mark.slow  # the loop is compiled once for each kind of vehicle and then kept on disk
@pytest.mark.parametrize("flight", FLIGHTS, ids=lambda flight: flight.name)
def test_a_compiled_flight_is_the_lockstep_flight_tick_by_tick(flight: EqualFlight, tmp_path: Path) -> None:
    config = load_config(ROOT / "config" / f"{flight.config}.yaml", (*flight.overrides, *STEP))
    reason, wanted = lockstep_flight.fly(config, tmp_path / "flight", hedging=flight.hedging)
    assert reason is Reason.MISSION_COMPLETE
    outcome, trace = fly(take_over(config, hedging=flight.hedging), len(wanted))
    assert outcome.ending == loop.COMPLETE
    assert len(wanted) > 400
    np.testing.assert_allclose(trace[:, :6], wanted[1:], rtol=0.0, atol=1e-9)  # the first began the compiled one


def test_what_a_campaign_does_not_fly_is_said_in_one_line() -> None:
    config = load_config(ROOT / "config" / "px4_quadrotor.yaml", ("plant.link={down: {delay_s: 0.01}}",))
    with pytest.raises(CampaignError, match=r"plant\.link: a campaign does not fly"):
        take_over(config, hedging=True)
