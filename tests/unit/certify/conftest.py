"""Problems of the paper, as fixtures."""

from collections.abc import Callable
from decimal import Decimal

import pytest

from companion.attitude_response.exact import decimal, interval
from companion.attitude_response.kinds import FirstOrder
from companion.attitude_response.response import AttitudeResponse
from companion.certify.certificate import certify
from companion.certify.problem import AxisProblem, Problem, Sampling
from companion.certify.statement import Json

Axis = Callable[..., AxisProblem]


def _axis(natural_frequency: str, position: str, velocity: str, bandwidth: str, delay: str) -> AxisProblem:
    bounds = decimal(position), decimal(velocity)
    return AxisProblem(
        decimal(natural_frequency),
        Decimal("0.7"),
        (-bounds[0], -bounds[1]),
        bounds,
        AttitudeResponse(FirstOrder(interval(bandwidth)), interval(delay)),
    )


def rig_axis(bandwidth: str | Decimal = "3", delay: str = "0") -> AxisProblem:
    return _axis("2.3", "0.55", "0.35", str(bandwidth), delay)


def simulation_axis(bandwidth: str | Decimal = "5.5", delay: str = "0") -> AxisProblem:
    return _axis("4", "1.8", "0.65", str(bandwidth), delay)


@pytest.fixture(scope="session")
def rig() -> Axis:
    return rig_axis


@pytest.fixture(scope="session")
def simulation() -> Axis:
    return simulation_axis


@pytest.fixture(scope="session")
def sampling() -> Sampling:
    return Sampling(Decimal(1000), Decimal(100), Decimal("0.4"), Decimal("0.5"))


@pytest.fixture(scope="session")
def quadrotor(sampling: Sampling) -> Problem:
    """Section 4 of the paper: pitch 5.5 rad/s on x, roll 9 rad/s on y."""
    axes = {"x": simulation_axis("5.5"), "y": simulation_axis("9")}
    return Problem(axes, sampling={"x": sampling, "y": sampling})


@pytest.fixture(scope="session")
def certificate(quadrotor: Problem) -> dict[str, Json]:
    found = certify(quadrotor, 4)
    assert found is not None
    return found
