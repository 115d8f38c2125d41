"""The key of a flight: whom it makes believed, and what of it is kept from one run to the next."""

from __future__ import annotations

import math
import threading
from typing import Final

from companion.config.schema import Config
from companion.mavlink.freshness import FreshSigning
from companion.mavlink.signing import read_key
from companion.mavlink.stamps import read_stamps, stamps_file, write_stamps

_KEEP_S: Final = 60.0  # between two times that the stamps are written


class Trust:
    """Signing where there is a key.

    Attributes: `signing`, None without a key; `remarks`, what a person should know of what was kept.
    """

    def __init__(self, config: Config) -> None:
        self.signing: FreshSigning | None = None
        self.remarks: list[str] = []
        self._kept_s = -math.inf
        self._writing: threading.Thread | None = None
        key_file = config.link.signing_key_file
        if key_file is None:
            return
        key = read_key(key_file)
        self._file = stamps_file(key)
        kept, complaint = read_stamps(self._file)
        self.remarks += [] if complaint is None else [complaint]
        vehicle, own = config.vehicle, config.link
        ids = (vehicle.system_id, vehicle.component_id), (own.system_id, own.component_id)
        self.signing = FreshSigning(key, *ids, kept=kept)

    def keep(self, now_s: float) -> None:
        """Write the stamps once a minute, by a thread: a disk may take its time."""
        if self.signing is None or not self.signing.proven or now_s - self._kept_s < _KEEP_S:
            return
        if self._writing is None or not self._writing.is_alive():
            self._kept_s = now_s
            stamps = self.signing.stamps()
            self._writing = threading.Thread(target=write_stamps, args=(self._file, stamps), name="stamps", daemon=True)
            self._writing.start()

    def close(self) -> str | None:
        """Write them a last time; a complaint as one line, or None."""
        if self.signing is None or not self.signing.proven:
            return None
        if self._writing is not None:
            self._writing.join(1.0)
        return write_stamps(self._file, self.signing.stamps())
