"""PX4's parameters, as far as they matter to a companion computer.

Names, types and defaults are those of PX4 v1.17 and v1.18 (`*_params.c`, `*params.yaml`, `module.yaml`), asked of both
in SITL. On the wire an int32 travels bytewise in the float field
(https://mavlink.io/en/services/parameter.html#parameter-encoding).
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator, Mapping
from enum import IntEnum, StrEnum
from typing import Final, NamedTuple

HASH_NAME: Final = "_HASH_CHECK"


class Px4Version(StrEnum):
    """The firmware that an autopilot is; what differs between them is asked of its parameters' `version`."""

    V1_17 = "1.17"
    V1_18 = "1.18"


class ParamType(IntEnum):
    """MAV_PARAM_TYPE, as far as PX4 uses it."""

    UINT32 = 5
    INT32 = 6
    REAL32 = 9


class WireParameter(NamedTuple):
    """One PARAM_VALUE."""

    name: str
    raw: bytes  # the four bytes of param_value: as a Python float an int32 that looks like a NaN would not survive
    type: ParamType
    place: int  # param_index; -1 for the hash
    total: int  # param_count


class OffboardLossAction(IntEnum):
    """COM_OBL_RC_ACT."""

    POSITION = 0
    ALTITUDE = 1
    STABILIZED = 2
    RETURN = 3
    LAND = 4
    HOLD = 5
    TERMINATE = 6
    DISARM = 7


class ManualLossAction(IntEnum):
    """NAV_RCL_ACT."""

    DISABLED = 0
    HOLD = 1
    RETURN = 2
    LAND = 3
    TERMINATE = 5
    DISARM = 6
    HOLD_NO_FAILSAFE = 7  # from v1.18: an ordinary change to Hold, made for flights in OFFBOARD


_COMMON_DEFAULTS: Final[Mapping[str, int | float]] = {
    "BAT_CRIT_THR": 0.07,
    "BAT_EMERGEN_THR": 0.05,
    "BAT_LOW_THR": 0.15,
    "COM_ARM_WO_GPS": 1,
    "COM_DISARM_LAND": 2.0,
    "COM_DISARM_PRFLT": 10.0,
    "COM_FAIL_ACT_T": 5.0,
    "COM_HOME_EN": 1,
    "COM_OBL_RC_ACT": 0,
    "COM_OF_LOSS_T": 1.0,
    "COM_POS_FS_EPH": 5.0,
    "COM_RCL_EXCEPT": 0,
    "COM_RC_IN_MODE": 3,
    "COM_RC_LOSS_T": 0.5,
    "COM_SPOOLUP_TIME": 1.0,
    "MAV_0_MODE": 0,
    "MAV_0_RATE": 1200,
    "MAV_1_MODE": 2,
    "MAV_1_RATE": 0,
    "MAV_2_MODE": 0,
    "MAV_2_RATE": 0,
    "MAV_COMP_ID": 1,
    "MAV_FWDEXTSP": 1,
    "MAV_PROTO_VER": 2,
    "MAV_SYS_ID": 1,
    "MAV_TYPE": 2,
    "MC_PITCHRATE_D": 0.003,
    "MC_PITCHRATE_FF": 0.0,
    "MC_PITCHRATE_I": 0.2,
    "MC_PITCHRATE_K": 1.0,
    "MC_PITCHRATE_MAX": 220.0,
    "MC_PITCHRATE_P": 0.15,
    "MC_PITCH_P": 4.0,
    "MC_ROLLRATE_D": 0.003,
    "MC_ROLLRATE_FF": 0.0,
    "MC_ROLLRATE_I": 0.2,
    "MC_ROLLRATE_K": 1.0,
    "MC_ROLLRATE_MAX": 220.0,
    "MC_ROLLRATE_P": 0.15,
    "MC_ROLL_P": 4.0,
    "MC_YAWRATE_D": 0.0,
    "MC_YAWRATE_FF": 0.0,
    "MC_YAWRATE_I": 0.1,
    "MC_YAWRATE_K": 1.0,
    "MC_YAWRATE_MAX": 200.0,
    "MC_YAWRATE_P": 0.2,
    "MC_YAW_P": 2.8,
    "MC_YAW_WEIGHT": 0.4,
    "MIS_TAKEOFF_ALT": 2.5,
    "MPC_LAND_ALT1": 10.0,
    "MPC_LAND_ALT2": 5.0,
    "MPC_LAND_SPEED": 0.7,
    "MPC_MANTHR_MIN": 0.08,
    "MPC_THR_HOVER": 0.5,
    "MPC_THR_MAX": 1.0,
    "MPC_THR_MIN": 0.12,
    "MPC_TILTMAX_AIR": 45.0,
    "MPC_TKO_RAMP_T": 3.0,
    "MPC_TKO_SPEED": 1.5,
    "MPC_XY_CRUISE": 5.0,
    "MPC_Z_V_AUTO_DN": 1.5,
    "MPC_Z_V_AUTO_UP": 3.0,
    "NAV_DLL_ACT": 0,
    "NAV_MC_ALT_RAD": 0.8,
    "NAV_RCL_ACT": 2,
    "RTL_DESCEND_ALT": 30.0,
    "RTL_LAND_DELAY": 0.0,
    "RTL_MIN_DIST": 10.0,
    "RTL_RETURN_ALT": 60.0,
    "RTL_TYPE": 0,
    "SYS_AUTOSTART": 4001,
    "SYS_PARAM_VER": 1,
}
PX4_DEFAULTS: Final[Mapping[Px4Version, Mapping[str, int | float]]] = {
    Px4Version.V1_17: {**_COMMON_DEFAULTS, "COM_RC_OVERRIDE": 1, "COM_RC_STICK_OV": 30.0, "COM_TAKEOFF_ACT": 0},
    Px4Version.V1_18: {
        **_COMMON_DEFAULTS,
        "MAN_OVERRIDE_SPD": 1.0,
        "MC_REF_FF": 0.0,
        "MC_REF_FF_MAX": 100.0,
        "MC_REF_W_N": 50.0,
    },
}
"""Defaults; an int is an int32 parameter and a float a float32 one. MPC_THR_HOVER is set to the vehicle's own."""

