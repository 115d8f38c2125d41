"""A planner's stream: what is flown between its samples and after them, and what is refused and why."""

from __future__ import annotations

import math
import random
from collections.abc import Iterator
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from companion.control.types import PositionSetpoint, Reference
from companion.trajectory.curves import Circle, Lemniscate
from companion.trajectory.feasibility import Limits
from companion.trajectory.sample import Sample
from companion.trajectory.streamed import Phase, Streamed
from companion.trajectory.trajectory import Trajectory, rest

LIMITS = Limits(3.0, 6.0, 20.0, math.radians(35.0), 0.4, 1.6, math.radians(45.0))
TICK_S = 0.004
HERE = rest((1.0, 2.0, -3.0, 0.5))
EIGHT = Lemniscate(4.0, 2.0, 2.0, 1.0, 3.0)


def stream() -> Streamed:
    return Streamed(LIMITS, timeout_s=0.25, late_s=0.1)


def sample_of(at: Reference, time_s: float, *, accelerates: bool = True, yaw: float = math.nan) -> Sample:
    """As a planner's clock and single precision have it."""
    values = [float(np.float32(value)) for value in at[: 9 if accelerates else 6]]
    return Sample(round(1e3 * time_s) & 0xFFFFFFFF, *values, *[math.nan] * (9 - len(values)), yaw)


def flown_along(
    trajectory: Trajectory,
    streamed: Streamed,
    *,
    ahead_s: float = 5000.0,
    rate_hz: float = 20.0,
    jitter_s: float = 0.03,
    until_s: float = math.inf,
    accelerates: bool = True,
) -> Iterator[tuple[float, Reference]]:
    """What is flown, tick by tick, from the first sample on; the planner's clock is ahead by so much."""
    chance, flown, next_s = random.Random(3), rest((0.0, 0.0, 0.0, 0.0)), 0.0
    due: list[tuple[float, Sample]] = []
    for k in range(round((trajectory.duration_s + 1.0) / TICK_S)):
        now_s = TICK_S * k
        if now_s >= next_s and now_s < min(until_s, trajectory.duration_s):
            due.append((
                now_s + jitter_s * chance.random(),
                sample_of(trajectory.at(now_s), now_s + ahead_s, accelerates=accelerates),
            ))  # fmt: skip
            next_s += 1.0 / rate_hz
        for heard_s, sample in sorted(due):
            if heard_s <= now_s:
                due.remove((heard_s, sample))
                assert streamed.take(sample, heard_s, flown, now_s - TICK_S) is None
        if streamed.phase is not Phase.NONE:
            flown = streamed.at(now_s)
            yield now_s, flown


@pytest.mark.parametrize(("accelerates", "most_m"), [(True, 0.008), (False, 0.012)])
@pytest.mark.parametrize("rate_hz", [10.0, 20.0, 50.0])
def test_a_stream_is_flown_where_the_planner_is_and_without_a_jump(
    rate_hz: float, accelerates: bool, most_m: float
) -> None:
    """At 20 Hz with 30 ms of jitter the figure of eight at 2 m/s is met to millimetres, not late by 80 ms."""
    jitter_s = 0.009 if rate_hz == 50.0 else 0.03
    before = None
    away = []
    for now_s, at in flown_along(
        EIGHT, streamed := stream(), rate_hz=rate_hz, accelerates=accelerates, jitter_s=jitter_s
    ):
        if before is not None:
            for axis in range(3):
                p, v, a = (before[axis + k] for k in (0, 3, 6))
                q, w, b = (at[axis + k] for k in (0, 3, 6))
                assert abs(q - p - TICK_S * (v + w) / 2) < 1e-4  # as its own velocity says
                assert abs(w - v - TICK_S * (a + b) / 2) < 5e-3
                assert abs(b - a) < 0.9  # m/s2 within a tick: what is worked off has a jerk
        before = at
        if streamed.phase is Phase.FOLLOWED and now_s > 0.5:
            away.append(math.dist(at[:3], EIGHT.at(now_s)[:3]))
    assert math.sqrt(sum(x * x for x in away) / len(away)) < most_m


