"""Whether what happened is what must hold. Pure: a scenario, its summary, its log and the plant's account in."""

from __future__ import annotations

from companion.config import Config
from companion.flight.authority.states import TAKEN
from companion.flight.host.runtime import Summary
from companion.record.reader import Flight
from sitl.autopilot.modes import FlightMode
from sitl.metrics import in_control, tracking_error_m
from sitl.scenarios.observer import Account, Change
from sitl.scenarios.scenario import Scenario

STEP_DEG = 1.0
_HANDOVER_S = 0.2  # from OFFBOARD to the companion's control
_ROUNDING = 1e-6  # thrust travels as float32


def worst_error_m(config: Config, flight: Flight) -> float | None:
    """Largest distance of the measured position from the tracked reference while in control, height included."""
    ticks = in_control(flight)
    return float(tracking_error_m(config, ticks).max()) if len(ticks) else None


def problems(
    scenario: Scenario,
    config: Config,
    summary: Summary,
    flight: Flight,
    seen: Account,
    asked: list[FlightMode],
) -> list[str]:
    """Everything that did not hold, one line each. `asked`: the modes that the companion asked for."""
    found = _of_the_ending(scenario, summary, flight, asked)
    found += _of_the_setpoints(scenario, config, seen)
    found += _of_the_vehicle(scenario, seen)
    error = worst_error_m(config, flight)
    if error is not None and not error <= scenario.error_m:
        found.append(f"worst error {error:.2f} m, at most {scenario.error_m:g}")
    return found


def _of_the_ending(scenario: Scenario, summary: Summary, flight: Flight, asked: list[FlightMode]) -> list[str]:
    found = []
    if summary.reason is not scenario.reason:
        found.append(f"ended for {summary.reason.value} ({summary.detail})")
    if summary.engaged is not scenario.engaged:
        found.append("control began" if summary.engaged else "control never began")
    if scenario.by_s is not None and summary.engaged_s > scenario.by_s:
        found.append(f"ended after {summary.engaged_s:.2f} s, not by {scenario.by_s:g}")
    first_s = min((at_s for at_s, _ in scenario.happens), default=0.0)
    if scenario.engaged and scenario.pilot and summary.engaged_s < first_s - _HANDOVER_S:
        found.append(f"ended after {summary.engaged_s:.2f} s, before anything happened at {first_s:g} s")
    names = {event.name for event in flight.events}
    found += [f"no event {name} in the log" for name in scenario.events if name not in names]
    if summary.reason in TAKEN and asked and not scenario.engage:
        found.append(f"asked for {asked[0].name} although control was taken")
    if not scenario.engage and FlightMode.OFFBOARD in asked:
        found.append("asked for OFFBOARD by itself")
    return found


def _of_the_setpoints(scenario: Scenario, config: Config, seen: Account) -> list[str]:
    found = []
    if seen.invalid_setpoints:
        found.append(f"{seen.invalid_setpoints} set-points were not finite")
    limits = config.controller.limits
    least = scenario.least_thrust
    if least is None:
        least = limits.thrust_min if scenario.engaged else 0.0  # what never began on the ground gives no thrust
    if seen.thrust_least < least - _ROUNDING or seen.thrust_most > limits.thrust_max + _ROUNDING:
        found.append(f"thrust from {seen.thrust_least:.3f} to {seen.thrust_most:.3f}, outside the limits")
    if not seen.largest_step_deg <= STEP_DEG:
        found.append(f"attitude set-point stepped by {seen.largest_step_deg:.2f} degrees")
    if scenario.streams != (seen.setpoints > 0):
        found.append(f"{seen.setpoints} set-points came" if seen.setpoints else "no set-point came")
    return found


def _of_the_vehicle(scenario: Scenario, seen: Account) -> list[str]:
    found = []
    if not seen.in_control_m <= scenario.stays_within_m:
        found.append(f"went {seen.in_control_m:.2f} m away in control, at most {scenario.stays_within_m:g}")
    if not seen.farthest_m <= scenario.stays_within_m + scenario.margin_m:
        found.append(
            f"went {seen.farthest_m:.2f} m away in all, at most {scenario.stays_within_m + scenario.margin_m:g}"
        )
    last = seen.changes[-1] if seen.changes else Change(0.0, FlightMode.HOLD, False)
    if last.mode not in scenario.ends_in:
        found.append(f"ended in {last.mode.name}")
    if last.armed is not scenario.armed:
        found.append("ended armed" if last.armed else "ended disarmed")
    return found
