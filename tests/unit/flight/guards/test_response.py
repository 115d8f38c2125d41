"""The certified attitude responses beside the real one: as certified is inside the band, otherwise is not."""

import math

import pytest

from companion.attitude_response.discrete import at_rest, step
from companion.attitude_response.kind import LinearResponse
from companion.attitude_response.kinds import FirstOrder, SecondOrder
from companion.config.attitude import ResponseSection
from companion.flight.guards.attitude_response import ResponseBand, ends

PERIOD_S = 0.02
FIRST = ResponseSection(bandwidth_rad_s=(5.0, 7.0), delay_s=(0.02, 0.04))
SECOND = ResponseSection(natural_frequency_rad_s=(8.5, 9.5), damping_ratio=(0.9, 1.1), delay_s=(0.02, 0.04))
TILT = math.sin(math.radians(20.0))
LIMIT_RAD = math.radians(8.0)


def test_every_corner_of_the_intervals_is_a_model() -> None:
    assert ends(ResponseSection(bandwidth_rad_s=5.5)) == (LinearResponse(FirstOrder, (5.5,), 0.0),)
    assert len(ends(FIRST)) == 4
    assert len(ends(SECOND)) == 8
    assert LinearResponse(SecondOrder, (9.5, 0.9), 0.04) in ends(SECOND)
    assert ends(None) == ()
    assert ends(ResponseSection(numerator=(1.0,), denominator=(0.2, 1.0))) == ()


@pytest.mark.parametrize(("rate", "ratio"), [(9.7, 0.94), (8.7, 1.22), (4.0, 1.0), (60.0, 0.3)])
@pytest.mark.parametrize("dt_s", [0.001, 0.02, 0.2])
def test_a_step_is_exact(rate: float, ratio: float, dt_s: float) -> None:
    exact = step(LinearResponse(SecondOrder, (rate, ratio)), dt_s)
    p, v, n = 1.0, 0.0, 20_000  # many small ones instead
    for _ in range(n):
        v += dt_s / n * (-rate * rate * p - 2.0 * ratio * rate * v)
        p += dt_s / n * v
    assert exact((1.0, 0.0), 0.0) == pytest.approx((p, v), abs=2e-3 * max(rate, 1.0))
    assert exact((1.0, 0.0), 0.0)[0] == pytest.approx(p, abs=2e-3)
    assert step(LinearResponse(FirstOrder, (rate,)), dt_s)((1.0, 0.0), 0.0)[0] == pytest.approx(math.exp(-rate * dt_s))


class Vehicle:
    """Answers as one model does, in a plane that points along `heading_rad`."""

    def __init__(self, model: LinearResponse, heading_rad: float = 0.0) -> None:
        self.model, self.heading_rad = model, heading_rad
        self.state = at_rest(model, 0.0)
        self.past: list[float] = []

    def answer(self, commanded: float) -> tuple[float, float]:
        n = 20
        move = step(self.model, PERIOD_S / n)
        for _ in range(n):
            self.past.append(commanded)
            late = round(self.model.delay_s / (PERIOD_S / n))
            self.state = move(self.state, self.past[-1 - late] if len(self.past) > late else 0.0)
        return self.state[0] * math.cos(self.heading_rad), self.state[0] * math.sin(self.heading_rad)


def worst(response: ResponseBand, vehicle: Vehicle, heading_rad: float = 0.0, bias: float = 0.0) -> tuple[float, float]:
    """Largest exceedance, and the longest time above the limit, over doublets of 20 degrees."""
    measured, largest, above, longest = (0.0, 0.0), 0.0, 0.0, 0.0
    c, s = math.cos(vehicle.heading_rad), math.sin(vehicle.heading_rad)
    for k in range(500):
        commanded = (TILT, -TILT, 0.0)[k // 40 % 3]
        outside = response.advance(0.02 * k, heading_rad, measured, (commanded * c, commanded * s))
        largest = max(largest, outside)
        above = above + PERIOD_S if outside > LIMIT_RAD else 0.0
        longest = max(longest, above)
        north, east = vehicle.answer(commanded)
        measured = (north + bias * c, east + bias * s)
    return largest, longest


@pytest.mark.parametrize("section", [FIRST, SECOND])
@pytest.mark.parametrize("heading_rad", [0.0, 2.0])
def test_what_answers_as_certified_stays_within_the_band(section: ResponseSection, heading_rad: float) -> None:
    for model in ends(section):
        response = ResponseBand(section, section)
        assert worst(response, Vehicle(model, heading_rad), heading_rad)[0] < math.radians(2.5)


@pytest.mark.parametrize(
    ("model", "section"),
    [
        (LinearResponse(FirstOrder, (1.5,), 0.03), FIRST),  # far too slow
        (LinearResponse(FirstOrder, (6.0,), 0.35), FIRST),  # far too late
        (LinearResponse(SecondOrder, (9.0, 0.08), 0.03), SECOND),  # rings
    ],
)
def test_what_answers_otherwise_leaves_it(model: LinearResponse, section: ResponseSection) -> None:
    largest, longest = worst(ResponseBand(section, section), Vehicle(model))
    assert largest > LIMIT_RAD
    assert longest >= 0.1


def test_an_attitude_that_does_not_come_back_is_outside_for_good() -> None:
    _, longest = worst(
        ResponseBand(FIRST, FIRST), Vehicle(LinearResponse(FirstOrder, (6.0,), 0.03)), bias=math.sin(math.radians(12.0))
    )
    assert longest > 0.5


def test_each_axis_has_its_own_band_wherever_the_vehicle_heads() -> None:
    slow, fast = ResponseSection(bandwidth_rad_s=2.0), ResponseSection(bandwidth_rad_s=12.0)
    east = math.pi / 2.0
    for heading_rad, along_x, along_y in ((0.0, 0.0, east), (east, east, math.pi)):
        assert (
            worst(ResponseBand(slow, fast), Vehicle(LinearResponse(FirstOrder, (2.0,), 0.0), along_x), heading_rad)[0]
            < 0.05
        )
        assert (
            worst(ResponseBand(slow, fast), Vehicle(LinearResponse(FirstOrder, (12.0,), 0.0), along_y), heading_rad)[0]
            < 0.05
        )
        assert (
            worst(ResponseBand(slow, fast), Vehicle(LinearResponse(FirstOrder, (2.0,), 0.0), along_y), heading_rad)[0]
            > LIMIT_RAD
        )


def test_a_turn_of_the_control_frame_is_no_error() -> None:
    response, measured = ResponseBand(FIRST, FIRST), (TILT, 0.0)
    outside = [response.advance(0.02 * k, 0.02 * k, measured, measured) for k in range(200)]
    assert max(outside) < 1e-9


def test_a_transfer_function_is_not_watched_and_says_so() -> None:
    function = ResponseSection(numerator=(1.0,), denominator=(0.2, 1.0))
    response = ResponseBand(function, None)
    assert response.watched == []
    assert math.isnan(response.advance(0.0, 0.0, (0.0, 0.0), (0.5, 0.0)))
    assert ResponseBand(FIRST, function).watched == ["x"]