def test_the_jerk_of_the_trajectory_is_found_for_the_feed_forward() -> None:
    left = [
        math.dist(at[9:11], EIGHT.at(now_s)[9:11])
        for now_s, at in flown_along(EIGHT, stream())
        if 1.0 < now_s < EIGHT.duration_s - 0.1
    ]
    assert sum(left) / len(left) < 0.15
    assert max(math.hypot(*EIGHT.at(0.01 * k)[9:11]) for k in range(600)) > 2.5


@pytest.mark.parametrize("until_s", [0.6, 2.0, 3.1, 4.7, 5.3])
def test_where_it_ends_it_brakes_along_the_path_to_rest(until_s: float) -> None:
    streamed = stream()
    track = list(flown_along(EIGHT, streamed, until_s=until_s))
    assert (streamed.phase, streamed.why) == (Phase.ENDED, "nothing new for 0.25 s")
    for (_, one), (_, other) in pairwise(track):
        assert math.dist(other[:3], one[:3]) < 1.1 * TICK_S * max(math.hypot(*one[3:6]), 0.05)
        assert math.dist(other[3:6], one[3:6]) < TICK_S * 8.0
    assert math.hypot(*track[-1][1][3:9]) < 1e-9
    braking = [at for now_s, at in track if now_s > until_s + 0.3]
    assert max(math.hypot(*at[6:9]) for at in braking) <= LIMITS.acceleration_m_s2
    speed = math.hypot(*EIGHT.at(until_s)[3:6])
    assert math.dist(braking[-1][:3], EIGHT.at(until_s)[:3]) < speed * 0.9 + 0.3


def test_it_stops_where_it_said_it_would() -> None:
    streamed = stream()
    last: Reference | None = None
    for k in range(60):  # straight on, ever faster: 3 m/s2 up to 1.5 m/s
        t = 0.05 * k
        speed, way = (3.0 * t, 1.5 * t * t) if t <= 0.5 else (1.5, 0.375 + 1.5 * (t - 0.5))
        sample = Sample(k * 50, way, 0.0, 0.0, speed, 0.0, 0.0, math.nan, math.nan, math.nan, math.nan)
        flown = rest((0.0, 0.0, 0.0, 0.0)) if last is None else streamed.at(t)
        assert streamed.take(sample, t, flown, t) is None
        last = streamed.at(t)
    said = streamed.stop_ned_m(sample)
    for k in range(600):
        last = streamed.at(t + TICK_S * k)
    assert last is not None
    assert math.dist(last[:3], said) < 0.1
    assert last.vx_m_s == 0.0


# --- what is refused ------------------------------------------------------------------------------------------------


def moving(time_s: float, **changed: Any) -> Sample:
    """North at 1 m/s from `HERE`, which is where it is at 0 s; the clock stands near its wrap."""
    x, y, z, *_ = HERE
    ms = (2**32 - 100 + round(1e3 * time_s)) & 0xFFFFFFFF
    plain = Sample(ms, x + time_s, y, z, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, math.nan)
    return plain._replace(**changed)


NORTHWARDS = HERE._replace(vx_m_s=1.0)


def followed(until_s: float = 0.25) -> tuple[Streamed, float]:
    """A stream that has been followed for a while at 20 Hz, and when its last sample was heard."""
    streamed, now_s = stream(), 0.0
    for k in range(round(until_s / 0.05) + 1):
        now_s = 0.05 * k
        flown = NORTHWARDS if k == 0 else streamed.at(now_s)
        assert streamed.take(moving(now_s), now_s, flown, now_s) is None
    return streamed, now_s


