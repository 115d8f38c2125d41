"""Odometry from the wire: ODOMETRY, or LOCAL_POSITION_NED with ATTITUDE_QUATERNION where ODOMETRY is absent.

Source: https://mavlink.io/en/messages/common.html; PX4 sends ODOMETRY in local NED, quaternion body to NED.
"""

from __future__ import annotations

import math
from typing import Final

from companion.control.types import Odometry
from companion.mavlink.codec import Frame, Layout

ODOMETRY: Final = Layout("ODOMETRY")
LOCAL_POSITION_NED: Final = Layout("LOCAL_POSITION_NED")
ATTITUDE_QUATERNION: Final = Layout("ATTITUDE_QUATERNION")

_new = tuple.__new__
_unpack_pose = ODOMETRY.only(
    "time_usec", "x", "y", "z", "q", "vx", "vy", "vz", "frame_id", "child_frame_id", "reset_counter",
).unpack_from  # fmt: skip
_unpack_variance = ODOMETRY.only(  # the diagonal of the covariance's upper right triangle
    "pose_covariance[0]", "pose_covariance[6]", "pose_covariance[11]",
).unpack_from  # fmt: skip
_unpack_quality = ODOMETRY.only("quality").unpack_from
_ODOMETRY = ODOMETRY.message_id
_BYTES = ODOMETRY.size
_LOCAL_NED = 1  # MAV_FRAME_LOCAL_NED
_POSITION = tuple(LOCAL_POSITION_NED.index(name) for name in ("x", "y", "z", "vx", "vy", "vz"))
_POSITION_MS = LOCAL_POSITION_NED.index("time_boot_ms")
_ATTITUDE = tuple(ATTITUDE_QUATERNION.index(name) for name in ("q1", "q2", "q3", "q4"))
_ATTITUDE_MS = ATTITUDE_QUATERNION.index("time_boot_ms")
_ATTITUDE_AGE_MS = 50  # an attitude older than this does not belong to a position


class PoseSource:
    """Turns pose frames into odometry. Once ODOMETRY has been heard, the other two are ignored.

    Attributes: `message` in use; `reset_counter` of the last ODOMETRY, which alone has one.
    """

    def __init__(self) -> None:
        self.message = "ODOMETRY"
        self.reset_counter = 0
        self._payload: bytes | None = None  # of the last ODOMETRY
        self._settled = False
        self._attitude: tuple[float, float, float, float] | None = None
        self._attitude_ms = 0

    def on_frame(self, frame: Frame) -> Odometry | None:
        """Odometry, when this frame completes one in local NED."""
        number, _, _, _, payload, _ = frame
        if number == _ODOMETRY:
            if self.message != "ODOMETRY" and self._settled:
                return None  # its rate has not been measured
            if len(payload) < _BYTES:
                payload = ODOMETRY.full(payload)
            time_us, x, y, z, qw, qx, qy, qz, vx, vy, vz, axes, child_axes, resets = _unpack_pose(payload)
            if axes != _LOCAL_NED or child_axes != _LOCAL_NED:
                return None
            self.message = "ODOMETRY"
            self.reset_counter = resets
            self._payload = payload
            return _new(Odometry, (time_us * 1e-6, x, y, z, vx, vy, vz, qw, qx, qy, qz))
        if self.message == "ODOMETRY":
            return None
        if number == ATTITUDE_QUATERNION.message_id:
            v = ATTITUDE_QUATERNION.unpack(payload)
            w, x, y, z = (v[i] for i in _ATTITUDE)
            self._attitude = (w, x, y, z)
            self._attitude_ms = v[_ATTITUDE_MS]
            return None
        if number != LOCAL_POSITION_NED.message_id or self._attitude is None:
            return None
        v = LOCAL_POSITION_NED.unpack(payload)
        if abs(v[_POSITION_MS] - self._attitude_ms) > _ATTITUDE_AGE_MS:
            return None
        x, y, z, vx, vy, vz = (v[i] for i in _POSITION)
        return Odometry(v[_POSITION_MS] * 1e-3, x, y, z, vx, vy, vz, *self._attitude)

    @property
    def message_ids(self) -> tuple[int, ...]:
        """The messages that odometry is made of, as things are."""
        return (
            (_ODOMETRY,)
            if self.message == "ODOMETRY"
            else (ATTITUDE_QUATERNION.message_id, LOCAL_POSITION_NED.message_id)
        )

    @property
    def variance_ned_m2(self) -> tuple[float, float, float]:
        """Of the last ODOMETRY, which alone tells it. Asked for seldom, so it is decoded then.

        Zero is what a sender leaves that does not know it, and a negative one is none: not told, like NaN.
        """
        if self._payload is None or self.message != "ODOMETRY":
            return (math.nan, math.nan, math.nan)
        x, y, z = _unpack_variance(self._payload)
        return (x if x > 0.0 else math.nan, y if y > 0.0 else math.nan, z if z > 0.0 else math.nan)

    @property
    def failed(self) -> bool:
        """Whether the last ODOMETRY says that it is worth nothing: `quality` is negative. Zero is unknown."""
        if self._payload is None or self.message != "ODOMETRY":
            return False
        (quality,) = _unpack_quality(self._payload)
        return bool(quality < 0)

    def settle(self) -> None:
        """Keep to the source in use from now on."""
        self._settled = True

    def fall_back(self) -> None:
        """Accept LOCAL_POSITION_NED with ATTITUDE_QUATERNION from now on, unless ODOMETRY comes after all."""
        self.message = "LOCAL_POSITION_NED"
