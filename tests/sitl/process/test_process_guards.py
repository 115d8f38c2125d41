"""The flight process against a scripted autopilot: estimators, links and controllers that go wrong."""

import math
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
from harness.fake_autopilot import HOLD, OFFBOARD, Forged, odometry, position_and_attitude
from harness.virtual_flight import RIG, flown
from pymavlink.dialects.v20 import development as mavlink

from companion.config import load_config
from companion.control.types import AttitudeSetpoint, Odometry
from companion.flight import session
from companion.flight.authority.states import Reason
from companion.flight.host import clock
from companion.flight.pilot.pilot import Pilot
from companion.record.reader import read_flight


def test_a_small_reset_is_flown_through_and_a_large_one_ends_control(tmp_path: Path) -> None:
    with flown(tmp_path) as flight:
        autopilot = flight.autopilot
        flight.until("^engaged")
        flight.fly_on(0.5)
        autopilot.pose = lambda time_us: odometry(time_us, 0.4, resets=1)
        flight.fly_on(0.5)
        before = autopilot.setpoints()[-80:]
        assert flight.running
        autopilot.pose = lambda time_us: odometry(time_us, 2.0, resets=2)
        assert "estimator_jump" in flight.until("^released")
        assert flight.exit_code(5.0) == 1
    steps = [math.dist(a.q, b.q) for a, b in pairwise(before)]
    assert math.degrees(2.0 * max(steps)) < 1.0
    (folder,) = tmp_path.iterdir()
    assert [e.detail for e in read_flight(folder).events if e.name == "reseated"] == ["the estimator reset, 0.40 m"]


def test_small_resets_that_come_again_and_again_end_control(tmp_path: Path) -> None:
    with flown(tmp_path, "guards.velocity_consistency_m.enabled=false") as flight:
        autopilot = flight.autopilot
        flight.until("^engaged")
        began_us = autopilot.time_us

        def walking(time_us: int) -> list[mavlink.MAVLink_message]:
            resets = max(time_us - began_us, 0) // 300_000
            return odometry(time_us, 0.4 * resets, resets=resets)

        autopilot.pose = walking
        line = flight.until("^released")
        assert "estimator_steps" in line
        assert "it was 1.2, the limit 1" in line
        assert flight.exit_code(5.0) == 1


def test_a_slide_that_nobody_counts_and_doubt_end_control_with_their_own_reasons(tmp_path: Path) -> None:
    with flown(tmp_path) as flight:
        autopilot = flight.autopilot
        flight.until("^engaged")
        autopilot.pose = lambda time_us: odometry(time_us, variance=0.6)
        assert "position_variance" in (line := flight.until("^released"))
        assert "it was 0.6, the limit 0.5" in line
    with flown(tmp_path) as flight:
        autopilot = flight.autopilot
        flight.until("^engaged")
        began_us = autopilot.time_us
        autopilot.pose = lambda time_us: odometry(time_us, 8e-6 * max(time_us - began_us, 0))
        assert "velocity_consistency" in flight.until("^released")


def test_its_own_heartbeat_tells_the_truth(tmp_path: Path) -> None:
    others = ("guards.attitude_response_deg.enabled=false", "guards.tilt_error_deg.enabled=false")
    with flown(
        tmp_path, "guards.tilt_deg={limit: 10, timeout_s: 2}", "controller.limits.tilt_deg=5", *others
    ) as flight:
        autopilot = flight.autopilot
        autopilot.switches = False
        flight.until("^standby")
        flight.fly_on(1.2)
        autopilot.mode = OFFBOARD
        flight.until("^engaged")
        flight.fly_on(1.2)
        autopilot.pose = lambda time_us: tilted(time_us, 0.3)  # above its limit, its timeout running
        assert "tilt" in flight.until("^released")
        flight.exit_code(5.0)
    assert autopilot.statuses() == [
        mavlink.MAV_STATE_BOOT, mavlink.MAV_STATE_CALIBRATING, mavlink.MAV_STATE_STANDBY,
        mavlink.MAV_STATE_ACTIVE, mavlink.MAV_STATE_CRITICAL,
    ]  # fmt: skip


def tilted(time_us: int, angle_rad: float) -> list[mavlink.MAVLink_message]:
    (message,) = odometry(time_us)
    message.q = [math.cos(angle_rad / 2), 0, math.sin(angle_rad / 2), 0]
    return [message]


def test_a_slow_answer_to_timesync_is_a_slow_link(tmp_path: Path) -> None:
    delay = ("attitude.x.delay_s=0.05", "guards.link_jitter_s.enabled=false")
    with flown(tmp_path, *delay) as flight:
        autopilot = flight.autopilot
        flight.until("^engaged")
        flight.fly_on(1.0)
        assert flight.running
        autopilot.late_s = 0.15
        assert "link_delay" in flight.until("^released")


