"""The propagation beside recordings of a real PX4 v1.17: what was honest stays below its limits, a real slide does not.

The limits are those of an estimator that is aided by GPS, as the recordings are.
"""

import struct
from pathlib import Path

import numpy as np
import pytest

from companion.config import load_config
from companion.config.guards.rows import Reason
from companion.control.types import Odometry
from companion.flight.guards import propagation, stuck, table
from companion.flight.guards.estimator import jump
from companion.flight.guards.look import PERIOD_S
from companion.flight.guards.propagation import Disagreement
from companion.flight.vehicle_link.odometry import PoseSource
from companion.mavlink.codec import Frame

ROOT = Path(__file__).resolve().parents[4]
DATA = ROOT / "tests" / "data"
FULL = ROOT.parent / "shared" / "data"
LIMITS = table.limits(load_config(ROOT / "config" / "px4_quadrotor.yaml", ()))
UNKNOWN = (0.0, 0.0, 0.0)
UP = (0.0, 0.0, -1.0)


def odometry(path: Path, begin_s: float, end_s: float) -> list[tuple[Odometry, int]]:
    """(sample, reset counter) of a recording's ODOMETRY, by the time of the recording."""
    data, at, first_us, source, found = path.read_bytes(), 0, None, PoseSource(), []
    while at < len(data):
        (time_us,) = struct.unpack_from(">Q", data, at)
        raw = data[at + 8 : at + 20 + data[at + 9]]
        at += 8 + len(raw)
        first_us = time_us if first_us is None else first_us
        if raw[5:7] != b"\x01\x01" or not begin_s <= 1e-6 * (time_us - first_us) < end_s:
            continue
        number = int.from_bytes(raw[7:10], "little")
        sample = source.on_frame(Frame(number, raw[5], raw[6], raw[4], raw[10:-2], raw))
        if sample is not None:
            found.append((sample, source.reset_counter))
    return found


def worst(samples: list[tuple[Odometry, int]]) -> tuple[Disagreement, float]:
    """The largest of each that was seen, and for how long anything had stopped."""
    (last, count), *rest = samples
    state, stopped = propagation.start(last, UNKNOWN), stuck.start(last, UP)
    seen, stopped_s = [Disagreement()], 0.0
    for sample, resets in rest:
        counted = jump(last, sample) if resets != count else None
        if sample.time_s - state.last.time_s >= PERIOD_S - 1e-6 or counted is not None:
            state, apart = propagation.step(state, sample, UNKNOWN, counted)
            stopped = stuck.step(stopped, sample, UP, reset=counted is not None)
            seen.append(apart)
            stopped_s = max(stopped_s, *stopped.for_s)
        last, count = sample, resets
    return Disagreement(*map(max, zip(*seen, strict=True))), stopped_s


def recording(name: str) -> Path:
    if not (FULL / name).exists():
        pytest.skip("the full recordings are not beside this checkout")
    return FULL / name


@pytest.mark.parametrize(
    ("name", "begin_s", "end_s"),
    [
        ("px4_sih_flight.tlog", 14.0, 45.0),
        ("px4_sih_gps_loss.tlog", 12.0, 19.0),
        ("px4_sih_attitude_p3.tlog", 14.0, 70.0),
    ],
)
def test_an_honest_flight_is_past_no_limit(name: str, begin_s: float, end_s: float) -> None:
    samples = odometry(recording(name), begin_s, end_s)
    assert len(samples) > 600
    apart, stopped_s = worst(samples)
    assert apart.drift_m < 0.6 * LIMITS[Reason.VELOCITY_CONSISTENCY]
    assert apart.slide_m < 0.8 * LIMITS[Reason.POSITION_SLIDE]
    assert apart.height_slide_m < 0.8 * LIMITS[Reason.HEIGHT_SLIDE]
    assert apart.step_m == 0.0
    assert stopped_s < 0.2 * LIMITS[Reason.ESTIMATE_STUCK]


def test_the_slide_of_a_gps_that_comes_back_is_seen_by_each_of_them() -> None:
    samples = odometry(recording("px4_sih_gps_loss.tlog"), 22.4, 24.8)
    apart, _ = worst(samples)
    assert apart.drift_m > 3.0 * LIMITS[Reason.VELOCITY_CONSISTENCY]
    assert apart.slide_m > LIMITS[Reason.POSITION_SLIDE]
    assert apart.step_m > 0.2


def test_the_errors_of_five_flights_with_ground_truth_are_past_no_limit() -> None:
    """Position and velocity of the truth belong together: what slides of an estimate is its error."""
    flights = np.load(DATA / "px4_sih_estimator_errors.npz")["errors"]
    assert len(flights) == 5
    for errors in flights:
        samples = [(Odometry(0.1 * n, *map(float, row), 1.0, 0.0, 0.0, 0.0), 0) for n, row in enumerate(errors)]
        apart, _ = worst(samples)
        assert 0.1 < apart.drift_m < 0.6 * LIMITS[Reason.VELOCITY_CONSISTENCY]
        assert 0.2 * LIMITS[Reason.POSITION_SLIDE] < apart.slide_m < 0.75 * LIMITS[Reason.POSITION_SLIDE]
        assert apart.height_slide_m < 0.75 * LIMITS[Reason.HEIGHT_SLIDE]
