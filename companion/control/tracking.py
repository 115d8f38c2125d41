"""The frame that moves with a trajectory, and the force that the trajectory itself needs, fed forward early.

With the reference trajectory r(t) and xi = x - r the plant (15) of an axis stays a double integrator,

    xi'' = g w - r'' = g w~,    w~ = w - r''/g,

so (19)-(23) fly it unchanged with xi, xi' as regressors, w~ in the hedge and the command zero. What is commanded is

    u = u~ + f,    g f(t) = r'' + l1 r''' + l2 r'''',

where f is r''/g sent through the inverse of the identified attitude response, to second order in s: a response
wn^2/(s^2 + 2 zeta wn s + wn^2) behind a delay T has l1 = 2 zeta/wn + T, l2 = 1/wn^2 + 2 zeta T/wn + T^2/2
(`docs/trajectories.md`). l1 is the lag: to first order f is the acceleration that comes so much later.

The force against a disturbance comes as late as any: it is that of the bias weight b, whose rate (22) has at hand, so
-l1 b' is added. u~ has neither f nor that in it. The hedge compares the measured w~ with u~, so that the error e = x -
x_r obeys the same equation as before, and in (24) both are bounded inputs (`docs/trajectories.md`).

References and integrators stay where they are in space. What a trajectory's own derivatives do not explain of its
motion is a step of the command, which the reference model works off as any other.
"""

from __future__ import annotations

from typing import NamedTuple

from companion.control import altitude, frame
from companion.control.mrac import AxisState
from companion.control.types import Horizontal, Reference


class LeadParams(NamedTuple):
    """l1 and l2 of the attitude response of each axis, and the delay of the thrust; zero: fed forward as it is now."""

    x1_s: float = 0.0
    x2_s2: float = 0.0
    y1_s: float = 0.0
    y2_s2: float = 0.0
    thrust_s: float = 0.0


class Frame(NamedTuple):
    """Velocity and acceleration of the frame at the last tick, local NED, and what was fed forward upwards then."""

    moving: bool
    vx_m_s: float
    vy_m_s: float
    vz_m_s: float
    ax_m_s2: float
    ay_m_s2: float
    az_m_s2: float
    fed_up: float  # specific force over g


AT_REST = Frame(False, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


def move(reference: Reference, lead: LeadParams, gravity_m_s2: float) -> Frame:
    """The frame on a trajectory."""
    _, _, _, vx, vy, vz, ax, ay, az, _, _, jz, _, _, _, _ = reference
    return Frame(True, vx, vy, vz, ax, ay, az, -(az + lead.thrust_s * jz) / gravity_m_s2)


def feed(reference: Reference, lead: LeadParams, c: float, s: float, gravity_m_s2: float) -> tuple[float, float]:
    """f along x and y of the control frame, whose heading has the cosine and sine given."""
    _, _, _, _, _, _, ax, ay, _, jx, jy, _, sx, sy, _, _ = reference
    x1, x2, y1, y2, _ = lead
    along = c * ax + s * ay + x1 * (c * jx + s * jy) + x2 * (c * sx + s * sy)
    across = c * ay - s * ax + y1 * (c * jy - s * jx) + y2 * (c * sy - s * sx)
    return along / gravity_m_s2, across / gravity_m_s2


def foresee(lag_s: float, bias_before: float, bias: float, dt_s: float) -> float:
    """What the force against the disturbance found, minus the bias weight, will be a lag later than it is now."""
    return lag_s * (bias_before - bias) / dt_s if dt_s > 0.0 else 0.0


def enter(
    before: Frame,
    now: Frame,
    x: AxisState,
    y: AxisState,
    shift_x_m: float,
    shift_y_m: float,
    measured: Horizontal,
    c: float,
    s: float,
    gravity_m_s2: float,
    dt_s: float,
) -> tuple[AxisState, AxisState, float, float, Horizontal]:
    """Both axes, the anchor's step along each, and what was measured, seen from the frame as it moves now.

    `shift_x_m` and `shift_y_m` are all of the anchor's way since the last tick. What of it, and of the change of
    velocity, the frame's own velocity and acceleration explain, references do not notice.
    """
    _, vx0, vy0, _, ax0, ay0, _, _ = before
    _, vx, vy, _, ax, ay, _, _ = now
    faster_north, faster_east = 0.5 * dt_s * (ax0 + ax), 0.5 * dt_s * (ay0 + ay)
    step_north, step_east = vx - vx0 - faster_north, vy - vy0 - faster_east
    north, east = dt_s * (vx - 0.5 * faster_north), dt_s * (vy - 0.5 * faster_east)  # a step came before the way
    at_x, speed_x, wx, at_y, speed_y, wy = measured
    return (
        frame.push(x, -(c * step_north + s * step_east)),
        frame.push(y, -(c * step_east - s * step_north)),
        shift_x_m - (c * north + s * east),
        shift_y_m - (c * east - s * north),
        Horizontal(
            at_x,
            speed_x - (c * vx + s * vy),
            wx - (c * ax + s * ay) / gravity_m_s2,
            at_y,
            speed_y - (c * vy - s * vx),
            wy - (c * ay - s * ax) / gravity_m_s2,
        ),
    )


def climb(
    params: altitude.AltitudeParams,
    state: altitude.AltitudeState,
    before: Frame,
    now: Frame,
    z_m: float,
    velocity_down_m_s: float,
    frame_z_m: float,
    dt_s: float,
    flown_up: float,
    lowest_up: float,
    highest_up: float,
    hover_ratio: float,
) -> tuple[altitude.AltitudeState, float]:
    """(4) in the moving frame, as `altitude.step`, what the trajectory needs included in its answer.

    The state stays that of the fixed frame. `frame_z_m` is where the trajectory is now, down.
    """
    fed, velocity = now.fed_up, now.vz_m_s
    faster = 0.5 * dt_s * (before.az_m_s2 + now.az_m_s2)
    down = dt_s * (velocity - 0.5 * faster)
    state = altitude.shift(state, down - frame_z_m, faster - velocity)
    state, up = altitude.step(
        params, state, z_m - frame_z_m, velocity_down_m_s - velocity, 0.0, dt_s,
        flown_up - before.fed_up, lowest_up - fed, highest_up - fed, hover_ratio,
    )  # fmt: skip
    return altitude.shift(state, frame_z_m, velocity), up + fed
