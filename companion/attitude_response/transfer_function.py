"""A response given by the coefficients of its transfer function: certified, but neither fitted, watched nor flown.

It has as many corners as its coefficients have ends. Standard library only.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from decimal import Decimal
from fractions import Fraction
from typing import ClassVar, Final

from companion.attitude_response.exact import Interval, check_order, ends
from companion.attitude_response.kind import EXACT, PLACES, Kind, ceiling
from companion.attitude_response.realisation import StateSpace, companion_form, is_hurwitz

MAX_ORDER: Final = 6


@dataclass(frozen=True)
class TransferFunction(Kind):
    """Strictly proper w/u = numerator / denominator, highest power of s first, s in rad/s.

    The two constant terms must be written alike: that is unit gain at rest, also when they are intervals (they move
    together).
    """

    name: ClassVar[str] = "transfer_function"
    title: ClassVar[str] = "transfer function"
    of_lists: ClassVar[bool] = True

    numerator: tuple[Interval, ...]
    denominator: tuple[Interval, ...]

    def check(self) -> None:
        numerator, denominator = self.numerator, self.denominator
        for coefficient in (*numerator, *denominator):
            check_order("attitude transfer function coefficient", coefficient)
        if len(denominator) < 2 or not 1 <= len(numerator) < len(denominator):
            raise ValueError("attitude transfer function must be strictly proper")
        if len(denominator) > MAX_ORDER + 1:
            raise ValueError(f"attitude transfer function has an order above {MAX_ORDER}")
        if denominator[0].lower != denominator[0].upper or denominator[0].lower <= 0:
            raise ValueError("leading denominator coefficient must be one positive value")
        if numerator[-1] != denominator[-1]:
            constants = f"{numerator[-1].lower}, {denominator[-1].lower}"
            raise ValueError(f"attitude dc gain is not 1: constant terms {constants}")
        for side in ([c.lower for c in denominator], [c.upper for c in denominator]):
            if not is_hurwitz([Fraction(c) for c in side]):
                raise ValueError("attitude transfer function is unstable")

    def corners(self) -> list[StateSpace]:
        # the constant terms of numerator and denominator are one parameter: unit gain at rest at every corner
        free = [ends(c) for c in (*self.numerator[:-1], *self.denominator)]
        split = len(self.numerator) - 1
        return [
            companion_form([*values[:split], values[-1]], list(values[split:])) for values in itertools.product(*free)
        ]

    def bandwidth(self) -> Decimal:
        """The -3 dB frequency of the lower coefficients."""
        high = 1e-3
        while self._gain(high) > math.sqrt(0.5):
            high *= 1.1
        low = high / 1.1
        for _ in range(40):
            middle = (low + high) / 2
            low, high = (middle, high) if self._gain(middle) > math.sqrt(0.5) else (low, middle)
        return ceiling(Decimal(high), PLACES)

    def with_bandwidth(self, bandwidth: Decimal) -> TransferFunction:
        """The same response in a time that runs as much faster, exactly."""
        factor, order = ceiling(bandwidth / self.bandwidth(), Decimal("1e-9")), len(self.denominator) - 1

        def scaled(coefficients: tuple[Interval, ...]) -> tuple[Interval, ...]:
            powers = [EXACT.power(factor, order - (len(coefficients) - 1 - i)) for i in range(len(coefficients))]
            pairs = zip(coefficients, powers, strict=True)
            return tuple(Interval(*(EXACT.multiply(end, power) for end in c)) for c, power in pairs)

        return TransferFunction(scaled(self.numerator), scaled(self.denominator))

    def _gain(self, frequency_rad_s: float) -> float:
        s = complex(0, frequency_rad_s)
        top, bottom = (
            sum(float(c.lower) * s ** (len(p) - 1 - i) for i, c in enumerate(p))
            for p in (self.numerator, self.denominator)
        )
        return abs(top / bottom)
