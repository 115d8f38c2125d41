"""Identification flight: the doublets, the lean that flies them, the pilot between them, and what a config may ask."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from companion.config import ConfigError, load_config
from companion.config.mission.identification import IdentificationSection
from companion.control import attitude, position
from companion.control.types import AttitudeSetpoint, Odometry
from companion.flight.pilot.controller_params import initial_weights, position_params
from companion.flight.pilot.doublets import CALM_M, CALM_M_S, PATIENCE_S, Manoeuvre
from companion.flight.pilot.pilot import Pilot
from sitl.vehicles.rotation import euler

SHIPPED = Path(__file__).resolve().parents[3] / "config"
PX4, RIG = SHIPPED / "px4_quadrotor.yaml", SHIPPED / "antx_rig.yaml"
IDENTIFY = "mission={identification: {}}"
EIGHT = "mission={identification: {amplitude_deg: 8}}"
DT_S = 0.004
SECTION = IdentificationSection()
SHORT = IdentificationSection(amplitude_deg=5.0, pulse_s=0.4, pause_s=1.0, repeats=3)
AMPLITUDE_RAD = math.radians(8.0)

Offset = tuple[float, float] | None


def calm(_time_s: float) -> tuple[float, float]:
    return 0.0, 0.0


def flown(
    manoeuvre: Manoeuvre, seconds: float, state: Callable[[float], tuple[float, float]] = calm, dt_s: float = DT_S
) -> list[Offset]:
    """Every tick's offset for a vehicle that is (distance, speed) away from rest."""
    return [manoeuvre.offset(k * dt_s, *state(k * dt_s)) for k in range(round(seconds / dt_s))]


def runs(offsets: list[Offset]) -> list[list[tuple[float, float]]]:
    """The doublets: what lies between two pauses."""
    found: list[list[tuple[float, float]]] = []
    for before, now in zip([None, *offsets], offsets, strict=False):
        if now is not None:
            if before is None:
                found.append([])
            found[-1].append(now)
    return found


# -- the shape -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("section", [SECTION, SHORT, IdentificationSection(pulse_s=0.7)])
@pytest.mark.parametrize("rate_hz", [100.0, 250.0])
def test_a_doublet_ends_where_it_began_and_at_rest(section: IdentificationSection, rate_hz: float) -> None:
    manoeuvre = Manoeuvre(section, 3.0, one_axis=False)
    doublets = runs(flown(manoeuvre, 100.0, dt_s=1.0 / rate_hz))
    assert len(doublets) == manoeuvre.doublets == manoeuvre.done == 2 * section.repeats
    assert manoeuvre.over
    for doublet in doublets:
        angles = np.array(doublet).sum(axis=1)  # the other one is zero
        assert len(angles) == pytest.approx(4 * section.pulse_s * rate_hz, abs=1)
        assert set(np.abs(angles)) == {math.radians(3.0)}
        velocity = np.cumsum(9.81 * np.tan(angles)) / rate_hz
        places = np.cumsum(velocity) / rate_hz
        assert velocity[-1] == pytest.approx(0.0, abs=1e-9)
        assert abs(places[-1]) < 0.02 * section.excursion_m(3.0)
        # the section says how far and how fast it goes
        assert np.abs(places).max() == pytest.approx(section.excursion_m(3.0), rel=0.03)
        assert np.abs(velocity).max() == pytest.approx(section.excursion_m(3.0) / section.pulse_s, rel=0.03)


def test_roll_comes_first_then_pitch_and_sides_alternate() -> None:
    manoeuvre = Manoeuvre(SHORT, 5.0, one_axis=False)
    doublets = runs(flown(manoeuvre, 40.0))
    firsts = [doublet[0] for doublet in doublets]
    a = math.radians(5.0)
    assert firsts == [(a, 0.0), (-a, 0.0), (a, 0.0), (0.0, -a), (0.0, a), (0.0, -a)]
    for doublet in doublets:
        assert len({tuple(x != 0.0 for x in offset) for offset in doublet}) == 1, "one axis moves, the other does not"


def test_a_rig_pitches_only() -> None:
    manoeuvre = Manoeuvre(SHORT, 5.0, one_axis=True)
    doublets = runs(flown(manoeuvre, 40.0))
    assert len(doublets) == manoeuvre.doublets == 3
    assert all(roll == 0.0 and pitch != 0.0 for doublet in doublets for roll, pitch in doublet)