@pytest.mark.parametrize(
    ("next_s", "late_s", "changed", "reason"),
    [
        (0.05, 0.0, {"x_m": 2.6}, "position jumps 1.3 m"),
        (0.05, 0.0, {"y_m": 2.1}, "position jumps 0.1 m"),
        (0.05, 0.0, {"vx_m_s": 1.3}, "velocity jumps 0.3 m/s"),
        (0.05, 0.0, {"ax_m_s2": 3.0, "vx_m_s": 1.075}, "acceleration jumps 3 m/s2"),
        (0.05, 0.0, {"vx_m_s": 3.5}, "speed 3.5 m/s, limit 3"),
        (0.05, 0.0, {"ay_m_s2": 7.0}, "acceleration 7 m/s2, limit 6"),
        (0.05, 0.0, {"az_m_s2": -6.5}, "thrust over hover thrust 1.66 1, limit 1.6"),
        (0.05, 0.11, {}, "0.11 s late, limit 0.1"),
        (0.005, 0.0, {}, "5 ms after the last, least 10"),
        (-0.05, 0.05, {}, "time_boot_ms is not later"),
        (0.05, 0.0, {"stamp_ms": moving(0.25).stamp_ms}, "time_boot_ms is not later"),
        (0.05, 0.0, {"stamp_ms": 5000}, "time_boot_ms jumps 4.85 s"),
    ],
)
def test_what_is_no_way_on_is_refused_with_its_reason_and_not_flown(
    next_s: float, late_s: float, changed: dict[str, Any], reason: str
) -> None:
    streamed, now_s = followed()
    wanted = streamed.at(now_s + 0.1)
    sample = moving(now_s + next_s, **changed)
    assert streamed.take(sample, now_s + next_s + late_s, streamed.at(now_s), now_s) == reason
    assert streamed.at(now_s + 0.1) == wanted
    assert streamed.take(moving(now_s + 0.1), now_s + 0.1, streamed.at(now_s), now_s) is None  # the next one is right


@pytest.mark.parametrize(
    ("changed", "reason"),
    [
        ({"x_m": 1.6}, "begins 0.6 m away, most 0.5"),
        ({"vx_m_s": 0.6}, "begins 0.6 m/s off, most 0.5"),
        ({"vz_m_s": -4.0}, "speed 4.12 m/s, limit 3"),
    ],
)
def test_a_stream_begins_where_the_vehicle_is(changed: dict[str, Any], reason: str) -> None:
    streamed = stream()
    assert (
        streamed.take(moving(0.0, **{"vx_m_s": 1.0 if "vz_m_s" in changed else 0.0, **changed}), 0.0, HERE, 0.0)
        == reason
    )
    assert streamed.phase is Phase.NONE


def test_a_place_half_a_metre_away_is_eased_into_within_the_limits() -> None:
    streamed = stream()
    for k in range(100):
        now_s = 0.05 * k
        flown = HERE if k == 0 else streamed.at(now_s)
        sample = moving(0.0, x_m=1.4, vx_m_s=0.0, stamp_ms=50 * k)
        assert streamed.take(sample, now_s, flown, now_s) is None
        assert math.hypot(*streamed.at(now_s + 0.02)[6:9]) < 0.3 * LIMITS.acceleration_m_s2
    assert streamed.at(now_s)[:3] == pytest.approx((1.4, 2.0, -3.0), abs=1e-3)


def test_a_velocity_alone_that_no_acceleration_explains_is_a_jump() -> None:
    streamed, unknown = stream(), {"ax_m_s2": math.nan, "ay_m_s2": math.nan, "az_m_s2": math.nan}
    assert streamed.take(moving(0.0, **unknown), 0.0, NORTHWARDS, 0.0) is None
    sample = moving(0.05, vx_m_s=1.5, x_m=1.0625, **unknown)
    assert streamed.take(sample, 0.05, NORTHWARDS, 0.0) == "velocity jumps 0.5 m/s"
    sample = moving(0.05, vz_m_s=-0.5, z_m=-3.0125, **unknown)
    assert streamed.take(sample, 0.05, NORTHWARDS, 0.0) == "velocity jumps 0.5 m/s"


def test_a_client_that_sends_again_what_it_has_says_nothing_new() -> None:
    """MAVSDK resends its last set-point at 20 Hz for ever: of a place in motion that is no stream."""
    streamed, now_s = followed()
    for k in range(1, 60):
        assert (
            streamed.take(moving(now_s, stamp_ms=50 * k), now_s + 0.05 * k, streamed.at(now_s + 0.05 * k), now_s)
            is None
        )
    assert streamed.phase is Phase.ENDED
    assert math.hypot(*streamed.at(now_s + 3.0)[3:6]) == 0.0


