"""Does a certificate cover exactly this config? Verified at start, exactly, without a solver."""

from __future__ import annotations

from pathlib import Path
from typing import Final, NamedTuple

from companion.certify import proof
from companion.certify.from_config import problem
from companion.certify.statement import problem_of, statement
from companion.config import Config, ConfigError
from companion.config.attitude import link_share_s
from companion.config.guards.rows import GUARDS

_ASSUMPTIONS: Final = tuple(guard.key for guard in GUARDS.values() if guard.row.certified)


class Cover(NamedTuple):
    """`config` to fly with, and why no certificate covers the flight, as one line; None when one does."""

    config: Config
    uncovered: str | None


def unwatched(config: Config) -> list[str]:
    """Guards of what the certificate takes for granted that are switched off: it holds only as long as that does."""
    return [name for name in _ASSUMPTIONS if not getattr(config.guards, name).enabled]


def cover(config: Config, certificate: Path, *, hedging: bool) -> Cover:
    """Whether a certificate covers this flight over a real link.

    Where the config has no delay of its own, the certificate says how much the link may have, and that is the limit of
    `guards.link_delay_s` in the config that is answered.
    """
    if not hedging:
        return Cover(config, "a certificate is about the hedged controller, and this flight is not hedged")
    content, reason = proof.load(certificate)
    if reason:
        return Cover(config, reason)
    try:
        stated = statement(problem(config))
    except ConfigError as error:
        return Cover(config, str(error))
    verdict = proof.verify(content, stated)
    if not verdict.ok:
        return Cover(config, f"{certificate}: {verdict.reason}")
    if link_share_s(config.attitude) > 0.0:
        return Cover(config, None)
    delays = [axis.response.delay_s for axis in problem_of(content["problem"]).axes.values()]
    longest_s = min(float(upper - lower if upper > lower else upper) for lower, upper in delays)
    if longest_s == 0.0:
        return Cover(config, f"{certificate}: it covers no delay, and every link has one")
    given_s = config.guards.link_delay_s.limit
    if given_s is not None and given_s > longest_s:
        return Cover(config, f"guards.link_delay_s.limit ({given_s:g}) is above the {longest_s:g} s of {certificate}")
    return Cover(_with_limit(config, given_s or longest_s), None)


def _with_limit(config: Config, longest_s: float) -> Config:
    guard = config.guards.link_delay_s.model_copy(update={"limit": longest_s})
    return config.model_copy(update={"guards": config.guards.model_copy(update={"link_delay_s": guard})})
