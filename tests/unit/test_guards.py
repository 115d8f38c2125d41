"""The guards: limits and timeouts from the config, and how long a limit must be exceeded before control ends."""

import math
from pathlib import Path
from typing import Any

import pytest

from companion.config import Config, ConfigError, load_config
from companion.config.guards import Guards, GuardSection
from companion.control.types import AttitudeSetpoint, Odometry
from companion.flight.authority.reasons import Reason
from companion.flight.guards import table as guards
from companion.flight.guards.table import CLEAR, GUARDS, Limits, Watched

ROOT = Path(__file__).resolve().parents[2]
RIG = ROOT / "config" / "antx_rig.yaml"
CALM = Watched(*([0.0] * len(GUARDS)))


def limits(*overrides: str) -> Limits:
    return guards.limits(load_config(RIG, overrides))


def test_ages_end_control_and_can_be_switched_off() -> None:
    on = limits()
    assert guards.stale(on, 0.2, 2.9) is None
    assert guards.stale(on, 0.26, 0.0) is Reason.POSE_STALE
    assert guards.stale(on, 0.0, 3.1) is Reason.HEARTBEAT_LOST
    assert guards.stale(limits("guards.pose_age_s.enabled=false"), 100.0, 0.0) is None
    assert guards.stale(limits("guards.pose_age_s.timeout_s=0.5"), 0.7, 0.0) is None


def test_every_number_has_its_guard_in_the_same_order() -> None:
    assert len(Watched._fields) == len(GUARDS) == len(CLEAR)
    for field, (reason, key, _) in zip(Watched._fields, GUARDS, strict=True):
        stem = field.removesuffix("_rad").replace("pose_period_s", "pose_rate_hz")
        assert key in (field, f"{stem}_deg", stem)
        assert hasattr(Guards(), key)
        assert key.startswith(reason.value)


def everything_on() -> Config:
    more = ("guards.fence={enabled: true, radius_m: 5}", "guards.flight_time_s={enabled: true, limit: 60}")
    return load_config(RIG, (*more, "guards.link_delay_s.limit=0.05", "guards.link_delay_s.timeout_s=1"))


@pytest.mark.parametrize(("place", "guard"), list(enumerate(GUARDS)))
def test_a_guard_ends_control_once_its_timeout_is_over(place: int, guard: tuple[Reason, str, float]) -> None:
    config = everything_on()
    limit = guards.limits(config)
    timeout_s = getattr(config.guards, guard[1]).timeout_s
    assert limit.watched[place] < math.inf
    above = Watched(*(limit.watched[place] * 1.01 + 0.1 if i == place else 0.0 for i in range(len(GUARDS))))
    since, reason = guards.watch(limit, CLEAR, above, 10.0)
    if timeout_s == 0.0:
        assert reason is guard[0]
        return
    assert reason is None
    since, reason = guards.watch(limit, since, above, 10.0 + 0.9 * timeout_s)
    assert reason is None
    _, reason = guards.watch(limit, since, above, 10.001 + timeout_s)
    assert reason is guard[0]
    interrupted, _ = guards.watch(limit, since, CALM, 10.0 + 0.95 * timeout_s)  # a break: it starts anew
    assert interrupted is CLEAR
    _, reason = guards.watch(limit, interrupted, above, 10.001 + timeout_s)
    assert reason is None


def test_at_the_limit_is_within_it_and_what_cannot_be_seen_is_above_nothing() -> None:
    limit = guards.limits(everything_on())
    assert guards.watch(limit, CLEAR, limit.watched, 0.0) == (CLEAR, None)
    assert guards.watch(limit, CLEAR, Watched(), 0.0) == (CLEAR, None)
    infinite = Watched(*([math.inf] * len(GUARDS)))
    assert guards.watch(limit, CLEAR, infinite, 0.0)[1] is Reason.VELOCITY_CONSISTENCY  # the first without a timeout


def test_a_break_of_one_guard_does_not_restart_another() -> None:
    limit = limits("guards.tilt_deg={limit: 40, timeout_s: 1}", "guards.tracking_error_m={limit: 1, timeout_s: 1}")
    tilt, both = CALM._replace(tilt_rad=1.0), CALM._replace(tilt_rad=1.0, tracking_error_m=2.0)
    since, _ = guards.watch(limit, CLEAR, tilt, 0.0)
    since, _ = guards.watch(limit, since, both, 0.5)
    since, reason = guards.watch(limit, since, CALM._replace(tracking_error_m=2.0), 0.9)
    assert reason is None
    assert guards.watch(limit, since, CALM._replace(tracking_error_m=2.0), 1.6)[1] is Reason.TRACKING_ERROR


def test_a_guard_switched_off_is_above_nothing() -> None:
    off = [f"guards.{key}.enabled=false" for _, key, _ in GUARDS]
    limit = limits(*off)
    assert set(limit.watched) == {math.inf}
    assert guards.watch(limit, CLEAR, CALM._replace(tilt_rad=3.0), 0.0) == (CLEAR, None)


