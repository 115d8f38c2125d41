"""PX4 v1.18's reference model: what a response would be at other settings, and which settings are proposed."""

from __future__ import annotations

from decimal import Decimal
from pathlib import Path

import numpy as np
import pytest
from scipy.signal import TransferFunction, step

from companion.certify.designing.design import two_figures
from companion.certify.designing.px4_reference_model import Proposal, Settings, predicted, propose, settings_of
from companion.certify.from_config import problem
from companion.config import load_config

CONFIG = Path(__file__).resolve().parents[3] / "config" / "px4_quadrotor_1_18.yaml"
DEFAULT = Settings(50.0, 0.0, 100.0)
P_1_S = 4.0
SIH = (9.2, 0.92, 0.08)  # identified on a real v1.18 with its defaults: rad/s, damping ratio, s


def lag_s(response: tuple[float, float, float]) -> float:
    wn, zeta, delay = response
    return 2.0 * zeta / wn + delay


def test_at_the_same_settings_it_stays() -> None:
    assert predicted(SIH, P_1_S, DEFAULT, DEFAULT) == pytest.approx(SIH, rel=1e-3)


@pytest.mark.parametrize(
    ("then", "measured"),
    [(Settings(200.0, 0.0, 100.0), (9.64, 0.955, 0.0525)), (Settings(15.0, 1.0, 100.0), (9.4, 0.48, 0.046))],
)
def test_a_real_vehicle_answers_as_predicted(then: Settings, measured: tuple[float, float, float]) -> None:
    """Identified with these settings on the same vehicle."""
    found = predicted(SIH, P_1_S, DEFAULT, then)
    assert found[:2] == pytest.approx(measured[:2], rel=0.03)
    assert found[2] == pytest.approx(measured[2], abs=0.006)


def test_with_feed_forward_a_real_vehicle_is_somewhat_slower_than_predicted() -> None:
    """Identified: 13.5 rad/s, 0.79, 42 ms. The direction and most of the size are right; hence identify again."""
    found = predicted(SIH, P_1_S, DEFAULT, Settings(50.0, 0.5, 300.0))
    assert lag_s(found) == pytest.approx(lag_s((13.5, 0.79, 0.042)), abs=0.02)
    assert lag_s(found) < lag_s(SIH) - 0.1


def test_the_step_response_is_that_of_the_whole_chain() -> None:
    """Time domain, independent of the fit in frequencies: loop times model, beside the second order found."""
    then, time_s = Settings(100.0, 0.25, 300.0), np.linspace(0.0, 1.5, 3001)
    wn, zeta, _ = SIH
    loop = np.polymul([1.0, 2 * zeta * wn, wn * wn], [1.0])
    bare = predicted(SIH, P_1_S, DEFAULT, Settings(1e4, 0.0, 100.0))
    chain = TransferFunction(
        wn * wn * 1e4 * np.polymul([0.25 / P_1_S, 1.0], [1.0]), np.polymul(loop, np.polymul([1.0, 100.0], [1.0, 100.0]))
    )
    _, wanted = step(chain, T=time_s)
    found = predicted((wn, zeta, bare[2]), P_1_S, Settings(1e4, 0.0, 100.0), then)
    late = np.interp(time_s - bare[2], time_s, wanted, left=0.0)
    _, second = step(TransferFunction([found[0] ** 2], [1.0, 2 * found[0] * found[1], found[0] ** 2]), T=time_s)
    shown = np.interp(time_s - found[2], time_s, second, left=0.0)
    assert float(np.sqrt(np.mean((late - shown) ** 2))) < 0.02


def proposal(gain_1_s: float, now: Settings = DEFAULT) -> Proposal | None:
    axes = {"x": problem(load_config(CONFIG)).axes["x"]}
    return propose(axes, dict.fromkeys(axes, SIH), dict.fromkeys(axes, gain_1_s), now, Decimal("0.1"))


def test_settings_are_proposed_that_allow_a_faster_reference() -> None:
    found = proposal(P_1_S)
    assert found is not None
    assert found.settings.parameters() == {"MC_REF_W_N": 50.0, "MC_REF_FF": 0.5, "MC_REF_FF_MAX": 300.0}
    assert found.fastest_rad_s > Decimal("3.3")


def test_nothing_is_proposed_that_px4_would_cut() -> None:
    """With a gain of 13 its rate limit of 220 deg/s is used up by the gain alone."""
    assert proposal(13.0) is None or proposal(13.0).settings.share == 0.0  # type: ignore[union-attr]


def test_nothing_is_proposed_where_the_settings_are_as_good() -> None:
    assert proposal(P_1_S, Settings(50.0, 0.5, 300.0)) is None


def test_a_vehicle_without_the_model_has_no_settings() -> None:
    assert settings_of({"MC_ROLL_P": 4.0}) is None
    assert settings_of({"MC_REF_W_N": 50.0, "MC_REF_FF": 0.0}) == DEFAULT


def test_a_rate_of_a_hundred_is_written_as_one() -> None:
    assert str(two_figures(104.0)) == "100"
    assert str(two_figures(0.0471)) == "0.047"
