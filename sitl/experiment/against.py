"""Hedged, standard and PX4's own position control over the same mission in the same plant, scored by the truth too.

All three begin in the air in Hold, so that none owes its error to a take-off. Plant and companion are one program
(`sitl.wire.memory`); PX4's own controller is the plant's (`sitl.autopilot.position_control`), told set-points at
50 Hz. The truth is what the plant knows and nobody else.
"""

from __future__ import annotations

from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt

from companion.config import Config
from companion.config.controller import AxisSection
from companion.control.reference_model import transition
from companion.control.types import PositionSetpoint
from companion.flight.authority.states import Reason
from companion.flight.pilot.mission import Mission
from companion.flight.process import FlightProcess
from companion.processes import Processes
from companion.record.folder import open_folder
from sitl.autopilot.autopilot import Autopilot
from sitl.autopilot.modes import FlightMode
from sitl.autopilot.position_control import PositionControlSetpoint
from sitl.autopilot.position_hold import yaw_of
from sitl.build import World, build_world
from sitl.wire.memory import LockstepLink

CONTROLLERS: Final = ("hedged", "standard", "px4")
ALTITUDE_M: Final = 5.0
SETTLE_S: Final = 10.0  # in Hold, before anybody takes over
_STREAMED_US: Final = 1_500_000  # of set-points before the pilot switches
_PATIENCE_US: Final = 10_000_000  # with an autopilot that does not go to OFFBOARD
_SETPOINT_US: Final = 20_000
_SAMPLE_US: Final = 20_000


class Scores(NamedTuple):
    """Distance from the ideal reference (19), m, along the way last commanded and across it; RMS.

    By the estimate; and by the truth less its mean offset, which no controller on this estimate can know.
    """

    truth_rms_along_m: float
    truth_rms_across_m: float
    estimate_rms_along_m: float
    estimate_rms_across_m: float


class Compared(NamedTuple):
    """One controller's flight; `scores` is None where it did not fly the mission to its end."""

    controller: str
    reason: str
    scores: Scores | None


class _Watch:
    """Samples truth and estimate in control, and plays the pilot who switches to OFFBOARD."""

    def __init__(self, world: World) -> None:
        self.autopilot: Autopilot = world.autopilot
        self._before = world.autopilot.on_control
        self.first_setpoint_us: int | None = None
        self.engaged_us: int | None = None
        self.rows: list[tuple[float, float, float, float, float]] = []  # s, truth x, y, estimate x, y
        self._next_us = 0
        self.autopilot.on_control = self.on_control
        self.autopilot.on_setpoint = self.on_setpoint

    def on_setpoint(self, _q: tuple[float, float, float, float], _thrust: float, _mask: int) -> None:
        if self.first_setpoint_us is None:
            self.first_setpoint_us = self.autopilot.time_us

    def on_control(self, now_us: int) -> None:
        if self._before is not None:
            self._before(now_us)
        autopilot, first = self.autopilot, self.first_setpoint_us
        if self.engaged_us is None and first is not None and now_us - first >= _STREAMED_US:
            autopilot.commander.request(FlightMode.OFFBOARD, now_us)
            autopilot.follow_mode()
            if autopilot.commander.mode is FlightMode.OFFBOARD:
                self.engaged_us = now_us
        if self.engaged_us is not None and now_us >= self._next_us and autopilot.commander.mode is FlightMode.OFFBOARD:
            self._next_us = now_us + _SAMPLE_US
            true, said = autopilot.vehicle.state.position_ned_m, autopilot.estimate().position_ned_m
            self.rows.append((1e-6 * (now_us - self.engaged_us), true[0], true[1], said[0], said[1]))


def fly_against(config: Config, config_path: Path, folder: Path, controller: str) -> Compared:
    """Fly the config's mission once, in lockstep. Raises `ConfigError`; `ValueError` without plant or an end."""
    if config.mission.duration_s is None and config.mission.identification is None:
        raise ValueError("a comparison needs a mission that ends: duration_s, or identification")
    world = build_world(config)
    world.autopilot.start_in_air(ALTITUDE_M, SETTLE_S)
    watch = _Watch(world)
    if controller == "px4":
        reason = _fly_px4(config, world, watch)
    else:
        recorder = open_folder(folder, config_path, config, blocking=True)
        try:
            link = LockstepLink(world.autopilot, channels=world.channels)
            hedging = controller == "hedged"
            process = FlightProcess(config, link, recorder, hedging=hedging, lockstep=True, wall=link.wall)
            reason = process.run().reason
        finally:
            recorder.close()
    samples = np.array(watch.rows)
    complete = reason is Reason.MISSION_COMPLETE and len(samples) > 1
    return Compared(controller, reason.value, score(config, samples) if complete else None)


