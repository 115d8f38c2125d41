"""What the vehicle is never asked for: limits on the force vector that keep its direction and put altitude first."""

from __future__ import annotations

import math
from typing import NamedTuple


class LimitParams(NamedTuple):
    """Tilt, normalised collective thrust, and horizontal acceleration. Infinite acceleration: no limit."""

    tilt_rad: float
    thrust_min: float
    thrust_max: float
    acceleration_m_s2: float
    gravity_m_s2: float


def limit(
    params: LimitParams, x: float, y: float, up: float, hover_thrust: float
) -> tuple[float, float, float, bool, bool]:
    """The force nearest to the wanted one that the limits allow, altitude first.

    The vertical component is cut by the thrust alone. The horizontal one then gets what tilt, acceleration and the rest
    of the thrust leave, and is scaled, so that its direction stays. Finite for finite input.

    Parameters
    ----------
    params
        What the limits are.
    x, y, up
        Wanted specific force over g, `up` positive; 1 up is hover.
    hover_thrust
        Normalised thrust that carries the weight.

    Returns
    -------
    x, y, up, horizontal_cut, vertical_cut
        The force that may be asked for, and which part of it is not the one wanted.
    """
    tilt, thrust_min, thrust_max, acceleration, gravity = params
    lowest, highest = thrust_min / hover_thrust, thrust_max / hover_thrust
    kept = lowest if up < lowest else highest if up > highest else up
    reach = min(kept * math.tan(tilt), math.sqrt(highest * highest - kept * kept), acceleration / gravity)
    if x * x + y * y <= reach * reach:
        return x, y, kept, False, kept != up
    x, y = shorten(x, y, reach)
    return x, y, kept, True, kept != up


def limit_level(params: LimitParams, x: float) -> tuple[float, float, float, bool, bool]:
    """The same for a vehicle on guides, whose thrust stays at hover and is only turned: `x` is the sine of its tilt."""
    reach = min(math.sin(params.tilt_rad), params.acceleration_m_s2 / params.gravity_m_s2)
    cut = not abs(x) <= reach
    if cut:
        x, _ = shorten(x, 0.0, reach)
    return x, 0.0, math.sqrt(1.0 - x * x), cut, False


def shorten(x: float, y: float, reach: float) -> tuple[float, float]:
    """The vector (x, y), longer than `reach`, scaled down to it."""
    length = math.sqrt(x * x + y * y)
    if length == math.inf:  # a square overflowed: scaled down first
        largest = max(abs(x), abs(y))
        x, y = x / largest, y / largest
        length = math.sqrt(x * x + y * y)
    scale = reach / length if length > 0.0 else reach  # NaN, where the reach is: for the guards to see
    return scale * x, scale * y
