"""Standard input, output and error exist, whoever started us.

A process that is started with one of them closed gives its number to the next file it opens: a link's socket would be
descriptor 1, and what is printed for a person would go out to the vehicle.
"""

from __future__ import annotations

import contextlib
import errno
import os
import sys
from typing import Final

FULL: Final = frozenset({errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO})  # what a file that takes no more says


def open_missing() -> None:
    """Put /dev/null where standard input, output or error is closed, for this process and its children.

    To be called before anything else is opened.
    """
    while (fd := os.open(os.devnull, os.O_RDWR)) <= 2:  # the lowest number that is free
        os.set_inheritable(fd, True)
    os.close(fd)
    # Python has none of a stream that was closed, and `print(file=None)` prints to standard output.
    sys.stdin = sys.stdin or open(0, encoding="utf-8", closefd=False)  # noqa: SIM115
    sys.stdout = sys.stdout or open(1, "w", encoding="utf-8", closefd=False)  # noqa: SIM115
    sys.stderr = sys.stderr or open(2, "w", encoding="utf-8", closefd=False)  # noqa: SIM115


def end_output() -> int:
    """Write out what is left for standard output. Exit code: 0, or 1 where it is lost."""
    try:
        sys.stdout.flush()
    except BrokenPipeError:  # who read it has had what he wanted
        _drop_output()
    except OSError as error:
        return output_lost(error)
    return 0


def output_lost(error: OSError) -> int:
    """Standard output takes no more: one line on stderr. The exit code."""
    _drop_output()
    with contextlib.suppress(OSError):
        print(f"companion: standard output: {error.strerror}: not all of it was written", file=sys.stderr)
    return 1


def _drop_output() -> None:
    """What is left goes nowhere: Python tries once more at its end, and would complain in its own way."""
    with contextlib.suppress(OSError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
