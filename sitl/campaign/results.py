"""The table of a campaign on disk: a Parquet file a batch, put in place whole, so that a kill costs a batch at most."""

from __future__ import annotations

import json
import os
from collections.abc import Iterable
from pathlib import Path
from typing import Any, Final

from companion.errors import CompanionError

BATCH: Final = 50  # flights
_IDENTITY: Final = "campaign.json"
_TABLE: Final = "flights.parquet"

Row = dict[str, Any]


class ResultsError(CompanionError):
    """The table cannot be written, or is that of another campaign; the message is one line."""


def _arrow() -> tuple[Any, Any]:
    try:
        import pyarrow  # noqa: PLC0415 - an extra
        from pyarrow import parquet  # noqa: PLC0415
    except ImportError:
        raise ResultsError("a campaign needs pyarrow: pip install 'companion[campaign]'") from None
    return pyarrow, parquet


class Results:
    """The folder of one campaign. `identity`: what it flies; a folder with another one is refused.

    Raises `ResultsError`, here and in every method, when the folder cannot be written.
    """

    def __init__(self, folder: Path, identity: dict[str, Any]) -> None:
        self._arrow, self._parquet = _arrow()
        self._parts = folder / "parts"
        self.table = folder / _TABLE
        known = folder / _IDENTITY
        text = json.dumps(identity, sort_keys=True, indent=1)
        try:
            self._parts.mkdir(parents=True, exist_ok=True)
            if not known.exists():
                _put(known, text.encode())
            same = json.loads(known.read_text(encoding="utf-8")) == json.loads(text)
        except (OSError, ValueError) as error:
            raise ResultsError(f"{folder}: {getattr(error, 'strerror', None) or 'not a campaign'}") from None
        if not same:
            raise ResultsError(
                f"{folder}: holds another campaign (config, --vary or --seed differ); choose another --out"
            )

    def missing(self, flights: int) -> list[range]:
        """The batches that have not been flown: whole ones are, and a file that cannot be read is none."""
        wanted = [range(first, min(first + BATCH, flights)) for first in range(0, flights, BATCH)]
        return [batch for batch in wanted if self._rows(batch) < len(batch)]

    def _part(self, batch: range) -> Path:
        return self._parts / f"{batch.start // BATCH:08d}.parquet"

    def _rows(self, batch: range) -> int:
        try:
            return int(self._parquet.read_metadata(self._part(batch)).num_rows)
        except (OSError, self._arrow.ArrowException):
            return 0

    def add(self, batch: range, rows: list[Row]) -> None:
        """A batch has been flown."""
        self._write(self._part(batch), [self._arrow.Table.from_pylist(rows)])

    def merge(self, flights: int) -> Any:
        """All flights in one table, in their order; `table` is where it is."""
        batches = [range(first, min(first + BATCH, flights)) for first in range(0, flights, BATCH)]
        try:
            self._write(self.table, (self._parquet.read_table(self._part(batch)) for batch in batches))
            return self._parquet.read_table(self.table)
        except self._arrow.ArrowException as error:
            raise ResultsError(f"{self.table}: {str(error).splitlines()[0]}") from None

    def _write(self, path: Path, tables: Iterable[Any]) -> None:
        beside = path.with_suffix(".part")
        writer = None
        try:
            for table in tables:
                writer = writer or self._parquet.ParquetWriter(beside, table.schema)
                writer.write_table(table)
            if writer is not None:
                writer.close()
                os.replace(beside, path)
        except OSError as error:
            beside.unlink(missing_ok=True)
            raise ResultsError(f"{path}: {error.strerror or error}; what was flown before is kept") from None


def _put(path: Path, data: bytes) -> None:
    beside = path.with_suffix(".part")
    beside.write_bytes(data)
    os.replace(beside, path)
