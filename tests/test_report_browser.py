"""Pages in a real browser: nothing in the console, every picture decoded, nothing wider than the window."""

from __future__ import annotations

import base64
import re
from pathlib import Path

import pytest
from headless import Browser, find_browser

ROOT = Path(__file__).resolve().parent.parent
FOUND = find_browser()

pytestmark = pytest.mark.skipif(
    FOUND is None,
    reason="no browser is installed (chromium, chromium-browser, google-chrome): pages are checked as text only",
)
PHONE, SCREEN, FOLD = 400, 1280, 800


@pytest.fixture(scope="module")
def browser(tmp_path_factory):
    with Browser(FOUND, tmp_path_factory.mktemp("profile")) as found:
        yield found


@pytest.fixture(scope="module")
def pages(grip_slip_page, point_page, drop_page):
    return {
        "grip-slip": grip_slip_page,
        "point": point_page,
        "drop": drop_page,
        "chapter five": ROOT / "fits" / "chapter_five" / "report.html",
    }


def complaints(visit, page):
    """What is wrong with a visited page, in words."""
    layout = visit.layout
    found = [f"console: {item}" for item in visit.errors]
    outside = [item for item in visit.requests if not item.startswith("data:") and item != page.as_uri()]
    found += [f"asks for {item}" for item in outside]
    found += [f"broken image {k}" for k, image in enumerate(layout["images"]) if not image["natural"] > 0]
    found += [f"image {k} without words" for k, image in enumerate(layout["images"]) if not image["alt"]]
    found += [f"{href} leads nowhere" for href in layout["dead"]]
    if layout["scroll"] > layout["width"]:
        found.append(f"{layout['scroll']} px wide in a window of {layout['width']}")
    return found


@pytest.mark.parametrize("name", ["grip-slip", "point", "drop", "chapter five"])
@pytest.mark.parametrize(("width", "scheme"), [(PHONE, "light"), (SCREEN, "dark")])
def test_pages_hold_in_a_browser(browser, pages, name, width, scheme):
    visit = browser.visit(pages[name], width, scheme)
    assert complaints(visit, pages[name]) == []
    assert visit.layout["width"] == width
    assert len(visit.layout["images"]) > 0
    if name != "chapter five":
        assert visit.layout["anchors"] >= 9


def test_dark_is_dark_and_figures_can_be_read_on_a_phone(browser, pages):
    light, dark = (browser.visit(pages["grip-slip"], PHONE, scheme) for scheme in ("light", "dark"))
    assert light.layout["paper"] == "rgb(255, 255, 255)"
    assert dark.layout["paper"] == "rgb(21, 24, 28)"
    # Wider than the window, in a box that scrolls: letters keep their size.
    assert max(image["shown"] for image in light.layout["images"]) > 1.3 * PHONE


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("<h1>", "<script>throw new Error('broken')</script><h1>", "console"),
        ("<h1>", "<script>console.error('broken')</script><h1>", "console"),
        ("png;base64,iVBOR", "png;base64,AAAAA", "broken image 0"),
        ("<h1>", '<img alt="far" src="http://127.0.0.1:9/x.png"><h1>', "asks for http://127.0.0.1:9/x.png"),
        ("<h1>", '<div style="width: 500px">wide</div><h1>', "516 px wide"),
        ('<img alt="', '<img alt="" title="', "without words"),
        ('href="#determined"', 'href="#determind"', "#determind leads nowhere"),
    ],
)
def test_a_page_broken_on_purpose_fails(browser, pages, tmp_path, old, new, said):
    text = pages["drop"].read_text(encoding="utf-8")
    assert old in text
    broken = tmp_path / "broken.html"
    broken.write_text(text.replace(old, new, 1), encoding="utf-8")
    found = complaints(browser.visit(broken, PHONE), broken)
    assert any(said in item for item in found), found


WHERE = """[...document.querySelectorAll('p.verdict, .beside img, .beside table')].map(element => {
  const box = element.getBoundingClientRect();
  return [element.tagName, box.left, box.top, box.right, box.bottom];
})"""


def boxes(browser, page, width):
    session = browser.open(page, width)
    answer = browser.call("Runtime.evaluate", session, expression=WHERE, returnByValue=True)
    browser.call("Page.close", session)
    return {name: sides for name, *sides in answer["result"]["value"]}


@pytest.mark.parametrize("name", ["grip-slip", "drop"])
def test_verdict_curves_and_parameters_are_above_the_fold(browser, pages, name):
    found = boxes(browser, pages[name], SCREEN)
    assert all(sides[1] < 0.7 * FOLD for sides in found.values())
    assert found["IMG"][3] < FOLD + 40.0 and found["IMG"][2] <= found["TABLE"][0]
    narrow = boxes(browser, pages[name], PHONE)
    assert narrow["IMG"][3] < narrow["TABLE"][1]


@pytest.mark.parametrize("name", ["grip-slip", "drop", "point"])
def test_a_report_prints_on_at_most_four_pages(browser, pages, name):
    session = browser.open(pages[name], SCREEN, media="print")
    made = browser.call("Page.printToPDF", session, preferCSSPageSize=True)
    browser.call("Page.close", session)
    count = len(re.findall(rb"/Type\s*/Page\b", base64.b64decode(made["data"])))
    assert 2 <= count <= 4
