"""A terminal escape in somebody else's text is shown, and not obeyed."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from companion.cli import main
from companion.errors import printable
from companion.flight.host.terminal import Terminal
from companion.flight.vehicle_link.messages import Parameter, parameter

CLEARS = "\x1b[2J\x1b]0;owned\x07"
SHOWN = r"\x1b[2J\x1b]0;owned\x07"


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("plain, ωn = 4 rad/s °", "plain, ωn = 4 rad/s °"),
        (CLEARS, SHOWN),
        ("a\nb\r\tc", r"a\nb\r\tc"),
        ("\x9b31m\x7f", r"\x9b31m\x7f"),
        ("left\u202eright", r"left\u202eright"),
        ("\udcff", r"\udcff"),  # of a file name that is no UTF-8
    ],
)
def test_what_a_terminal_would_obey_is_escaped(text: str, shown: str) -> None:
    assert printable(text) == shown
    assert shown.isprintable()


def test_a_line_for_the_person_beside_a_flight() -> None:
    out, into = os.pipe()
    terminal = Terminal(into)
    terminal.print_line(f"released: {CLEARS}")
    terminal.close()
    os.close(into)
    with open(out, "rb") as stream:
        assert stream.read() == f"released: {SHOWN}\n".encode()


@pytest.mark.parametrize("command", [["identify"], ["check"], ["run"]])
def test_the_name_of_a_file(command: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / f"log{CLEARS}.ulg"
    path.write_bytes(b"no log")
    with pytest.raises(SystemExit):
        main([*command, str(path)])
    said = capsys.readouterr()
    assert "\x1b" not in said.out + said.err
    assert SHOWN in said.err


def test_a_key_of_a_config(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "config.yaml"
    path.write_text('"\\e[2J": 1\n')
    with pytest.raises(SystemExit):
        main(["check", str(path)])
    assert "\x1b" not in capsys.readouterr().err


def test_a_parameter_s_name() -> None:
    payload = b"\0" * 8 + b"MC\x1b[2J".ljust(16, b"\0") + b"\x09"
    assert parameter(payload) == Parameter(r"MC\x1b[2J", 0.0)
