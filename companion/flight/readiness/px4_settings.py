"""What a vehicle's settings mean for a flight in OFFBOARD: fine, other than certified, or dangerous; and what to do.

Names, values and meanings are those of PX4 v1.17 and v1.18 (`commander_params.c` and `.yaml`, `failsafe.cpp`,
`manual_control_params.yaml`, `mc_att_control_params.c` and `.yaml`, `mc_rate_control_params.c`, `mavlink/module.yaml`).
What is judged is what the version heard has.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from enum import StrEnum
from typing import Final, NamedTuple

from companion.certify import link_loss
from companion.config import Config
from companion.config.numbers import shortest
from companion.flight.readiness.parameters import response_parameters, same, same_version
from companion.flight.readiness.pinned import HOVER_PLAUSIBLE

Found = Mapping[str, float]
Version = tuple[int, int, int]


class Verdict(StrEnum):
    """What a setting is to a flight."""

    FINE = "fine"
    DIFFERS = "differs"  # from what was certified, or from what the companion counts on
    DANGEROUS = "dangerous"


class Setting(NamedTuple):
    """One row: what it is, what it means here, and what to do about it."""

    name: str
    value: str
    verdict: Verdict
    advice: str


_KNOWN: Final = ((1, 17), (1, 18))  # versions whose settings are judged here
_OVERRIDE_BY_SPEED: Final = (1, 18)  # from here on MAN_OVERRIDE_SPD, before it COM_RC_OVERRIDE
_OFFBOARD_LOSS: Final = ("Position", "Altitude", "Stabilized", "Return", "Land", "Hold", "Terminate", "Disarm")
_BY_STICKS: Final = _OFFBOARD_LOSS[:3]
_LINK_LOSS: Final = {0: "Disabled", 1: "Hold", 2: "Return", 3: "Land", 5: "Terminate", 6: "Disarm"}
_HOLD_NO_FAILSAFE: Final = 7  # of NAV_RCL_ACT, from v1.18
_OFFBOARD_BIT: Final = {"COM_RCL_EXCEPT": 4, "COM_RC_OVERRIDE": 2}
_ODOMETRY_BYTES: Final = 244
_BESIDE_BYTES_S: Final = 4000  # heartbeat, mode, status, answers
_LONGEST_LOSS_S: Final = 1.0
LANDED_ABOVE_IDLE: Final = 0.01  # over MPC_MANTHR_MIN; `land_detector/MulticopterLandDetector.cpp`
_DANGEROUS_LOSS_S: Final = 2.0


def wanted(version: Version) -> tuple[str, ...]:
    """The parameters that matter and that PX4 of this version has."""
    return (
        "MPC_THR_HOVER",
        *response_parameters(version),
        "COM_OF_LOSS_T",
        "MPC_MANTHR_MIN",
        "COM_OBL_RC_ACT",
        "COM_RC_IN_MODE",
        "NAV_RCL_ACT",
        "COM_RCL_EXCEPT",
        "MAN_OVERRIDE_SPD" if version[:2] >= _OVERRIDE_BY_SPEED else "COM_RC_OVERRIDE",
        "NAV_DLL_ACT",
    )


def judge(
    config: Config,
    version: Version,
    firmware: str,
    health: Mapping[str, bool],
    found: Found,
    odometry_hz: float | None,
) -> list[Setting]:
    """A row for everything the vehicle tells of itself; `odometry_hz` is None where it could not be counted."""
    rows = [judge_firmware(config, version, firmware), judge_health(health)]
    if odometry_hz is not None:
        rows.append(judge_odometry(config, odometry_hz))
    return rows + judge_parameters(config, version, found)


def judge_parameters(config: Config, version: Version, found: Found) -> list[Setting]:
    """A row for each parameter that matters, and for each that `vehicle.parameters` states."""
    rows = []
    for name in dict.fromkeys((*wanted(version), *config.vehicle.parameters)):
        value = found.get(name)
        stated = config.vehicle.parameters.get(name)
        if value is None:
            advice = f"the vehicle does not tell it: is this PX4 {version[0]}.{version[1]}?"
            rows.append(Setting(name, "-", Verdict.DIFFERS, advice))
        elif stated is not None and not same(stated, value):
            rows.append(
                Setting(
                    name,
                    shortest(value),
                    Verdict.DIFFERS,
                    f"it was {shortest(stated)} when the response was identified: the certificate is stale; "
                    f"set it back, or identify and check again",
                )
            )
        elif name in _RULES:
            rows.append(Setting(name, *_RULES[name](config, value, found)))
        elif stated is None:
            rows.append(Setting(name, shortest(value), Verdict.FINE, "not compared"))
        else:
            rows.append(Setting(name, shortest(value), Verdict.FINE, "as identified"))
    return rows + [_rate(config, name, value) for name, value in found.items() if name.endswith("_RATE")]


def unstated(config: Config, version: Version, found: Found) -> dict[str, float]:
    """What the response is made of and `vehicle.parameters` does not state, as it is."""
    names = [name for name in response_parameters(version) if name in found]
    return {name: found[name] for name in names if name not in config.vehicle.parameters}


def judge_firmware(config: Config, version: Version, text: str) -> Setting:
    """PX4's version."""
    stated = config.vehicle.px4_version
    if stated is not None and not same_version(stated, version):
        advice = f"it was {stated} when the response was identified: the certificate is stale; identify and check again"
        return Setting("firmware", text, Verdict.DIFFERS, advice)
    if version[:2] in _KNOWN:
        return Setting("firmware", text, Verdict.FINE, "" if stated is None else "as identified")
    known = " or ".join("{}.{}".format(*known) for known in _KNOWN)
    return Setting("firmware", text, Verdict.DIFFERS, f"not PX4 {known}: try modes and failsafes in simulation first")


