"""The guards: limits and timeouts from the config, and how long a limit must be exceeded before control ends."""

import math
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from companion.config import Config, ConfigError, load_config
from companion.config.guards.declaration import Group
from companion.config.guards.rows import GUARDS, Guards, Reason
from companion.config.guards.sections import EventGuardSection, GuardSection
from companion.control.types import AttitudeSetpoint, Odometry
from companion.flight.guards import table as guards
from companion.flight.guards.measures import MEASURES
from companion.flight.guards.table import CLEAR, WATCHED, Limits, WatchLimits

ROOT = Path(__file__).resolve().parents[4]
RIG = ROOT / "config" / "antx_rig.yaml"
# Compared where it happens: these have no measure.
BEFORE = {Reason.NOT_SETTLED}  # looked at before control begins alone
AGES = {Reason.POSE_STALE, Reason.HEARTBEAT_LOST}
EVENTS = {Reason.CLOCK_JUMP, Reason.ESTIMATOR_JUMP, Reason.TICK_OVERRUN}
UNITS = ("m_s", "deg", "hz", "m", "m2", "s")  # the longest first


def limits(*overrides: str) -> Limits:
    return guards.limits(load_config(RIG, overrides))


def watched(*overrides: str) -> WatchLimits:
    config = load_config(RIG, overrides)
    return guards.watch_limits(config, guards.limits(config))


def seen(otherwise: float = 0.0, **by_name: float) -> tuple[float, ...]:
    """One number a guard: these by the names of their reasons, `otherwise` for all others."""
    assert set(by_name) <= {reason.value for reason in WATCHED}
    return tuple(by_name.get(reason.value, -math.inf if GUARDS[reason].row.least else otherwise) for reason in WATCHED)


# --- the rows ---------------------------------------------------------------------------------------------------------


def test_every_guard_of_the_schema_has_its_row_and_its_description() -> None:
    assert [guard.key for guard in GUARDS.values()] == list(Guards.model_fields)
    for reason, (key, about, row) in GUARDS.items():
        assert about, key
        assert row.reason is reason
        assert not any("\n" in text or "|" in text for text in (about, reason.meaning, reason.look_at))
        ending = next((unit for unit in UNITS if key.endswith(f"_{unit}")), "")
        assert row.unit == ending, "the unit of its limit is in its name"


def test_every_guard_is_measured_or_stands_where_it_happens() -> None:
    assert set(GUARDS) == set(WATCHED) | AGES | EVENTS | BEFORE
    assert len(WATCHED) == len(CLEAR)
    assert not set(WATCHED) & (AGES | EVENTS | BEFORE)
    assert set(MEASURES) <= set(GUARDS)
    for reason in EVENTS:
        assert isinstance(getattr(Guards(), GUARDS[reason].key), EventGuardSection)


def test_a_guard_that_can_go_blind_has_a_way_to_tell_and_a_reason_to_give() -> None:
    can = {reason for reason, measured in MEASURES.items() if measured.blind is not None}
    assert can == {reason for reason, guard in GUARDS.items() if guard.row.blind is not None}
    for reason in can:
        blind = GUARDS[reason].row.blind
        assert blind is not None
        assert blind.why
        assert blind.ends_control is None or blind.age_s is not None


def test_the_order_of_the_checks_is_that_of_the_rows() -> None:
    """What tells most of the cause comes first; the estimator's doubt before what follows from it."""
    assert WATCHED == (
        Reason.POSITION_VARIANCE, Reason.ESTIMATOR_FLAGS, Reason.ESTIMATE_STUCK, Reason.VELOCITY_CONSISTENCY,
        Reason.ESTIMATOR_STEPS, Reason.POSITION_SLIDE, Reason.HEIGHT_SLIDE, Reason.FENCE, Reason.TILT,
        Reason.UNEXPLAINED_MOTION, Reason.ATTITUDE_RESPONSE, Reason.TILT_ERROR, Reason.LANDED, Reason.HOVER_THRUST,
        Reason.THRUST_SATURATION, Reason.WEIGHTS_ON_BOUND, Reason.TRACKING_ERROR, Reason.ENVELOPE, Reason.LINK_DELAY,
        Reason.LINK_JITTER, Reason.POSE_RATE, Reason.CLOCK_RATE, Reason.FLIGHT_TIME,
    )  # fmt: skip


def test_the_page_of_the_guards_is_what_the_rows_say() -> None:
    page = subprocess.run(
        [sys.executable, ROOT / "docs" / "guards_page.py"], capture_output=True, text=True, check=True, timeout=60
    ).stdout
    written = (ROOT / "docs" / "guards.md").read_text(encoding="utf-8")
    assert page == written, "write it again: python docs/guards_page.py > docs/guards.md"
    assert all(f"`{reason.value}`" in page for reason in Reason)
    assert all(f"`{guard.key}`" in page for guard in GUARDS.values())
    assert all(group.value in page for group in Group)


# --- limits and timeouts ----------------------------------------------------------------------------------------------


def test_ages_end_control_and_can_be_switched_off() -> None:
    on = limits()
    assert guards.stale(on, 0.2, 2.9) is None
    assert guards.stale(on, 0.26, 0.0) is Reason.POSE_STALE
    assert guards.stale(on, 0.0, 3.1) is Reason.HEARTBEAT_LOST
    assert guards.stale(limits("guards.pose_age_s.enabled=false"), 100.0, 0.0) is None
    assert guards.stale(limits("guards.pose_age_s.timeout_s=0.5"), 0.7, 0.0) is None


