"""The whole position controller: odometry and command in, attitude set-point out.

The control frame is NED moved to the anchor and turned by the yaw set-point, so that its x is pitch and its y is roll.
The adaptation gain grows with the square of the distance from the anchor: it stays where control began (the paper), or
goes along with the flown set-point (the regulation form, for flight).
"""

from __future__ import annotations

import math
from typing import NamedTuple

from companion.control import altitude, attitude, ease, frame, hover, limits, mrac, setpoint, tracking
from companion.control.reference_model import discretise
from companion.control.types import AttitudeSetpoint, Horizontal, Jump, Odometry, PositionSetpoint, Reference


class PositionParams(NamedTuple):
    """Both axes, the altitude cascade, and what the vehicle can do."""

    x: mrac.AxisParams
    y: mrac.AxisParams
    altitude: altitude.AltitudeParams
    one_axis: bool  # a rig on guides: x only, and the thrust stays at hover, as under (28)
    anchored_at_setpoint: bool
    limits: limits.LimitParams
    setpoint: setpoint.SetpointParams
    hover: hover.HoverParams
    lead: tracking.LeadParams = tracking.LeadParams()


class PositionState(NamedTuple):
    """Everything that one tick leaves to the next."""

    x: mrac.AxisState
    y: mrac.AxisState
    altitude: altitude.AltitudeState
    hover: hover.HoverState
    anchor_x_m: float
    anchor_y_m: float
    flown: PositionSetpoint  # the set-point on its way to the target; its yaw is the control frame's
    force: tuple[float, float, float]  # flown over the last tick: specific force over g, control frame, positive up
    thrust: float  # normalised, over the last tick
    ease: ease.EaseState
    frame: tracking.Frame  # that moves with a trajectory, at the last tick


class PositionOutput(NamedTuple):
    """The set-point, what was measured, and what each axis thought of it."""

    setpoint: AttitudeSetpoint
    measured: Horizontal
    x: mrac.AxisOutput
    y: mrac.AxisOutput
    limited: bool  # a limit cut the force
    thrust_limited: bool  # the vertical force was cut: the thrust is at its limit


def engage(
    params: PositionParams,
    odometry: Odometry,
    yaw_rad: float,
    weights_x: tuple[float, float],
    weights_y: tuple[float, float],
    hover_thrust: float,
    lift: float = 1.0,
) -> PositionState:
    """A bumpless start: anchor, references and integrators on the vehicle; weights are (position, velocity).

    It begins with the attitude that the vehicle has and the thrust that carries it, `lift` times `hover_thrust`. What
    the law wants where it is and as it moves is eased into; a command to be elsewhere is not.
    """
    now = frame.in_control_frame(odometry, odometry.x_m, odometry.y_m, math.cos(yaw_rad), math.sin(yaw_rad), 1.0)
    _, _, down = attitude.thrust_direction(odometry.qw, odometry.qx, odometry.qy, odometry.qz)
    upright = max(-down, 0.1)  # the guard on tilt ends control long before that
    size = 1.0 if params.one_axis else lift / upright  # a rig's thrust is turned, a free one also carries the weight
    wx, wy = size * now.wx, size * now.wy
    z = altitude.start(odometry.z_m, odometry.vz_m_s, lift, params.altitude.gravity_m_s2)
    _, up = altitude.step(
        params.altitude, z, odometry.z_m, odometry.vz_m_s, odometry.z_m, 0.0, 1.0,
        params.limits.thrust_min / hover_thrust, params.limits.thrust_max / hover_thrust, 1.0,
    )  # fmt: skip
    brake_x = min(max(weights_x[1], params.x.velocity_weight_lower), params.x.velocity_weight_upper) * now.vx_m_s
    brake_y = min(max(weights_y[1], params.y.velocity_weight_lower), params.y.velocity_weight_upper) * now.vy_m_s
    return PositionState(
        mrac.start(now.x_m, now.vx_m_s, weights_x[0], weights_x[1], wx),
        mrac.start(now.y_m, now.vy_m_s, weights_y[0], weights_y[1], wy),
        z,
        hover.start(hover_thrust, odometry.vz_m_s),
        odometry.x_m,
        odometry.y_m,
        PositionSetpoint(odometry.x_m, odometry.y_m, odometry.z_m, yaw_rad),
        (wx, wy, size * upright),
        size * hover_thrust,
        ease.EaseState(wx + brake_x, wy + brake_y, lift - up, ease.DURATION_S, False),
        tracking.AT_REST,
    )


