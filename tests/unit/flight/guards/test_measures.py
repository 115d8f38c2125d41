"""What the guards measure at a look, what a release says of it, and guards that go blind."""

import math
from pathlib import Path

import pytest

from companion.config import Config, load_config
from companion.config.guards.rows import GUARDS, Reason
from companion.control.types import AttitudeSetpoint, Jump, Odometry
from companion.flight.guards import table
from companion.flight.guards.blindness import Blindness
from companion.flight.guards.look import PERIOD_S, Told
from companion.flight.guards.table import WATCHED
from companion.flight.guards.watch import Watch
from companion.flight.pilot.pilot import Pilot
from companion.flight.vehicle_link.estimator_health import EstimatorHealth

CONFIG = Path(__file__).resolve().parents[4] / "config" / "px4_quadrotor.yaml"
HOVER = Odometry(10.0, 4.0, -2.0, -3.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0)
GOOD = Told(0.0, (0.01, 0.02, 0.03), resets_counted=True, round_trip_s=0.01, jitter_s=0.001, clock_rate=1.0)
FENCED = "guards.fence={enabled: true, radius_m: 2}"


class Flight:
    """A pilot and its guards, looked at by hand."""

    def __init__(self, *overrides: str) -> None:
        self.config = load_config(CONFIG, overrides)
        self.pilot = Pilot(self.config, hedging=True)
        self.watch = Watch(self.config, table.limits(self.config))
        self.pilot.take_over(HOVER)
        self.watch.begin(HOVER)
        self.time_s, self.ticks = HOVER.time_s, 0

    def look(
        self, told: Told = GOOD, setpoint: AttitudeSetpoint | None = None, ticks: int = 5, **changed: float
    ) -> Reason | None:
        """The next look, at a vehicle that hovers but for what has changed."""
        self.time_s += PERIOD_S
        self.ticks += ticks
        sample = HOVER._replace(time_s=self.time_s, **changed)
        flown = self.pilot.step(sample, PERIOD_S)
        return self.watch.look(sample, setpoint or flown, self.pilot, told, self.ticks)

    def seen(self, reason: Reason) -> float:
        return self.watch.last[WATCHED.index(reason)]


def tilted(angle_rad: float) -> dict[str, float]:
    return {"qw": math.cos(angle_rad / 2), "qy": math.sin(angle_rad / 2)}


def test_a_vehicle_that_hovers_is_past_no_limit() -> None:
    flight = Flight(FENCED)
    assert {flight.look() for _ in range(100)} == {None}
    assert not flight.watch.alarmed
    for reason, value in zip(WATCHED, flight.watch.last, strict=True):
        assert not math.isnan(value), reason


def test_what_is_told_is_what_is_seen_and_what_is_not_told_is_not_a_number() -> None:
    flight = Flight()
    flight.look(GOOD._replace(missing_flags=2.0))
    assert flight.seen(Reason.ESTIMATOR_FLAGS) == 2.0
    assert flight.seen(Reason.POSITION_VARIANCE) == 0.03
    assert flight.seen(Reason.LINK_DELAY) == 0.01
    assert flight.seen(Reason.LINK_JITTER) == 0.001
    flight.look(Told())
    for reason in (Reason.ESTIMATOR_FLAGS, Reason.LINK_DELAY, Reason.LINK_JITTER, Reason.CLOCK_RATE):
        assert math.isnan(flight.seen(reason))


def test_a_variance_that_was_told_and_is_no_more_is_an_alarm() -> None:
    flight = Flight()
    flight.look(GOOD._replace(variance_ned_m2=(0.2, math.nan, 0.1)))
    assert flight.seen(Reason.POSITION_VARIANCE) == 0.2, "it was never told whole"
    flight.look(GOOD)
    for untold in ((math.nan, 0.1, 0.1), (math.nan,) * 3):
        flight.look(GOOD._replace(variance_ned_m2=untold))
        assert flight.seen(Reason.POSITION_VARIANCE) == math.inf
    assert flight.watch.describe(Reason.POSITION_VARIANCE).endswith("it is not told any more")
    never = Flight()
    never.look(Told())
    assert math.isnan(never.seen(Reason.POSITION_VARIANCE))


def test_a_large_variance_with_gaps_in_it_ends_control() -> None:
    """5 m2 that is no number for 50 ms in each 250: a look without a number takes nothing back."""
    flight = Flight()
    flight.look()
    large = GOOD._replace(variance_ned_m2=(5.0, 5.0, 0.1))
    unseen = GOOD._replace(variance_ned_m2=(math.nan,) * 3)
    found = [flight.look(unseen if k % 12 < 3 else large) for k in range(40)]
    assert Reason.POSITION_VARIANCE in found


