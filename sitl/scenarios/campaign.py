"""Flies scenarios, several at a time."""

from __future__ import annotations

import gc
import signal
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from multiprocessing import get_context
from pathlib import Path

from companion.processes import end_with_parent
from sitl.scenarios.flight import Bases, fly
from sitl.scenarios.index import by_name
from sitl.scenarios.scenario import Flown


def fly_all(
    names: Sequence[str], bases: Bases, folder: Path, on_flown: Callable[[Flown], None], workers: int
) -> list[Flown]:
    """Fly scenarios by name, `workers` at a time; their verdicts in the order of `names`. Ctrl-C ends what flies."""
    flown: dict[str, Flown] = {}
    context = get_context("forkserver")
    context.set_forkserver_preload([__name__])  # imported once, for all processes
    with ProcessPoolExecutor(workers, context, _begin) as pool:
        before = signal.signal(signal.SIGINT, signal.SIG_IGN)  # workers inherit it: in them only a flight listens
        try:
            futures = [pool.submit(_fly_named, name, bases, folder / name) for name in names]
        finally:
            signal.signal(signal.SIGINT, before)
        try:
            for future in as_completed(futures):
                result = future.result()
                flown[result.name] = result
                on_flown(result)
        except BaseException:
            pool.shutdown(cancel_futures=True)
            raise
    return [flown[name] for name in names]


def _begin() -> None:
    gc.freeze()
    end_with_parent()


def _fly_named(name: str, bases: Bases, folder: Path) -> Flown:
    return fly(by_name(name), bases, folder)
