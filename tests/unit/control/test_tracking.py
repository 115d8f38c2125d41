"""The frame that moves with a trajectory: in it the controller is the one that hovers, and its force comes in time."""

import math

import pytest
from harness.processes import ROOT

from companion.attitude_response.inverse import inverse
from companion.config import load_config
from companion.config.attitude import response_of
from companion.control import altitude, position, tracking
from companion.control.types import Odometry, PositionSetpoint, Reference
from companion.flight.pilot.controller_params import initial_weights, lead_params, position_params
from companion.trajectory.curves import Lemniscate
from companion.trajectory.trajectory import Hold, Trajectory

CONFIG = load_config(ROOT / "config" / "trajectories.yaml")
PARAMS = position_params(CONFIG, hedging=True)._replace(lead=lead_params(CONFIG))
DT_S = 0.004
G = 9.81


def moving(x: float, vx: float, ax: float = 0.0, vz: float = 0.0, yaw: float = 0.0, z: float = -2.0) -> Reference:
    return Reference(x, 0.0, z, vx, 0.0, vz, ax, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, yaw)


def odometry(time_s: float, x: float, vx: float, z: float = -2.0, vz: float = 0.0) -> Odometry:
    return Odometry(time_s, x, 0.0, z, vx, 0.0, vz, 1.0, 0.0, 0.0, 0.0)


def engaged(x: float, vx: float) -> position.PositionState:
    weights = initial_weights(CONFIG, PARAMS.x)
    state = position.engage(PARAMS, odometry(0.0, x, vx), 0.0, weights, weights, 0.49)
    return state._replace(ease=state.ease._replace(left_s=0.0))


def test_in_a_frame_of_constant_velocity_it_answers_as_at_rest() -> None:
    """Galileo: the same error gives the same set-point, horizontally and vertically."""
    speed, climb = 1.5, -0.4
    still, flying = engaged(0.1, 0.05), engaged(0.1, 0.05 + speed)
    for k in range(1, 250):
        t = DT_S * k
        x, vx = 0.1 * math.cos(3 * t), -0.3 * math.sin(3 * t)
        z, vz = -2.0 + 0.05 * math.sin(2 * t), 0.1 * math.cos(2 * t)
        here, there = odometry(t, x, vx, z, vz), odometry(t, x + speed * t, vx + speed, z + climb * t, vz + climb)
        still, at_rest = position.step(PARAMS, still, here, PositionSetpoint(0, 0, 0, 0), DT_S, moving(0.0, 0.0))
        flying, on_the_way = position.step(
            PARAMS, flying, there, PositionSetpoint(0, 0, 0, 0), DT_S,
            moving(speed * t, speed, vz=climb, z=-2.0 + climb * t),
        )  # fmt: skip
        if k == 1:  # the references were at rest in space: from here on they are where the errors are
            flying = flying._replace(x=still.x, altitude=still.altitude._replace(
                reference_z_m=still.altitude.reference_z_m + climb * t,
                reference_velocity_m_s=still.altitude.reference_velocity_m_s + climb,
                filtered_velocity_m_s=still.altitude.filtered_velocity_m_s + climb,
            ), hover=still.hover, force=still.force, thrust=still.thrust)  # fmt: skip
        elif k > 1:
            assert on_the_way.x.control == pytest.approx(at_rest.x.control, abs=1e-9)
            assert on_the_way.measured == pytest.approx(at_rest.measured, abs=1e-9)
        flying = flying._replace(hover=still.hover)  # whose filter looks at the velocity in space