def _fly_px4(config: Config, world: World, watch: _Watch) -> Reason:
    """Position set-points of the mission, from where OFFBOARD began, until its time is up or OFFBOARD is."""
    assert config.mission.duration_s is not None
    autopilot, mission = world.autopilot, Mission(config.mission)
    origin: PositionSetpoint | None = None
    watch.first_setpoint_us = autopilot.time_us
    while True:
        here = autopilot.estimate()
        at = PositionSetpoint(*here.position_ned_m, yaw_of(here.q_wxyz))
        elapsed_s = 0.0
        if watch.engaged_us is not None:
            origin = origin or at
            elapsed_s = 1e-6 * (autopilot.time_us - watch.engaged_us)
            if autopilot.commander.mode is not FlightMode.OFFBOARD:
                return Reason.MODE_CHANGED
        elif autopilot.time_us - watch.first_setpoint_us > _PATIENCE_US:
            return Reason.ENGAGE_REFUSED
        if mission.over(elapsed_s):
            return Reason.MISSION_COMPLETE
        wanted = at if origin is None else mission.command(elapsed_s, origin)
        autopilot.on_position_target(PositionControlSetpoint((wanted.x_m, wanted.y_m, wanted.z_m)), wanted.yaw_rad)
        autopilot.advance(autopilot.time_us + _SETPOINT_US)


def score(config: Config, samples: npt.NDArray[np.float64]) -> Scores:
    """Scores of rows (s since control began, truth x, y, estimate x, y), local NED."""
    mission = Mission(config.mission)
    origin = PositionSetpoint(float(samples[0, 3]), float(samples[0, 4]), 0.0, 0.0)
    axes = (config.controller.axes.x, config.controller.axes.y or config.controller.axes.x)
    ideal = [(origin.x_m, 0.0), (origin.y_m, 0.0)]
    along = (1.0, 0.0)
    last_s, last = 0.0, origin
    rows = []
    for time_s, *places in samples.tolist():
        command = mission.command(time_s, origin)
        way = command.x_m - last.x_m, command.y_m - last.y_m
        length = float(np.hypot(*way))
        if length > 0.0:
            along, last = (way[0] / length, way[1] / length), command
        wanted = command.x_m, command.y_m
        ideal = [
            _ideal(axis, state, command_m, time_s - last_s)
            for axis, state, command_m in zip(axes, ideal, wanted, strict=True)
        ]
        last_s = time_s
        rows.append([place - ideal[n % 2][0] for n, place in enumerate(places)] + list(along))
    truth_x, truth_y, said_x, said_y, along_x, along_y = np.array(rows).T
    truth_x, truth_y = truth_x - truth_x.mean(), truth_y - truth_y.mean()

    def rms(values: npt.NDArray[np.float64]) -> float:
        return float(np.sqrt(np.mean(values**2)))

    return Scores(
        rms(truth_x * along_x + truth_y * along_y),
        rms(truth_y * along_x - truth_x * along_y),
        rms(said_x * along_x + said_y * along_y),
        rms(said_y * along_x - said_x * along_y),
    )


def _ideal(axis: AxisSection, state: tuple[float, float], command_m: float, dt_s: float) -> tuple[float, float]:
    """Position and velocity of the ideal reference (19) a step later."""
    over = transition(axis.natural_frequency_rad_s, axis.damping_ratio, dt_s)
    at, speed = state
    acceleration = axis.natural_frequency_rad_s**2 * command_m
    return (
        over.phi11 * at + over.phi12 * speed + over.gamma1 * acceleration,
        over.phi21 * at + over.phi22 * speed + over.gamma2 * acceleration,
    )


def compare(config: Config, config_path: Path, folder: Path) -> list[Compared]:
    """Fly all three, two at a time. Ctrl-C ends them. Raises `ConfigError`."""
    with Processes(elsewhere=True) as processes:
        flights = [processes.call(fly_against, config, config_path, folder / name, name) for name in CONTROLLERS]
        return [flight() for flight in flights]
