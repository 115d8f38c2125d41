"""Every scenario that `companion sitl --scenarios` flies, and how to pick from them."""

from __future__ import annotations

from collections.abc import Sequence
from fnmatch import fnmatchcase
from typing import Final

from sitl.scenarios.catalogue.authority import AUTHORITY
from sitl.scenarios.catalogue.companion import COMPANION
from sitl.scenarios.catalogue.estimator import ESTIMATOR
from sitl.scenarios.catalogue.flight import FLIGHT
from sitl.scenarios.catalogue.ground import GROUND
from sitl.scenarios.catalogue.guards import GUARDS
from sitl.scenarios.catalogue.lies import LIES
from sitl.scenarios.catalogue.link import LINK
from sitl.scenarios.catalogue.px4 import PX4
from sitl.scenarios.scenario import Scenario

ALL: Final[tuple[Scenario, ...]] = (*FLIGHT, *GROUND, *ESTIMATOR, *LIES, *GUARDS, *LINK, *AUTHORITY, *PX4, *COMPANION)
_BY_NAME: Final = {scenario.name: scenario for scenario in ALL}


def by_name(name: str) -> Scenario:
    """The scenario of a name. Raises `KeyError`."""
    return _BY_NAME[name]


def pick(patterns: Sequence[str]) -> list[str]:
    """The names that match any of the patterns (`*`, `?`), in the order of the list; all of them for none.

    Raises `KeyError` with the pattern that matches nothing.
    """
    for pattern in patterns:
        if not any(fnmatchcase(name, pattern) for name in _BY_NAME):
            raise KeyError(pattern)
    return [name for name in _BY_NAME if not patterns or any(fnmatchcase(name, pattern) for pattern in patterns)]
