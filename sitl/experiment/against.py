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
from companion.flight.pilot.mission import Mission, TrajectoryMission, mission_of
from companion.flight.process import FlightProcess
from companion.processes import Processes
from companion.record.folder import open_folder
from sitl.autopilot.autopilot import Autopilot
from sitl.autopilot.modes import FlightMode
from sitl.autopilot.position_control import PositionControlSetpoint
from sitl.autopilot.position_hold import yaw_of
from sitl.build import World, build_world
from sitl.wire.memory import LockstepLink

TITLES: Final = {"hedged": "hedged", "standard": "standard", "px4": "PX4's own"}
CONTROLLERS: Final = tuple(TITLES)
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


class PathScores(NamedTuple):
    """Distance from where the trajectory is, m, from the first instant that moves to the last; horizontal, and down.

    By the truth as it is, and by the estimate, in whose coordinates the trajectory stands.
    """

    truth_rms_m: float
    truth_peak_m: float
    estimate_rms_m: float
    truth_height_rms_m: float


class Track(NamedTuple):
    """A flight along a trajectory by time: (n,) s since control began, (n, 3) NED m, and (n,) speed wanted, m/s."""

    time_s: npt.NDArray[np.float64]
    truth_ned_m: npt.NDArray[np.float64]
    estimate_ned_m: npt.NDArray[np.float64]
    wanted_ned_m: npt.NDArray[np.float64]
    wanted_speed_m_s: npt.NDArray[np.float64]


class Compared(NamedTuple):
    """One controller's flight; `scores` is None where it did not fly the mission to its end.

    `track` is there where it flew trajectories to their end.
    """

    controller: str
    reason: str
    scores: Scores | PathScores | None
    track: Track | None = None


class _Watch:
    """Samples truth and estimate in control, and plays the pilot who switches to OFFBOARD."""

    def __init__(self, world: World) -> None:
        self.autopilot: Autopilot = world.autopilot
        self._before = world.autopilot.on_control
        self.first_setpoint_us: int | None = None
        self.engaged_us: int | None = None
        self.rows: list[tuple[float, ...]] = []  # s, truth x, y, estimate x, y; truth z, estimate z, yaw
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
            at_s = 1e-6 * (now_us - self.engaged_us)
            yaw = yaw_of(autopilot.estimate().q_wxyz)
            self.rows.append((at_s, true[0], true[1], said[0], said[1], true[2], said[2], yaw))


def fly_against(config: Config, config_path: Path, folder: Path, controller: str) -> Compared:
    """Fly the config's mission once, in lockstep. Raises `ConfigError`; `ValueError` without plant or an end."""
    mission = config.mission
    if mission.duration_s is None and mission.identification is None and not mission.trajectories:
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
    if complete and mission.trajectories:
        track = track_of(config, samples)
        return Compared(controller, reason.value, score_path(track), track)
    return Compared(controller, reason.value, score(config, samples[:, :5]) if complete else None)


def _fly_px4(config: Config, world: World, watch: _Watch) -> Reason:
    """Position set-points of the mission, from where OFFBOARD began, until its time is up or OFFBOARD is."""
    autopilot, mission = world.autopilot, mission_of(config)
    origin: PositionSetpoint | None = None
    watch.first_setpoint_us = autopilot.time_us
    while True:
        here = autopilot.estimate()
        at = PositionSetpoint(*here.position_ned_m, yaw_of(here.q_wxyz))
        elapsed_s = 0.0
        if watch.engaged_us is not None:
            if origin is None:
                origin = at
                mission.begin(origin)
            elapsed_s = 1e-6 * (autopilot.time_us - watch.engaged_us)
            if autopilot.commander.mode is not FlightMode.OFFBOARD:
                return Reason.MODE_CHANGED
        elif autopilot.time_us - watch.first_setpoint_us > _PATIENCE_US:
            return Reason.ENGAGE_REFUSED
        if mission.over(elapsed_s):
            return Reason.MISSION_COMPLETE
        wanted, moving = (at, None) if origin is None else mission.wanted(elapsed_s, origin)
        setpoint = PositionControlSetpoint((wanted.x_m, wanted.y_m, wanted.z_m))
        if moving is not None:
            setpoint = PositionControlSetpoint(setpoint.position_ned_m, moving[3:6], moving[6:9])
        autopilot.on_position_target(setpoint, wanted.yaw_rad)
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


def track_of(config: Config, samples: npt.NDArray[np.float64]) -> Track:
    """What was flown beside what was wanted, of the rows that `_Watch` has kept."""
    mission = TrajectoryMission(config)
    first = samples[0].tolist()
    origin = PositionSetpoint(first[3], first[4], first[6], first[7])
    mission.begin(origin)
    wanted = [mission.wanted(time_s, origin) for time_s in samples[:, 0].tolist()]
    places = np.array([place[:3] for place, _ in wanted])
    speeds = np.array([0.0 if moving is None else float(np.linalg.norm(moving[3:6])) for _, moving in wanted])
    return Track(samples[:, 0], samples[:, [1, 2, 5]], samples[:, [3, 4, 6]], places, speeds)


def score_path(track: Track) -> PathScores:
    """Scores of a flight along a trajectory; of all of it where nothing moves."""
    moving = np.flatnonzero(track.wanted_speed_m_s > 0.0)
    part = slice(moving[0], moving[-1] + 1) if len(moving) else slice(None)
    truth, said = ((at - track.wanted_ned_m)[part] for at in (track.truth_ned_m, track.estimate_ned_m))
    distance, estimated = np.hypot(truth[:, 0], truth[:, 1]), np.hypot(said[:, 0], said[:, 1])
    return PathScores(
        float(np.sqrt(np.mean(distance**2))),
        float(distance.max()),
        float(np.sqrt(np.mean(estimated**2))),
        float(np.sqrt(np.mean(truth[:, 2] ** 2))),
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
