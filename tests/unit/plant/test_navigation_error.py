"""The plant's GPS estimator is as wrong as a real one: joint statistics and spectra beside recorded flights."""

from pathlib import Path
from random import Random

import numpy as np
import numpy.typing as npt
import pytest

from sitl.world.navigation_error import PRESETS, AxisError, ErrorState, settled, step

RECORDED = np.load(Path(__file__).resolve().parents[2] / "data" / "px4_sih_estimator_errors.npz")["errors"]
RATE_HZ = 10.0
BANDS_HZ = ((0.02, 0.1), (0.1, 0.3), (0.3, 1.0))
Series = npt.NDArray[np.float64]


def flown(params: AxisError, flights: int) -> tuple[Series, Series]:
    """(position, velocity) errors of as many flights as long as the recorded ones, each row less nothing."""
    random = Random("errors")
    positions, velocities = [], []
    for _ in range(flights):
        state = settled(params, lambda: random.gauss(0.0, 1.0))
        rows = []
        for _ in range(RECORDED.shape[1]):
            for _ in range(5):
                state = step(params, state, 0.02, *(random.gauss(0.0, 1.0) for _ in range(3)))
            rows.append((state.position_m, state.velocity_m_s))
        position, velocity = np.array(rows).T
        positions.append(position)
        velocities.append(velocity)
    return np.array(positions), np.array(velocities)


def centred(values: Series) -> Series:
    return values - values.mean(axis=1, keepdims=True)


def left_after(values: Series, lag_s: float) -> float:
    """Autocorrelation."""
    shift = round(lag_s * RATE_HZ)
    return float(np.mean(values[:, :-shift] * values[:, shift:]) / np.mean(values**2))


def powers(values: Series) -> list[float]:
    """Mean power of each band."""
    spectrum = np.mean(np.abs(np.fft.rfft(values, axis=1)) ** 2, axis=0)
    frequency = np.fft.rfftfreq(values.shape[1], 1.0 / RATE_HZ)
    return [float(spectrum[(frequency >= low) & (frequency < high)].mean()) for low, high in BANDS_HZ]


def disagreement(position: Series, velocity: Series) -> tuple[float, float]:
    """(gain in 1/s, correlation) of the slope of the position less the velocity, against the position."""
    slope = (position[:, 2:] - position[:, :-2]) * RATE_HZ / 2.0 - velocity[:, 1:-1]
    at = position[:, 1:-1]
    slope, at = centred(slope).ravel(), centred(at).ravel()
    return float(-(slope @ at) / (at @ at)), float(np.corrcoef(slope, at)[0, 1])


@pytest.mark.parametrize("axis", [0, 1], ids=["north", "east"])
def test_gps_is_as_wrong_as_recorded(axis: int) -> None:
    recorded = RECORDED[:, :, axis].astype(float), RECORDED[:, :, axis + 3].astype(float)
    plant = flown(PRESETS["gps"][axis], 60)
    (p0, v0), (p1, v1) = ([centred(values) for values in each] for each in (recorded, plant))
    # Five flights are few: their own standard deviations differ by a third from one another.
    assert p1.std() == pytest.approx(p0.std(), rel=0.2)
    assert v1.std() == pytest.approx(v0.std(), rel=0.2)
    together = [float(np.corrcoef(p.ravel(), v.ravel())[0, 1]) for p, v in ((p0, v0), (p1, v1))]
    assert together[1] == pytest.approx(together[0], abs=0.06)
    for lag_s in (1.0, 2.0, 4.0):
        assert left_after(p1, lag_s) == pytest.approx(left_after(p0, lag_s), abs=0.15)
        assert left_after(v1, lag_s) == pytest.approx(left_after(v0, lag_s), abs=0.15)
    for real, ours in zip(powers(p0) + powers(v0), powers(p1) + powers(v1), strict=True):
        assert 0.4 < ours / real < 2.5
    (gain0, correlation0), (gain1, correlation1) = disagreement(p0, v0), disagreement(p1, v1)
    assert gain1 == pytest.approx(gain0, rel=0.1)
    assert correlation1 == pytest.approx(correlation0, abs=0.06)


def test_presets_are_ordered_as_the_sources_are_good() -> None:
    deviations = {name: float(flown(PRESETS[name].north, 8)[0].std()) for name in ("gps", "rtk", "motion_capture")}
    assert deviations["gps"] > 2.0 * deviations["rtk"] > 2.0 * deviations["motion_capture"]


def test_optical_flow_walks_away_and_begins_at_zero() -> None:
    random = Random(1)
    params = PRESETS["optical_flow"].north
    assert settled(params, lambda: random.gauss(0.0, 1.0)).position_m == 0.0
    positions, _ = flown(params, 20)
    assert np.abs(positions[:, -1]).mean() > np.abs(positions[:, 50]).mean()


def test_without_noise_an_error_dies_out() -> None:
    quiet = AxisError(1.2, 0.5, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0)
    state = ErrorState(1.0, 0.5, 0.0, 0.0)
    for _ in range(1500):
        state = step(quiet, state, 0.02, 0.0, 0.0, 0.0)
    assert abs(state.position_m) < 1e-3
