"""What keeps a simulated vehicle from being ideal: mismatch, wind, sensors and radio."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from companion.config.base import Fraction, NonNegative, Positive, Section, Vector


class MismatchSection(Section):
    """What a quadrotor really has, over what this file says and autopilot and companion believe."""

    mass: Positive = 1.0
    """[1] True mass over `mass_kg`."""
    thrust: Positive = 1.0
    """[1] True thrust over the one believed, at the same set-point."""
    drag: NonNegative = 1.0
    """[1] True drag over `drag_n_s2_m2`."""


class GustSection(Section):
    """A gust of 1-cosine shape (MIL-F-8785C, 3.7.1.3) that rises, stays and falls; again every `every_s`."""

    peak_ned_m_s: Vector
    """What it adds to the mean wind at its peak."""
    start_s: NonNegative = 0.0
    """When it begins, since the plant's boot."""
    rise_s: Positive = 1.0
    """How long it rises, and falls."""
    hold_s: NonNegative = 0.0
    """How long it stays at its peak."""
    every_s: NonNegative = 0.0
    """From one beginning to the next; 0: it comes once."""


class TurbulenceSection(Section):
    """Dryden turbulence at low altitude (MIL-F-8785C, 3.7.3.4)."""

    wind_at_20_ft_m_s: NonNegative
    """Its intensity, as the wind speed at 20 ft: light 7.7, moderate 15.4."""
    altitude_m: Positive = 6.0
    """Height at which its scale lengths are taken."""


class WindSection(Section):
    """Wind, acting through `quadrotor.drag_n_s2_m2`; vectors say where the air goes to. A rig has none."""

    mean_ned_m_s: Vector = (0.0, 0.0, 0.0)
    """The steady wind."""
    gust: GustSection | None = None
    """A gust on top of it."""
    turbulence: TurbulenceSection | None = None
    """Turbulence on top of it."""


class SensorsSection(Section):
    """How the estimate differs from the truth: the errors of an estimator, plain noise on top of them, and its age.

    Left out, autopilot and companion see the truth.
    """

    preset: Literal["gps", "rtk", "optical_flow", "motion_capture"] | None = None
    """What aids the estimator. Position and velocity errors then have the sizes, the correlation and the times that
    PX4's EKF2 has with it; `docs/estimator.md` says where they are from."""
    position_m: NonNegative = 0.0
    """Standard deviation of the position."""
    velocity_m_s: NonNegative = 0.0
    """Standard deviation of the velocity."""
    attitude_deg: NonNegative = 0.0
    """Standard deviation of roll, pitch and yaw."""
    correlation_s: Positive = 0.5
    """Correlation time of the noise."""
    delay_s: Annotated[NonNegative, Field(le=0.5)] = 0.0
    """How old the state is that is reported as the present one."""
    jitter_s: Annotated[NonNegative, Field(le=0.5)] = 0.0
    """Largest random age on top of the delay, uniform."""


class DirectionSection(Section):
    """What frames meet on their way in one direction; chances are per frame."""

    delay_s: NonNegative = 0.0
    """How long a frame is on its way."""
    jitter_s: NonNegative = 0.0
    """Largest random time on top of the delay, uniform. Frames keep their order."""
    loss: Fraction = 0.0
    """[1] Chance to be lost."""
    burst_begins: Fraction = 0.0
    """[1] Gilbert-Elliott: chance that a burst begins, in which everything is lost."""
    burst_ends: Fraction = 1.0
    """[1] Gilbert-Elliott: chance that the burst ends."""
    duplication: Fraction = 0.0
    """[1] Chance to arrive twice."""
    reordering: Fraction = 0.0
    """[1] Chance to be overtaken: to arrive 20 ms later than it would."""
    corruption: Fraction = 0.0
    """[1] Chance of one to eight flipped bits."""


class RadioSection(Section):
    """The link between autopilot and companion."""

    down: DirectionSection = DirectionSection()
    """Autopilot to companion."""
    up: DirectionSection = DirectionSection()
    """Companion to autopilot."""
