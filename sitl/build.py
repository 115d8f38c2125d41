"""From the `plant` section of a config to a vehicle."""

from __future__ import annotations

from companion.config import Config
from companion.config.plant import Angle, Cascade, QuadrotorPlant, RigPlant
from sitl.attitude_loop import AngleGains, RateGains, Response
from sitl.quadrotor import QuadrotorParams
from sitl.rig import RigParams
from sitl.vehicle import Quadrotor, Rig, Vehicle

_NO_RESPONSE = Response(1.0, 0.0, 0.0)
_NO_RATE_LOOP = RateGains(0.0, 0.0, 0.0, 1.0, 0.0)


def _response(angle: Angle | None) -> Response:
    if angle is None:
        return _NO_RESPONSE
    return Response(angle.bandwidth_rad_s or 0.0, angle.natural_frequency_rad_s or 0.0, angle.damping_ratio or 0.0)


def _rate_gains(cascade: Cascade | None) -> RateGains:
    if cascade is None:
        return _NO_RATE_LOOP
    rate = cascade.rate
    return RateGains(
        rate.proportional_1_s, rate.integral_1_s2, rate.derivative, rate.filter_bandwidth_rad_s,
        rate.integral_limit_rad_s2,
    )  # fmt: skip


def rig_params(section: RigPlant) -> RigParams:
    """Parameters of (27)-(28)."""
    return RigParams(
        section.viscous_friction_1_s,
        section.coulomb_friction_m_s2,
        section.coulomb_width_m_s,
        section.cascade is not None,
        _response(section.pitch),
        section.cascade.pitch_gain_1_s if section.cascade else 0.0,
        _rate_gains(section.cascade),
    )


def quadrotor_params(section: QuadrotorPlant) -> QuadrotorParams:
    """Parameters of (1)-(2) and (7)."""
    cascade = section.cascade
    rate = _rate_gains(cascade)
    return QuadrotorParams(
        section.mass_kg,
        section.drag_n_s2_m2,
        *section.inertia_kg_m2,
        cascade is not None,
        _response(section.roll),
        _response(section.pitch),
        _response(section.yaw),
        AngleGains(cascade.roll_gain_1_s, cascade.pitch_gain_1_s, cascade.yaw_gain_1_s)
        if cascade
        else AngleGains(0.0, 0.0, 0.0),
        rate,
        rate,
        rate,
    )


def build_vehicle(config: Config) -> Vehicle:
    """The vehicle that the config describes. Raises `ValueError` when it has no `plant` section."""
    plant = config.plant
    if plant is None:
        raise ValueError("the config has no plant section: there is nothing to simulate")
    hover, delay = config.vehicle.hover_thrust, plant.setpoint_delay_s
    if plant.rig is not None:
        return Rig(rig_params(plant.rig), hover, delay)
    assert plant.quadrotor is not None  # the schema holds exactly one
    return Quadrotor(quadrotor_params(plant.quadrotor), hover, delay)
