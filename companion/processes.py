"""Long work in processes of its own, one a core, that Ctrl-C ends: searches for a certificate, flights in the plant."""

from __future__ import annotations

import contextlib
import os
import signal
import threading
from collections.abc import Callable, Iterator
from multiprocessing import get_context, parent_process
from typing import Any, Final, ParamSpec, TypeVar

from companion.safe_path import safe_environment

P = ParamSpec("P")
T = TypeVar("T")

_PROCESSES: Final = 2  # a companion board has as many cores to spare
_LOOK_S: Final = 0.2  # how often a wait lets Ctrl-C through


class Processes:
    """Runs functions elsewhere, or here and later where that is not worth it. Leaving it ends what still runs."""

    def __init__(self, elsewhere: bool) -> None:
        # Spawned: a forked child would inherit the threads' locks of the progress bar.
        with _safe_children():
            self._pool = get_context("spawn").Pool(_PROCESSES, _begin) if elsewhere else None

    def __enter__(self) -> Processes:
        return self

    def __exit__(self, *_: object) -> None:
        if self._pool is not None:
            self._pool.terminate()
            self._pool.join()

    def call(self, function: Callable[P, T], *args: P.args, **kwargs: P.kwargs) -> Callable[[], T]:
        """Begin a call; what comes back waits for its result."""
        if self._pool is None:
            return lambda: function(*args, **kwargs)
        begun: Any = self._pool.apply_async(function, args, kwargs)

        def result() -> T:
            while not begun.ready():
                begun.wait(_LOOK_S)
            answer: T = begun.get()
            return answer

        return result


@contextlib.contextmanager
def _safe_children() -> Iterator[None]:
    """Whoever is started meanwhile begins without the current directory on its path."""
    before = dict(os.environ)
    os.environ.update(safe_environment())
    try:
        yield
    finally:
        os.environ.clear()
        os.environ.update(before)


def end_with_parent() -> None:
    """In a process that multiprocessing has started: end with the one who wanted it, even where that was killed."""
    parent = parent_process()
    if parent is not None:
        _end_after(parent.join)


def end_with_input() -> None:
    """End when standard input does: a pipe from whoever started this process, and ends with them."""
    _end_after(_read_all)


def _read_all() -> None:
    with contextlib.suppress(OSError):
        while os.read(0, 4096):
            pass


def _end_after(wait: Callable[[], object]) -> None:
    def end() -> None:
        wait()
        os._exit(1)  # nobody is left to tell

    threading.Thread(target=end, name="end", daemon=True).start()


def _begin() -> None:
    """Ctrl-C is the parent's, who ends the children."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    end_with_parent()
