"""Live commands: what is taken as a set-point, what is refused and why, and where the fence is."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import development as mavlink

from companion.config import ConfigError, load_config
from companion.config.guards.fence import FenceSection
from companion.control.types import PositionSetpoint
from companion.flight.vehicle_link import live_command as steer
from companion.mavlink.codec import Frame, FrameParser
from companion.trajectory.sample import Sample

OWN = (1, 191)
POSITION_AND_YAW, POSITION_ALONE, STREAMED = 0x9F8, 0xDF8, 0x800
MASKS = [POSITION_AND_YAW, POSITION_ALONE, STREAMED, STREAMED | 0x1C0]
MANY = settings(max_examples=200)
HERE = PositionSetpoint(10.0, -5.0, -3.0, 0.5)


def frame(**changed: Any) -> Frame:
    values: dict[str, Any] = {
        "time_boot_ms": 5, "target_system": OWN[0], "target_component": OWN[1], "coordinate_frame": 1,
        "type_mask": POSITION_AND_YAW, "x": 1.0, "y": 2.0, "z": -3.0, "vx": 0.0, "vy": 0.0, "vz": 0.0,
        "afx": 0.0, "afy": 0.0, "afz": 0.0, "yaw": 0.25, "yaw_rate": 0.0,
    }  # fmt: skip
    message = mavlink.MAVLink_set_position_target_local_ned_message(**{**values, **changed})
    (found,) = FrameParser().feed(bytes(message.pack(mavlink.MAVLink(None, srcSystem=255, srcComponent=190))))
    return found


def test_position_and_yaw_are_taken() -> None:
    assert steer.parse(frame(), OWN) == PositionSetpoint(1.0, 2.0, -3.0, 0.25)


def test_a_yaw_to_be_ignored_is_kept() -> None:
    command = steer.parse(frame(type_mask=POSITION_ALONE, yaw=math.nan), OWN)
    assert isinstance(command, PositionSetpoint)
    assert command[:3] == (1.0, 2.0, -3.0)
    assert math.isnan(command.yaw_rad)


def test_a_yaw_beyond_a_turn_is_the_same_heading() -> None:
    command = steer.parse(frame(yaw=0.25 + 6 * math.pi), OWN)
    assert isinstance(command, PositionSetpoint)
    assert command.yaw_rad == pytest.approx(0.25, abs=1e-5)


def test_numbers_in_ignored_fields_do_not_matter() -> None:
    ignored = dict.fromkeys(("vx", "vy", "vz", "afx", "afy", "afz", "yaw_rate"), math.nan)
    assert steer.parse(frame(**ignored), OWN) == PositionSetpoint(1.0, 2.0, -3.0, 0.25)


def test_what_mavsdk_and_dronekit_send_for_a_position_is_taken() -> None:
    for mask in (0x9F8, 0xBF8, 0xDF8, 0xFF8):  # with and without the force bit
        assert isinstance(steer.parse(frame(type_mask=mask), OWN), PositionSetpoint), hex(mask)


@pytest.mark.parametrize(
    ("changed", "reason"),
    [
        ({"coordinate_frame": mavlink.MAV_FRAME_BODY_NED}, "frame 8 is not LOCAL_NED"),
        ({"coordinate_frame": mavlink.MAV_FRAME_LOCAL_OFFSET_NED}, "frame 7 is not LOCAL_NED"),
        ({"type_mask": POSITION_AND_YAW | 1}, "x, y and z must be given"),
        ({"type_mask": POSITION_AND_YAW | 4}, "x, y and z must be given"),
        ({"type_mask": POSITION_AND_YAW & ~0x10}, "velocity is given in part"),
        ({"type_mask": POSITION_AND_YAW & ~0x100}, "acceleration is given in part"),
        ({"type_mask": POSITION_AND_YAW & ~0x1C0}, "acceleration without velocity"),
        ({"type_mask": STREAMED | 0x200}, "a force is no acceleration"),
        ({"type_mask": STREAMED & ~0x800}, "yaw rate must be ignored"),
        ({"type_mask": STREAMED, "vy": math.nan}, "velocity is not finite"),
        ({"type_mask": STREAMED, "afz": -math.inf}, "acceleration is not finite"),
        ({"type_mask": STREAMED, "x": math.nan}, "position is not finite"),
        ({"type_mask": STREAMED, "coordinate_frame": 9}, "frame 9 is not LOCAL_NED"),
        ({"type_mask": POSITION_AND_YAW & ~0x800}, "yaw rate must be ignored"),
        ({"type_mask": POSITION_AND_YAW | 0x2000}, "unknown bits in type_mask"),
        ({"type_mask": 0xFFFF}, "unknown bits in type_mask"),
        ({"type_mask": 0}, "yaw rate must be ignored"),
        ({"x": math.nan}, "position is not finite"),
        ({"y": math.inf}, "position is not finite"),
        ({"x": math.inf, "y": -math.inf}, "position is not finite"),
        ({"yaw": math.nan}, "yaw is not finite"),
        ({"yaw": -math.inf}, "yaw is not finite"),
        ({"target_component": 1}, "not addressed to the companion"),
        ({"target_system": 0, "target_component": 0}, "not addressed to the companion"),
    ],
)
def test_what_is_malformed_is_refused_with_its_reason(changed: dict[str, Any], reason: str) -> None:
    assert steer.parse(frame(**changed), OWN) == reason


@pytest.mark.parametrize(
    ("mask", "accelerates", "turns"), [(0x800, True, True), (0xC00, True, False), (0x9C0, False, True)]
)
def test_a_velocity_makes_it_a_sample_of_a_stream(mask: int, accelerates: bool, turns: bool) -> None:
    sample = steer.parse(frame(type_mask=mask, vx=0.5, afy=-0.25, time_boot_ms=2**32 - 1), OWN)
    assert isinstance(sample, Sample)
    assert (sample.stamp_ms, *sample[1:7]) == (2**32 - 1, 1.0, 2.0, -3.0, 0.5, 0.0, 0.0)
    assert sample[7:10] == (0.0, -0.25, 0.0) if accelerates else all(map(math.isnan, sample[7:10]))
    assert (sample.accelerates, not math.isnan(sample.yaw_rad)) == (accelerates, turns)


def test_another_message_is_not_for_steering() -> None:
    message = mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 0, 3)
    (other,) = FrameParser().feed(bytes(message.pack(mavlink.MAVLink(None, srcSystem=255, srcComponent=190))))
    assert not steer.addressed_to(other, OWN)
    assert steer.parse(other, OWN) == "not addressed to the companion"


number = st.floats(width=32)


@MANY
@given(
    st.fixed_dictionaries(
        {
            **dict.fromkeys(("x", "y", "z", "vx", "vy", "vz", "afx", "afy", "afz", "yaw", "yaw_rate"), number),
            "type_mask": st.one_of(
                st.integers(0, 0xFFFF),
                st.sampled_from(MASKS),
                st.just(POSITION_AND_YAW),
            ),
            "coordinate_frame": st.one_of(st.just(1), st.integers(0, 255)),
            "target_component": st.one_of(st.just(191), st.integers(0, 255)),
        }
    )
)
def test_whatever_comes_is_a_finite_command_or_a_short_refusal(values: dict[str, Any]) -> None:
    outcome = steer.parse(frame(**values), OWN)
    if isinstance(outcome, str):
        assert 0 < len(outcome) <= 32
        return
    assert math.isnan(outcome.yaw_rad) == bool(values["type_mask"] & 0x400)
    if isinstance(outcome, Sample):
        assert all(map(math.isfinite, outcome[: 10 if outcome.accelerates else 7]))
    else:
        assert all(map(math.isfinite, outcome[:3]))
    assert not abs(outcome.yaw_rad) > math.pi
    refusal = steer.outside(outcome, FenceSection(enabled=True, radius_m=20.0), HERE)
    assert (refusal is None) == (math.hypot(outcome.x_m - 10.0, outcome.y_m + 5.0) <= 20.0)
    assert refusal is None or len(refusal) <= 32


# --- the fence ------------------------------------------------------------------------------------------------------

RADIUS = FenceSection(enabled=True, radius_m=4.0)
BOX = FenceSection(enabled=True, lower_ned_m=(-2.0, -3.0, -6.0), upper_ned_m=(5.0, 3.0, 1.0))


def moved(north: float = 0.0, east: float = 0.0, down: float = 0.0) -> PositionSetpoint:
    return PositionSetpoint(HERE.x_m + north, HERE.y_m + east, HERE.z_m + down, math.nan)


@pytest.mark.parametrize(
    ("fence", "command", "reason"),
    [
        (RADIUS, moved(), None),
        (RADIUS, moved(4.0), None),
        (RADIUS, moved(2.8, -2.8, -50.0), None),
        (RADIUS, moved(3.0, 3.0), "4.24 m away, fence 4 m"),
        (BOX, moved(5.0, 3.0, 1.0), None),
        (BOX, moved(-2.0, -3.0, -6.0), None),
        (BOX, moved(5.1), "5.1 m north, fence 5 m"),
        (BOX, moved(-2.5), "-2.5 m north, fence -2 m"),
        (BOX, moved(east=-3.5), "-3.5 m east, fence -3 m"),
        (BOX, moved(down=1.5), "1.5 m down, fence 1 m"),
        (BOX, moved(down=-7.0), "-7 m down, fence -6 m"),
        (FenceSection(radius_m=1.0), moved(99.0), None),
        (FenceSection(enabled=True, upper_ned_m=(5.0, 5.0, 5.0)), moved(-1e30, -1e30, -1e30), None),
        (RADIUS, moved(1e30), "1e+30 m away, fence 4 m"),
        (RADIUS, PositionSetpoint(math.nan, 0.0, 0.0, 0.0), "nan m away, fence 4 m"),
    ],
)
def test_the_fence_stands_around_where_control_began(
    fence: FenceSection, command: PositionSetpoint, reason: str | None
) -> None:
    assert steer.outside(command, fence, HERE) == reason


def test_a_client_that_repeats_itself_is_answered_once_a_second() -> None:
    refusals = steer.Refusals()
    told = [n for n in range(200) if refusals.tell(100.0 + 0.02 * n)]
    assert told == [0, 50, 100, 150]
    assert refusals.count == 200


@pytest.mark.parametrize(
    ("overrides", "reason"),
    [
        (("steering.enabled=true",), "give system_ids"),
        (("steering.enabled=true", "steering.system_ids=[255]"), r"needs guards\.fence\.enabled"),
        (("steering.enabled=true", "steering.system_ids=[256]"), r"system_ids\.0"),
        (("service.realtime_priority=100",), r"realtime_priority.* 99 \(it is 100\)"),
        (("service.realtime_priority=true",), "a number is wanted"),
    ],
)
def test_a_config_that_would_let_anybody_steer_anywhere_is_refused(overrides: tuple[str, ...], reason: str) -> None:
    with pytest.raises(ConfigError, match=reason) as caught:
        load_config(Path(__file__).resolve().parents[3] / "config" / "antx_rig.yaml", overrides)
    assert len(str(caught.value).splitlines()) == 1
