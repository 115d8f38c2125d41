"""From a lockstep flight in memory to the compiled loop: all that is remembered where control begins.

Up to there, connecting, checks, take-off and Hold, a flight is flown by the real flight process on the real plant. The
first set-point in control finds both of them at one instant, and nothing on its way between them.
"""

from __future__ import annotations

import math
import tempfile
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from companion.config import Config
from companion.control.estimate_correction import CorrectionParams, CorrectionState
from companion.errors import CompanionError
from companion.flight.authority.states import State
from companion.flight.pilot.mission import Mission as Stairs
from companion.flight.process import FlightProcess
from companion.mavlink.px4 import ATTITUDE_TYPE_MASK
from companion.record.folder import open_folder
from sitl.autopilot.modes import FlightMode
from sitl.autopilot.parameters import Px4Version
from sitl.build import World, build_world
from sitl.campaign import free_vehicle, guided_vehicle
from sitl.campaign.air import Air
from sitl.campaign.loop import Actuation, Flags, Mission, Pilot
from sitl.campaign.mersenne import Floats, Words, state_of
from sitl.campaign.sensors import Memory, Sensors, empty_past, remember
from sitl.campaign.timeline import timeline
from sitl.vehicles.attitude_loop import NO_RESPONSE
from sitl.vehicles.vehicle import Quadrotor, Rig
from sitl.wire.memory import LockstepLink
from sitl.world.environment import Environment
from sitl.world.estimator import Estimator, Lag, Noise
from sitl.world.navigation_error import AxisError
from sitl.world.wind import STILL, Dryden, DrydenState, Gust, Transverse

