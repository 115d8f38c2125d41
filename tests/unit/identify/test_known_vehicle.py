"""Flights of a vehicle that is known: what is identified is what it is, and the interval is as wide as it says."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from harness.identify_logs import Known, flown_tlog, fly, recording

from companion.attitude_response.kind import LinearResponse
from companion.attitude_response.kinds import FIRST_ORDER_DELAY, MODELS, SECOND_ORDER_DELAY, FirstOrder, SecondOrder
from companion.attitude_response.simulation import respond
from companion.identify.identification import identify, identify_log
from sitl.vehicles.attitude_loop import respond as exact

RUNS = 100


def first_order(bandwidth_rad_s: float) -> LinearResponse:
    return LinearResponse(FirstOrder, (bandwidth_rad_s,))


@pytest.mark.slow
def test_a_hundred_flights_with_noise_delay_and_friction() -> None:
    """Acceptance of the identification: truth within the interval in 90 of them, bias below 3 %."""
    inside, ratios = 0, []
    for seed in range(RUNS):
        random = np.random.default_rng(1000 + seed)
        bandwidth, up, down = random.uniform(3.0, 10.0), random.uniform(0.005, 0.04), random.uniform(0.002, 0.02)
        flown = fly(
            Known(first_order(bandwidth), up, down, noise_rad=math.radians(random.uniform(0.05, 0.3))),
            seed,
            setpoint_rate_hz=random.choice([50.0, 100.0]),
            attitude_rate_hz=random.choice([50.0, 100.0]),
        )
        axis = identify([recording(flown)]).axes["pitch"]
        truth = np.array([bandwidth, up + down])
        found = axis.models["first_order_delay"]
        ratios.append(np.array(found.values) / truth)
        ends = axis.chosen.intervals()
        inside += axis.chosen.model is FIRST_ORDER_DELAY and all(
            low <= value <= high for value, (low, high) in zip(truth, ends.values(), strict=True)
        )
    bias = np.mean(ratios, axis=0) - 1.0
    assert inside >= 90
    assert np.abs(bias).max() < 0.03


def test_a_second_order_vehicle_is_told_from_a_first_order_one() -> None:
    known = Known(LinearResponse(SecondOrder, (9.0, 0.8)), up_s=0.02, down_s=0.01)
    axis = identify([recording(fly(known, 1, manoeuvres=5))]).axes["pitch"]
    assert axis.chosen.model is SECOND_ORDER_DELAY
    for truth, (low, high) in zip((9.0, 0.8, 0.03), axis.chosen.interval_95, strict=True):
        assert low < truth < high
    assert axis.chosen.values == pytest.approx((9.0, 0.8, 0.03), rel=0.1)


def test_the_interval_narrows_with_repetition() -> None:
    widths = []
    for manoeuvres in (3, 12):
        axis = identify([recording(fly(Known(first_order(5.0)), 2, manoeuvres=manoeuvres))]).axes["pitch"]
        assert len(axis.manoeuvres) == manoeuvres
        widths.append(np.ptp(axis.models["first_order_delay"].interval_95, axis=1))
    assert (widths[1] < widths[0] / 2).all()


def test_several_logs_add_their_manoeuvres_up() -> None:
    known = Known(first_order(5.0))
    one, two = (recording(fly(known, seed, manoeuvres=3)) for seed in (3, 4))
    assert len(identify([one, two._replace(path=Path("other"))]).axes["pitch"].manoeuvres) == 6


def test_the_link_is_told_from_the_vehicle_in_a_tlog_whose_clocks_differ(tmp_path: Path) -> None:
    known = Known(LinearResponse(SecondOrder, (9.0, 0.9)), up_s=0.03, down_s=0.02)
    path = tmp_path / "flight.tlog"
    path.write_bytes(flown_tlog(fly(known, 5, manoeuvres=4), up_s=known.up_s))
    axis = identify_log([path]).axes["pitch"]
    assert axis.delay is not None
    assert axis.delay.total_s == pytest.approx(0.05, abs=0.004)
    assert axis.delay.vehicle_s == pytest.approx(0.0, abs=0.004)
    assert axis.delay.link_s == pytest.approx(0.05, abs=0.003)


@pytest.mark.parametrize("model", MODELS, ids=lambda model: model.name)
@pytest.mark.parametrize("values", [(5.0, 0.7, 0.033), (40.0, 1.0, 0.0), (90.0, 3.5, 0.2), (9.0, 0.2, 0.01)])
def test_the_response_is_the_plants_step_by_step(model: object, values: tuple[float, float, float]) -> None:
    random = np.random.default_rng(7)
    setpoint_s = np.sort(random.uniform(0.0, 6.0, 80))
    setpoints = np.cumsum(random.normal(0.0, 0.1, 80))
    time_s = np.linspace(0.0, 6.0, 200)
    assert model in MODELS
    parameters = {1: values[:1], 2: (values[0], values[2]), 3: values}[len(model.parameters)]  # type: ignore[attr-defined]
    delay_s = parameters[-1] if len(parameters) > 1 else 0.0
    second = len(parameters) == 3
    plant = LinearResponse(SecondOrder, values[:2]) if second else LinearResponse(FirstOrder, values[:1])
    modelled = respond(model, parameters, setpoint_s, setpoints, time_s)  # type: ignore[arg-type]
    angle, rate, now, wanted = setpoints[0], 0.0, -1.0, setpoints[0]
    events = sorted(
        [(t + delay_s, 0, u) for t, u in zip(setpoint_s, setpoints, strict=True)] + [(t, 1, 0.0) for t in time_s]
    )
    stepped = []
    for at, kind, value in events:
        angle, rate, _ = exact(plant, angle, rate, (), wanted, at - now)
        now = at
        if kind == 0:
            wanted = value
        else:
            stepped.append(angle)
    assert modelled == pytest.approx(np.array(stepped), abs=1e-6)
