"""The flight process against a scripted autopilot: estimators, links and controllers that go wrong."""

import math
import time
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
from pymavlink.dialects.v20 import development as mavlink
from scripted_autopilot import (
    HOLD,
    OFFBOARD,
    RIG,
    Autopilot,
    Forged,
    flown,
    odometry,
    position_and_attitude,
    statuses,
    until,
)

from companion.config import load_config
from companion.control.types import AttitudeSetpoint, Odometry
from companion.flight import session as shared
from companion.flight.authority.states import Reason
from companion.flight.pilot.pilot import Pilot
from companion.flight.process import FlightProcess
from companion.mavlink.link import open_link
from companion.record.folder import open_folder
from companion.record.reader import read_flight


def test_a_small_reset_is_flown_through_and_a_large_one_ends_control(tmp_path: Path) -> None:
    with flown(tmp_path) as (autopilot, process):
        autopilot.start()
        until(process, "^engaged")
        time.sleep(0.5)
        autopilot.pose = lambda time_us: odometry(time_us, 0.4, resets=1)
        time.sleep(0.5)
        before = autopilot.setpoints()[-80:]
        assert process.poll() is None
        autopilot.pose = lambda time_us: odometry(time_us, 2.0, resets=2)
        assert "estimator_jump" in until(process, "^released")
        assert process.wait(5.0) == 1
    steps = [math.dist(a.q, b.q) for a, b in pairwise(before)]
    assert math.degrees(2.0 * max(steps)) < 1.0
    (folder,) = tmp_path.iterdir()
    assert [e.detail for e in read_flight(folder).events if e.name == "reseated"] == ["the estimator reset, 0.40 m"]


def test_small_resets_that_come_again_and_again_end_control(tmp_path: Path) -> None:
    with flown(tmp_path, "--set", "guards.velocity_consistency_m.enabled=false") as (autopilot, process):
        autopilot.start()
        until(process, "^engaged")
        began_us = round(1e6 * (time.monotonic() - autopilot.began_s))

        def walking(time_us: int) -> list[mavlink.MAVLink_message]:
            resets = max(time_us - began_us, 0) // 300_000
            return odometry(time_us, 0.4 * resets, resets=resets)

        autopilot.pose = walking
        line = until(process, "^released")
        assert "estimator_jump" in line
        assert "add up to 1.20 m, more than 1 m" in line
        assert process.wait(5.0) == 1


def test_a_slide_that_nobody_counts_and_doubt_end_control_with_their_own_reasons(tmp_path: Path) -> None:
    with flown(tmp_path) as (autopilot, process):
        autopilot.start()
        until(process, "^engaged")
        autopilot.pose = lambda time_us: odometry(time_us, variance=0.6)
        assert "position_variance" in (line := until(process, "^released"))
        assert "it was 0.6, the limit 0.5" in line
    with flown(tmp_path) as (autopilot, process):
        autopilot.start()
        until(process, "^engaged")
        began_us = round(1e6 * (time.monotonic() - autopilot.began_s))
        autopilot.pose = lambda time_us: odometry(time_us, 8e-6 * max(time_us - began_us, 0))
        assert "velocity_consistency" in until(process, "^released")


def test_its_own_heartbeat_tells_the_truth(tmp_path: Path) -> None:
    others = ("--set", "guards.attitude_response_deg.enabled=false", "--set", "guards.tilt_error_deg.enabled=false")
    with flown(
        tmp_path, "--set", "guards.tilt_deg={limit: 10, timeout_s: 2}", "--set", "controller.limits.tilt_deg=5", *others
    ) as (autopilot, process):
        autopilot.switches = False
        autopilot.start()
        until(process, "^standby")
        time.sleep(1.2)
        autopilot.mode = OFFBOARD
        until(process, "^engaged")
        time.sleep(1.2)
        autopilot.pose = lambda time_us: tilted(time_us, 0.3)  # above its limit, its timeout running
        assert "tilt" in until(process, "^released")
        process.wait(5.0)
    assert statuses(autopilot) == [
        mavlink.MAV_STATE_BOOT, mavlink.MAV_STATE_CALIBRATING, mavlink.MAV_STATE_STANDBY,
        mavlink.MAV_STATE_ACTIVE, mavlink.MAV_STATE_CRITICAL,
    ]  # fmt: skip


def tilted(time_us: int, angle_rad: float) -> list[mavlink.MAVLink_message]:
    (message,) = odometry(time_us)
    message.q = [math.cos(angle_rad / 2), 0, math.sin(angle_rad / 2), 0]
    return [message]