def test_a_planner_that_stands_still_goes_on_streaming() -> None:
    streamed = stream()
    for k in range(40):
        sample = moving(0.0, vx_m_s=0.0, stamp_ms=50 * k)
        assert streamed.take(sample, 0.05 * k, HERE, 0.05 * k) is None
        assert streamed.at(0.05 * k)[:9] == pytest.approx(HERE[:9], abs=1e-9)
    assert streamed.phase is Phase.FOLLOWED


def test_what_mavsdk_sends_twice_is_no_flood() -> None:
    """Of a place at rest: its first sample twice within a millisecond, later its old one right before its new one."""
    streamed, rest_ = stream(), {"vx_m_s": 0.0}
    for ms in (0, 1, 50, 100):
        assert streamed.take(moving(0.0, stamp_ms=ms, **rest_), 1e-3 * ms, HERE, 1e-3 * ms) is None
    assert streamed.take(moving(0.0, stamp_ms=101, **rest_)._replace(vx_m_s=0.02), 0.101, HERE, 0.1) is None
    assert streamed.at(0.1) == streamed.at(0.15)  # dropped, and the next is in time
    slow = moving(0.0, stamp_ms=150, vx_m_s=0.02, x_m=1.0005, ax_m_s2=0.2)
    assert streamed.take(slow, 0.15, HERE, 0.1) is None
    assert streamed.take(slow._replace(stamp_ms=155, x_m=1.0006), 0.155, HERE, 0.15) == "5 ms after the last, least 10"


def test_after_a_pause_it_goes_on_from_where_the_vehicle_has_come_to_rest() -> None:
    streamed, now_s = followed()
    later_s = now_s + 3.0
    rests = streamed.at(now_s + 0.3), streamed.at(later_s)
    assert streamed.phase is Phase.ENDED
    assert streamed.take(moving(now_s + 3.0), later_s, rests[1], later_s) == "begins 2.39 m away, most 0.5"
    place = dict(zip(("x_m", "y_m", "z_m"), rests[1][:3], strict=True))
    assert streamed.take(moving(now_s + 3.0, vx_m_s=0.0, **place), later_s, rests[1], later_s) is None
    assert streamed.phase is Phase.FOLLOWED


def test_a_short_gap_is_bridged_and_one_after_the_timeout_is_caught_up_with_while_it_still_moves() -> None:
    streamed, now_s = followed()
    assert streamed.at(now_s + 0.24).x_m == pytest.approx(HERE.x_m + now_s + 0.24, abs=1e-6)
    braking = streamed.at(now_s + 0.26)
    assert streamed.phase is Phase.ENDED
    assert streamed.take(moving(now_s + 0.3), now_s + 0.3, braking, now_s + 0.26) is None
    assert streamed.phase is Phase.FOLLOWED
    assert streamed.at(now_s + 0.26)[:9] == pytest.approx(braking[:9], abs=1e-9)


def test_the_planner_s_clock_is_that_of_its_quickest_samples() -> None:
    """The first one was 80 ms late, the others were not: it is noticed, and nothing jumps."""
    streamed = stream()
    assert streamed.take(moving(0.0), 0.08, NORTHWARDS, 0.08) is None
    for k in range(1, 30):
        flown = streamed.at(0.05 * k + 0.04)
        assert streamed.take(moving(0.05 * k), 0.05 * k + 0.001, flown, 0.05 * k + 0.04) is None
        assert streamed.at(0.05 * k + 0.04)[:9] == pytest.approx(flown[:9], abs=1e-9)
    assert streamed.at(1.6).x_m == pytest.approx(HERE.x_m + 1.6, abs=0.003)