def judge_health(health: Mapping[str, bool]) -> Setting:
    """What the vehicle says of itself. Only a local position is what we cannot fly without."""
    missing = [name for name, good in health.items() if not good]
    needed = [name for name in missing if name not in ("global position", "home")]
    text = "good" if not missing else f"no {', '.join(missing)}"
    if "local position" in missing:
        return Setting(
            "health", text, Verdict.DANGEROUS, "no estimate to fly by: look at GPS, vision or motion capture"
        )
    if needed:
        return Setting("health", text, Verdict.DIFFERS, "PX4 will not arm: its messages on a ground station say why")
    return Setting("health", text, Verdict.FINE, "a local position is enough" if missing else "")


def judge_odometry(config: Config, rate_hz: float) -> Setting:
    """The rate at which ODOMETRY comes unasked: how fast it can come, only `companion run` finds out by asking."""
    text = f"{rate_hz:.0f} Hz"
    return Setting(
        "ODOMETRY", text, Verdict.FINE, f"`companion run` asks for {config.tick.rate_hz:g} Hz and measures it"
    )


def worst(rows: list[Setting]) -> Verdict:
    """Of all."""
    order = list(Verdict)
    return max((row.verdict for row in rows), key=order.index, default=Verdict.FINE)


# -- one rule a parameter: its value as text, the verdict, what to do --------------------------------------------------

_Judged = tuple[str, Verdict, str]
_Rule = Callable[[Config, float, Found], _Judged]


def _hover(config: Config, value: float, _: Found) -> _Judged:
    ours = config.vehicle.hover_thrust
    off = value / ours - 1.0
    if abs(off) <= 0.05:
        return f"{value:g}", Verdict.FINE, f"vehicle.hover_thrust is {ours:g}"
    verdict = Verdict.DIFFERS if abs(off) <= HOVER_PLAUSIBLE else Verdict.DANGEROUS
    advice = (
        f"vehicle.hover_thrust is {ours:g}, {abs(off):.0%} away: one of them climbs or sinks; correct the wrong one"
    )
    return f"{value:g}", verdict, advice


def _loss_time(config: Config, value: float, _: Found) -> _Judged:
    text = f"{value:g} s"
    proposed_s = link_loss.proposed_s(config)
    bound = f"a dead companion: up to {link_loss.worst(config, value)}"
    if value > _LONGEST_LOSS_S:
        verdict = Verdict.DANGEROUS if value > _DANGEROUS_LOSS_S else Verdict.DIFFERS
        return text, verdict, f"{bound}; set it to {proposed_s:g}: {link_loss.worst(config, proposed_s)}"
    age_s = config.guards.pose_age_s.limit
    if value <= age_s:
        advice = f"PX4 acts before the companion has handed over: set it above guards.pose_age_s ({age_s:g} s)"
        return text, Verdict.DIFFERS, advice
    if value > proposed_s:
        bound += f"; {proposed_s:g} s would do: {link_loss.worst(config, proposed_s)}"
    return text, Verdict.FINE, bound


def _loss_action(_: Config, value: float, __: Found) -> _Judged:
    action = _loss_name(value)
    text = f"{value:g} {action}"
    if action in ("Terminate", "Disarm"):
        return text, Verdict.DANGEROUS, "when the companion dies the vehicle falls: set it to 5 (Hold) or 4 (Land)"
    if action in ("Stabilized", "Altitude"):
        advice = "when the companion dies somebody must fly by hand at once: set it to 5 (Hold) or 4 (Land)"
        return text, Verdict.DIFFERS, advice
    return text, Verdict.FINE, "with sticks; without them NAV_RCL_ACT" if action == "Position" else ""


def _loss_name(value: float) -> str:
    """COM_OBL_RC_ACT."""
    return _OFFBOARD_LOSS[int(value)] if 0 <= value < len(_OFFBOARD_LOSS) else "Position"


