"""The functions that fly, compiled: numba gets their own code, bound to each other compiled instead of interpreted.

A pure step looks up what it calls in its module. Here each module has a shadow: the same names, with every function of
ours compiled by numba and every module of ours replaced by its shadow. Nothing is copied and no module is changed, so
that the flight process and the plant in the same program go on uncompiled.

What is compiled is kept on disk in a folder named after all the source it may be made of: numba itself looks only at
the file of the function that is called.
"""

from __future__ import annotations

import hashlib
import os
import sys
from collections.abc import Callable
from functools import cache
from pathlib import Path
from types import FunctionType, ModuleType
from typing import Any, Final

import sitl
from companion.attitude_response import held
from companion.errors import CompanionError

_ROOMS: Final = (
    "companion.control", "companion.attitude_response.held", "sitl.vehicles", "sitl.world", "sitl.autopilot",
    "sitl.campaign",
)  # fmt: skip
_ROOT: Final = Path(sitl.__file__ or "").parents[1]
_SOURCES: Final = (
    Path(held.__file__),
    *(path for room in _ROOMS for path in (_ROOT / room.replace(".", "/")).rglob("*.py")),
)


class MissingNumbaError(CompanionError):
    """numba is not installed; the message says how to install it."""


def require() -> None:
    """Raises `MissingNumbaError` where numba is missing."""
    _numba()


def _numba() -> Any:
    try:
        import numba  # noqa: PLC0415 - an extra: flying needs none of it
    except ImportError:
        raise MissingNumbaError("a campaign needs numba: pip install 'companion[campaign]'") from None
    return numba


def cache_folder() -> Path:
    """Where what is compiled from the source as it is now is kept."""
    base = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    digest = hashlib.sha256(f"{_numba().__version__} {sys.version}".encode())
    for path in sorted(_SOURCES):
        digest.update(path.read_bytes())
    return base / "companion" / f"campaign-{digest.hexdigest()[:16]}"


class _Shadows:
    """Shadows of modules, each made once. Args: `rebound`, names of one module that are bound to something else."""

    def __init__(self, numba: Any, kept: FunctionType, rebound: dict[str, ModuleType]) -> None:
        self._numba, self._kept, self._rebound = numba, kept, rebound
        self._made: dict[str, ModuleType] = {}
        self._suffix = "".join(f"_{module.__name__.rpartition('.')[2]}" for module in rebound.values())

    def of(self, module: ModuleType) -> ModuleType:
        name = module.__name__
        if name in self._made:
            return self._made[name]
        shadow = self._made[name] = ModuleType(name)
        for attribute, value in vars(module).items():
            if not attribute.startswith("__"):
                setattr(shadow, attribute, self._bound(value, shadow))
        if name == self._kept.__module__:
            for attribute, other in self._rebound.items():
                setattr(shadow, attribute, self.of(other))
        return shadow

    def _bound(self, value: Any, shadow: ModuleType) -> Any:
        if isinstance(value, ModuleType):
            return self.of(value) if _ours(value.__name__) else value
        if not isinstance(value, FunctionType) or not _ours(value.__module__):
            return value
        if value.__module__ != shadow.__name__:
            return getattr(self.of(sys.modules[value.__module__]), value.__name__)
        same = FunctionType(value.__code__, vars(shadow), value.__name__, value.__defaults__)
        # Code from disk is linked by its name, the first of a name for all: what calls another vehicle needs another.
        same.__qualname__ = f"{value.__name__}{self._suffix}"
        # A division by zero makes a number that is none, as in C, and ends the flight as such.
        return self._numba.njit(same, cache=value is self._kept, error_model="numpy")


def _ours(module: str) -> bool:
    return any(module == room or module.startswith(f"{room}.") for room in _ROOMS)


def compiled(function: Callable[..., Any], **rebound: ModuleType) -> Callable[..., Any]:
    """The function compiled, with all that it calls; on its first call, or taken from disk if it has been before.

    `rebound`: modules that the function's own module is to know by these names. Raises `MissingNumbaError`.
    """
    assert isinstance(function, FunctionType)
    numba = _numba()
    before, numba.config.CACHE_DIR = numba.config.CACHE_DIR, str(_folder())
    try:
        shadow = _Shadows(numba, function, rebound).of(sys.modules[function.__module__])
        return getattr(shadow, function.__name__)  # type: ignore[no-any-return]
    finally:
        numba.config.CACHE_DIR = before


@cache
def _folder() -> Path:
    folder = cache_folder()
    folder.mkdir(parents=True, exist_ok=True)
    return folder