def test_the_heading_turns_along_and_one_that_jumps_is_refused() -> None:
    streamed = stream()
    for k in range(21):
        now_s = 0.05 * k
        flown = NORTHWARDS if k == 0 else streamed.at(now_s)
        yaw = math.remainder(3.0 + 0.5 * now_s, math.tau)  # through the wrap
        if k == 0:
            flown = flown._replace(yaw_rad=3.0)
        assert streamed.take(moving(now_s, yaw_rad=yaw), now_s, flown, now_s) is None
        turned = math.remainder(streamed.at(now_s + 0.02).yaw_rad - (3.0 + 0.5 * (now_s + 0.02)), math.tau)
        assert abs(turned) < 0.03
    sample = moving(now_s + 0.05, yaw_rad=math.remainder(3.7, math.tau))
    assert streamed.take(sample, now_s + 0.05, streamed.at(now_s), now_s) == "yaw jumps 11.5 deg"
    assert streamed.take(moving(now_s + 0.05), now_s + 0.05, streamed.at(now_s), now_s) is None
    assert streamed.at(now_s + 0.1).yaw_rad == streamed.at(now_s + 0.2).yaw_rad  # none is given: it stays


def test_where_the_estimate_jumps_the_stream_ends_and_braking_jumps_along() -> None:
    streamed, now_s = followed()
    before = streamed.at(now_s)
    after = streamed.end(now_s, "the estimator reset", PositionSetpoint(0.3, -0.2, 0.1, 0.2))
    assert after[:9] == pytest.approx([b + d for b, d in zip(before[:9], (0.3, -0.2, 0.1, *[0] * 6), strict=True)])
    assert streamed.why == "the estimator reset"
    assert math.hypot(*streamed.at(now_s + 3.0)[3:9]) == 0.0


def test_a_circle_of_ten_hertz_is_followed_past_a_lost_sample() -> None:
    circle, streamed, worst = Circle(1.5, 1.5, 1.0, 2.0), stream(), 0.0
    flown = rest((0.0, 0.0, 0.0, 0.0))
    for k in range(round(circle.duration_s / 0.05)):
        now_s = 0.05 * k
        if k % 2 == 0 and k % 10 != 4:
            assert streamed.take(sample_of(circle.at(now_s), now_s), now_s, flown, max(now_s - 0.05, 0.0)) is None
        flown = streamed.at(now_s)
        worst = max(worst, math.dist(flown[:3], circle.at(now_s)[:3]))
        assert streamed.phase is Phase.FOLLOWED
    assert worst < 0.02


number = st.floats(width=32, allow_nan=False, allow_infinity=False)
near = st.floats(-0.03, 0.03)


@settings(max_examples=150)
@given(
    st.lists(
        st.tuples(
            st.one_of(st.integers(0, 2**32 - 1), st.just(-1)),
            st.one_of(st.lists(number, min_size=9, max_size=9), st.lists(near, min_size=9, max_size=9)),
            st.one_of(st.just(math.nan), st.floats(-math.pi, math.pi)),
            st.booleans(),
        ),
        max_size=8,
    )
)
def test_whatever_comes_what_is_flown_is_finite_slow_enough_and_without_a_jump(
    said: list[tuple[int, list[float], float, bool]],
) -> None:
    streamed, flown, now_s = stream(), HERE, 0.0
    for stamp_ms, values, yaw, accelerates in [*said, *said]:
        stamp = round(1e3 * now_s) if stamp_ms < 0 else stamp_ms
        place = [a + b for a, b in zip(HERE[:6], values[:6], strict=True)]
        sample = Sample(stamp, *place, *(values[6:] if accelerates else [math.nan] * 3), yaw)
        streamed.stop_ned_m(sample)
        streamed.take(sample, now_s, flown, now_s)
        for _ in range(20):
            now_s += TICK_S
            if streamed.phase is not Phase.NONE:
                before, flown = flown, streamed.at(now_s)
                assert all(map(math.isfinite, flown))
                assert math.dist(before[:3], flown[:3]) < TICK_S * LIMITS.speed_m_s
                assert math.hypot(*flown[6:9]) < 1.25 * LIMITS.acceleration_m_s2
