"""The page in a real browser: nothing complains, every panel is drawn, replay and keyboard move, on a phone too."""

from __future__ import annotations

import json
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from companion.report.page import page
from companion.report.reading import read

sync_api = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="no Chromium is installed")


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    with sync_api.sync_playwright() as playwright:
        found = playwright.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        yield found
        found.close()


@pytest.fixture(scope="module")
def made(flights: dict[str, Path], tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("page") / "two.html"
    out.write_text(page([read(flights["pilot_hold"]), read(flights["gps_lost"])]), encoding="utf-8")
    return out


@pytest.mark.parametrize(("width", "scheme"), [(1400, "light"), (390, "dark")])
def test_every_panel_is_drawn_and_everything_moves(browser: Any, made: Path, width: int, scheme: str) -> None:
    tab = browser.new_page(viewport={"width": width, "height": 844}, color_scheme=scheme)
    complaints: list[str] = []
    tab.on("console", lambda message: complaints.append(message.text))
    tab.on("pageerror", lambda error: complaints.append(str(error)))
    tab.on("request", lambda request: request.url.startswith(("http:", "https:")) and complaints.append(request.url))
    tab.goto(made.as_uri())
    tab.wait_for_selector("body[data-ready]")
    data = json.loads(tab.inner_text("#data") or tab.evaluate("document.getElementById('data').textContent"))
    panels = sum(len(flight["panels"]) for flight in data["flights"])
    assert panels > 30
    assert tab.evaluate(INKED) == panels
    assert tab.evaluate("[...document.querySelectorAll('.plot')].every((p) => p.getAttribute('aria-label'))")
    assert tab.evaluate("document.documentElement.scrollWidth") <= width
    where = tab.inner_text(".where >> nth=0")
    tab.click("#play")
    tab.wait_for_function("(was) => document.querySelector('.where').innerText !== was", arg=where)
    whole = tab.evaluate(SPAN)
    tab.focus(".plot >> nth=4")
    tab.keyboard.press("+")
    tab.wait_for_function(f"(was) => ({SPAN}) < 0.8 * was", arg=whole)
    assert tab.evaluate(SPANS) == 1  # zoom is linked
    assert complaints == []
    tab.close()


INKED = """[...document.querySelectorAll('.plot canvas')].filter((c) =>
  new Set(new Uint32Array(c.getContext('2d').getImageData(0, 0, c.width, c.height).data.buffer)).size > 3).length"""
SPAN = "plots[0].scales.x.max - plots[0].scales.x.min"
SPANS = "new Set(plots.map((p) => (p.scales.x.max - p.scales.x.min).toFixed(6))).size"
