"""The framing of a ULog, and whether a file is a whole one by it: a hole breaks the chain of messages.

Source: https://docs.px4.io/main/en/dev_log/ulog_file_format.html
"""

from __future__ import annotations

from pathlib import Path
from typing import Final, NamedTuple

MAGIC: Final = b"ULog\x01\x12\x35"
HEADER_BYTES: Final = 16
KINDS: Final = frozenset(b"BFIMPQARDLCSO")


class Extent(NamedTuple):
    """How far the chain of messages holds."""

    messages: int
    bytes_read: int
    size_bytes: int
    problem: str | None  # as one line; None for a whole log


def extent(path: Path) -> Extent:
    """Walk the messages of a ULog from its header to its end. Raises `OSError`."""
    data = path.read_bytes()
    total = len(data)
    if not data.startswith(MAGIC):
        return Extent(0, 0, total, "not a ULog: it does not begin with one's header")
    at, messages = HEADER_BYTES, 0
    while at + 3 <= total:
        if data[at + 2] not in KINDS:
            return Extent(messages, at, total, f"broken at byte {at} of {total}: no ULog message begins there")
        at += 3 + (data[at] | data[at + 1] << 8)
        messages += 1
    if at != total:
        return Extent(
            messages, total, total, "its last message is cut short: the vehicle lost power or is logging still"
        )
    return Extent(messages, at, total, None)