def everything_on() -> Config:
    """No limit but those that follow from elsewhere is left out."""
    enabled = [f"guards.{key}.enabled=true" for key in Guards.model_fields if key != "fence"]
    more = ("guards.fence={enabled: true, radius_m: 5}", "guards.link_delay_s.limit=0.05")
    return load_config(RIG, (*enabled, *more, "guards.link_delay_s.timeout_s=1", "attitude.x.delay_s=0.05"))


@pytest.mark.parametrize("guarded", WATCHED)
def test_a_guard_ends_control_once_its_timeout_is_over(guarded: Reason) -> None:
    config = everything_on()
    of = guards.limits(config)
    limit, place = guards.watch_limits(config, of), WATCHED.index(guarded)
    timeout_s = getattr(config.guards, GUARDS[guarded].key).timeout_s
    assert math.isfinite(limit.limits[place])
    calm = seen()
    past = tuple(limit.limits[i] * 1.01 + 0.1 if i == place else value for i, value in enumerate(calm))
    if GUARDS[guarded].row.least:
        assert limit.limits[place] == -of[guarded]
        past = (*past[:place], -of[guarded] * 0.99, *past[place + 1 :])
    dt_s = max(timeout_s, 1.0) / 10.0
    had, reason = guards.watch(limit, CLEAR, past, dt_s)
    if timeout_s == 0.0:
        assert reason is guarded
        return
    for _ in range(round(timeout_s / dt_s) - 2):
        assert reason is None
        had, reason = guards.watch(limit, had, past, dt_s)
    held, reason = guards.watch(limit, had, (math.nan,) * len(WATCHED), 100.0)  # what cannot be seen takes nothing back
    assert (held, reason) == (had, None)
    drained, reason = guards.watch(limit, had, calm, dt_s)  # and a calm look no more than itself
    assert reason is None
    assert drained[place] == pytest.approx(had[place] - dt_s)
    for _ in range(2):
        assert reason is None
        drained, reason = guards.watch(limit, drained, past, dt_s)
    assert reason is guarded
    assert guards.watch(limit, had, calm, timeout_s) == (CLEAR, None)


def test_at_the_limit_is_within_it_and_what_cannot_be_seen_is_past_nothing() -> None:
    config = everything_on()
    limit = guards.watch_limits(config, guards.limits(config))
    assert guards.watch(limit, CLEAR, limit.limits, 0.0) == (CLEAR, None)
    assert guards.watch(limit, CLEAR, (math.nan,) * len(WATCHED), 0.0) == (CLEAR, None)
    infinite = (math.inf,) * len(WATCHED)
    assert guards.watch(limit, CLEAR, infinite, 0.0)[1] is Reason.ESTIMATE_STUCK  # the first without a timeout


def test_a_break_of_one_guard_does_not_restart_another() -> None:
    limit = watched("guards.tilt_deg={limit: 40, timeout_s: 1}", "guards.tracking_error_m={limit: 1, timeout_s: 1}")
    had, _ = guards.watch(limit, CLEAR, seen(tilt=1.0), 0.5)
    had, _ = guards.watch(limit, had, seen(tilt=1.0, tracking_error=2.0), 0.4)
    had, reason = guards.watch(limit, had, seen(tracking_error=2.0), 0.4)
    assert reason is None
    assert guards.watch(limit, had, seen(tracking_error=2.0), 0.3)[1] is Reason.TRACKING_ERROR


def test_a_guard_switched_off_is_past_nothing() -> None:
    off = [f"guards.{guard.key}.enabled=false" for guard in GUARDS.values()]
    limit = watched(*off)
    assert set(limit.limits) == {math.inf}
    assert {abs(value) for value in limits(*off).values()} == {math.inf}
    assert guards.watch(limit, CLEAR, seen(tilt=3.0), 0.0) == (CLEAR, None)


def test_limits_are_in_our_units_and_some_follow_from_elsewhere() -> None:
    usual = limits()
    assert usual[Reason.TILT] == pytest.approx(math.radians(60.0))
    assert usual[Reason.FENCE] == math.inf  # off
    assert usual[Reason.ENVELOPE] == 1.0
    assert usual[Reason.POSE_RATE] == pytest.approx(900, rel=0.02)
    assert limits("guards.pose_rate_hz.limit=950")[Reason.POSE_RATE] == pytest.approx(950, rel=0.02)
    assert usual[Reason.LINK_DELAY] == math.inf  # without a certificate nothing is known of a delay
    assert usual[Reason.LINK_JITTER] == 0.15
    shared = limits("attitude.x.delay_s=[0.01, 0.03]")
    assert shared[Reason.LINK_DELAY] == pytest.approx(0.02)  # the vehicle has the rest
    assert shared[Reason.LINK_JITTER] == pytest.approx(0.02)
    assert limits("attitude.x.delay_s=0.03", "guards.link_jitter_s.limit=0.01")[Reason.LINK_JITTER] == 0.01
    given = limits("attitude.x.delay_s=0.03", "guards.link_delay_s.limit=0.02")
    assert given[Reason.LINK_DELAY] == given[Reason.LINK_JITTER] == 0.02
    identifying = guards.limits(load_config(ROOT / "config" / "px4_quadrotor.yaml", ("mission={identification: {}}",)))
    assert identifying[Reason.ATTITUDE_RESPONSE] == math.inf


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