def test_it_ends_by_itself_after_the_last_pause() -> None:
    manoeuvre = Manoeuvre(SHORT, 5.0, one_axis=True)
    lasts_s = 3 * (SHORT.pause_s + 4 * SHORT.pulse_s) + SHORT.pause_s
    flown(manoeuvre, lasts_s - 0.1)
    assert (manoeuvre.done, manoeuvre.over) == (3, False)
    flown(manoeuvre, lasts_s + 0.1)  # from the same clock's beginning: nothing starts anew
    assert manoeuvre.over
    assert not manoeuvre.gave_up
    assert manoeuvre.offset(1000.0, 0.0, 0.0) is None


# -- calm ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("restless", [(CALM_M + 0.01, 0.0), (0.0, CALM_M_S + 0.01)], ids=["far", "fast"])
def test_a_doublet_waits_until_the_vehicle_is_calm(restless: tuple[float, float]) -> None:
    manoeuvre = Manoeuvre(SHORT, 5.0, one_axis=False)
    offsets = flown(manoeuvre, 12.0, lambda t: restless if t < 9.0 else (0.0, 0.0))
    first = next(k for k, offset in enumerate(offsets) if offset is not None)
    assert first * DT_S == pytest.approx(9.0, abs=2 * DT_S)


def test_once_begun_a_doublet_is_flown_whatever_it_does() -> None:
    """It is what makes the vehicle fast and far."""
    manoeuvre = Manoeuvre(SHORT, 5.0, one_axis=False)
    (doublet,) = runs(flown(manoeuvre, 3.0, lambda t: (0.0, 0.0) if t <= 1.02 else (1.0, 1.0)))
    assert len(doublet) == pytest.approx(4 * SHORT.pulse_s / DT_S, abs=1)


@pytest.mark.parametrize("flown_before", [0, 1])
def test_it_gives_up_when_the_vehicle_does_not_become_calm(flown_before: int) -> None:
    manoeuvre = Manoeuvre(SHORT, 5.0, one_axis=False)
    calm_until_s = 2.0 * flown_before
    begins_s = flown_before * (SHORT.pause_s + 4 * SHORT.pulse_s)
    gives_up_s = begins_s + SHORT.pause_s + PATIENCE_S

    def state(time_s: float) -> tuple[float, float]:
        return (0.0, 0.0) if time_s < calm_until_s else (1.0, 0.0)

    flown(manoeuvre, gives_up_s - 0.1, state)
    assert not manoeuvre.over
    assert manoeuvre.done == flown_before
    manoeuvre.offset(gives_up_s + 0.1, 1.0, 0.0)
    assert manoeuvre.over
    assert manoeuvre.gave_up
    assert manoeuvre.done < manoeuvre.doublets
    assert manoeuvre.offset(gives_up_s + 0.2, 0.0, 0.0) is None, "over is over"


# -- the lean --------------------------------------------------------------------------------------------------------


def hovering(
    yaw: float, bias: tuple[float, float], config: Path = PX4
) -> tuple[position.PositionParams, position.PositionState]:
    """A state in flight at a heading, its bias weights (x, y) as a steady wind has made them, a little climb wanted."""
    read = load_config(config)
    params = position_params(read, hedging=True)
    odometry = Odometry(0.0, 3.0, 4.0, -5.0, 0.0, 0.0, 0.0, math.cos(yaw / 2), 0.0, 0.0, math.sin(yaw / 2))
    weights = initial_weights(read, params.x)
    state = position.engage(params, odometry, yaw, weights, weights, read.vehicle.hover_thrust)
    x, y = state.x._replace(bias_weight=bias[0]), state.y._replace(bias_weight=bias[1])
    up = 1.0 if params.one_axis else 1.05
    return params, state._replace(x=x, y=y, force=(-bias[0], -bias[1], up))


def angles(setpoint: AttitudeSetpoint) -> tuple[float, float, float]:
    return euler(setpoint.qw, setpoint.qx, setpoint.qy, setpoint.qz)


