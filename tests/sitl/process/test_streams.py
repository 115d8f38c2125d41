"""A planner streams to a flight: begins, ends, pauses, is refused by name, and gives way to the pilot."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from harness.fake_autopilot import HOLD
from harness.virtual_flight import VirtualFlight, flown
from pymavlink.dialects.v20 import development as mavlink

from companion.record.reader import read_flight

SETTINGS = (
    "steering={enabled: true, system_ids: [255, 250]}",
    "guards.fence={enabled: true, radius_m: 2, lower_ned_m: [-2, -2, -2], upper_ned_m: [2, 2, 2]}",
    "controller.anchor=setpoint", "controller.limits.speed_m_s=0.5", "mission.limits.speed_m_s=1",
    "guards.attitude_response_deg.enabled=false",  # the scripted vehicle does not move
    "guards.estimate_stuck_s.enabled=false", "guards.tracking_error_m.enabled=false", "guards.envelope.enabled=false",
    "guards.tilt_error_deg.enabled=false",
)  # fmt: skip
STREAMED, POSITION_ALONE = 0xC00, 0xDF8
SPEED_M_S = 0.1


class Sent(mavlink.MAVLink_set_position_target_local_ned_message):
    """A sample, as PX4 forwards it from a planner."""

    def __init__(self, ms: int, x: float, vx: float, *, system: int = 250, **changed: Any) -> None:
        values = {
            "frame": 1, "mask": STREAMED, "y": 0.0, "vy": 0.0, "ax": 0.0, "yaw": math.nan, **changed
        }  # fmt: skip
        super().__init__(
            ms, 1, 191, values["frame"], values["mask"], x, values["y"], 0, vx, values["vy"], 0,
            values["ax"], 0, 0, values["yaw"], 0,
        )  # fmt: skip
        self.sender = mavlink.MAVLink(None, system, 190)

    def pack(self, _: mavlink.MAVLink) -> bytes:
        return bytes(super().pack(self.sender))


class Planner:
    """Goes north at a constant speed, 20 samples a second."""

    def __init__(self, flight: VirtualFlight) -> None:
        self._flight = flight
        self.ms, self.x_m, self.speed_m_s = 10_000, 0.0, SPEED_M_S

    def go(self, seconds: float, *also: Sent) -> None:
        """Stream for so long; and before that, what somebody says in between."""
        self._flight.autopilot.answers += also
        for _ in range(round(seconds / 0.05)):
            self._flight.autopilot.answers.append(Sent(self.ms, self.x_m, self.speed_m_s))
            self._flight.fly_on(0.05)
            self.ms += 50
            self.x_m += 0.05 * self.speed_m_s

    def wait(self, seconds: float) -> None:
        """Say nothing, while its clock goes on."""
        self._flight.fly_on(seconds)
        self.ms += round(1e3 * seconds)


def events(folder: Path, *names: str) -> list[str]:
    return [event.detail for event in read_flight(folder).events if event.name in names]


def end(flight: VirtualFlight) -> None:
    """The pilot takes over."""
    flight.autopilot.mode = HOLD
    flight.until("^released")
    flight.exit_code(5.0)


def in_control(folder: Path) -> Any:
    ticks = read_flight(folder).ticks
    return ticks[ticks["state"] == 3]


def test_it_begins_pauses_resumes_and_ends_and_says_so(tmp_path: Path) -> None:
    with flown(tmp_path, *SETTINGS) as flight:
        planner = Planner(flight)
        planner.go(0.3)  # in stand-by
        flight.until("^engaged")
        planner.x_m = 0.0
        planner.go(1.5)
        planner.wait(2.0)
        assert any("stream ended, braking" in m.text for m in flight.autopilot.of_kind("STATUSTEXT"))
        rests_m = planner.x_m + 0.1 * SPEED_M_S
        planner.go(1.2, Sent(planner.ms, 1.0, SPEED_M_S))
        assert flight.until("^streamed by 250/190")
        planner.go(1.0)
        planner.wait(1.5)
        end(flight)
    engaged = in_control(flight.folder)
    told = events(flight.folder, "stream", "stream_ended")
    ended = "stream ended, braking: nothing new for 0.25 s"
    assert told == ["streamed by 250/190", ended, "streamed by 250/190", ended]
    assert events(flight.folder, "command_refused")[0] == "not in control"
    assert rests_m > 0.0
    assert np.abs(np.diff(engaged["target_ned_m"][:, 0])).max() < 0.004


@pytest.mark.parametrize(
    ("wrong", "reason"),
    [
        ({"x": 0.5}, "position jumps 0.35 m"),
        ({"x": math.nan}, "position is not finite"),
        ({"vx": math.inf}, "velocity is not finite"),
        ({"ax": math.nan}, "acceleration is not finite"),
        ({"vx": 1.5}, "speed 1.5 m/s, limit 1"),
        ({"frame": 8}, "frame 8 is not LOCAL_NED"),
        ({"mask": STREAMED | 0x200}, "a force is no acceleration"),
        ({"y": 2.1}, "2.11 m away, fence 2 m"),
        ({"later_ms": -50}, "time_boot_ms is not later"),
        ({"later_ms": 4}, "4 ms after the last, least 10"),
        ({"later_ms": 5000}, "time_boot_ms jumps 5 s"),
        ({"system": 255}, "another planner streams"),
        ({"system": 255, "mask": POSITION_ALONE}, "another planner streams"),
    ],
)
def test_what_is_wrong_is_refused_by_name_and_never_flown(wrong: dict[str, Any], reason: str, tmp_path: Path) -> None:
    with flown(tmp_path, *SETTINGS) as flight:
        flight.until("^engaged")
        planner = Planner(flight)
        planner.go(1.5)
        ms = planner.ms - 50 + wrong.get("later_ms", 50)
        values = {"x": planner.x_m, "vx": SPEED_M_S, **{k: v for k, v in wrong.items() if k != "later_ms"}}
        flight.autopilot.answers.append(Sent(ms, values.pop("x"), values.pop("vx"), **values))
        flight.fly_on(0.05)
        planner.ms, planner.x_m = planner.ms + 50, planner.x_m + 0.05 * SPEED_M_S
        planner.go(0.5)
        flight.until_heard(lambda: any(reason[:20] in m.text for m in flight.autopilot.of_kind("STATUSTEXT")), 1.0)
        assert any(reason[:20] in m.text for m in flight.autopilot.of_kind("STATUSTEXT"))
        end(flight)
    engaged = in_control(flight.folder)
    assert events(flight.folder, "command_refused") == [reason]
    assert np.abs(np.diff(engaged["target_ned_m"][:, 0])).max() < 0.002  # at 100 Hz, 0.1 m/s
    assert np.abs(engaged["target_ned_m"][:, 1]).max() == 0.0


def test_a_sample_too_late_is_refused(tmp_path: Path) -> None:
    with flown(tmp_path, *SETTINGS) as flight:
        flight.until("^engaged")
        planner = Planner(flight)
        planner.go(1.0)
        planner.ms -= 120  # its clock has fallen back, or the link queues
        planner.x_m -= 0.12 * SPEED_M_S
        flight.fly_on(0.15)
        planner.ms += 150
        planner.x_m += 0.15 * SPEED_M_S
        planner.go(0.05)
        end(flight)
    (refused,) = events(flight.folder, "command_refused")
    assert refused.endswith("s late, limit 0.1")


def test_one_that_could_not_brake_before_the_fence_is_refused(tmp_path: Path) -> None:
    with flown(tmp_path, *SETTINGS) as flight:
        flight.until("^engaged")
        planner = Planner(flight)
        planner.speed_m_s = 0.45
        planner.go(7.0)
        end(flight)
    engaged = in_control(flight.folder)
    assert events(flight.folder, "command_refused")[0].startswith("to brake: 2 m away")
    assert events(flight.folder, "stream_ended") == ["stream ended, braking: nothing new for 0.25 s"]
    assert 1.6 < engaged["target_ned_m"][-1, 0] < 2.0
    assert engaged["target_ned_m"][-1, 0] == engaged["target_ned_m"][-50, 0]


def test_a_position_of_the_planner_s_own_ends_its_stream(tmp_path: Path) -> None:
    with flown(tmp_path, *SETTINGS) as flight:
        flight.until("^engaged")
        planner = Planner(flight)
        planner.go(1.0)
        flight.autopilot.answers.append(Sent(0, 0.5, 0.0, mask=POSITION_ALONE))
        flight.fly_on(0.5)
        end(flight)
    engaged = in_control(flight.folder)
    assert events(flight.folder, "stream_ended") == ["stream ended: another command"]
    assert engaged["target_ned_m"][-1, 0] == 0.5


def test_without_an_anchor_at_the_set_point_nobody_streams(tmp_path: Path) -> None:
    settings = ("controller.anchor=engage", "controller.envelope.position_m=3")
    small = "guards.fence={enabled: true, radius_m: 2, lower_ned_m: [-2, -2, -2], upper_ned_m: [2, 2, 2]}"
    with flown(tmp_path, *SETTINGS, *settings, small) as flight:
        flight.until("^engaged")
        planner = Planner(flight)
        planner.go(0.5)
        end(flight)
    assert events(flight.folder, "command_refused") == ["a stream needs anchor: setpoint"]
