"""Ten flights, each of which the compiled loop must fly as lockstep does."""

from __future__ import annotations

from typing import Final, NamedTuple

_WIND: Final = (
    "plant.wind={mean_ned_m_s: [4, 3, 0], turbulence: {wind_at_20_ft_m_s: 7.7, altitude_m: 6},"
    " gust: {peak_ned_m_s: [2, 1.5, 0], start_s: 0, rise_s: 1, hold_s: 1, every_s: 8}}"
)
_NOISE: Final = "position_m: 0.02, velocity_m_s: 0.03, attitude_deg: 0.3, correlation_s: 0.5"
_NOISY: Final = f"plant.sensors={{{_NOISE}}}"
_LATE_AND_NOISY: Final = f"plant.sensors={{{_NOISE}, delay_s: 0.01, jitter_s: 0.004}}"
_SATURATED: Final = ("controller.limits.tilt_deg=14", "controller.limits.thrust_max=0.55")
_CASCADE: Final = "plant.quadrotor={mass_kg: 0.25, drag_n_s2_m2: 0.1, inertia_kg_m2: [3.0e-4, 3.0e-4, 5.0e-4], cascade: {roll_gain_1_s: 9.0, pitch_gain_1_s: 5.5, yaw_gain_1_s: 3.0, rate: {proportional_1_s: 40.0}}}"  # fmt: skip # noqa: E501
_RIG_CASCADE: Final = "plant.rig={viscous_friction_1_s: 1.2, coulomb_friction_m_s2: 0.25, coulomb_width_m_s: 0.005, cascade: {pitch_gain_1_s: 3.0, rate: {proportional_1_s: 25.0, integral_1_s2: 20.0}}}"  # fmt: skip # noqa: E501
_LATE_ANGLES: Final = (
    "plant.quadrotor.roll={natural_frequency_rad_s: 9.7, damping_ratio: 0.94, delay_s: 0.042}",
    "plant.quadrotor.pitch={natural_frequency_rad_s: 9.5, damping_ratio: 0.92, delay_s: 0.028}",
)
_GUARDS: Final = (
    "tracking_error_m", "weights_on_bound", "envelope", "attitude_response_deg", "thrust_saturation", "tilt_error_deg",
)  # fmt: skip
_UNGUARDED: Final = tuple(f"guards.{guard}.enabled=false" for guard in _GUARDS)


class EqualFlight(NamedTuple):
    """A flight of a shipped config, by controller, with what is overridden."""

    name: str
    config: str
    hedging: bool
    overrides: tuple[str, ...] = ()


FLIGHTS: Final = (
    EqualFlight("rig", "antx_rig", True),
    EqualFlight("rig, standard, noise, late", "antx_rig", False, (_LATE_AND_NOISY, "plant.setpoint_delay_s=0.005")),
    EqualFlight("rig, cascade, saturated", "antx_rig", True, (_RIG_CASCADE, "controller.limits.tilt_deg=4")),
    EqualFlight("paper's quadrotor", "paper_quadrotor", True),
    EqualFlight("paper's quadrotor, standard, noise", "paper_quadrotor", False, (_NOISY,)),
    EqualFlight("paper's quadrotor, cascade", "paper_quadrotor", True, (_CASCADE,)),
    EqualFlight("PX4, standard, wind", "px4_quadrotor", False, ("plant.sensors=null", _WIND, *_UNGUARDED)),
    EqualFlight("PX4, all of it", "px4_quadrotor", True,
                (_WIND, _LATE_AND_NOISY, "plant.mismatch={mass: 1.1, thrust: 1.05, drag: 2.0}",
                 "plant.battery_sag_1_s=0.001", *_SATURATED, *_UNGUARDED)),
    EqualFlight("PX4, late angles, evenly", "px4_quadrotor", True,
                ("plant.sensors=null", *_LATE_ANGLES, "plant.telemetry=even", "tick.rate_hz=250")),
    EqualFlight("PX4 by GPS, corrected", "px4_quadrotor", True, (_WIND, *_UNGUARDED)),
)  # fmt: skip