def reseat(state: PositionState, jump: Jump) -> PositionState:
    """The estimate jumped and the vehicle did not: everything that is remembered jumps along.

    What stays of it, a law that sees another velocity or heading, is eased into from the force flown last. Tilt and
    thrust are the vehicle's own and stay in the control frame, which turns with the heading.
    """
    x, y, z, lift, anchor_x, anchor_y, flown, force, thrust, _, moved = state
    yaw = flown.yaw_rad + jump.yaw_rad
    c, s = math.cos(yaw), math.sin(yaw)
    x, y = frame.turn_references(x, y, jump.yaw_rad)
    return PositionState(
        frame.push(x, c * jump.vx_m_s + s * jump.vy_m_s),
        frame.push(y, c * jump.vy_m_s - s * jump.vx_m_s),
        altitude.shift(z, jump.z_m, jump.vz_m_s),
        hover.shift(lift, jump.vz_m_s),
        anchor_x + jump.x_m,
        anchor_y + jump.y_m,
        PositionSetpoint(flown.x_m + jump.x_m, flown.y_m + jump.y_m, flown.z_m + jump.z_m, yaw),
        force,
        thrust,
        ease.EaseState(0.0, 0.0, 0.0, 0.0, True),
        moved,
    )


def step(
    params: PositionParams,
    state: PositionState,
    odometry: Odometry,
    command: PositionSetpoint,
    dt_s: float,
    reference: Reference | None = None,
) -> tuple[PositionState, PositionOutput]:
    """One tick of the position loop: (4) and (19)-(22) for the force, (5)-(6) for the attitude that makes it.

    With a `reference` it flies that instant of a trajectory, in the frame that moves with it (`control.tracking`), and
    not the command. The anchor must be at the set-point.
    """
    params_x, params_y, params_z, one_axis, anchored_at_setpoint, bounds, travel, estimation, lead = params
    x, y, z, lift, anchor_x, anchor_y, flown, force, thrust, easing, before = state
    yaw, gravity, after = flown.yaw_rad, bounds.gravity_m_s2, tracking.AT_REST
    if reference is not None:
        flown = PositionSetpoint(reference.x_m, reference.y_m, reference.z_m, reference.yaw_rad)
        after = tracking.move(reference, lead, gravity)
    elif command != flown:
        flown = setpoint.advance(travel, flown, command, dt_s)
    command_x, command_y, command_z, flown_yaw = flown
    if flown_yaw != yaw:
        by = setpoint.turn(yaw, flown_yaw)
        x, y = frame.turn(x, y, by)
        force, easing = frame.turn_force(force, by), ease.turn(easing, by)
        yaw = flown_yaw

    hover_before = lift[0]
    if estimation.rate_1_s > 0.0:
        upright = 1.0 - 2.0 * (odometry.qx * odometry.qx + odometry.qy * odometry.qy)
        lift = hover.step(estimation, lift, odometry.vz_m_s, thrust * upright, dt_s)
    hover_thrust = lift[0]

    c, s = math.cos(yaw), math.sin(yaw)
    north, east = command_x - anchor_x, command_y - anchor_y  # the command, seen from the anchor
    ahead, aside = c * north + s * east, c * east - s * north
    shift_x = shift_y = 0.0
    if anchored_at_setpoint:
        anchor_x, anchor_y, shift_x, shift_y, ahead, aside = command_x, command_y, ahead, aside, 0.0, 0.0
    now = frame.in_control_frame(odometry, anchor_x, anchor_y, c, s, thrust / hover_thrust)
    if after.moving or before.moving:
        x, y, shift_x, shift_y, now = tracking.enter(before, after, x, y, shift_x, shift_y, now, c, s, gravity, dt_s)
    at_x, vx, wx, at_y, vy, wy = now
    omega, damping = params_x[0], params_x[1]
    over = discretise(omega, damping, dt_s)
    bias_x, bias_y = x.bias_weight, y.bias_weight
    x, out_x = mrac.step(params_x, x, over, shift_x, at_x, vx, wx, ahead, dt_s)
    if one_axis:
        out_y, up = mrac.AxisOutput(0.0, 0.0, 0.0, 0.0), 1.0
    else:
        if params_y[0] != omega or params_y[1] != damping:
            over = discretise(params_y[0], params_y[1], dt_s)
        y, out_y = mrac.step(params_y, y, over, shift_y, at_y, vy, wy, aside, dt_s)
        z, up = _climb(
            params_z, bounds, z, before, after, odometry, command_z, dt_s, force[2], hover_before, hover_thrust
        )
    along, across = out_x.control, out_y.control
    if reference is not None:
        fed_along, fed_across = tracking.feed(reference, lead, c, s, gravity)
        along += fed_along + tracking.foresee(lead.x1_s, bias_x, x.bias_weight, dt_s)
        across += fed_across + tracking.foresee(lead.y1_s, bias_y, y.bias_weight, dt_s)
    if easing.due or easing.left_s > 0.0:
        easing, along, across, up = ease.step(easing, (along, across, up), force, dt_s)

    force, answer, cut, up_cut = _attain(bounds, one_axis, along, across, up, hover_thrust, c, s)
    return (
        PositionState(x, y, z, lift, anchor_x, anchor_y, flown, force, answer.thrust, easing, after),
        PositionOutput(answer, now, out_x, out_y, cut or up_cut, up_cut),
    )


