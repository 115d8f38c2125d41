"""The kinds of vehicle: what each can do, and the keys of its simulated twin.

A new kind is a row in `VEHICLE_KINDS`, its name in `VehicleName`, and its section in `VehiclePlants`; its physics is
looked up in `sitl/build.py`: docs/recipes/add_a_vehicle.md.
"""

from __future__ import annotations

from typing import Annotated, Final, Literal, NamedTuple

from pydantic import Field, model_validator

from companion.attitude_response.kind import LinearResponse, ParametricKind
from companion.config.attitude import ResponseKeys
from companion.config.base import NonNegative, Positive, Section

VehicleName = Literal["rig", "quadrotor"]
ANGLES: Final = {"x": "pitch", "y": "roll"}
"""The angle that moves the vehicle along each axis of the control frame."""


class VehicleKind(NamedTuple):
    """What a vehicle can do, as far as companion and commands must know."""

    name: VehicleName
    axes: tuple[str, ...]  # of the control frame that it moves along
    can_fly: bool  # it takes off, lands and feels the wind; guides carry the others

    @property
    def one_axis(self) -> bool:
        """Whether it moves along x alone. Then it keeps its thrust and its heading: it has no altitude controller."""
        return len(self.axes) == 1

    @property
    def angles(self) -> tuple[str, ...]:
        """The angles that it is steered by, roll before pitch."""
        return tuple(ANGLES[axis] for axis in reversed(self.axes))


VEHICLE_KINDS: Final = {
    kind.name: kind
    for kind in (
        VehicleKind("rig", ("x",), can_fly=False),
        VehicleKind("quadrotor", ("x", "y"), can_fly=True),
    )
}


class Angle(ResponseKeys[Positive]):
    """How one angle follows its set-point when the attitude loop is replaced by a linear response."""

    delay_s: Annotated[NonNegative, Field(le=0.5)] = 0.0
    """Transport delay of this angle, on top of `setpoint_delay_s`."""

    @property
    def response(self) -> LinearResponse:
        """The response without its delay."""
        kind = self.kind
        assert issubclass(kind, ParametricKind)  # the section has the keys of no other
        return LinearResponse(kind, self.values)


class RateLoop(Section):
    """The rate loop, PI_R and D_R of (7) over the inertia: angular acceleration from rate error. One for all axes."""

    proportional_1_s: Positive
    """Angular acceleration per rad/s of rate error."""
    integral_1_s2: NonNegative = 0.0
    """Angular acceleration per radian of rate error added up."""
    derivative: NonNegative = 0.0
    """[1] Angular acceleration against a measured one, which is filtered."""
    filter_bandwidth_rad_s: Positive = 100.0
    """Bandwidth of the derivative's filter."""
    integral_limit_rad_s2: NonNegative = 10.0
    """Largest angular acceleration that the integrator may hold."""


class Cascade(Section):
    """The attitude cascade (7): K_p^R as its gain about each axis, and one rate loop for all."""

    roll_gain_1_s: Positive = 6.0
    """Roll rate wanted per radian of error."""
    pitch_gain_1_s: Positive = 6.0
    """Pitch rate wanted per radian of error."""
    yaw_gain_1_s: Positive = 3.0
    """Yaw rate wanted per radian of error."""
    rate: RateLoop
    """The rate loop."""


class RigPlant(Section):
    """The ANT-X rig, (27)-(28) with the friction of its guides, over the mass. `pitch` or `cascade`."""

    viscous_friction_1_s: NonNegative
    """Deceleration of the guides per m/s."""
    coulomb_friction_m_s2: NonNegative
    """Deceleration of the guides at any speed."""
    coulomb_width_m_s: Positive = 0.005
    """Speed over which Coulomb friction changes its sign, as tanh(v / width)."""
    pitch: Angle | None = None
    """Pitch as a linear response."""
    cascade: Cascade | None = None
    """Pitch by the paper's attitude cascade; of the gains only that of pitch counts."""

    @model_validator(mode="after")
    def _one_loop(self) -> RigPlant:
        if (self.pitch is None) == (self.cascade is None):
            raise ValueError("give either the linear response (pitch) or the cascade")
        return self


class QuadrotorPlant(Section):
    """The 6-DoF quadrotor, (1)-(2) with body drag. `roll`, `pitch` and `yaw`, or `cascade`."""

    mass_kg: Positive
    """Mass."""
    drag_n_s2_m2: NonNegative
    """Drag c_D in -c_D |v| v, with the velocity v against the air. Wind acts through it."""
    inertia_kg_m2: tuple[Positive, Positive, Positive]
    """Moments of inertia about the body's x, y and z. Only the cascade needs them."""
    roll: Angle | None = None
    """Roll as a linear response."""
    pitch: Angle | None = None
    """Pitch as a linear response."""
    yaw: Angle | None = None
    """Yaw as a linear response."""
    cascade: Cascade | None = None
    """All three by the paper's attitude cascade."""

    @model_validator(mode="after")
    def _one_loop(self) -> QuadrotorPlant:
        linear = [angle is not None for angle in (self.roll, self.pitch, self.yaw)]
        if all(linear) == (self.cascade is not None) or any(linear) != all(linear):
            raise ValueError("give either the linear responses (roll, pitch and yaw) or the cascade")
        return self


class VehiclePlants(Section):
    """The simulated vehicle: the section of one kind."""

    rig: RigPlant | None = None
    """The rig, where `vehicle.kind` is `rig`."""
    quadrotor: QuadrotorPlant | None = None
    """The quadrotor, where `vehicle.kind` is `quadrotor`."""

    @property
    def kind(self) -> VehicleKind:
        """The kind whose section is given."""
        return next(kind for name, kind in VEHICLE_KINDS.items() if getattr(self, name) is not None)

    @model_validator(mode="after")
    def _one_vehicle(self) -> VehiclePlants:
        if sum(getattr(self, name) is not None for name in VEHICLE_KINDS) != 1:
            raise ValueError(f"give either {' or '.join(VEHICLE_KINDS)}")
        return self
