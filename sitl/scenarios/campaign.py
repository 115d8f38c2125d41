"""Flies scenarios, several at a time."""

from __future__ import annotations

import contextlib
import gc
import signal
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor, ProcessPoolExecutor, as_completed
from multiprocessing import get_context
from pathlib import Path
from typing import Final

from sitl.scenarios.flight import Bases, fly
from sitl.scenarios.index import by_name
from sitl.scenarios.scenario import Flown

_WAITING: Final = 4  # flights by the wall clock at a time: they leave most of a core alone


def fly_all(
    names: Sequence[str], bases: Bases, folder: Path, on_flown: Callable[[Flown], None], workers: int
) -> list[Flown]:
    """Fly scenarios by name, several at a time; their verdicts in the order of `names`.

    `workers` processes fly those in lockstep, as fast as the machine allows. Those that take the wall's time are flown
    beside them by processes of their own. Ctrl-C ends what flies.
    """
    waiting = [name for name in names if by_name(name).realtime]
    busy = [name for name in names if not by_name(name).realtime]
    flown: dict[str, Flown] = {}
    with contextlib.ExitStack() as pools:
        futures = []
        before = signal.signal(signal.SIGINT, signal.SIG_IGN)  # workers inherit it: in them only a flight listens
        try:
            for queue, size in ((waiting, _WAITING), (busy, workers)):
                if queue:
                    pool = pools.enter_context(_pool(min(size, len(queue))))
                    futures += [pool.submit(_fly_named, name, bases, folder / name) for name in queue]
        finally:
            signal.signal(signal.SIGINT, before)
        for future in as_completed(futures):
            result = future.result()
            flown[result.name] = result
            on_flown(result)
    return [flown[name] for name in names]


@contextlib.contextmanager
def _pool(workers: int) -> Iterator[Executor]:
    """Processes to fly in; whatever goes wrong, what has not begun is not begun any more."""
    context = get_context("forkserver")
    context.set_forkserver_preload([__name__])  # imported once, for all of them
    with ProcessPoolExecutor(workers, context, gc.freeze) as pool:
        try:
            yield pool
        except BaseException:
            pool.shutdown(cancel_futures=True)
            raise


def _fly_named(name: str, bases: Bases, folder: Path) -> Flown:
    return fly(by_name(name), bases, folder)