@pytest.mark.parametrize("yaw", [0.0, 0.7, -2.5])
@pytest.mark.parametrize("offset", [(AMPLITUDE_RAD, 0.0), (-AMPLITUDE_RAD, 0.0), (0.0, AMPLITUDE_RAD), (0.0, 0.0)])
def test_a_lean_is_about_the_trim_and_keeps_the_vertical_force(yaw: float, offset: tuple[float, float]) -> None:
    params, state = hovering(yaw, (0.03, -0.05))
    leaning, setpoint = position.lean(params, state, (-0.03, 0.05), *offset)
    trim_roll, trim_pitch = math.atan(0.05), math.atan(0.03)  # a force of -bias: along -tan(pitch), across tan(roll)
    roll, pitch, heading = angles(setpoint)
    # (6) keeps the body's y axis normal to the heading, so that the lean of one axis turns the other a little
    assert (roll, pitch) == pytest.approx((trim_roll + offset[0], trim_pitch + offset[1]), abs=1.5e-3)
    assert math.remainder(heading - yaw, math.tau) == pytest.approx(0.0, abs=0.01)
    _, _, down = attitude.thrust_direction(*setpoint[:4])
    assert -down * setpoint.thrust / state.hover.hover_thrust == pytest.approx(1.05)
    # what the next tick takes for flown is what is flown
    x, y, _ = attitude.thrust_direction(*setpoint[:4])
    share = setpoint.thrust / state.hover.hover_thrust
    along, across = math.cos(yaw) * x + math.sin(yaw) * y, math.cos(yaw) * y - math.sin(yaw) * x
    assert leaning.force == pytest.approx((share * along, share * across, 1.05))
    assert leaning.thrust == setpoint.thrust
    untouched = leaning._replace(force=state.force, thrust=state.thrust)
    assert untouched == state


def test_a_lean_stays_within_the_tilt_limit() -> None:
    params, state = hovering(0.3, (0.0, 0.0))
    _, setpoint = position.lean(params, state, (0.0, 0.0), math.radians(50.0), 0.0)
    roll, pitch, _ = angles(setpoint)
    assert math.degrees(roll) <= 30.0 + 1e-6
    assert pitch == pytest.approx(0.0, abs=1e-9)


def test_a_rig_leans_in_pitch_alone_and_its_thrust_stays_at_hover() -> None:
    params, state = hovering(0.0, (0.0, 0.0), RIG)
    _, setpoint = position.lean(params, state, (0.0, 0.0), 0.1, AMPLITUDE_RAD)
    roll, pitch, _ = angles(setpoint)
    assert (roll, pitch) == pytest.approx((0.0, AMPLITUDE_RAD), abs=1e-9)
    assert setpoint.thrust == pytest.approx(0.5)


# -- the pilot -------------------------------------------------------------------------------------------------------


def sample(time_s: float) -> Odometry:
    return Odometry(time_s, 3.0, 4.0, -5.0, 0.0, 0.0, 0.0, math.cos(0.2), 0.0, 0.0, math.sin(0.2))


@pytest.mark.parametrize("config", [PX4, RIG], ids=["quadrotor", "rig"])
def test_the_pilot_flies_doublets_in_place_of_the_mission_and_then_is_done(config: Path) -> None:
    short = "mission={identification: {amplitude_deg: 5, pulse_s: 0.4, pause_s: 1, repeats: 3}}"
    pilot = Pilot(load_config(config, (short,)), hedging=True)
    pilot.take_over(sample(10.0))
    tilts, thrusts, k = [], [], 0
    while not pilot.mission_over and k < 20 / DT_S:
        setpoint = pilot.step(sample(10.0 + k * DT_S), DT_S if k else 0.0)
        tilts.append(angles(setpoint)[:2])
        thrusts.append(setpoint.thrust)
        assert pilot.last is not None
        assert pilot.last.setpoint == setpoint, "guards and record see what is flown"
        k += 1
    doublets = 3 if config is RIG else 6
    assert pilot.elapsed_s == pytest.approx(doublets * 2.6 + 1.0, abs=2 * (doublets + 1) * DT_S)
    assert pilot.target == pilot.origin, "it comes back to where it began"
    roll, pitch = np.degrees(np.array(tilts)).T
    assert np.ptp(pitch) >= 10.0
    assert (np.ptp(roll) >= 10.0) == (config is PX4)
    # It does not move and yet is told to: the adaptation takes it up, and the doublets stand on that.
    assert np.abs(pitch).max() < 16.0
    assert np.ptp(thrusts) == 0.0 if config is RIG else np.ptp(thrusts) < 0.05


