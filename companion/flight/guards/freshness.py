"""How old pose and heartbeat are: the two guards that see what does not come."""

from __future__ import annotations

import math

from companion.config.guards.rows import Reason
from companion.flight.guards import table
from companion.flight.guards.table import Limits


class Freshness:
    """When pose and heartbeat were last heard.

    Attributes: `until_s`, before which neither can be stale, as last looked at: what is heard later only puts it off;
    `pose_at_s`, when the pose was heard; `poses` so far that were not the one before.
    """

    def __init__(self, limits: Limits, now_s: float) -> None:
        self._limits = limits
        self.pose_at_s = self._heartbeat_at_s = now_s
        self.until_s = -math.inf
        self.poses = 0

    def on_pose(self, now_s: float) -> None:
        """A pose that is not the one before it."""
        self.pose_at_s = now_s
        self.poses += 1

    def on_heartbeat(self, now_s: float) -> None:
        """A heartbeat of the vehicle."""
        self._heartbeat_at_s = now_s

    def pose_stale(self, now_s: float) -> bool:
        """Whether no new pose has been heard for too long."""
        return now_s - self.pose_at_s > self._limits[Reason.POSE_STALE]

    def stale(self, now_s: float, *, grounded: bool = False) -> Reason | None:
        """What has not been heard for too long, or None. `grounded`: without the pose, which nobody flies by then."""
        pose_at_s, heartbeat_at_s, limits = self.pose_at_s, self._heartbeat_at_s, self._limits
        reason = table.stale(limits, 0.0 if grounded else now_s - pose_at_s, now_s - heartbeat_at_s)
        fresh_until_s = min(pose_at_s + limits[Reason.POSE_STALE], heartbeat_at_s + limits[Reason.HEARTBEAT_LOST])
        self.until_s = fresh_until_s if reason is None else -math.inf
        return reason