def fly(trajectory: Trajectory, params: position.PositionParams, seconds: float) -> list[float]:
    """Errors, m, of a double integrator behind the attitude response in the middle of the config's intervals."""
    wn, zeta, delay_s = 9.6, 0.95, 0.0325
    state = engaged(0.0, 0.0)._replace(altitude=altitude.start(0.0, 0.0))
    places, speeds, tilt, rate = [0.0, 0.0], [0.0, 0.0], [0.0, 0.0], [0.0, 0.0]
    commanded = [(0.0, 0.0)] * round(delay_s / DT_S)
    errors = []
    for k in range(round(seconds / DT_S)):
        at = trajectory.at(DT_S * k)
        pitch = -math.atan(tilt[0])
        roll = math.atan(tilt[1] * math.cos(pitch))
        cp, sp, cr, sr = math.cos(pitch / 2), math.sin(pitch / 2), math.cos(roll / 2), math.sin(roll / 2)
        sample = Odometry(DT_S * k, *places, 0.0, *speeds, 0.0, cr * cp, sr * cp, cr * sp, -sr * sp)
        lift = 1.0 / math.cos(roll) / math.cos(pitch)
        state = state._replace(hover=state.hover._replace(hover_thrust=0.49), thrust=0.49 * lift)
        state, _ = position.step(params, state, sample, PositionSetpoint(0, 0, 0, 0), DT_S if k else 0.0, at)
        errors.append(math.hypot(places[0] - at.x_m, places[1] - at.y_m))
        commanded.append((state.force[0] / state.force[2], state.force[1] / state.force[2]))
        wanted = commanded.pop(0)
        for axis in (0, 1):
            rate[axis] += DT_S * (wn * wn * (wanted[axis] - tilt[axis]) - 2 * zeta * wn * rate[axis])
            tilt[axis] += DT_S * rate[axis]
            speeds[axis] += DT_S * G * tilt[axis]
            places[axis] += DT_S * speeds[axis]
    return errors


def rms(values: list[float]) -> float:
    return math.sqrt(sum(v * v for v in values) / len(values))


def test_the_force_through_the_inverse_response_comes_in_time() -> None:
    """Without lead the vehicle is behind; with the lag alone much less; with the snap too least."""
    eight = Lemniscate(4.0, 2.0, 2.0, 1.0, 3.0)
    lead = PARAMS.lead
    late = rms(fly(eight, PARAMS._replace(lead=tracking.LeadParams()), 11.0))
    early = rms(fly(eight, PARAMS._replace(lead=lead._replace(x2_s2=0.0, y2_s2=0.0)), 11.0))
    exact = rms(fly(eight, PARAMS, 11.0))
    assert exact < early < 0.5 * late
    assert exact < 0.01


def test_a_trajectory_at_rest_is_a_hover() -> None:
    assert max(fly(Hold(2.0), PARAMS, 2.0)) < 1e-9


def test_references_stay_where_they_are_when_a_trajectory_ends_in_motion() -> None:
    """A step of the command: the set-point stops, the vehicle and its reference do not."""
    state = engaged(0.0, 1.0)
    for k in range(1, 50):
        at = moving(DT_S * k, 1.0)
        state, _ = position.step(
            PARAMS, state, odometry(DT_S * k, DT_S * k, 1.0), PositionSetpoint(0, 0, 0, 0), DT_S, at
        )
    before = state.anchor_x_m + state.x.reference_position_m, 1.0 + state.x.reference_velocity_m_s
    goal = PositionSetpoint(state.flown.x_m, 0.0, -2.0, 0.0)
    state, out = position.step(PARAMS, state, odometry(DT_S * 50, DT_S * 50, 1.0), goal, DT_S)
    after = state.anchor_x_m + state.x.reference_position_m, state.x.reference_velocity_m_s
    assert after[0] == pytest.approx(before[0] + DT_S, abs=2e-4)
    assert after[1] == pytest.approx(before[1], abs=0.05)
    assert out.measured.vx_m_s == pytest.approx(1.0)
    assert not state.frame.moving


def test_the_inverse_of_a_second_order_is_its_lag_and_more() -> None:
    section = CONFIG.attitude.x.model_copy(
        update={"natural_frequency_rad_s": 9.5, "damping_ratio": 0.9, "delay_s": 0.03}
    )
    found = inverse(response_of(section))
    lag = 2 * 0.9 / 9.5
    assert found.first_s == pytest.approx(lag + 0.03)
    assert found.second_s2 == pytest.approx(1 / 9.5**2 + lag * 0.03 + 0.03**2 / 2)
    assert found.spread_s == 0.0
    box = inverse(response_of(CONFIG.attitude.x))
    assert box.spread_s == pytest.approx(max(2 / 9 + 0.045 - box.first_s, box.first_s - 1.8 / 10.2 - 0.02))
