"""Imported first by benchmarks that share `tests/harness` with the tests."""

import sys
from pathlib import Path

sys.path.append(str(Path(__file__).resolve().parents[1] / "tests"))
