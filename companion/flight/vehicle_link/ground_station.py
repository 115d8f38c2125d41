"""What a ground station is told of the controller: a few named numbers, twice a second each.

NAMED_VALUE_FLOAT and not DEBUG_FLOAT_ARRAY: a value carries its name, so that QGroundControl's MAVLink inspector (5.0;
before, it mixed the names and could not chart arrays at all), MAVProxy and PX4's own log (`debug_key_value`) show it
without a table of indices. PX4 passes both on to its other links where MAV_n_FORWARD is set.

Source: https://mavlink.io/en/messages/common.html#NAMED_VALUE_FLOAT and #MAV_STATE.
"""

from __future__ import annotations

import math
from typing import Any, Final

from pymavlink.dialects.v20 import development as mavlink

from companion.flight.authority.states import TAKEN, Reason, State
from companion.record import schema

_PER_CALL: Final = 2  # of ten values at 10 Hz: each twice a second
_ORDINARY: Final = TAKEN | {Reason.OPERATOR, Reason.MISSION_COMPLETE}
_STATUS: Final = {
    State.CONNECTING: mavlink.MAV_STATE_BOOT,
    State.CHECKING: mavlink.MAV_STATE_CALIBRATING,
    State.STANDBY: mavlink.MAV_STATE_STANDBY,
    State.ENGAGED: mavlink.MAV_STATE_ACTIVE,
}


def system_status(state: State, reason: Reason | None = None) -> int:
    """MAV_STATE of the companion's heartbeat; `reason` why it is released."""
    released = mavlink.MAV_STATE_POWEROFF if reason in _ORDINARY else mavlink.MAV_STATE_CRITICAL
    return int(_STATUS.get(state, released))


def _places() -> dict[str, int]:
    """Where the first value of each field stands in an unpacked tick."""
    places, at = {}, 1  # after the CDR header
    for field in schema.FLOATS:
        places[field.name] = at
        at += field.size
    return places


_PLACES: Final = _places()


class GroundStation:
    """Turns the tick last flown into messages, a few at a call, in turn.

    `one_axis`: a rig, which has no y.
    """

    def __init__(self, *, one_axis: bool) -> None:
        self._axes = 1 if one_axis else 2
        self._names = tuple(self._values((0.0,) * (1 + sum(field.size for field in schema.FLOATS))))
        self._turn = 0

    def messages(self, tick: bytes) -> list[Any]:
        """The next NAMED_VALUE_FLOATs of a tick, as `companion.record.schema` packs it; none of one out of control."""
        flown = schema.PACKER.unpack(tick)
        values = self._values(flown)
        if math.isnan(values["err_ideal"]):
            return []
        time_ms = round(flown[_PLACES["time_s"]] * 1e3) & 0xFFFFFFFF
        names = [self._names[(self._turn + n) % len(self._names)] for n in range(_PER_CALL)]
        self._turn = (self._turn + _PER_CALL) % len(self._names)
        return [mavlink.MAVLink_named_value_float_message(time_ms, name.encode(), values[name]) for name in names]

    def _values(self, tick: tuple[Any, ...]) -> dict[str, float]:
        """By name, at most ten characters each: metres, 1/m, s/m, thousandths of g, milliseconds."""

        def pair(name: str) -> tuple[float, ...]:
            at = _PLACES[name]
            return tick[at : at + self._axes]

        position = pair("position_m")
        values = {
            "err_track": math.dist(position, pair("reference_position_m")),
            "err_ideal": math.dist(position, pair("ideal_position_m")),
        }
        for axis, number in zip("xy", range(self._axes), strict=False):
            values[f"w_pos_{axis}"] = pair("position_weight")[number]
            values[f"w_vel_{axis}"] = pair("velocity_weight")[number]
            values[f"hedge_{axis}"] = 1e3 * pair("hedge_deficit")[number]
        values["latency_ms"] = 1e3 * tick[_PLACES["latency_s"]]
        return values
