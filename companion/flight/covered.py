"""Does a certificate cover exactly this config? Verified at start, exactly, without a solver."""

from __future__ import annotations

from pathlib import Path

from companion.certify import proof
from companion.certify.statement import statement
from companion.config import Config, ConfigError
from companion.config.certification import problem


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