def test_a_slide_may_be_as_long_as_the_estimator_of_the_config_is_wrong() -> None:
    limits = [
        table.limits(load_config(CONFIG, overrides))[Reason.POSITION_SLIDE]
        for overrides in ((), ("estimator={preset: gps}",), ("estimator={preset: rtk}",),
                          ("estimator={preset: motion_capture}",), ("guards.position_slide_m.limit=3",))
    ]  # fmt: skip
    assert limits[0] == limits[1] == pytest.approx(7.17, abs=0.01)
    assert limits[2:] == [pytest.approx(2.41, abs=0.01), pytest.approx(0.96, abs=0.01), 3.0]


def test_tilt_is_from_the_vertical_and_its_error_from_the_set_point() -> None:
    flight = Flight()
    flight.look(**tilted(0.5), setpoint=AttitudeSetpoint(math.cos(0.4), 0.0, math.sin(0.4), 0.0, 0.5))
    assert flight.seen(Reason.TILT) == pytest.approx(0.5)
    assert flight.seen(Reason.TILT_ERROR) == pytest.approx(0.3)


def test_the_fence_is_around_where_control_began_and_a_counted_reset_moves_it_along() -> None:
    flight = Flight(FENCED, "guards.velocity_consistency_m.enabled=false", "guards.estimator_steps_m.enabled=false")
    assert flight.look(x_m=HOVER.x_m + 2.1) is Reason.FENCE
    assert flight.seen(Reason.FENCE) == 1.0
    moved = Flight(FENCED, "guards.estimator_steps_m.limit=3")
    jump = Jump(1.1, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    for _ in range(2):
        moved.pilot.reseat(jump)
        moved.watch.reseat(jump, HOVER.time_s)
    assert moved.look(x_m=HOVER.x_m + 2.2) is None
    assert moved.seen(Reason.FENCE) == 0.0
    assert moved.seen(Reason.VELOCITY_CONSISTENCY) == pytest.approx(0.0, abs=1e-9)
    off = Flight()
    off.look()
    assert math.isnan(off.seen(Reason.FENCE))


def test_a_position_that_slides_is_seen_from_the_take_over_on() -> None:
    flight = Flight()
    assert flight.look(x_m=HOVER.x_m + 2.0) is Reason.VELOCITY_CONSISTENCY
    assert flight.seen(Reason.VELOCITY_CONSISTENCY) == pytest.approx(2.0, rel=0.05)


def test_a_rate_is_known_after_half_a_second_and_its_limit_is_the_least() -> None:
    flight = Flight("guards.pose_rate_hz.timeout_s=0")
    limit_hz = table.limits(flight.config)[Reason.POSE_RATE]
    ticks = math.floor(0.9 * limit_hz * PERIOD_S)
    for _ in range(25):
        assert flight.look(ticks=ticks) is None
        assert math.isnan(flight.seen(Reason.POSE_RATE))
    assert flight.look(ticks=ticks) is Reason.POSE_RATE
    text = flight.watch.describe(Reason.POSE_RATE)
    assert text.endswith(f"; it was {ticks / PERIOD_S:.3g}, the limit {limit_hz:.3g}")


def test_a_release_says_what_it_was_in_the_units_of_the_config() -> None:
    flight = Flight("guards.tilt_deg={limit: 40, timeout_s: 0}")
    assert flight.look(**tilted(math.radians(50.0))) is Reason.TILT
    assert flight.watch.describe(Reason.TILT) == f"{Reason.TILT.meaning}; it was 50, the limit 40"
    assert flight.watch.describe(Reason.OPERATOR) == Reason.OPERATOR.meaning


def test_too_little_thrust_to_hover_on_average_is_seen_within_seconds() -> None:
    flight = Flight("guards.hover_thrust.timeout_s=0")
    hover = flight.pilot.hover_thrust
    light = AttitudeSetpoint(1.0, 0.0, 0.0, 0.0, 0.7 * hover)
    seen = [flight.look(setpoint=light) for _ in range(100)]
    assert Reason.HOVER_THRUST in seen
    assert seen[0] is None
    assert flight.seen(Reason.HOVER_THRUST) == pytest.approx(0.3, abs=0.06)


def falling(flight: Flight, lift: float, seconds: float, falls: float) -> list[Reason | None]:
    """Looks at a vehicle whose thrust carries so much of its weight; `falls`, what of the rest accelerates it."""
    setpoint = AttitudeSetpoint(1.0, 0.0, 0.0, 0.0, lift * flight.pilot.hover_thrust)
    down_m_s2 = falls * 9.81 * (1.0 - lift)
    return [
        flight.look(setpoint=setpoint, vz_m_s=HOVER.vz_m_s + down_m_s2 * PERIOD_S * k)
        for k in range(round(seconds / PERIOD_S))
    ]


_CONTACT = tuple(
    f"guards.{name}.enabled=false" for name in ("velocity_consistency_m", "tracking_error_m", "hover_thrust")
)


@pytest.mark.parametrize("lift", [0.2, 0.45])
def test_what_does_not_fall_though_little_carries_it_has_landed(lift: float) -> None:
    seen = falling(Flight(*_CONTACT), lift, 2.0, 0.0)
    first = next(k for k, reason in enumerate(seen) if reason is not None)
    assert seen[first] is Reason.LANDED
    assert 0.5 <= first * PERIOD_S < 1.2


@pytest.mark.parametrize("lift", [0.2, 0.45])
def test_what_falls_has_not(lift: float) -> None:
    assert Reason.LANDED not in falling(Flight(*_CONTACT), lift, 1.0, 1.0)


# --- blindness --------------------------------------------------------------------------------------------------------

KNOWS_OF_DELAY = ("attitude.x.delay_s=[0.02, 0.045]", "attitude.y.delay_s=[0.02, 0.045]")


def blindness(config: Config, status: EstimatorHealth | None = None) -> Blindness:
    forget = {} if status is None else {Reason.ESTIMATOR_FLAGS: status.forget}
    return Blindness(config, table.limits(config), forget)


def test_at_stand_by_all_that_cannot_be_seen_is_told() -> None:
    config = load_config(CONFIG, KNOWS_OF_DELAY)
    assert blindness(config).settle(GOOD) == []
    assert blindness(config).settle(Told()) == [
        "guard cannot see: estimator_flags (no ESTIMATOR_STATUS)",
        "guard cannot see: position_variance_m2 (not in the odometry)",
        "guard cannot see: estimator_jump_m (resets are counted in ODOMETRY alone)",
        "guard cannot see: link_delay_s (no answer to TIMESYNC)",
    ]
    off = [f"guards.{guard.key}.enabled=false" for guard in GUARDS.values()]
    assert blindness(load_config(CONFIG, tuple(off))).settle(Told()) == []


def test_a_transfer_function_is_a_band_that_nobody_sees() -> None:
    function = "attitude.x={numerator: [90], denominator: [1, 18, 90]}"
    (line,) = blindness(load_config(CONFIG, (function,))).settle(GOOD)
    assert line == "guard cannot see: attitude_response_deg (a transfer function)"


def test_one_message_without_it_is_nothing_and_two_seconds_without_it_end_control() -> None:
    guards = blindness(load_config(CONFIG))
    assert guards.settle(GOOD) == []
    untold = GOOD._replace(variance_ned_m2=(math.nan, 0.1, 0.1))
    assert guards.look(GOOD, 10.0, ready=True) == []
    assert guards.look(untold, 12.0, ready=True) == []
    ((reason, text, ends),) = guards.look(untold, 12.1, ready=True)
    assert (reason, text) == (Reason.POSITION_VARIANCE, "guard cannot see: position_variance_m2 (not in the odometry)")
    assert ends == "the estimator no longer answers: no variance in its odometry for 2 s"
    assert guards.look(untold, 12.2, ready=True) == [], "it is told once"


def test_what_was_never_told_is_not_missed_until_it_has_been_told() -> None:
    guards = blindness(load_config(CONFIG))
    assert len(guards.settle(Told(resets_counted=True, round_trip_s=0.01))) == 2
    untold = GOOD._replace(variance_ned_m2=(math.nan,) * 3)
    assert all(guards.look(untold, 0.1 * n, ready=True) == [] for n in range(100))
    assert guards.look(GOOD, 10.0, ready=True) == []
    assert [gone.reason for gone in guards.look(untold, 12.1, ready=True)] == [Reason.POSITION_VARIANCE]


def test_before_stand_by_nothing_is_missed() -> None:
    guards = blindness(load_config(CONFIG))
    assert all(guards.look(Told(), 0.1 * n, ready=False) == [] for n in range(100))


def test_a_source_forgets_at_the_age_of_its_guards_row() -> None:
    status = EstimatorHealth()
    status.missing, status._at_s = 0.0, 10.0
    guards = blindness(load_config(CONFIG), status)
    guards.forget(12.0)
    assert status.missing == 0.0
    guards.forget(12.1)
    assert math.isnan(status.missing)
    told = GOOD._replace(missing_flags=status.missing)
    (gone,) = guards.look(told, 12.1, ready=True)
    assert gone.ends_control == "the estimator no longer answers: no ESTIMATOR_STATUS for 2 s"
