"""The `companion` command in this process: what it does is the same, but its imports are paid for once."""

from __future__ import annotations

import contextlib
import io
from pathlib import Path
from typing import NamedTuple

import pytest

from companion.cli import main
from harness.processes import ROOT


class Ended(NamedTuple):
    """How it ended."""

    returncode: int
    stdout: str
    stderr: str


def companion(*arguments: object, cwd: Path = ROOT) -> Ended:
    """The command with these arguments, in this folder. Whatever it lets out as an exception fails the test."""
    out, err = io.StringIO(), io.StringIO()
    with (
        contextlib.chdir(cwd),
        contextlib.redirect_stdout(out),
        contextlib.redirect_stderr(err),
        pytest.raises(SystemExit) as ended,
    ):
        main([str(argument) for argument in arguments])
    code = ended.value.code
    assert isinstance(code, int)
    return Ended(code, out.getvalue(), err.getvalue())