def test_what_a_guard_cannot_see_is_told(tmp_path: Path) -> None:
    with flown(tmp_path) as flight:
        autopilot = flight.autopilot
        autopilot.pose = lambda time_us: odometry(time_us, variance=math.nan)
        assert "estimator_flags" in flight.until("^guard cannot see")
        assert "position_variance_m2" in flight.until("^guard cannot see")


# Longer than what does not answer may stand there.
LONGER = [f"guards.{name}.enabled=false" for name in ("attitude_response_deg", "tilt_error_deg", "hover_thrust")]


def test_an_estimator_that_no_longer_answers_ends_control(tmp_path: Path) -> None:
    with flown(tmp_path, *LONGER) as flight:
        autopilot = flight.autopilot
        autopilot.tells_estimator = True
        flight.until("^engaged")
        autopilot.tells_estimator = False
        flight.until("^guard cannot see: estimator_flags")
        assert "estimator_flags (the estimator no longer answers" in flight.until("^released")
        assert flight.exit_code(5.0) == 1


@pytest.mark.parametrize("pose", [lambda t: odometry(t, variance=math.nan), position_and_attitude])
def test_what_was_never_told_is_not_missed(tmp_path: Path, pose: Callable[[int], Any]) -> None:
    """The pilot knows it from stand-by; longer than after which it would be missed."""
    with flown(tmp_path, *LONGER) as flight:
        autopilot = flight.autopilot
        autopilot.pose = pose
        flight.until("^engaged")
        flight.fly_on(4.0)
        assert flight.running
        flight.process.stop()
        flight.exit_code(5.0)
    rest = "\n".join(flight.lines)
    assert "released: operator" in rest
    assert "guard cannot see" not in rest[rest.index("\nengaged") :]


def test_variances_that_are_told_no_longer_end_control(tmp_path: Path) -> None:
    with flown(tmp_path, *LONGER) as flight:
        autopilot = flight.autopilot
        flight.until("^engaged")
        autopilot.pose = lambda time_us: odometry(time_us, variance=math.nan)
        assert "position_variance (the estimator no longer answers" in flight.until("^released")


def test_a_link_whose_delay_is_seen_no_longer_is_told_and_flown_on(tmp_path: Path) -> None:
    with flown(tmp_path, "attitude.x.delay_s=0.05", *LONGER) as flight:
        autopilot = flight.autopilot
        flight.until("^engaged")
        flight.fly_on(0.5)
        autopilot.answers_timesync = False
        flight.until("^guard cannot see: link_delay_s")
        flight.fly_on(0.5)
        assert flight.running
        assert any(m.get_type() == "STATUSTEXT" and "cannot see: link_delay_s" in m.text for m in autopilot.heard)


@pytest.mark.parametrize("when", ["at once", "at stand-by"])
def test_two_companions_are_one_too_many(when: str, tmp_path: Path) -> None:
    twin = mavlink.MAVLink(None, 1, 191)
    with flown(tmp_path) as flight:
        autopilot = flight.autopilot
        autopilot.switches = False
        if when == "at once":
            autopilot.pose = lambda time_us: [*odometry(time_us), Forged(twin)]
        if when == "at stand-by":
            flight.until("^standby")
            autopilot.pose = lambda time_us: [*odometry(time_us), Forged(twin)]
        assert flight.exit_code(10.0) == 2
        assert "another companion is 1/191 too" in flight.complaint
        assert bool(autopilot.setpoints()) == (when == "at stand-by")


class Broken(Pilot):
    """A controller that fails after a second in control, in one of three ways."""

    def __init__(self, how: str) -> None:
        super().__init__(load_config(RIG), hedging=True)
        self.how = how

    def step(self, sample: Odometry, dt_s: float) -> AttitudeSetpoint:
        setpoint = super().step(sample, dt_s)
        if self.elapsed_s < 1.0:
            return setpoint
        if self.how == "raises":
            raise ZeroDivisionError("of some kind")
        if self.how == "sleeps":
            clock.time.sleep(0.4)  # of the flight's own time
        return setpoint._replace(qx=math.nan) if self.how == "not a number" else setpoint


@pytest.mark.parametrize(
    ("how", "reason"),
    [
        ("not a number", Reason.SETPOINT_INVALID),
        ("raises", Reason.INTERNAL_ERROR),
        ("sleeps", Reason.TICK_OVERRUN),
    ],
)
def test_a_controller_that_fails_hands_the_vehicle_back(
    how: str, reason: Reason, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(session, "Pilot", lambda *_, **__: Broken(how))
    with flown(tmp_path, "guards.pose_age_s.limit=1") as flight:
        flight.exit_code(within_s=10.0)
    autopilot, summary = flight.autopilot, flight.summary
    assert summary is not None
    assert (summary.reason, summary.engaged) == (reason, True)
    assert autopilot.mode == HOLD
    assert all(math.isfinite(v) for m in autopilot.setpoints() for v in (*m.q, m.thrust))
    assert ("traceback" in {event.name for event in read_flight(flight.folder).events}) == (how == "raises")
