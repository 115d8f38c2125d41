"""The numbers of a config are those that stand in it, digit for digit, or it is refused."""

from decimal import Decimal
from pathlib import Path

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from companion.certify.from_config import problem
from companion.config.load import ConfigError, load_config, load_text, parse_override

ROOT = Path(__file__).resolve().parents[3]
RIG = ROOT / "config" / "antx_rig.yaml"
TEXT = RIG.read_text()


def complaint(number: str) -> str:
    """Of the rig's config with this text for its natural frequency."""
    with pytest.raises(ConfigError) as caught:
        load_text(TEXT.replace("natural_frequency_rad_s: 2.3", f"natural_frequency_rad_s: {number}"), RIG, ROOT)
    assert len(str(caught.value).splitlines()) == 1
    return str(caught.value)


LINE = next(n for n, line in enumerate(TEXT.splitlines(), 1) if "natural_frequency_rad_s: 2.3" in line)


@pytest.mark.parametrize(
    ("number", "why"),
    [
        ("010", "no plain decimal number, and YAML would read 8: write"),
        ("1:30", "and YAML would read 90"),
        ("1:30.5", "and YAML would read 90.5"),
        ("0x1F", "and YAML would read 31"),
        ("0b11", "and YAML would read 3"),
        ("1_000", "and YAML would read 1000"),
        ("2_0.5", "and YAML would read 20.5"),
        ("007.5", "and YAML would read 7.5"),
        ("!!float '010'", "and YAML would read 10.0"),
        ("08", "no plain decimal number: write decimal digits"),
        ("1_0e2", "no plain decimal number"),
        ("٣", "no plain decimal number"),
        ("2.30000000000000000001", "has more digits than are kept: write 2.3"),
        ("1e-400", "has more digits than are kept: write 0.0"),
        ("1e-99999999999999999999999", "has more digits than are kept"),
    ],
)
def test_a_number_that_would_be_read_otherwise_is_refused_where_it_stands(number: str, why: str) -> None:
    said = complaint(number)
    assert why in said
    assert f"antx_rig.yaml line {LINE}: " in said
    with pytest.raises(ConfigError) as caught:
        parse_override(f"a.b={number}")
    assert why in str(caught.value)
    assert str(caught.value).startswith(f"--set a.b={number}: ")


@pytest.mark.parametrize(
    ("number", "why"),
    [
        (".inf", "natural_frequency_rad_s: input should be a finite number"),
        ("1e999", "natural_frequency_rad_s: input should be a finite number"),
        ("'2.3'", "natural_frequency_rad_s: a number is wanted"),
        ("9007199254740993", "natural_frequency_rad_s: it has more digits than are kept"),
        ("yes", "natural_frequency_rad_s: a number is wanted"),
    ],
)
def test_what_is_no_number_is_refused_by_its_key(number: str, why: str) -> None:
    assert why in complaint(number)


def test_words_that_begin_with_digits_stay_words() -> None:
    values = parse_override("a=[1.2.3, 2026-x, '010', '1e3', 1e3, -5, +.5, 3., 1.e2]")[1]
    assert values == ["1.2.3", "2026-x", "010", "1e3", 1000.0, -5, 0.5, 3.0, 100.0]
    assert [type(value) for value in values[5:7]] == [int, float]


@given(st.text("0123456789+-._eExb: ", min_size=1, max_size=24))
@example("010")
@example("0.1000000000000000055511151231257827")
def test_a_number_that_is_taken_is_the_one_written(text: str) -> None:
    """Whatever the text: a finite number comes of it only where a person reads the same one."""
    try:
        value = parse_override(f"a={text}")[1]
    except ConfigError:
        return
    if isinstance(value, int | float) and not isinstance(value, bool) and abs(value) < float("inf"):
        assert Decimal(str(value)) == Decimal(text.strip())
        assert "_" not in text


@given(st.decimals(min_value="2.2", max_value="2.32", places=12))
def test_the_certificate_speaks_of_the_digits_of_the_file(frequency: Decimal) -> None:
    config = load_config(RIG, (f"controller.axes.x.natural_frequency_rad_s={frequency}",))
    assert problem(config).axes["x"].natural_frequency_rad_s == frequency
