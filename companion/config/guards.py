"""The `guards` section: every failsafe as enabled / limit / timeout, units in the names."""

from __future__ import annotations

from companion.config.base import Positive, Section


class GuardSection(Section):
    """One failsafe: on or off, and the limit past which control ends."""

    enabled: bool = True
    limit: Positive


class Guards(Section):
    """Every failsafe, with the unit of its limit in its name."""

    pose_age_s: GuardSection = GuardSection(limit=0.25)
    heartbeat_age_s: GuardSection = GuardSection(limit=3.0)
