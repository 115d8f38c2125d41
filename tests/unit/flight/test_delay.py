"""Delay and jitter of a link, from TIMESYNC answers and from the age of samples."""

import math

import pytest
from pymavlink.dialects.v20 import development as mavlink

from companion.flight.vehicle_link.link_delay import INTERVAL_S, LinkDelay
from companion.mavlink.codec import Frame, FrameParser

VEHICLE = mavlink.MAVLink(None, 1, 1)


def timesync(theirs: int, ours: int) -> Frame:
    (frame,) = FrameParser().feed(bytes(mavlink.MAVLink_timesync_message(theirs, ours).pack(VEHICLE)))
    return frame


def round_trips(delay: LinkDelay, trips_s: list[float], begin_s: float = 100.0) -> None:
    for k, trip_s in enumerate(trips_s):
        now = begin_s + k * INTERVAL_S
        request = delay.request(now)
        assert request.tc1 == 0
        delay.answered(timesync(7_000_000_000 + k, request.ts1), now + trip_s)


def test_nothing_is_known_before_an_answer() -> None:
    delay = LinkDelay()
    assert math.isnan(delay.round_trip_s)
    assert math.isnan(delay.jitter_s)


def test_a_round_trip_is_from_request_to_answer() -> None:
    delay = LinkDelay()
    round_trips(delay, [0.03] * 10)
    assert delay.round_trip_s == pytest.approx(0.03)
    assert delay.jitter_s < 1e-3
    round_trips(delay, [0.08] * 5, 102.0)
    assert delay.round_trip_s > 0.07  # within a second of the change


def test_one_slow_answer_is_not_a_slow_link() -> None:
    delay = LinkDelay()
    round_trips(delay, [0.01] * 5 + [0.05] + [0.01])
    assert delay.round_trip_s < 0.025


def test_answers_may_overtake_each_other_and_come_late() -> None:
    delay = LinkDelay()
    first, second = delay.request(100.0), delay.request(100.2)
    delay.answered(timesync(1, second.ts1), 100.5)
    assert delay.round_trip_s == pytest.approx(0.3)
    delay.answered(timesync(1, first.ts1), 100.5)
    assert delay.round_trip_s == pytest.approx(0.4)


def test_requests_of_the_vehicle_copies_and_foreign_answers_say_nothing() -> None:
    delay = LinkDelay()
    request = delay.request(100.0)
    delay.answered(timesync(0, request.ts1), 100.01)  # a request: its tc1 is zero
    delay.answered(timesync(5, 4_711), 100.01)
    assert math.isnan(delay.round_trip_s)
    delay.answered(timesync(5, request.ts1), 100.01)
    delay.answered(timesync(5, request.ts1), 103.0)  # the link sent it twice
    assert delay.round_trip_s == pytest.approx(0.01)


def test_what_is_not_answered_any_more_is_forgotten() -> None:
    delay = LinkDelay()
    round_trips(delay, [0.03] * 3)
    delay.forget(100.0)
    assert delay.round_trip_s == pytest.approx(0.03)
    delay.forget(101.0)
    assert math.isnan(delay.round_trip_s)
    round_trips(delay, [0.05], 102.0)
    assert delay.round_trip_s == pytest.approx(0.05)


def test_lateness_is_against_the_youngest_sample_whatever_the_clocks_say() -> None:
    delay = LinkDelay()
    for k in range(100):
        delay.heard(5.0 + 0.01 * k, 1000.0 + 0.01 * k + 0.005)
    assert delay.jitter_s < 1e-3
    delay.heard(6.0, 1001.0 + 0.125)
    assert delay.jitter_s == pytest.approx(0.12, abs=0.01)
    for k in range(1, 400):
        delay.heard(6.0 + 0.01 * k, 1001.0 + 0.01 * k + 0.005)
    assert delay.jitter_s < 0.01  # forgotten


def test_clocks_that_drift_are_not_lateness() -> None:
    delay = LinkDelay()
    for k in range(10_000):
        delay.heard(0.01 * k, 50.0 + 0.01 * k * 1.02)  # as PX4's SIH in the recordings
    assert delay.jitter_s < 2e-3


@pytest.mark.parametrize("rate", [0.95, 0.8, 1.1])
def test_a_slow_clock_is_not_lateness_either_and_is_known(rate: float) -> None:
    """A simulated PX4 told to run at 0.8 (PX4_SIM_SPEED_FACTOR): without its clock 0.15 s a second would add up."""
    delay = LinkDelay()
    worst_s = 0.0
    for k in range(2000):
        now = 100.0 + 0.01 * k
        if k % 20 == 0:
            request = delay.request(now)
            theirs_s = 5.0 + rate * (now + 0.002 - 100.0)
            delay.answered(timesync(round(theirs_s * 1e9), request.ts1), now + 0.004)
        delay.heard(5.0 + rate * (now - 100.0), now + 0.004)
        worst_s = max(worst_s, delay.jitter_s)
    assert delay.clock_rate == pytest.approx(rate, abs=1e-3)
    assert worst_s < 0.15, "not even while the clock is not known yet"
    delay.heard(5.0 + rate * 20.0, 120.2 + 0.004)
    assert delay.jitter_s == pytest.approx(0.2, abs=0.07), "lateness is seen as before"
    delay.restart()
    assert math.isnan(delay.clock_rate)


def test_an_answer_of_another_clock_is_none() -> None:
    delay = LinkDelay()
    round_trips(delay, [0.01] * 20)
    assert math.isnan(delay.clock_rate)


def test_a_clock_that_begins_anew_is_not_lateness() -> None:
    delay = LinkDelay()
    delay.heard(500.0, 1000.0)
    delay.restart()
    delay.heard(0.1, 1000.01)
    assert delay.jitter_s < 1e-3
