"""From a config to the problem that its certificate is about. It runs in flight too, so it imports no solver."""

from __future__ import annotations

from pathlib import Path

from companion.attitude_response.exact import decimal
from companion.certify.problem import AxisProblem, Problem, Sampling
from companion.config.attitude import ResponseSection, response_of
from companion.config.controller import AxisSection, interval
from companion.config.load import ConfigError
from companion.config.schema import Config
from companion.control.types import GRAVITY_M_S2


def certificate_path(config_path: Path) -> Path:
    """Where a config's certificate is looked for: beside it, `my.yaml` and `my.certificate.json`."""
    return config_path.with_name(f"{config_path.stem}.certificate.json")


def problem(config: Config) -> Problem:
    """The problem, in the numbers as written in the config. Raises `ConfigError` with one line for an impossible one.

    The tick rate is `tick.floor_hz`, the slowest that flight accepts; the adaptation rate is the hedged one's, since
    the certificate is about the hedged controller.
    """
    axes, sampling = {}, {}
    pairs = {
        "x": (config.controller.axes.x, config.attitude.x),
        "y": (config.controller.axes.y, config.attitude.y),
    }
    where = ""
    try:
        for where, (axis, response) in pairs.items():
            if axis is not None and response is not None:
                axes[where] = _axis(axis, response)
                sampling[where] = _sampling(config, axis)
        where = "both"
        return Problem(axes, config.attitude.yaw_free, sampling)
    except ValueError as error:
        raise ConfigError(f"axis {where}: {error}") from None


def _axis(axis: AxisSection, response: ResponseSection) -> AxisProblem:
    position, velocity = interval(axis.position_weight_bound), interval(axis.velocity_weight_bound)
    return AxisProblem(
        decimal(axis.natural_frequency_rad_s),
        decimal(axis.damping_ratio),
        (decimal(position[0]), decimal(velocity[0])),
        (decimal(position[1]), decimal(velocity[1])),
        response_of(response),
        decimal(GRAVITY_M_S2),
    )


def _sampling(config: Config, axis: AxisSection) -> Sampling:
    envelope, bias = config.controller.envelope, config.controller.bias
    return Sampling(
        tick_rate_hz=decimal(config.tick.floor_hz),
        adaptation_rate=decimal(axis.adaptation_rate.hedged),
        position_m=decimal(envelope.position_m),
        velocity_m_s=decimal(envelope.velocity_m_s),
        lyapunov_q=(decimal(axis.lyapunov_q[0]), decimal(axis.lyapunov_q[1])),
        bias_adaptation_rate=decimal(0 if bias is None else bias.adaptation_rate.hedged),
    )
