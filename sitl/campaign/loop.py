"""The closed loop, millisecond by millisecond: what the flight process, the wire and the plant do to one another.

To be compiled (`sitl.campaign.compiled`), with `vehicle` bound to the module of the vehicle that flies. It holds no
arithmetic of its own: it calls the steps that fly, in the order in which lockstep over MAVLink calls them, and rounds
where the wire rounds.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt

from companion.control import estimate_correction, mrac, position
from companion.control.estimate_correction import CorrectionParams, CorrectionState
from companion.control.types import AttitudeSetpoint, Odometry, PositionSetpoint
from sitl.autopilot import offboard
from sitl.campaign import air as airs
from sitl.campaign import free_vehicle as vehicle
from sitl.campaign import sensors as sensing
from sitl.campaign.air import Air
from sitl.campaign.mersenne import Floats, Words
from sitl.campaign.sensors import Memory, Sensors
from sitl.vehicles.body import Vector
from sitl.vehicles.rotation import Quaternion, quaternion
from sitl.world.environment import STEP_S
from sitl.world.sensing import Pose
from sitl.world.wind import DrydenState

ESTIMATE: Final = 1  # what happens in a millisecond, in this order
READ: Final = 2  # an ODOMETRY is filled
ANSWER: Final = 4  # it is sent, and the set-point comes back
CONTROL: Final = 8  # the autopilot's turn, ten milliseconds apart

COMPLETE: Final = 0  # how it ended
NOT_FINITE: Final = 1  # a set-point or a pose was no number
GROUND: Final = 2
TIME_OVER: Final = 3

Flags = npt.NDArray[np.uint8]
Count = npt.NDArray[np.int64]


class Mission(NamedTuple):
    """Waypoints from where control began: `times_s` (n,), `offsets` (n + 1, 4) north, east, down, turn."""

    since_s: float
    duration_s: float
    origin: PositionSetpoint
    times_s: Floats
    offsets: Floats


class Pilot(NamedTuple):
    """The companion at a tick."""

    params: position.PositionParams
    control: position.PositionState
    corrects: bool
    correction_params: CorrectionParams
    correction: CorrectionState
    sample_s: float  # of the last tick
    setpoint: AttitudeSetpoint  # its answer, which has not reached the plant yet


class Actuation(NamedTuple):
    """The set-point in force, and its way to the vehicle, changed in place.

    `setpoint` (8,) attitude, thrust, and the angles of it; `late` (steps + 1, 8) a ring of them; `angle_steps` (3,) the
    delay of each angle, `late_angles` (3, m) their rings.
    """

    setpoint: Floats
    late: Floats
    angle_steps: Count
    late_angles: Floats


class Outcome(NamedTuple):
    """What a flight was like. Errors are horizontal distances from the ideal reference, (26) and (29)."""

    ending: int
    ticks: int
    flown_s: float
    peak_m: float  # by the estimate
    rms_m: float
    truth_peak_m: float
    truth_rms_m: float
    tilt_rad: float  # the largest
    limited_ticks: int
    on_bound_ticks: int  # with a weight on a bound


class Tally(NamedTuple):
    """What the ticks so far come to; `upright` is the least vertical part of the thrust direction."""

    ticks: int
    peak_m: float
    squares_m2: float
    truth_peak_m: float
    truth_squares_m2: float
    upright: float
    limited: int
    on_bound: int


def command_at(mission: Mission, elapsed_s: float) -> PositionSetpoint:
    """As `companion.flight.pilot.mission.Mission.command`."""
    after = 0
    while after < len(mission.times_s) and mission.times_s[after] <= elapsed_s + 1e-9:
        after += 1
    x, y, z, yaw = mission.origin
    offset = mission.offsets[after]
    return PositionSetpoint(x + offset[0], y + offset[1], z + offset[2], yaw + offset[3])


def on_wire(value: float) -> float:
    """A number as a float32 of MAVLink carries it."""
    return np.float64(np.float32(value))


def sample_of(pose: Pose, stamp_us: int) -> Odometry:
    """ODOMETRY of a pose, as it is read from the wire."""
    (x, y, z), (vx, vy, vz), (qw, qx, qy, qz) = pose
    return Odometry(
        stamp_us * 1e-6, on_wire(x), on_wire(y), on_wire(z), on_wire(vx), on_wire(vy), on_wire(vz),
        on_wire(qw), on_wire(qx), on_wire(qy), on_wire(qz),
    )  # fmt: skip


def execute(setpoint: AttitudeSetpoint, type_mask: int, into: Floats) -> None:
    """SET_ATTITUDE_TARGET through the wire, and what OFFBOARD makes of it."""
    qw, qx, qy, qz, thrust = setpoint
    flown = offboard.by_attitude(
        (on_wire(qw), on_wire(qx), on_wire(qy), on_wire(qz)), on_wire(thrust), type_mask, 0.0, 1.0
    )
    a, b, c = vehicle.angles(flown.q_wxyz)
    into[0], into[1], into[2], into[3] = flown.q_wxyz
    into[4], into[5], into[6], into[7] = flown.thrust, a, b, c


def arrive(actuation: Actuation, k: int) -> tuple[Quaternion, float, Vector]:
    """What comes out of the delays in millisecond `k`: attitude, thrust, and the angles of the attitude."""
    setpoint, late, angle_steps, late_angles = actuation
    row = setpoint
    length = late.shape[0]
    if length > 1:
        for place in range(len(setpoint)):  # numba takes five seconds longer to compile the assignment of a row
            late[k % length, place] = setpoint[place]
        row = late[(k + 1) % length]
    attitude, angles = (row[0], row[1], row[2], row[3]), (row[5], row[6], row[7])
    if late_angles.shape[1] > 1:
        depth = late_angles.shape[1]
        for axis in range(3):
            late_angles[axis, k % depth] = row[5 + axis]
        attitude = quaternion(
            late_angles[0, (k - angle_steps[0]) % depth],
            late_angles[1, (k - angle_steps[1]) % depth],
            late_angles[2, (k - angle_steps[2]) % depth],
        )
        angles = vehicle.angles(attitude)
    return attitude, row[4], angles


def distance_m(control: position.PositionState, x_m: float, y_m: float, one_axis: bool) -> float:
    """From the ideal reference to a place in the control frame."""
    along, across = x_m - control.x.ideal_position_m, y_m - control.y.ideal_position_m
    return abs(along) if one_axis else math.sqrt(along * along + across * across)


def counted(
    tally: Tally,
    params: position.PositionParams,
    control: position.PositionState,
    out: position.PositionOutput,
    truth: Pose,
) -> Tally:
    """One tick more, whose sample was of the true pose given."""
    ticks, peak, squares, true_peak, true_squares, upright, limited, on_bound = tally
    error = distance_m(control, out.measured.x_m, out.measured.y_m, params.one_axis)
    north, east = truth[0][0] - control.anchor_x_m, truth[0][1] - control.anchor_y_m
    c, s = math.cos(control.flown.yaw_rad), math.sin(control.flown.yaw_rad)
    true_error = distance_m(control, c * north + s * east, c * east - s * north, params.one_axis)
    _, qx, qy, _ = truth[2]
    bounds = mrac.on_bound(params.x, control.x)
    if not params.one_axis:
        bounds += mrac.on_bound(params.y, control.y)
    return Tally(
        ticks + 1,
        max(peak, error),
        squares + error * error,
        max(true_peak, true_error),
        true_squares + true_error * true_error,
        min(upright, 1.0 - 2.0 * (qx * qx + qy * qy)),
        limited + (1 if out.limited else 0),
        on_bound + (1 if bounds > 0 else 0),
    )  # fmt: skip


def outcome(tally: Tally, ending: int, flown_s: float) -> Outcome:
    """How a flight went."""
    ticks, peak, squares, true_peak, true_squares, upright, limited, on_bound = tally
    count = max(ticks, 1)
    return Outcome(
        ending, ticks, flown_s, peak, math.sqrt(squares / count), true_peak, math.sqrt(true_squares / count),
        math.acos(max(min(upright, 1.0), -1.0)), limited, on_bound,
    )  # fmt: skip


def write(row: Floats, sample_s: float, setpoint: AttitudeSetpoint, place: Vector) -> None:
    """One tick of the trace."""
    row[0] = sample_s
    row[1], row[2], row[3], row[4], row[5] = setpoint
    row[6], row[7], row[8] = place


def fly(
    constants: vehicle.Constants,
    state: vehicle.State,
    actuation: Actuation,
    sensors: Sensors,
    memory: Memory,
    air: Air,
    turbulence: DrydenState,
    wind_ned_m_s: Vector,
    battery: float,
    air_words: Words,
    air_kept: Floats,
    pilot: Pilot,
    mission: Mission,
    type_mask: int,
    timeline: Flags,
    begin_us: int,
    trace: Floats,
) -> Outcome:
    """One flight from `begin_us` on, for as long as `timeline` lasts, a flag a millisecond.

    `trace` (n, 9) takes the time of each tick's sample, its set-point and the true place, as many as there is room for.
    """
    params, control, corrects, correction_params, correction, sample_s, first = pilot
    execute(first, type_mask, actuation.setpoint)
    reported = true = vehicle.truth(state)
    sample = sample_of(reported, begin_us)
    tally = Tally(0, 0.0, 0.0, 0.0, 0.0, 1.0, 0, 0)
    ending, elapsed_s = TIME_OVER, 0.0
    for k in range(len(timeline)):
        now_us, happens = begin_us + 1000 * k, timeline[k]
        if happens & (ESTIMATE | READ):
            truth = vehicle.truth(state)
            if not sensors.used:
                reported = truth
            elif now_us != memory.marks[0]:  # the same instant gives the same answer
                reported = sensing.report(sensors, memory, truth, now_us)
            if happens & READ:
                sample, true = sample_of(reported, now_us), truth
        if happens & ANSWER:
            elapsed_s = sample.time_s - mission.since_s
            dt_s, sample_s = sample.time_s - sample_s, sample.time_s
            seen = sample
            if corrects:
                correction, seen = estimate_correction.step(correction_params, correction, sample, dt_s)
            control, out = position.step(params, control, seen, command_at(mission, elapsed_s), dt_s)
            qw, qx, qy, qz, thrust = out.setpoint
            if not math.isfinite(qw + qx + qy + qz + thrust):
                ending = NOT_FINITE
                break
            execute(out.setpoint, type_mask, actuation.setpoint)
            if tally.ticks < len(trace):
                write(trace[tally.ticks], sample.time_s, out.setpoint, true[0])
            tally = counted(tally, params, control, out, true)
            if elapsed_s >= mission.duration_s - 1e-9:
                ending = COMPLETE
                break
        if happens & CONTROL and air.used:
            turbulence, wind_ned_m_s = airs.blow(air, turbulence, wind_ned_m_s, now_us, air_words, air_kept)
            battery = max(battery - STEP_S * air.sag_1_s, 0.0)
        attitude, thrust, angles = arrive(actuation, k)
        state = vehicle.step(constants, state, attitude, angles, thrust, battery, wind_ned_m_s)
        if vehicle.grounded(state):
            ending = GROUND
            break
    return outcome(tally, ending, elapsed_s)
