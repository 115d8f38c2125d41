"""Does a certificate cover exactly this config? Verified at start, exactly, without a solver."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from companion.certify import proof
from companion.certify.from_config import problem
from companion.certify.statement import statement
from companion.config import Config, ConfigError
from companion.config.attitude import certified_delay_s
from companion.config.guards.rows import GUARDS

_ASSUMPTIONS: Final = tuple(guard.key for guard in GUARDS.values() if guard.row.certified)


def unwatched(config: Config) -> list[str]:
    """Guards of what the certificate takes for granted that are switched off: it holds only as long as that does."""
    off = [name for name in _ASSUMPTIONS if not getattr(config.guards, name).enabled]
    return [name for name in off if name != "link_delay_s" or certified_delay_s(config.attitude) > 0.0]


def uncovered(config: Config, certificate: Path, *, hedging: bool) -> str | None:
    """Why the certificate does not cover this flight, as one line; None when it does."""
    if not hedging:
        return "a certificate is about the hedged controller, and this flight is not hedged"
    content, reason = proof.load(certificate)
    if reason:
        return reason
    try:
        stated = statement(problem(config))
    except ConfigError as error:
        return str(error)
    verdict = proof.verify(content, stated)
    return None if verdict.ok else f"{certificate}: {verdict.reason}"