def _least_thrust(config: Config, value: float, _: Found) -> _Judged:
    """In OFFBOARD by attitude PX4 finds the ground by a thrust at or below this and 0.01."""
    ours, found_below = config.controller.limits.thrust_min, value + LANDED_ABOVE_IDLE
    if not config.vehicle_kind.can_fly or ours <= found_below:
        return f"{value:g}", Verdict.FINE, ""
    advice = (
        f"controller.limits.thrust_min is {ours:g}: at more than {found_below:g} PX4 finds no landing in OFFBOARD; "
        f"set ours to {value:g}"
    )
    return f"{value:g}", Verdict.DIFFERS, advice


def _manual_control(_: Config, value: float, __: Found) -> _Judged:
    if value == 4:
        advice = "no sticks: nobody takes over by hand; have a ground station ready to change the mode"
        return "4 none", Verdict.DIFFERS, advice
    return f"{value:g}", Verdict.FINE, ""


def _ground_station_loss(_: Config, value: float, __: Found) -> _Judged:
    action = _LINK_LOSS.get(int(value), "unknown")
    if action in ("Terminate", "Disarm", "unknown"):
        advice = "without a ground station the vehicle falls: set it to 2 (Return) or 3 (Land)"
        return f"{value:g} {action}", Verdict.DANGEROUS, advice
    return f"{value:g} {action}", Verdict.FINE, ""


def _stick_loss(_: Config, value: float, found: Found) -> _Judged:
    """0 and what a version does not know mean that nothing happens, as 7 does from v1.18 on in OFFBOARD."""
    action = _LINK_LOSS.get(int(value), "unknown")
    text = f"{value:g} {action}"
    if action in ("Terminate", "Disarm"):
        return text, Verdict.DANGEROUS, "without sticks the vehicle falls: set it to 2 (Return) or 3 (Land)"
    if value == _HOLD_NO_FAILSAFE and "MAN_OVERRIDE_SPD" in found:
        text = "7 Hold, no failsafe"
        if _loss_name(found.get("COM_OBL_RC_ACT", 0.0)) in _BY_STICKS:
            advice = "and without sticks COM_OBL_RC_ACT does nothing when the companion dies: set that to 5 (Hold)"
            return text, Verdict.DANGEROUS, advice
        return text, Verdict.DIFFERS, "in OFFBOARD lost sticks change nothing: nobody can take over by hand"
    if action in ("Disabled", "unknown"):
        return text, Verdict.DANGEROUS, "without sticks nothing happens: set it to 2 (Return) or 3 (Land)"
    return text, Verdict.FINE, ""


def _loss_exceptions(_: Config, value: float, __: Found) -> _Judged:
    bit = _OFFBOARD_BIT["COM_RCL_EXCEPT"]
    if int(value) & bit:
        advice = f"in OFFBOARD lost sticks are ignored, and nobody can take over: set it to {int(value) & ~bit}"
        return f"{value:g}", Verdict.DANGEROUS, advice
    return f"{value:g}", Verdict.FINE, ""


def _override(_: Config, value: float, __: Found) -> _Judged:
    bit = _OFFBOARD_BIT["COM_RC_OVERRIDE"]
    if int(value) & bit:
        return f"{value:g}", Verdict.FINE, "the sticks end OFFBOARD"
    advice = f"the sticks do not end OFFBOARD, only the mode switch does: set it to {int(value) | bit}"
    return f"{value:g}", Verdict.DIFFERS, advice


def _override_speed(_: Config, value: float, __: Found) -> _Judged:
    if value >= 0.0:
        return f"{value:g} /s", Verdict.FINE, "sticks that move faster end OFFBOARD"
    advice = "the sticks do not end OFFBOARD, only the mode switch does: set it to 1"
    return f"{value:g}", Verdict.DIFFERS, advice


def _rate(config: Config, name: str, value: float) -> Setting:
    needed = round(config.tick.rate_hz * _ODOMETRY_BYTES) + _BESIDE_BYTES_S
    if value == 0:
        return Setting(name, "0 B/s", Verdict.FINE, "half of what the line carries")
    if value >= needed:
        return Setting(name, f"{value:g} B/s", Verdict.FINE, "")
    advice = f"PX4 slows every stream down: {config.tick.rate_hz:g} Hz of ODOMETRY need {needed}; 0 is half the line"
    return Setting(name, f"{value:g} B/s", Verdict.DIFFERS, advice)


_RULES: Final[Mapping[str, _Rule]] = {
    "MPC_THR_HOVER": _hover,
    "COM_OF_LOSS_T": _loss_time,
    "MPC_MANTHR_MIN": _least_thrust,
    "COM_OBL_RC_ACT": _loss_action,
    "COM_RC_IN_MODE": _manual_control,
    "NAV_RCL_ACT": _stick_loss,
    "COM_RCL_EXCEPT": _loss_exceptions,
    "COM_RC_OVERRIDE": _override,
    "MAN_OVERRIDE_SPD": _override_speed,
    "NAV_DLL_ACT": _ground_station_loss,
}
