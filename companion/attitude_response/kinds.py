"""The kinds of attitude response, each once, and the models that identification fits.

A new kind is a class here, its name in `KINDS`, a row in `MODELS`, and its keys in `companion/config/attitude.py`:
docs/recipes/add_an_attitude_response.md. Standard library only.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Any, ClassVar, Final, NamedTuple

from companion.attitude_response.exact import Interval
from companion.attitude_response.held import Held, advance
from companion.attitude_response.kind import DELAY, Kind, Parameter, ParametricKind, State, Step
from companion.attitude_response.realisation import ONE, ZERO, StateSpace
from companion.attitude_response.transfer_function import TransferFunction
from companion.control.reference_model import transition

_NEARLY_EQUAL: Final = 1e-6  # of damping² from one: the two poles are then told apart by hand


@dataclass(frozen=True)
class FirstOrder(ParametricKind):
    """w' = M (u - w), eq. (18) written in its output; M in rad/s."""

    name: ClassVar[str] = "first_order"
    title: ClassVar[str] = "first order"
    parameters: ClassVar[tuple[Parameter, ...]] = (Parameter("bandwidth_rad_s", "rad/s", "M"),)

    bandwidth_rad_s: Interval

    @staticmethod
    def realise(*values: Fraction) -> StateSpace:
        (m,) = values
        return StateSpace(((-m,),), (m,), (ONE,), ZERO)

    @staticmethod
    def step(values: Sequence[float], dt_s: float) -> Step:
        over = FirstOrder.held(values, dt_s)

        def stepped(state: State, wanted: float) -> State:
            output, rate = state
            return advance(over, output, rate, wanted)

        return stepped

    @staticmethod
    def held(values: Sequence[float], dt_s: float) -> Held:
        (bandwidth,) = values
        return Held(True, math.exp(-bandwidth * dt_s), 0.0, 0.0, 0.0, 0.0, 0.0, bandwidth)

    @staticmethod
    def lag(values: Sequence[float], of: Callable[[Any], Any]) -> Any:
        (bandwidth,) = values
        return of(-bandwidth)


@dataclass(frozen=True)
class SecondOrder(ParametricKind):
    """w'' = wn^2 (u - w) - 2 zeta wn w'; wn in rad/s."""

    name: ClassVar[str] = "second_order"
    title: ClassVar[str] = "second order"
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter("natural_frequency_rad_s", "rad/s", "ωn"),
        Parameter("damping_ratio", "1", "ζ"),
    )

    natural_frequency_rad_s: Interval
    damping_ratio: Interval

    @staticmethod
    def realise(*values: Fraction) -> StateSpace:
        """States w and w'/wn: affine in wn and in zeta, which [w, w'] is not."""
        wn, zeta = values
        return StateSpace(((ZERO, wn), (-wn, -2 * zeta * wn)), (ZERO, wn), (ONE, ZERO), ZERO)

    @staticmethod
    def step(values: Sequence[float], dt_s: float) -> Step:
        over = SecondOrder.held(values, dt_s)

        def stepped(state: State, wanted: float) -> State:
            output, rate = state
            return advance(over, output, rate, wanted)

        return stepped

    @staticmethod
    def held(values: Sequence[float], dt_s: float) -> Held:
        wn, zeta = values
        return Held(False, *transition(wn, zeta, dt_s), wn * wn)

    @staticmethod
    def lag(values: Sequence[float], of: Callable[[Any], Any]) -> Any:
        frequency, damping = values
        apart = damping * damping - 1.0
        if apart < _NEARLY_EQUAL:  # a conjugate pair: the imaginary part of one says both
            pole = frequency * complex(-damping, math.sqrt(max(-apart, _NEARLY_EQUAL)))
            return -((of(pole) * pole.conjugate()).imag / pole.imag)
        root = math.sqrt(apart)
        fast, slow = frequency * (-damping - root), frequency * (-damping + root)
        return (of(slow) * fast - of(fast) * slow) / (fast - slow)


KINDS: Final[tuple[type[Kind], ...]] = (FirstOrder, SecondOrder, TransferFunction)


class Model(NamedTuple):
    """A kind, with a delay or without, as it is fitted to a log: between what and from where its numbers are sought.

    `start`, `lower` and `upper` are in the order of `parameters`.
    """

    kind: type[ParametricKind]
    delayed: bool
    start: tuple[float, ...]
    lower: tuple[float, ...]
    upper: tuple[float, ...]

    @property
    def name(self) -> str:
        """In the machine-readable output."""
        return f"{self.kind.name}_delay" if self.delayed else self.kind.name

    @property
    def title(self) -> str:
        """On a screen."""
        return f"{self.kind.title} + delay" if self.delayed else self.kind.title

    @property
    def described(self) -> tuple[Parameter, ...]:
        """Its parameters, the delay last."""
        return (*self.kind.parameters, DELAY) if self.delayed else self.kind.parameters

    @property
    def parameters(self) -> tuple[str, ...]:
        """Their keys."""
        return tuple(parameter.key for parameter in self.described)


FIRST_ORDER: Final = Model(FirstOrder, False, (5.0,), (0.2,), (80.0,))
FIRST_ORDER_DELAY: Final = Model(FirstOrder, True, (6.0, 0.05), (0.2, 0.0), (80.0, 0.5))
SECOND_ORDER_DELAY: Final = Model(SecondOrder, True, (9.0, 1.0, 0.03), (0.5, 0.15, 0.0), (120.0, 4.0, 0.5))
MODELS: Final = (FIRST_ORDER, FIRST_ORDER_DELAY, SECOND_ORDER_DELAY)  # from the simplest