_F32 = struct.Struct("<f")
_I32 = struct.Struct("<i")
_U32 = struct.Struct("<I")


class Parameters:
    """The parameter store of one autopilot.

    Args: `overrides` by name, laid over the `PX4_DEFAULTS` of `version`. Raises `KeyError` for a name that is not a
    parameter of that version and `TypeError` for a float given to an int32 parameter.
    Attributes: `version`; `changes`, how often one was set.
    """

    def __init__(
        self, overrides: Mapping[str, int | float] | None = None, version: Px4Version = Px4Version.V1_17
    ) -> None:
        self.version = version
        self.changes = 0
        self._values: dict[str, int | float] = {}
        for name, value in PX4_DEFAULTS[version].items():
            self._values[name] = value if isinstance(value, int) else _as_float32(value)
        self._names = sorted(self._values)
        self._index = {name: index for index, name in enumerate(self._names)}
        for name, value in (overrides or {}).items():
            self.set(name, value)

    def __len__(self) -> int:
        return len(self._names)

    def __iter__(self) -> Iterator[str]:
        """Names in the order of their wire index."""
        return iter(self._names)

    def __contains__(self, name: object) -> bool:
        return name in self._values

    def __getitem__(self, name: str) -> int | float:
        return self._values[name]

    def number(self, name: str) -> float:
        """A parameter as a float."""
        return float(self._values[name])

    def integer(self, name: str) -> int:
        """A parameter as an int."""
        return int(self._values[name])

    def set(self, name: str, value: float) -> None:
        """Set one parameter, rounded to the wire's 32 bits. As PX4 does, no range is enforced."""
        self.changes += 1
        if isinstance(self._values[name], int):
            if not isinstance(value, int):
                raise TypeError(f"{name} is an int32 parameter, got {value!r}")
            (self._values[name],) = _I32.unpack(_I32.pack(value))
        else:
            self._values[name] = _as_float32(value)

    def wire(self, name: str) -> WireParameter | None:
        """The PARAM_VALUE of a parameter, `None` for an unknown one: PX4 answers that with silence."""
        if name == HASH_NAME:
            return WireParameter(HASH_NAME, _U32.pack(self.hash()), ParamType.UINT32, -1, len(self))
        stored = self._values.get(name)
        if stored is None:
            return None
        if isinstance(stored, int):
            return WireParameter(name, _I32.pack(stored), ParamType.INT32, self._index[name], len(self))
        return WireParameter(name, _F32.pack(stored), ParamType.REAL32, self._index[name], len(self))

    def wire_at(self, index: int) -> WireParameter | None:
        """The PARAM_VALUE at a wire index, `None` where there is none."""
        return self.wire(self._names[index]) if 0 <= index < len(self._names) else None

    def set_wire(self, name: str, raw_value: bytes, wire_type: int) -> WireParameter | None:
        """Take a PARAM_SET whose value field holds the four bytes `raw_value`.

        Returns the PARAM_VALUE to answer with; `None` where PX4 stays silent: unknown name or wrong type.
        """
        stored = self._values.get(name)
        if stored is None:
            return None
        if isinstance(stored, int):
            if wire_type != ParamType.INT32:
                return None
            (self._values[name],) = _I32.unpack(raw_value)
        else:
            if wire_type != ParamType.REAL32:
                return None
            (self._values[name],) = _F32.unpack(raw_value)
        self.changes += 1
        return self.wire(name)

    def hash(self) -> int:
        """CRC-32 over names and values in order, without the usual inversions: what QGroundControl caches by."""
        state = 0
        for name in self._names:
            stored = self._values[name]
            value = _I32.pack(stored) if isinstance(stored, int) else _F32.pack(stored)
            state = _crc32_part(value, _crc32_part(name.encode(), state))
        return state


def _as_float32(value: float) -> float:
    rounded: float = _F32.unpack(_F32.pack(value))[0]
    return rounded


def _crc32_part(data: bytes, state: int) -> int:
    return zlib.crc32(data, state ^ 0xFFFFFFFF) ^ 0xFFFFFFFF