# -- what a config may ask -------------------------------------------------------------------------------------------


def complaint(config: Path, *overrides: str) -> str:
    with pytest.raises(ConfigError) as caught:
        load_config(config, overrides)
    (line,) = str(caught.value).splitlines()
    return line


def amplitude_advised(line: str) -> str:
    return line.split("an amplitude_deg of ")[1].split(" ", maxsplit=1)[0]


def test_the_shipped_quadrotor_flies_the_default_doublets() -> None:
    flown_ = load_config(PX4, (IDENTIFY,)).mission.identification
    assert flown_ == SECTION
    assert flown_.excursion_m(8.0) == pytest.approx(0.345, abs=0.001)


@pytest.mark.parametrize(("config", "amplitude"), [(PX4, 8.0), (RIG, 6.9)], ids=["quadrotor", "rig"])
def test_an_amplitude_that_is_left_out_is_as_large_as_fits(config: Path, amplitude: float) -> None:
    pilot = Pilot(load_config(config, (IDENTIFY,)), hedging=True)
    pilot.take_over(sample(0.0))
    tilts = [angles(pilot.step(sample(k * DT_S), DT_S if k else 0.0))[:2] for k in range(round(4.3 / DT_S))]
    assert np.degrees(np.ptp(tilts, axis=0).max()) == pytest.approx(amplitude, abs=1.0)


@pytest.mark.parametrize(
    ("overrides", "words"),
    [
        (
            ("mission={identification: {amplitude_deg: 9, pulse_s: 1}}",),
            r"1.6 m to the side, beyond controller.envelope",
        ),
        (
            ("mission={identification: {amplitude_deg: 9}}", "guards.fence={enabled: true, radius_m: 0.5}"),
            "0.39 m to the side, beyond half of guards.fence (0.25)",
        ),
        (
            (EIGHT, "guards.fence={enabled: true, lower_ned_m: [-9, -0.6, -9], upper_ned_m: [9, 9, 1]}"),
            "0.34 m to the side, beyond half of guards.fence (0.3)",
        ),
        (
            (EIGHT, "controller.envelope.velocity_m_s=0.6", "controller.limits.speed_m_s=0.5"),
            "reaches 0.69 m/s, beyond controller.envelope.velocity_m_s (0.6)",
        ),
    ],
    ids=["envelope", "radius", "box", "velocity"],
)
def test_doublets_that_go_too_far_are_refused_with_an_amplitude_that_would_do(
    overrides: tuple[str, ...], words: str
) -> None:
    line = complaint(PX4, *overrides)
    assert words in line
    advised = f"mission.identification.amplitude_deg={amplitude_advised(line)}"
    assert load_config(PX4, (*overrides, advised)).mission.identification is not None


def test_where_no_amplitude_would_do_only_the_pulse_is_advised() -> None:
    line = complaint(PX4, IDENTIFY, "guards.fence={enabled: true, radius_m: 0.1}")
    assert line.endswith("beyond half of guards.fence (0.05): make pulse_s shorter")


def test_a_fence_that_is_off_does_not_count() -> None:
    load_config(PX4, (IDENTIFY, "guards.fence={enabled: false, radius_m: 0.1}"))


@pytest.mark.parametrize(
    ("section", "words"),
    [
        ("{amplitude_deg: 1}", "mission.identification.amplitude_deg: "),
        ("{amplitude_deg: 21}", "mission.identification.amplitude_deg: "),
        ("{pulse_s: 0.1}", "mission.identification.pulse_s: "),
        ("{pause_s: 0}", "mission.identification.pause_s: "),
        ("{repeats: 2}", "mission.identification.repeats: "),  # `companion identify` wants three
        ("{chirp: true}", "mission.identification.chirp: unknown key"),
        ("{}, duration_s: 60", "identification ends by itself: leave out waypoints and duration_s"),
        ("{}, waypoints: [{at_s: 1, offset_ned_m: [1, 0, 0]}]", "identification ends by itself"),
    ],
)
def test_what_is_wrong_with_the_section_is_one_line(section: str, words: str) -> None:
    assert words in complaint(PX4, f"mission={{identification: {section}}}")