_NO_GUST = Gust((0.0, 0.0, 0.0), math.inf, 1.0, 0.0, 0.0)
_STILL_FILTER = Transverse(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
_NO_TURBULENCE = Dryden(0.0, 0.0, _STILL_FILTER, _STILL_FILTER)


class CampaignError(CompanionError):
    """A flight that the compiled loop cannot fly, or that never came under control; the message is one line."""


class NeverInControlError(CampaignError):
    """The flight ended before control began; the message says why."""


class TakeOver(NamedTuple):
    """The arguments of `sitl.campaign.loop.fly`, but for the trace."""

    constants: Any  # of the vehicle's module: `free_vehicle` or `guided_vehicle`
    state: Any
    actuation: Actuation
    sensors: Sensors
    memory: Memory
    air: Air
    turbulence: DrydenState
    wind_ned_m_s: tuple[float, float, float]
    battery: float
    air_words: Words
    air_kept: Floats
    pilot: Pilot
    mission: Mission
    type_mask: int
    timeline: Flags
    begin_us: int


def take_over(config: Config, *, hedging: bool) -> TakeOver:
    """Fly the beginning of a mission, up to the first set-point in control. Raises `CampaignError`, `ConfigError`."""
    _refuse(config)
    world = build_world(config)
    autopilot, begun = world.autopilot, False
    with tempfile.TemporaryDirectory() as folder:
        recorder = open_folder(Path(folder), Path("campaign"), config, blocking=True, direct=True)
        try:
            link = LockstepLink(autopilot, stop=lambda: begun)
            process = FlightProcess(config, link, recorder, hedging=hedging, engage=True, lockstep=True, wall=link.wall)
            flight = process._flight
            found: list[TakeOver] = []

            def on_setpoint(*_: Any) -> None:
                nonlocal begun
                offboard = autopilot.commander.mode is FlightMode.OFFBOARD
                if not begun and offboard and flight.state is State.ENGAGED and flight.pilot.last is not None:
                    begun = True
                    autopilot.on_setpoint = None
                    found.append(_snapshot(config, world, link, process))

            autopilot.on_setpoint = on_setpoint
            summary = process.run()
        finally:
            recorder.close()
    if not found:
        raise NeverInControlError(f"control never began: {summary.reason.value} ({summary.detail})")
    return found[0]


def _refuse(config: Config) -> None:
    plant, mission = config.plant, config.mission
    if plant is None:
        raise CampaignError("the config has no plant section: there is nothing to simulate")
    if plant.link is not None:
        raise CampaignError("plant.link: a campaign does not fly a link that delays or loses frames yet")
    if mission.identification is not None or mission.trajectories:
        raise CampaignError("mission: a campaign flies waypoints, neither trajectories nor an identification yet")
    if Px4Version(plant.px4_version) is not Px4Version.V1_17:
        raise CampaignError("plant.px4_version: a campaign flies PX4 1.17's attitude controller only yet")


def _snapshot(config: Config, world: World, link: LockstepLink, process: FlightProcess) -> TakeOver:
    """Everything, at the instant of a set-point that has not been executed yet."""
    autopilot, pilot = world.autopilot, process._flight.pilot
    duration_s = config.mission.duration_s
    if duration_s is None:
        raise CampaignError("mission.duration_s: a campaign flies missions that end")
    constants, state, rows, angle_steps, late_angles = _vehicle(autopilot.vehicle)
    begin_us, last = autopilot.time_us, pilot.last
    assert last is not None
    assert pilot._control is not None
    assert pilot._sample is not None
    sensors, memory = _sensors(world.estimator)
    air, turbulence, wind, air_words, air_kept = _air(world.environment)
    control = pilot._control
    engaged = Pilot(
        _floats(pilot._params),
        _floats(control),
        pilot._correction_params is not None,
        _floats(pilot._correction_params or CorrectionParams(1.0, 0.0, 0.0, 0.0)),
        _floats(pilot._correction or CorrectionState(0.0, 0.0)),
        pilot._sample.time_s,
        last.setpoint,
    )
    mission = _mission(pilot._mission, pilot._since_s, duration_s, pilot.origin)
    actuation = Actuation(np.zeros(8), rows, angle_steps, late_angles)
    flags = timeline(link._plant, begin_us + round(1e6 * (duration_s + 2.0)))
    return TakeOver(
        constants, state, actuation, sensors, memory, air, turbulence, wind,
        autopilot.vehicle.thrust_share, air_words, air_kept, engaged, mission, ATTITUDE_TYPE_MASK, flags, begin_us,
    )  # fmt: skip


def _floats(record: Any) -> Any:
    """The record with every whole number as a float: numba tells them apart, and compiles anew for each."""
    if isinstance(record, tuple):
        values = [_floats(value) for value in record]
        return type(record)(*values) if hasattr(record, "_fields") else tuple(values)
    return record if isinstance(record, bool) else float(record)


def _vehicle(vehicle: Any) -> tuple[Any, Any, Floats, Any, Floats]:
    """Constants, state, the ring of set-points on their way, and delays and rings of the angles."""
    constants: Any
    state: Any
    form = vehicle._dynamics.constants
    if not form.cascade and NO_RESPONSE in form:
        raise CampaignError("plant: a campaign flies attitude responses of first and of second order only")
    s = vehicle._state
    if isinstance(vehicle, Rig):
        module: Any = guided_vehicle
        constants = guided_vehicle.Constants(_floats(form), float(vehicle.hover_thrust))
        state = guided_vehicle.State(*_floats((*s[:4], s.rate_loop)))
        delayed = None
    else:
        assert isinstance(vehicle, Quadrotor)
        module = free_vehicle
        constants = free_vehicle.Constants(_floats(form), float(vehicle._full_thrust_n))
        state = free_vehicle.State(
            _floats(s[0:3]), _floats(s[3:6]), _floats(s[6:10]), _floats(s[10:13]), _floats(s[13:16])
        )
        delayed = vehicle._angle_delays
    rows = [(*q_wxyz, thrust, *module.angles(q_wxyz)) for q_wxyz, thrust in vehicle._delay._queue]
    steps = [0, 0, 0] if delayed is None else delayed._steps
    depth = 1 if delayed is None else max(steps) + 1
    late = _ring(rows, vehicle._delay._steps + 1, 8)
    rings = (
        [] if delayed is None else [_ring([(angle,) for angle in queue], depth, 1)[:, 0] for queue in delayed._queues]
    )
    return constants, state, late, np.array(steps), np.array(rings) if rings else np.zeros((3, 1))


def _ring(rows: list[tuple[float, ...]], length: int, width: int) -> Floats:
    """A ring whose next place is the first: the rows end at its end, before them the first one stands.

    Without rows, which is without a delay, each place is written before it is read.
    """
    ring = np.zeros((length, width))
    for place in range(1, length if rows else 0):
        ring[-place] = rows[max(len(rows) - place, 0)]
    return ring


def _sensors(estimator: Estimator | None) -> tuple[Sensors, Memory]:
    past_us, past = empty_past()
    if estimator is None:
        nothing = Sensors(
            False, False, 0.0, 0.0, 0.0, 1.0, False, 0.0, 0.0, False, AxisError(), AxisError(), AxisError()
        )
        unused = np.zeros(625, dtype=np.uint32), np.zeros(2)
        marks = np.zeros(3, dtype=np.int64)
        return nothing, Memory(np.zeros(9), np.zeros((3, 4)), past_us, past, marks, *unused)
    noise, lag, error = estimator.noise, estimator.lag, estimator._error
    north, east, down = error or (AxisError(), AxisError(), AxisError())
    sensors = Sensors(
        True,
        noise[:3] != Noise()[:3],
        float(noise.position_m),
        float(noise.velocity_m_s),
        float(noise.attitude_rad),
        float(noise.correlation_s),
        lag != Lag(),
        float(lag.delay_s),
        float(lag.jitter_s),
        error is not None,
        _floats(north),
        _floats(east),
        _floats(down),
    )
    marks = np.array([estimator._at_us, 0, 0], dtype=np.int64)
    for at_us, pose in estimator._past:
        remember(past_us, past, marks, pose[:3], at_us)
    errors = np.array(estimator._errors) if estimator._errors else np.zeros((3, 4))
    words, kept = state_of(estimator._random)
    return sensors, Memory(np.array(estimator._noise_state), errors, past_us, past, marks, words, kept)


def _air(environment: Environment | None) -> tuple[Air, DrydenState, tuple[float, float, float], Words, Floats]:
    calm = (0.0, 0.0, 0.0)
    if environment is None:
        nothing = Air(False, False, calm, False, _NO_GUST, False, _NO_TURBULENCE, (1.0, 0.0), 0.0)
        return nothing, STILL, calm, np.zeros(625, dtype=np.uint32), np.zeros(2)
    wind, filters = environment._wind, environment._dryden
    air = Air(
        True,
        wind is not None,
        calm if wind is None else _floats(wind.mean_ned_m_s),
        wind is not None and wind.gust is not None,
        _floats(_NO_GUST if wind is None or wind.gust is None else wind.gust),
        filters is not None,
        _floats(filters or _NO_TURBULENCE),
        _floats(environment._along),
        float(environment.sag_1_s),
    )
    return air, _floats(environment._turbulence), _floats(environment.wind_ned_m_s), *state_of(environment._random)


def _mission(stairs: Any, since_s: float, duration_s: float, origin: Any) -> Mission:
    assert isinstance(stairs, Stairs)
    offsets = np.array(stairs._offsets, dtype=np.float64)
    return Mission(since_s, float(duration_s), _floats(origin), np.array(stairs._times, dtype=np.float64), offsets)