def test_a_slow_answer_to_timesync_is_a_slow_link(tmp_path: Path) -> None:
    delay = ("--set", "attitude.x.delay_s=0.05", "--set", "guards.link_jitter_s.enabled=false")
    with flown(tmp_path, *delay) as (autopilot, process):
        autopilot.start()
        until(process, "^engaged")
        time.sleep(1.0)
        assert process.poll() is None
        autopilot.late_s = 0.15
        assert "link_delay" in until(process, "^released")


def test_what_a_guard_cannot_see_is_told(tmp_path: Path) -> None:
    with flown(tmp_path) as (autopilot, process):
        autopilot.pose = lambda time_us: odometry(time_us, variance=math.nan)
        autopilot.start()
        assert "estimator_flags" in until(process, "^guard cannot see")
        assert "position_variance_m2" in until(process, "^guard cannot see")


STANDS_STILL = [f"guards.{name}.enabled=false" for name in ("attitude_response_deg", "tilt_error_deg", "hover_thrust")]
LONGER = [word for setting in STANDS_STILL for word in ("--set", setting)]  # than what does not answer may stand there


def test_an_estimator_that_no_longer_answers_ends_control(tmp_path: Path) -> None:
    with flown(tmp_path, *LONGER) as (autopilot, process):
        autopilot.tells_estimator = True
        autopilot.start()
        until(process, "^engaged")
        autopilot.tells_estimator = False
        until(process, "^guard cannot see: estimator_flags")
        assert "estimator_flags (the estimator no longer answers" in until(process, "^released")
        assert process.wait(5.0) == 1


@pytest.mark.parametrize("pose", [lambda t: odometry(t, variance=math.nan), position_and_attitude])
def test_what_was_never_told_is_not_missed(tmp_path: Path, pose: Callable[[int], Any]) -> None:
    """The pilot knows it from stand-by; longer than after which it would be missed."""
    with flown(tmp_path, *LONGER) as (autopilot, process):
        autopilot.pose = pose
        autopilot.start()
        until(process, "^engaged")
        time.sleep(4.0)
        assert process.poll() is None
        process.terminate()
        rest = process.stdout.read() if process.stdout is not None else ""
        assert "released: operator" in rest
        assert "guard cannot see" not in rest


def test_variances_that_are_told_no_longer_end_control(tmp_path: Path) -> None:
    with flown(tmp_path, *LONGER) as (autopilot, process):
        autopilot.start()
        until(process, "^engaged")
        autopilot.pose = lambda time_us: odometry(time_us, variance=math.nan)
        assert "position_variance (the estimator no longer answers" in until(process, "^released")


def test_a_link_whose_delay_is_seen_no_longer_is_told_and_flown_on(tmp_path: Path) -> None:
    with flown(tmp_path, "--set", "attitude.x.delay_s=0.05", *LONGER) as (autopilot, process):
        autopilot.start()
        until(process, "^engaged")
        time.sleep(0.5)
        autopilot.answers_timesync = False
        until(process, "^guard cannot see: link_delay_s")
        time.sleep(0.5)
        assert process.poll() is None
        assert any(m.get_type() == "STATUSTEXT" and "cannot see: link_delay_s" in m.text for m in autopilot.heard)


@pytest.mark.parametrize("when", ["at once", "at stand-by"])
def test_two_companions_are_one_too_many(when: str, tmp_path: Path) -> None:
    twin = mavlink.MAVLink(None, 1, 191)
    with flown(tmp_path) as (autopilot, process):
        autopilot.switches = False
        if when == "at once":
            autopilot.pose = lambda time_us: [*odometry(time_us), Forged(twin)]
        autopilot.start()
        if when == "at stand-by":
            until(process, "^standby")
            autopilot.pose = lambda time_us: [*odometry(time_us), Forged(twin)]
        assert process.wait(10.0) == 2
        assert process.stderr is not None
        assert "another companion is 1/191 too" in process.stderr.read()
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
            time.sleep(0.4)
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
    monkeypatch.setattr(shared, "Pilot", lambda *_, **__: Broken(how))
    config = load_config(RIG, ("tick.rate_hz=100", "tick.floor_hz=60", "guards.pose_age_s.limit=1"))
    autopilot = Autopilot()
    recorder = open_folder(tmp_path / "flight", RIG, config, blocking=False)
    link = open_link(f"udpout://127.0.0.1:{autopilot.port}")
    try:
        autopilot.start()
        summary = FlightProcess(config, link, recorder).run()
    finally:
        autopilot.running = False
        autopilot.join()
        autopilot.socket.close()
        link.close()
        recorder.close()
    assert (summary.reason, summary.engaged) == (reason, True)
    assert autopilot.mode == HOLD
    assert all(math.isfinite(v) for m in autopilot.setpoints() for v in (*m.q, m.thrust))
    assert ("traceback" in {event.name for event in read_flight(tmp_path / "flight").events}) == (how == "raises")
