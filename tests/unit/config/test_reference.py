"""`docs/config.md`: every key is described, and the page is what the schema says today."""

from __future__ import annotations

from pathlib import Path

from companion.config.base import NonNegative, Section
from companion.config.reference import all_keys, markdown, undocumented

PAGE = Path(__file__).parents[3] / "docs" / "config.md"


def test_every_key_has_a_meaning_and_every_quantity_a_unit() -> None:
    assert undocumented(all_keys()) == []


def test_the_page_is_not_stale() -> None:
    stale = "write it anew: python -m companion.config.reference > docs/config.md"
    assert PAGE.read_text(encoding="utf-8") == markdown(), stale


class _Below(Section):
    told_s: NonNegative = 0.5
    """Told."""
    share: NonNegative
    """A number whose unit nobody knows."""
    untold_m: NonNegative


class _Whole(Section):
    below: _Below = _Below(share=0.25, untold_m=3.0)
    """A section."""


def test_what_is_missing_is_found() -> None:
    assert undocumented(all_keys(_Whole)) == ["below.share", "below.untold_m"]


def test_a_default_of_the_section_counts_more_than_that_of_the_key() -> None:
    defaults = {key.path: key.default for key in all_keys(_Whole)}
    assert defaults == {"below": "see below", "below.told_s": "0.5", "below.share": "0.25", "below.untold_m": "3"}
    own = {key.path: key.default for key in all_keys(_Below)}
    assert own["share"] == "required"


def test_a_key_tells_its_range_and_unit() -> None:
    keys = {key.path: key for key in all_keys()}
    assert (keys["tick.rate_hz"].kind, keys["tick.rate_hz"].unit) == ("number > 0, ≤ 1000", "Hz")
    assert keys["attitude.x.delay_s"].kind == "number ≥ 0, or list of 2: number ≥ 0"
    assert keys["controller.axes.x.position_weight_bound"].unit == "1/m"
    assert keys["guards.pose_age_s.limit"].default == "0.25"
