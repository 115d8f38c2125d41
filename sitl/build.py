"""From the `plant` section of a config to a plant."""

from __future__ import annotations

import math
import struct
from collections.abc import Callable, Mapping
from random import Random
from typing import Final, NamedTuple

from companion.attitude_response.kind import LinearResponse
from companion.attitude_response.kinds import FirstOrder
from companion.config import Config, ConfigError
from companion.config.plant import Plant
from companion.config.plant.disturbances import DirectionSection, RadioSection, SensorsSection, WindSection
from companion.config.vehicles import Angle, Cascade, QuadrotorPlant, RigPlant, VehicleName
from sitl.autopilot.autopilot import Autopilot
from sitl.autopilot.parameters import PX4_DEFAULTS, Parameters, Px4Version
from sitl.vehicles.attitude_loop import AngleGains, RateGains
from sitl.vehicles.quadrotor import QuadrotorParams
from sitl.vehicles.rig import RigParams
from sitl.vehicles.vehicle import Quadrotor, Rig, Vehicle
from sitl.wire.impairments import Channel, Impairments
from sitl.wire.wire import Channels
from sitl.world.environment import Environment, Turbulence, Wind
from sitl.world.estimator import Estimator, Lag, Noise
from sitl.world.navigation_error import PRESETS
from sitl.world.wind import Gust

_NO_RESPONSE = LinearResponse(FirstOrder, (1.0,))
_NO_RATE_LOOP = RateGains(0.0, 0.0, 0.0, 1.0, 0.0)


def _response(angle: Angle | None) -> LinearResponse:
    return _NO_RESPONSE if angle is None else angle.response


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


def build_rig(plant: Plant, hover_thrust: float) -> Rig:
    """The rig of a plant section that has one."""
    flown = plant.rig
    assert flown is not None
    delay_s = plant.setpoint_delay_s + (flown.pitch.delay_s if flown.pitch else 0.0)
    return Rig(rig_params(flown), hover_thrust, delay_s)


def build_quadrotor(plant: Plant, hover_thrust: float) -> Quadrotor:
    """The quadrotor of a plant section that has one, as it really is."""
    flown, mismatch = plant.quadrotor, plant.mismatch
    assert flown is not None
    believed = quadrotor_params(flown)
    true = believed._replace(
        mass_kg=mismatch.mass * believed.mass_kg, drag_n_s2_m2=mismatch.drag * believed.drag_n_s2_m2
    )
    roll_s, pitch_s, yaw_s = (0.0 if angle is None else angle.delay_s for angle in (flown.roll, flown.pitch, flown.yaw))
    return Quadrotor(
        true,
        hover_thrust,
        plant.setpoint_delay_s,
        thrust_factor=mismatch.thrust / mismatch.mass,
        angle_delays_s=(roll_s, pitch_s, yaw_s),
    )


BUILDERS: Final[Mapping[VehicleName, Callable[[Plant, float], Vehicle]]] = {
    "rig": build_rig,
    "quadrotor": build_quadrotor,
}
"""By kind of vehicle: from the plant section and the hover thrust to the physics."""


def build_vehicle(config: Config) -> Vehicle:
    """The vehicle that the config describes. Raises `ValueError` when it has no `plant` section."""
    plant = config.plant
    if plant is None:
        raise ValueError("the config has no plant section: there is nothing to simulate")
    return BUILDERS[plant.kind.name](plant, config.vehicle.hover_thrust)


class World(NamedTuple):
    """An autopilot with all that may go wrong around it; `None` where nothing does. Pickling copies it."""

    autopilot: Autopilot
    environment: Environment | None
    estimator: Estimator | None
    channels: Channels | None


def plant_parameters(config: Config) -> Parameters:
    """PX4's parameters as the config has them, the gains of its attitude response included. Raises `ConfigError`."""
    assert config.plant is not None  # the caller has checked
    version = Px4Version(config.plant.px4_version)
    defaults = PX4_DEFAULTS[version]
    ids = {"MAV_SYS_ID": config.vehicle.system_id, "MAV_COMP_ID": config.vehicle.component_id}
    identified = {
        name: type(defaults[name])(value) for name, value in config.vehicle.parameters.items() if name in defaults
    }
    hover = {"MPC_THR_HOVER": config.vehicle.hover_thrust}
    try:
        return Parameters({**hover, **identified, **config.plant.parameters, **ids}, version)
    except KeyError as error:
        raise ConfigError(f"plant.parameters: the plant, PX4 {version}, has no parameter {error}") from None
    except TypeError as error:
        raise ConfigError(f"plant.parameters: {error}") from None
    except (OverflowError, struct.error):
        raise ConfigError("plant.parameters: a value does not fit into 32 bits") from None


def build_world(config: Config, *, complete: bool = False) -> World:
    """The plant of a config: only what its `plant` section asks for, or, `complete`, everything, harmless as yet.

    Raises `ConfigError`; `ValueError` when there is no `plant` section.
    """
    vehicle = build_vehicle(config)
    plant = config.plant
    assert plant is not None
    autopilot = Autopilot(vehicle, plant_parameters(config), like_px4=plant.telemetry == "px4")

    def random(name: str) -> Random:
        return Random(f"{plant.seed} {name}")  # one each, so that one fault does not change another's luck

    environment = estimator = channels = None
    if complete or plant.wind is not None or plant.battery_sag_1_s:
        environment = Environment(vehicle, random("environment"), wind(plant.wind), plant.battery_sag_1_s)
        autopilot.on_control = environment.step
    if complete or plant.sensors is not None:
        sensors = plant.sensors or SensorsSection()
        estimator = Estimator(
            autopilot.truth,
            autopilot.now_us,
            random("estimator"),
            Noise(sensors.position_m, sensors.velocity_m_s, math.radians(sensors.attitude_deg), sensors.correlation_s),
            Lag(sensors.delay_s, sensors.jitter_s),
            None if sensors.preset is None else PRESETS[sensors.preset],
        )
        autopilot.estimate = estimator
    if complete or plant.link is not None:
        link = plant.link or RadioSection()
        channels = Channels(
            Channel(random("down"), impairments(link.down)), Channel(random("up"), impairments(link.up))
        )
    return World(autopilot, environment, estimator, channels)


def wind(section: WindSection | None) -> Wind | None:
    """The wind that a config describes."""
    if section is None:
        return None
    gust, turbulence = section.gust, section.turbulence
    return Wind(
        section.mean_ned_m_s,
        None if gust is None else Gust(gust.peak_ned_m_s, gust.start_s, gust.rise_s, gust.hold_s, gust.every_s),
        None if turbulence is None else Turbulence(turbulence.wind_at_20_ft_m_s, turbulence.altitude_m),
    )


def impairments(section: DirectionSection) -> Impairments:
    """What a config says about one direction of the link."""
    return Impairments(**section.model_dump())
