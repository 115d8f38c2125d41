"""An estimate whose position and velocity disagree tells by how much it is wrong.

An estimator with position aiding moves its position by more than its velocity: what is left over is its innovation,
fed back with its gain k1. For an error e_p of position, ``d/dt p - v = -k1 e_p + noise``, and the error of the velocity
goes the same way (`docs/estimator.md`). So with ``r``, the low-passed difference,

    r = 1/(tau s + 1) (s p - v)        p_corrected = p + k_p r        v_corrected = v + k_v r

where the best k_p is about 1/k1 and the best k_v about one: the velocity that the position has, at low frequency.

An estimate that agrees with itself has r = 0. So the model of (18) and the closed loop of (24), which know no
estimator, are what they were; the certificate does not change. r is limited to what a healthy estimator shows, so that
an estimate that jumps or slides moves the vehicle by no more than k_p and k_v times that limit beyond what it says.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from companion.control.types import Jump, Odometry


class CorrectionParams(NamedTuple):
    """tau, k_p in seconds, and k_v; zero gains leave the estimate alone. Horizontal only."""

    filter_s: float
    position_gain_s: float
    velocity_gain: float
    limit_m_s: float  # of r


class CorrectionState(NamedTuple):
    """Low-passed ``p + tau v``, north and east, m: r is ``(p - it) / tau``, without a derivative."""

    north_m: float
    east_m: float


def start(sample: Odometry) -> CorrectionState:
    """Settled on a sample: r is zero."""
    return CorrectionState(sample.x_m, sample.y_m)


def step(
    params: CorrectionParams, state: CorrectionState, sample: Odometry, dt_s: float
) -> tuple[CorrectionState, Odometry]:
    """(state, the sample with position and velocity corrected)."""
    tau_s, k_p, k_v, limit = params
    north, east = state
    share = 1.0 - math.exp(-dt_s / tau_s)
    north += share * (sample.x_m + tau_s * sample.vx_m_s - north)
    east += share * (sample.y_m + tau_s * sample.vy_m_s - east)
    r_north = min(max((sample.x_m - north) / tau_s, -limit), limit)
    r_east = min(max((sample.y_m - east) / tau_s, -limit), limit)
    time_s, x, y, z, vx, vy, vz, qw, qx, qy, qz = sample
    corrected = Odometry(
        time_s, x + k_p * r_north, y + k_p * r_east, z, vx + k_v * r_north, vy + k_v * r_east, vz, qw, qx, qy, qz
    )
    # Where r was limited the state follows, or a jump would be worked off for seconds.
    return CorrectionState(sample.x_m - tau_s * r_north, sample.y_m - tau_s * r_east), corrected


def reseat(params: CorrectionParams, state: CorrectionState, jump: Jump) -> tuple[CorrectionState, Jump]:
    """(state, what the corrected estimate does) where the estimate jumped and the vehicle did not.

    A reset of position leaves r as it is. One of velocity changes it at once by as much the other way: the position
    goes on as it did, so what it says of the velocity does too. What the limit cuts of that is eased in by the filter.
    """
    tau_s, k_p, k_v, _ = params
    corrected = jump._replace(
        x_m=jump.x_m - k_p * jump.vx_m_s,
        y_m=jump.y_m - k_p * jump.vy_m_s,
        vx_m_s=(1.0 - k_v) * jump.vx_m_s,
        vy_m_s=(1.0 - k_v) * jump.vy_m_s,
    )
    moved = CorrectionState(
        state.north_m + jump.x_m + tau_s * jump.vx_m_s, state.east_m + jump.y_m + tau_s * jump.vy_m_s
    )
    return moved, corrected
