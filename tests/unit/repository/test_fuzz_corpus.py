"""What fuzzing has found and kept, once more: inputs that reach all that was reached, and those that once broke it.

`tests/data/fuzz/TARGET.json` holds them, base64 (`benchmarks/fuzz/fuzz.py --minimise`).
"""

from __future__ import annotations

import base64
import importlib
import json
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[3]
CORPORA = sorted((ROOT / "tests" / "data" / "fuzz").glob("*.json"))


@pytest.mark.parametrize("corpus", CORPORA, ids=[path.stem for path in CORPORA])
def test_nothing_but_errors_for_a_person_comes_out(corpus: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(ROOT / "benchmarks" / "fuzz"))
    targets = importlib.import_module("targets").TARGETS
    inputs = [base64.b64decode(one) for one in json.loads(corpus.read_text())]
    assert inputs
    for data in inputs:
        targets[corpus.stem](data)  # raises, or an assertion of its own fails


def test_every_target_has_a_corpus(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(ROOT / "benchmarks" / "fuzz"))
    assert {path.stem for path in CORPORA} == set(importlib.import_module("targets").TARGETS)
