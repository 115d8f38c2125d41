"""Lies of the estimator, as happenings of a scenario."""

from __future__ import annotations

from random import Random
from typing import NamedTuple

from sitl.scenarios.run import ScenarioRun
from sitl.world.estimator_status import NOMINAL
from sitl.world.lies import Kind, Liar, Lie


class TellLie(NamedTuple):
    """The estimator is wrong about some quantities from now on."""

    kind: Kind
    of: tuple[str, ...]
    size: float = 0.0

    def happen(self, run: ScenarioRun) -> None:
        lies = run.estimator.lies
        lies.append(Liar(Lie(*self), Random(f"lie {len(lies)}")))


class Blink(NamedTuple):
    """A variance of the position, m², that is `other` for `for_s` in every `every_s`."""

    position_m2: float
    other: float
    for_s: float = 0.05
    every_s: float = 0.25

    def happen(self, run: ScenarioRun) -> None:
        def blink(elapsed_s: float) -> None:
            hidden = elapsed_s % self.every_s < self.for_s
            run.autopilot.health = NOMINAL._replace(horizontal_m2=self.other if hidden else self.position_m2)

        run.each_step(blink)


class Fail(NamedTuple):
    """`quality` of the odometry: -1 is failed."""

    quality: int = -1

    def happen(self, run: ScenarioRun) -> None:
        run.autopilot.health = run.autopilot.health._replace(quality=self.quality)


class Hold(NamedTuple):
    """The estimate changes only so often, under stamps that are fresh."""

    rate_hz: float

    def happen(self, run: ScenarioRun) -> None:
        run.estimator.renewed_hz = self.rate_hz


class CountResets(NamedTuple):
    """The reset counter changes with every step of the estimator."""

    def happen(self, run: ScenarioRun) -> None:
        def count(_: float) -> None:
            run.autopilot.reset_counter = run.autopilot.reset_counter + 1 & 255

        run.each_step(count)
