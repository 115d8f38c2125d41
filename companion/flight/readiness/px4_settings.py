"""What a vehicle's settings mean for a flight in OFFBOARD: fine, other than certified, or dangerous; and what to do.

Names, values and meanings are those of PX4 v1.17 (`commander_params.c`, `failsafe.cpp`, `mc_att_control_params.c`,
`mc_rate_control_params.c`, `mavlink/module.yaml`).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from enum import StrEnum
from typing import Final, NamedTuple

from companion.config import Config
from companion.flight.readiness.parameters import same

Found = Mapping[str, float]


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


_LOOP: Final = ("ROLL", "PITCH")
GAINS: Final = (
    *(f"MC_{axis}_P" for axis in (*_LOOP, "YAW")),
    *(f"MC_{axis}RATE_{term}" for axis in _LOOP for term in "PIDK"),
)
KINDS: Final[Mapping[str, type]] = {
    "MPC_THR_HOVER": float,
    **dict.fromkeys(GAINS, float),
    "COM_OF_LOSS_T": float,
    "COM_OBL_RC_ACT": int,
    "COM_RC_IN_MODE": int,
    "NAV_RCL_ACT": int,
    "COM_RCL_EXCEPT": int,
    "COM_RC_OVERRIDE": int,
    "NAV_DLL_ACT": int,
}

_FIRMWARE: Final = (1, 17)
_OFFBOARD_LOSS: Final = ("Position", "Altitude", "Stabilized", "Return", "Land", "Hold", "Terminate", "Disarm")
_LINK_LOSS: Final = {0: "Disabled", 1: "Hold", 2: "Return", 3: "Land", 5: "Terminate", 6: "Disarm"}
_OFFBOARD_BIT: Final = {"COM_RCL_EXCEPT": 4, "COM_RC_OVERRIDE": 2}
_ODOMETRY_BYTES: Final = 244
_BESIDE_BYTES_S: Final = 4000  # heartbeat, mode, status, answers
_LONGEST_LOSS_S: Final = 1.0
_DANGEROUS_LOSS_S: Final = 2.0


def judge(
    config: Config,
    version: tuple[int, int, int],
    firmware: str,
    health: Mapping[str, bool],
    found: Found,
    odometry_hz: float | None,
) -> list[Setting]:
    """A row for everything the vehicle tells of itself; `odometry_hz` is None where it could not be counted."""
    rows = [judge_firmware(version, firmware), judge_health(health)]
    if odometry_hz is not None:
        rows.append(judge_odometry(config, odometry_hz))
    return rows + judge_parameters(config, found)


def judge_parameters(config: Config, found: Found) -> list[Setting]:
    """A row for each parameter that matters, and for each that `vehicle.parameters` states."""
    rows = []
    for name in dict.fromkeys((*KINDS, *config.vehicle.parameters)):
        value = found.get(name)
        stated = config.vehicle.parameters.get(name)
        if value is None:
            rows.append(Setting(name, "-", Verdict.DIFFERS, "the vehicle does not tell it: is this PX4 v1.17?"))
        elif stated is not None and not same(stated, value):
            rows.append(
                Setting(
                    name,
                    f"{value:g}",
                    Verdict.DIFFERS,
                    f"it was {stated:g} when the response was identified: the certificate is stale; "
                    f"set it back, or identify and check again",
                )
            )
        elif name in _RULES:
            rows.append(Setting(name, *_RULES[name](config, value)))
        elif stated is None:
            rows.append(Setting(name, f"{value:g}", Verdict.FINE, "not compared"))
        else:
            rows.append(Setting(name, f"{value:g}", Verdict.FINE, "as identified"))
    return rows + [_rate(config, name, value) for name, value in found.items() if name.endswith("_RATE")]


def unstated(config: Config, found: Found) -> dict[str, float]:
    """The gains that `vehicle.parameters` does not state, as they are: changed later, they would go unnoticed."""
    return {name: found[name] for name in GAINS if name in found and name not in config.vehicle.parameters}


def judge_firmware(version: tuple[int, int, int], text: str) -> Setting:
    """PX4's version."""
    if version[:2] == _FIRMWARE:
        return Setting("firmware", text, Verdict.FINE, "")
    return Setting("firmware", text, Verdict.DIFFERS, "not PX4 1.17: try modes and failsafes in simulation first")


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


