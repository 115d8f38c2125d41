"""The other checkout of this project that a benchmark is given to compare with."""

from __future__ import annotations

import argparse
from pathlib import Path


def checkout(text: str) -> Path:
    """Type of `--baseline`: the absolute path of a folder that holds this project.

    Python skips a folder of PYTHONPATH that is not there and takes the installed package instead: this project would be
    compared with itself. Raises `argparse.ArgumentTypeError`.
    """
    path = Path(text).resolve()
    if not (path / "companion" / "__init__.py").is_file():
        raise argparse.ArgumentTypeError(f"{text} is no checkout of this project")
    return path