def _climb(
    params: altitude.AltitudeParams,
    bounds: limits.LimitParams,
    state: altitude.AltitudeState,
    before: tracking.Frame,
    after: tracking.Frame,
    odometry: Odometry,
    command_z_m: float,
    dt_s: float,
    flown_up: float,
    hover_before: float,
    hover_thrust: float,
) -> tuple[altitude.AltitudeState, float]:
    """The altitude cascade in the frame that is flown in."""
    z_m, vz_m_s = odometry.z_m, odometry.vz_m_s
    lowest, highest, ratio = (
        bounds.thrust_min / hover_thrust, bounds.thrust_max / hover_thrust, hover_before / hover_thrust
    )  # fmt: skip
    if after.moving or before.moving:
        return tracking.climb(
            params, state, before, after, z_m, vz_m_s, command_z_m, dt_s, flown_up, lowest, highest, ratio
        )
    return altitude.step(params, state, z_m, vz_m_s, command_z_m, dt_s, flown_up, lowest, highest, ratio)


def _attain(
    bounds: limits.LimitParams, one_axis: bool, x: float, y: float, up: float, hover_thrust: float, c: float, s: float
) -> tuple[tuple[float, float, float], AttitudeSetpoint, bool, bool]:
    """(force within the limits, the set-point that makes it, whether anything was cut, whether `up` was)."""
    if one_axis:
        x, y, up, cut, up_cut = limits.limit_level(bounds, x)
    else:
        x, y, up, cut, up_cut = limits.limit(bounds, x, y, up, hover_thrust)
    qw, qx, qy, qz, size = attitude.orient(c * x - s * y, s * x + c * y, -up, c, s)
    thrust = min(size * hover_thrust, bounds.thrust_max)
    return (x, y, up), AttitudeSetpoint(qw, qx, qy, qz, thrust), cut, up_cut


def lean(
    params: PositionParams, state: PositionState, trim: tuple[float, float], roll_rad: float, pitch_rad: float
) -> tuple[PositionState, AttitudeSetpoint]:
    """A lean of so much about a trim in place of what the last step asked for, the vertical force kept.

    `trim` is what a steady wind needs, specific force over g in the control frame. Out: the state of a vehicle that
    flies this, and the set-point.
    """
    x, y, z, lift, anchor_x, anchor_y, flown, (_, _, up), _, easing, moved = state
    c, s = math.cos(flown.yaw_rad), math.sin(flown.yaw_rad)
    along = math.tan(math.atan(trim[0]) - pitch_rad)
    across = 0.0 if params.one_axis else math.tan(math.atan(trim[1]) + roll_rad)
    along, across = (math.sin(math.atan(along)), across) if params.one_axis else (up * along, up * across)
    force, answer, _, _ = _attain(params.limits, params.one_axis, along, across, up, lift.hover_thrust, c, s)
    return (
        PositionState(x, y, z, lift, anchor_x, anchor_y, flown, force, answer.thrust, easing, moved),
        answer,
    )