def _hover(config: Config, value: float) -> _Judged:
    ours = config.vehicle.hover_thrust
    off = value / ours - 1.0
    if abs(off) <= 0.05:
        return f"{value:g}", Verdict.FINE, f"vehicle.hover_thrust is {ours:g}"
    verdict = Verdict.DIFFERS if abs(off) <= 0.2 else Verdict.DANGEROUS
    advice = (
        f"vehicle.hover_thrust is {ours:g}, {abs(off):.0%} away: one of them climbs or sinks; correct the wrong one"
    )
    return f"{value:g}", verdict, advice


def _loss_time(config: Config, value: float) -> _Judged:
    text = f"{value:g} s"
    if value > _LONGEST_LOSS_S:
        verdict = Verdict.DANGEROUS if value > _DANGEROUS_LOSS_S else Verdict.DIFFERS
        return text, verdict, "so long PX4 holds the last tilt when the companion dies: set it to 1 or less"
    age_s = config.guards.pose_age_s.limit
    if value <= age_s:
        advice = f"PX4 acts before the companion has handed over: set it above guards.pose_age_s ({age_s:g} s)"
        return text, Verdict.DIFFERS, advice
    return text, Verdict.FINE, ""


def _loss_action(_: Config, value: float) -> _Judged:
    action = _OFFBOARD_LOSS[int(value)] if 0 <= value < len(_OFFBOARD_LOSS) else "Position"
    text = f"{value:g} {action}"
    if action in ("Terminate", "Disarm"):
        return text, Verdict.DANGEROUS, "when the companion dies the vehicle falls: set it to 5 (Hold) or 4 (Land)"
    if action in ("Stabilized", "Altitude"):
        advice = "when the companion dies somebody must fly by hand at once: set it to 5 (Hold) or 4 (Land)"
        return text, Verdict.DIFFERS, advice
    return text, Verdict.FINE, "with sticks; without them NAV_RCL_ACT" if action == "Position" else ""


def _manual_control(_: Config, value: float) -> _Judged:
    if value == 4:
        advice = "no sticks: nobody takes over by hand; have a ground station ready to change the mode"
        return "4 none", Verdict.DIFFERS, advice
    return f"{value:g}", Verdict.FINE, ""


def _link_loss(who: str) -> Callable[[Config, float], _Judged]:
    def rule(_: Config, value: float) -> _Judged:
        action = _LINK_LOSS.get(int(value), "unknown")
        text = f"{value:g} {action}"
        if action in ("Terminate", "Disarm", "unknown"):
            return text, Verdict.DANGEROUS, f"without {who} the vehicle falls: set it to 2 (Return) or 3 (Land)"
        if action == "Disabled" and who == "sticks":
            return text, Verdict.DANGEROUS, "without sticks nothing happens: set it to 2 (Return) or 3 (Land)"
        return text, Verdict.FINE, ""

    return rule


def _loss_exceptions(_: Config, value: float) -> _Judged:
    bit = _OFFBOARD_BIT["COM_RCL_EXCEPT"]
    if int(value) & bit:
        advice = f"in OFFBOARD lost sticks are ignored, and nobody can take over: set it to {int(value) & ~bit}"
        return f"{value:g}", Verdict.DANGEROUS, advice
    return f"{value:g}", Verdict.FINE, ""


def _override(_: Config, value: float) -> _Judged:
    bit = _OFFBOARD_BIT["COM_RC_OVERRIDE"]
    if int(value) & bit:
        return f"{value:g}", Verdict.FINE, "the sticks end OFFBOARD"
    advice = f"the sticks do not end OFFBOARD, only the mode switch does: set it to {int(value) | bit}"
    return f"{value:g}", Verdict.DIFFERS, advice


def _rate(config: Config, name: str, value: float) -> Setting:
    needed = round(config.tick.rate_hz * _ODOMETRY_BYTES) + _BESIDE_BYTES_S
    if value == 0:
        return Setting(name, "0 B/s", Verdict.FINE, "half of what the line carries")
    if value >= needed:
        return Setting(name, f"{value:g} B/s", Verdict.FINE, "")
    advice = f"PX4 slows every stream down: {config.tick.rate_hz:g} Hz of ODOMETRY need {needed}; 0 is half the line"
    return Setting(name, f"{value:g} B/s", Verdict.DIFFERS, advice)


_RULES: Final[Mapping[str, Callable[[Config, float], _Judged]]] = {
    "MPC_THR_HOVER": _hover,
    "COM_OF_LOSS_T": _loss_time,
    "COM_OBL_RC_ACT": _loss_action,
    "COM_RC_IN_MODE": _manual_control,
    "NAV_RCL_ACT": _link_loss("sticks"),
    "COM_RCL_EXCEPT": _loss_exceptions,
    "COM_RC_OVERRIDE": _override,
    "NAV_DLL_ACT": _link_loss("a ground station"),
}
