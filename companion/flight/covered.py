"""Does a certificate cover exactly this config? Verified at start, exactly, without a solver."""

from __future__ import annotations

from pathlib import Path

from companion.certify import proof
from companion.certify.statement import statement
from companion.config import Config
from companion.config.certification import problem


def uncovered(config: Config, certificate: Path, *, hedging: bool) -> str | None:
    """Why the certificate does not cover this flight, as one line; None when it does.

    Raises `ConfigError` when the config itself is impossible.
    """
    if not hedging:
        return "a certificate is about the hedged controller, and this flight is not hedged"
    content, reason = proof.load(certificate)
    if reason:
        return reason
    verdict = proof.verify(content, statement(problem(config)))
    return None if verdict.ok else f"{certificate}: {verdict.reason}"
