"""What ODOMETRY tells of itself beside the pose: variances that are none, and a quality that says it has failed."""

import math
from typing import Any

import pytest
from pymavlink.dialects.v20 import development as mavlink

from companion.flight.vehicle_link.odometry import PoseSource
from companion.mavlink.codec import Frame


def told(variance: float = 0.02, **changed: Any) -> PoseSource:
    """A source that has taken one ODOMETRY."""
    covariance = [math.nan] * 21
    covariance[0] = covariance[6] = covariance[11] = variance
    fields = {
        "time_usec": 1_000_000, "frame_id": 1, "child_frame_id": 1, "x": 1.0, "y": 2.0, "z": -3.0,
        "q": [1.0, 0.0, 0.0, 0.0], "vx": 0.0, "vy": 0.0, "vz": 0.0, "rollspeed": 0.0, "pitchspeed": 0.0,
        "yawspeed": 0.0, "pose_covariance": covariance, "velocity_covariance": [math.nan] * 21,
    }  # fmt: skip
    raw = bytes(mavlink.MAVLink_odometry_message(**fields, **changed).pack(mavlink.MAVLink(None, 1, 1)))
    source = PoseSource()
    assert source.on_frame(Frame(331, 1, 1, 0, raw[10:-2], raw)) is not None
    return source


@pytest.mark.parametrize(("variance", "known"), [(0.02, True), (0.0, False), (-1.0, False), (math.nan, False)])
def test_a_variance_of_zero_or_less_is_not_told(variance: float, known: bool) -> None:
    assert [not math.isnan(value) for value in told(variance).variance_ned_m2] == [known] * 3


@pytest.mark.parametrize(("quality", "failed"), [(-1, True), (0, False), (1, False), (100, False)])
def test_a_negative_quality_has_failed_and_zero_is_unknown(quality: int, failed: bool) -> None:
    """As the page of ODOMETRY has it: https://mavlink.io/en/messages/common.html#ODOMETRY"""
    assert told(quality=quality).failed is failed


def test_without_odometry_nothing_has_failed_and_nothing_is_told() -> None:
    source = PoseSource()
    assert not source.failed
    assert all(map(math.isnan, source.variance_ned_m2))