def test_limits_that_follow_from_elsewhere() -> None:
    assert limits().watched.pose_period_s == pytest.approx(1 / 900, rel=0.02)
    assert limits("guards.pose_rate_hz.limit=950").watched.pose_period_s == pytest.approx(1 / 950, rel=0.02)
    assert limits().watched.link_delay_s == math.inf  # nothing is certified with a delay
    assert limits("attitude.x.delay_s=[0.01, 0.03]").watched.link_delay_s == pytest.approx(
        0.02
    )  # the vehicle has the rest
    assert limits("attitude.x.delay_s=0.03", "guards.link_delay_s.limit=0.02").watched.link_delay_s == 0.02


@pytest.mark.parametrize(
    ("overrides", "complaint"),
    [
        (("attitude.x.delay_s=0.03", "guards.link_delay_s.limit=0.04"), "above the certified attitude"),
        (("guards.pose_rate_hz.limit=100",), "below tick.floor_hz"),
        (("guards.tilt_deg.limit=30",), "not above controller.limits.tilt_deg"),
        (("guards.thrust_saturation.limit=1",), "below 1"),
        (("guards.fence={enabled: true, radius_m: 0.2}",), "lies outside guards.fence"),
        (("steering={enabled: true, system_ids: [255]}", "guards.fence={enabled: true, radius_m: 1}"), "any height"),
        (("guards.clock_jump_s.timeout_s=1",), "guards.clock_jump_s.timeout_s"),
        (("guards.fence.enabled=true",), "give radius_m, lower_ned_m or upper_ned_m"),
        (("guards.fence={enabled: true, lower_ned_m: [1, -1, -1]}",), "control begins within the fence"),
        (("guards.tilt.limit=1",), "guards.tilt: unknown key"),
        (("guards.weights_on_bound.limit=-1",), "guards.weights_on_bound.limit"),
        (("release.mode=rtl",), "release.mode"),
    ],
)
def test_limits_that_make_no_sense_are_refused(overrides: tuple[str, ...], complaint: str) -> None:
    with pytest.raises(ConfigError, match=complaint):
        load_config(RIG, overrides)


def test_what_a_file_leaves_out_of_a_guard_keeps_its_default() -> None:
    config = load_config(RIG, ("guards.tilt_deg={limit: 40}",))
    assert config.guards.tilt_deg == GuardSection(limit=40.0, timeout_s=Guards().tilt_deg.timeout_s)
    assert not load_config(RIG, ("guards.tilt_deg={enabled: false}",)).guards.tilt_deg.enabled


def test_an_estimate_that_stops_while_it_says_it_moves_is_no_news() -> None:
    moving = Odometry(1.0, 0.1, 0.2, -1.0, 0.3, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0)
    assert guards.repeats(moving, moving._replace(time_s=1.01))
    assert guards.repeats(moving, moving._replace(time_s=1.01, vx_m_s=0.0, vz_m_s=-0.1))
    assert not guards.repeats(moving, moving._replace(time_s=1.01, y_m=0.2001))
    assert not guards.repeats(moving, moving._replace(time_s=1.01, vx_m_s=0.01))  # standing still is no fault


def test_in_control_an_estimate_that_stays_the_same_to_the_last_bit_has_stopped() -> None:
    """In hover it hardly moves. Only an ideal plant rests exactly where it is wanted, and that is no fault."""
    hover = Odometry(1.0, 0.1, 0.2, -1.0, 0.01, 0.0, 0.02, 1.0, 0.0, 0.0, 0.0)
    later, rest = hover._replace(time_s=1.01), hover._replace(vx_m_s=1e-6, vz_m_s=0.0)
    assert guards.frozen(hover, later, 0.0)
    assert guards.frozen(rest, rest._replace(time_s=1.01), 0.01)
    assert not guards.frozen(rest, rest._replace(time_s=1.01), 1e-6)
    for changed in ({"x_m": 0.1001}, {"vz_m_s": 0.0200001}, {"qz": 1e-7}):
        assert not guards.frozen(hover, later._replace(**changed), 0.1)


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("place", range(5))
def test_not_a_number_is_seen_in_every_place(bad: float, place: int) -> None:
    values = [0.5] * 5
    assert guards.all_finite(AttitudeSetpoint(*values))
    values[place] = bad
    assert not guards.all_finite(AttitudeSetpoint(*values))


@pytest.mark.parametrize("q", [(0.0, 0.0, 0.0, 0.0), (2.0, 0.0, 0.0, 0.0), (math.nan, 0.0, 0.0, 0.0)])
def test_a_pose_without_a_unit_quaternion_is_not_valid(q: tuple[float, float, float, float]) -> None:
    good = Odometry(1.0, 0.1, 0.2, -1.0, 0.0, 0.0, 0.0, 0.6, 0.0, 0.8, 0.0)
    changed: dict[str, Any] = dict(zip(("qw", "qx", "qy", "qz"), q, strict=True))
    assert guards.valid_pose(good)
    assert not guards.valid_pose(good._replace(**changed))
    assert not guards.valid_pose(good._replace(vy_m_s=math.inf))
