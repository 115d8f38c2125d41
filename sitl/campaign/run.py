"""A campaign: flights drawn, flown in batches by one process or several, and kept."""

from __future__ import annotations

import gc
import hashlib
import math
import time
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from multiprocessing import get_context
from pathlib import Path
from typing import Any, Final, NamedTuple

from companion.config import Config, load_config
from companion.processes import end_with_parent
from sitl.campaign import loop
from sitl.campaign.draws import Distribution, draw
from sitl.campaign.flight import fly
from sitl.campaign.loop import Outcome
from sitl.campaign.results import ResultsError, Row
from sitl.campaign.takeover import NeverInControlError, take_over

ENDINGS: Final = {
    loop.COMPLETE: "mission_complete",
    loop.NOT_FINITE: "setpoint_invalid",
    loop.GROUND: "ground",
    loop.TIME_OVER: "time_over",
}
NEVER: Final = "never_in_control"
_NOTHING: Final = Outcome(-1, 0, math.nan, math.nan, math.nan, math.nan, math.nan, math.nan, 0, 0)


class Campaign(NamedTuple):
    """What is flown: config file and overrides, what varies, the seed, and which controller."""

    path: Path
    overrides: tuple[str, ...]
    distributions: tuple[Distribution, ...]
    seed: int
    hedging: bool | None  # None: as the config has it

    def config(self, flight: int) -> tuple[Config, dict[str, float]]:
        """Of one flight, and what was drawn for it. Raises `ConfigError`."""
        drawn = draw(self.distributions, self.seed, flight)
        return load_config(self.path, (*self.overrides, *drawn.overrides)), drawn.columns

    def identity(self) -> dict[str, Any]:
        """What makes a campaign another one. Raises `ConfigError`."""
        flown = load_config(self.path, self.overrides).model_dump_json()
        return {
            "config_sha256": hashlib.sha256(flown.encode()).hexdigest(),
            "vary": [list(one) for one in self.distributions],
            "seed": self.seed,
            "hedging": self.hedging,
        }


class Flown(NamedTuple):
    """A batch that was flown, and the processor time that it took."""

    batch: range
    rows: list[Row]
    cpu_s: float


def fly_one(campaign: Campaign, flight: int) -> Row:
    """One flight as a row: what was drawn, and how it went. Raises `ConfigError`, `CampaignError`."""
    config, drawn = campaign.config(flight)
    hedging = config.controller.hedging if campaign.hedging is None else campaign.hedging
    try:
        outcome, _ = fly(take_over(config, hedging=hedging))
        ending = ENDINGS[outcome.ending]
    except NeverInControlError:
        outcome, ending = _NOTHING, NEVER
    left = outcome.truth_peak_m > config.controller.envelope.position_m
    ticks = max(outcome.ticks, 1)
    return {
        "flight": flight,
        **drawn,
        "ending": ending,
        "unstable": ending != NEVER and (left or outcome.ending != loop.COMPLETE),
        "ticks": outcome.ticks,
        "flown_s": outcome.flown_s,
        "peak_m": outcome.peak_m,
        "rms_m": outcome.rms_m,
        "truth_peak_m": outcome.truth_peak_m,
        "truth_rms_m": outcome.truth_rms_m,
        "tilt_deg": math.degrees(outcome.tilt_rad),
        "limited_share": outcome.limited_ticks / ticks,
        "on_bound_share": outcome.on_bound_ticks / ticks,
    }


def fly_batch(campaign: Campaign, batch: range) -> Flown:
    """Some flights, one after the other."""
    began_s = time.process_time()
    rows = [fly_one(campaign, flight) for flight in batch]
    return Flown(batch, rows, time.process_time() - began_s)


def _begin() -> None:
    end_with_parent()
    gc.freeze()


def fly_all(campaign: Campaign, batches: list[range], workers: int) -> Iterator[Flown]:
    """Every batch, in the order in which they end. Raises what `fly_one` raises, and `ResultsError`."""
    if workers == 1:
        gc.freeze()  # the flight process collects garbage before each flight: what is there now is none
        for batch in batches:
            yield fly_batch(campaign, batch)
        return
    with ProcessPoolExecutor(workers, get_context("spawn"), _begin) as pool:
        futures = [pool.submit(fly_batch, campaign, batch) for batch in batches]
        try:
            for future in as_completed(futures):
                yield future.result()
        except BrokenProcessPool:
            raise ResultsError(
                "a worker has gone: it was killed; start again, and only what is missing is flown"
            ) from None
        finally:
            pool.shutdown(cancel_futures=True)
