"""What a PX4 was doing over time, from what it said on the link: when a hovering multicopter was in OFFBOARD.

Source: https://mavlink.io/en/messages/common.html (HEARTBEAT, CURRENT_MODE, EXTENDED_SYS_STATE, MAV_TYPE)
"""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import Final

from pymavlink.dialects.v20 import development as mavlink

from companion.identify.reading.tlog_file import Messages
from companion.identify.series import Floats, LogError, intersect, spans
from companion.mavlink.px4 import Mode

_MULTICOPTERS: Final = (2, 3, 4, 13, 14, 15, 29, 35, 43)  # MAV_TYPE
_VTOLS: Final = tuple(range(19, 26))


def followed(path: Path, vehicle: int, said: dict[str, tuple[Floats, Messages]], end_s: float) -> Floats:
    """When the vehicle said that it was a PX4 multicopter, armed and in OFFBOARD. Raises `LogError` for another."""
    beat_s, beats = said["HEARTBEAT"]
    if not len(beat_s):
        raise LogError(f"{path}: no HEARTBEAT of vehicle {vehicle} in it: whether it flew cannot be told: record it")
    autopilot = Counter(beats.rows["autopilot"].tolist()).most_common(1)[0][0]
    if autopilot != mavlink.MAV_AUTOPILOT_PX4:
        named = mavlink.enums["MAV_AUTOPILOT"].get(autopilot)
        raise LogError(
            f"{path}: not a PX4: HEARTBEAT.autopilot is {autopilot if named is None else named.name}: only PX4's modes "
            "are known here"
        )
    armed = spans(beat_s, (beats.rows["base_mode"] & mavlink.MAV_MODE_FLAG_SAFETY_ARMED).astype(bool), end_s)
    mode_s, modes = said["CURRENT_MODE"] if len(said["CURRENT_MODE"][0]) else said["HEARTBEAT"]
    following = intersect(armed, spans(mode_s, modes.rows["custom_mode"] == Mode.OFFBOARD, end_s))
    kind = Counter(beats.rows["type"].tolist()).most_common(1)[0][0]
    if not len(following) or kind in _MULTICOPTERS:
        return following
    name = mavlink.enums["MAV_TYPE"][kind].name if kind in mavlink.enums["MAV_TYPE"] else str(kind)
    if kind not in _VTOLS:
        raise LogError(f"{path}: HEARTBEAT.type is {name}: the response of a hovering multicopter is wanted")
    state_s, states = said["EXTENDED_SYS_STATE"]
    hovering = spans(state_s, states.rows["vtol_state"] == mavlink.MAV_VTOL_STATE_MC, end_s)
    following = intersect(following, hovering)
    if not len(following):
        raise LogError(
            f"{path}: HEARTBEAT.type is {name} and EXTENDED_SYS_STATE.vtol_state never says that it flew as a "
            "multicopter: the response of a hovering multicopter is wanted"
        )
    return following
