"""Standard input, output and error exist, whoever started us.

A process that is started with one of them closed gives its number to the next file it opens: a link's socket would be
descriptor 1, and what is printed for a person would go out to the vehicle.
"""

from __future__ import annotations

import os
import sys


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
