"""The page as text: balanced, self-contained, and saying what the fit found."""

from __future__ import annotations

import base64
import re
import shutil
from dataclasses import replace
from html import escape
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import fitball
from fitball.data.read import load_table
from fitball.inference.identifiability.verdict import plain
from fitball.inference.prediction.outputs import root_mean_square
from fitball.inference.results.results import BudgetLine, ErrorBudget, Verdict
from fitball.inference.thesis.published_cases import case_errors, compare_cases
from fitball.report.figures.canvas import PNG_COLOURS, few_colours, new_figure, save_figure
from fitball.report.figures.registry import FIGURES, alt_text
from fitball.report.fit.document import case_parts, page
from fitball.report.fit.folder import write_all
from fitball.report.fit.rows import budget_rows, budget_sentence
from fitball.report.form.document import DPI
from fitball.report.form.numbers import digits
from fitball.report.form.palette import MEASURED, MODEL

ROOT = Path(__file__).resolve().parent.parent
# Elements that have no end tag (HTML, "void elements"), so far as these pages use them.
VOID = {"meta", "img", "br", "link", "hr", "input"}
REACHES_OUT = re.compile(
    r"(?:src|href|action|poster)\s*=\s*[\"']?\s*(?:https?:)?//|url\(\s*[\"']?(?!data:)|@import", re.I
)


class Strict(HTMLParser):
    """Collects what is wrong with a page."""

    def __init__(self) -> None:
        super().__init__(convert_charrefs=True)
        self.open, self.faults, self.ids, self.links, self.images = [], [], [], [], []
        self.cells, self.tables = 0, []

    def handle_starttag(self, tag, attrs):
        found = dict(attrs)
        if tag not in VOID:
            self.open.append(tag)
        if "id" in found:
            self.ids.append(found["id"])
        if tag == "a":
            self.links.append(found.get("href", ""))
        if tag == "img":
            self.images.append(found)
        if tag == "table":
            self.tables.append([])
        if tag == "tr":
            self.cells = 0
        if tag in ("td", "th"):
            self.cells += int(found.get("colspan", 1))
        if tag in ("script", "iframe", "object", "link"):
            self.faults.append(f"<{tag}>")

    def handle_endtag(self, tag):
        if not self.open or self.open.pop() != tag:
            self.faults.append(f"</{tag}> at {self.getpos()}")
        if tag == "tr":
            self.tables[-1].append(self.cells)


def faults(text):
    """Everything wrong with a page, in words."""
    parser = Strict()
    parser.feed(text)
    parser.close()
    found = [*parser.faults, *(f"<{tag}> stays open" for tag in parser.open)]
    found += [f"id {name} twice" for name in set(parser.ids) if parser.ids.count(name) > 1]
    found += [f"{link} leads nowhere" for link in parser.links if link.removeprefix("#") not in parser.ids]
    found += ["image without words" for image in parser.images if not (image.get("alt") or "").strip()]
    found += ["image from outside" for image in parser.images if not image["src"].startswith("data:image/")]
    found += ["ragged table" for rows in parser.tables if len(set(rows)) > 1]
    shown = re.sub(r"data:image/[^\"]*", "", text)
    found += [f"reaches out: {item}" for item in REACHES_OUT.findall(shown)]
    return found


@pytest.fixture(scope="module")
def text(grip_slip_page):
    return grip_slip_page.read_text(encoding="utf-8")


def test_pages_are_whole(text, grip_slip_fit, point_page, drop_page):
    assert text.count("<img ") == 9
    assert all(item.name in text and item.verdict_words in text for item in grip_slip_fit.estimates)
    for item in (text, point_page.read_text(encoding="utf-8"), drop_page.read_text(encoding="utf-8")):
        assert faults(item) == []
        assert not re.search(r"\b(nan|None|Undefined|inf)\b", re.sub(r"data:image/[^\"]*", "", item))


def test_the_committed_page_of_chapter_five_is_whole():
    assert faults((ROOT / "fits" / "chapter_five" / "report.html").read_text(encoding="utf-8")) == []


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("</section>", "", "</body>"),
        ("<h1>", '<h1><img src="data:image/png;base64,x" alt=" ">', "image without words"),
        ('href="#determined"', 'href="#determind"', "#determind leads nowhere"),
        ("<h1>", '<script src="https://example.org/x.js"></script><h1>', "<script>"),
        ("body { font", "body { background: url(http://example.org/x.png); font", "reaches out"),
        ('<tr><td class="text">mu</td>', "<tr>", "ragged table"),
    ],
)
def test_a_broken_page_is_noticed(text, old, new, said):
    assert old in text
    assert any(said in item for item in faults(text.replace(old, new, 1)))


def test_sections_are_in_the_order_of_the_contents(text, grip_slip_fit):
    order = [text.index(f'<section id="{name}"') for name in re.findall(r'<a href="#([a-z-]+)"', text)]
    assert len(order) > 12
    assert order == sorted(order)
    assert text.index(escape(grip_slip_fit.adequacy.sentence[:40])) < text.index("Contents")


def test_a_page_is_small_and_shows_the_files_beside_it(text, grip_slip_page):
    assert len(text.encode()) < 1_000_000
    written = {place.stem: place.read_bytes() for place in grip_slip_page.parent.glob("*.png")}
    assert set(written) == set(FIGURES) - {"force"}
    shown = [base64.b64decode(item) for item in re.findall(r'src="data:image/png;base64,([^"]*)"', text)]
    assert sorted(shown) == sorted(written.values())


def test_without_figures_there_are_none_and_older_ones_go(grip_slip_fit, grip_slip_page, tmp_path):
    place = shutil.copytree(grip_slip_page.parent, tmp_path / "fit")
    (place / "mine.png").write_bytes(b"not ours")
    write_all(grip_slip_fit, place, figures=False)
    assert [item.name for item in place.glob("*.png")] == ["mine.png"]
    bare = (place / "report.html").read_text(encoding="utf-8")
    assert "<img" not in bare and faults(bare) == []


def test_a_figure_keeps_the_colours_of_its_areas(tmp_path):
    colours = [MODEL, MEASURED, "#f2f3f3", "#e4e6e7"]
    figure = new_figure(2.0, 1.0, layout=None)
    for k, colour in enumerate(colours):
        figure.add_axes((0.2 * k, 0.0, 0.2, 1.0)).set_facecolor(colour)
    content = save_figure(figure, tmp_path / "some.png")
    assert content == (tmp_path / "some.png").read_bytes()
    picture = Image.open(tmp_path / "some.png")
    assert picture.size == (2 * DPI, DPI) and picture.info["dpi"] == pytest.approx((DPI, DPI), abs=0.02)
    assert picture.mode == "P" and len(picture.getcolors()) <= PNG_COLOURS
    pixels = np.asarray(picture.convert("RGB")).astype(int)
    for k, colour in enumerate(colours):
        # Pale bands, one on the other, stay apart from each other and from the paper.
        assert np.abs(pixels[70, 30 + 60 * k] - list(bytes.fromhex(colour[1:]))).max() <= 3
    assert pixels[70, 290].tolist() == [255, 255, 255]


def test_what_has_more_colours_gets_the_nearest():
    rng = np.random.default_rng(2)
    pixels = np.full((200, 300, 4), 255, dtype=np.uint8)
    pixels[:100, :, :3] = rng.integers(0, 256, (100, 300, 3))
    pixels[100:150, :, :3] = (0, 114, 178)
    shown = np.asarray(few_colours(pixels).convert("RGB")).astype(int)
    assert np.abs(shown[100:150] - (0, 114, 178)).max() <= 3 and np.all(shown[150:] == 255)
    assert np.median(np.abs(shown[:100] - pixels[:100, :, :3]).max(axis=-1)) < 40


def test_long_tables_are_cut_and_say_so(grip_slip_fit, monkeypatch):
    monkeypatch.setattr("fitball.report.form.document.MOST_ROWS", 5)
    cut = page(grip_slip_fit, {})
    assert cut.count("16 more: ") == 2
    assert faults(cut) == []


def test_what_is_conditional_is_not_called_identified(grip_slip_fit):
    fit = grip_slip_fit
    conditional = {item.name: replace(item, verdict=Verdict.CONDITIONAL) for item in fit.estimates}
    said = page(replace(fit, parameters=conditional), {})
    assert '<span class="v-identified"' not in said and "conditional" in said


def test_alt_texts_carry_the_numbers(grip_slip_fit):
    found = {name: alt_text(name, grip_slip_fit) for name in ("corner", "residuals", "regimes", "trace")}
    mu = grip_slip_fit.parameters["mu"]
    assert f"mu {mu.median:.3f} [{mu.q025:.3f}, {mu.q975:.3f}]" in found["corner"]
    residual = {item.name: (item.observed - item.median) / item.sd for item in grip_slip_fit.predictive.observables}
    for name, values in residual.items():
        worst = int(np.argmax(np.abs(values)))
        beyond = int(np.sum(np.abs(values) > 2.0))
        told = f"{name}: {beyond} of 21 beyond 2 sd, the largest {values[worst]:+.1f} sd at impact "
        assert told + grip_slip_fit.problem.table.ids[worst] in found["residuals"]
    sliding = sum(next(iter(item)) == "slide" for item in grip_slip_fit.predictive.regimes)
    assert f"slide at {sliding}" in found["regimes"]
    strongest = np.abs(grip_slip_fit.correlation - np.eye(len(grip_slip_fit.problem.free_names))).max()
    assert re.search(rf"Strongest correlations: \w+ with \w+ [+-]{strongest:.2f}", found["corner"])
    assert f"{grip_slip_fit.diagnostics.max_r_hat:.3f}" in found["trace"]
    for r_hat, words in ((1.003, "too few draws. Largest R-hat 1.003"), (1.02, "not converged")):
        worst = replace(grip_slip_fit.diagnostics, converged=False, max_r_hat=r_hat)
        assert words in alt_text("trace", replace(grip_slip_fit, diagnostics=worst))


def test_bounds_in_words_have_no_powers_of_ten():
    assert plain(7424.0, "N/m") == "7420 N/m"
    assert plain(0.00252, "m") == "0.00252 m"


# --- beside Table 9


def test_cases_of_table_9_stand_beside_a_fit_of_wangs_data(grip_slip_fit, text):
    table = load_table("wang_all.csv")
    found = compare_cases(table, grip_slip_fit.point.rebound, ())
    # Table 9 in print: M1/M, k_y [lb/in]; a pound a inch is 175.127 N/m.
    assert [item.values["mass_ratio"] for item in found.cases] == pytest.approx([2 / 3, 2 / 3, 1 / 2])
    assert [item.values["k_y"] / 175.127 for item in found.cases] == pytest.approx([80.0, 90.0, 72.0], rel=1e-4)
    # The README's figure of case 3 on all 21 impacts.
    assert found.cases[2].rms["omega_2"] == pytest.approx(128.4, abs=0.1)
    for name, value in grip_slip_fit.point.rms.items():
        assert found.fitted_rms[name] == pytest.approx(value, rel=1e-9)
    words, values, _errors = case_parts(grip_slip_fit)
    rows = {row[0]: row for row in values.rows if row[0]}
    assert rows["k_y"][1:] == ("lb/in", "not in this model", "80.0", "90.0", "72.0")
    offset = grip_slip_fit.parameters["offset"].median / 0.0254
    assert rows["eps_10"][1:3] == ("in", rows["eps_10"][2])
    assert float(rows["eps_10"][2].split(" ")[0]) == pytest.approx(offset, abs=0.002)
    # Eq. (53) at 10 m/s: 0.0431 x 10 - 0.189.
    assert rows["eps_10"][3:] == ("0.242",) * 3
    assert rows["k_theta"][3:] == ("1000", "1000", "1000")
    assert rows["mu"][3:] == ("0.550", "0.550", "0.550")
    assert "0.50 m/s in v_x2 and 16 rad/s in omega_2" in words.texts[0]
    assert "26 to 128 rad/s" in words.texts[0]
    assert "26 to 128\u00a0rad/s" in text


def test_a_part_of_wangs_data_counts_its_own_rows():
    part, whole = case_errors(load_table("wang_topspin.csv")), case_errors(load_table("wang_all.csv"))
    for case, errors in part.items():
        np.testing.assert_allclose(errors["v_x2"], whole[case]["v_x2"][7:14])
        assert root_mean_square(errors["v_x2"]) > 0.5


def test_other_data_have_no_such_section(drop_page):
    assert "Table 9" not in drop_page.read_text(encoding="utf-8")


# --- error budget, repeating


def test_the_budget_is_a_table(grip_slip_fit):
    row = next(row for row in budget_rows(grip_slip_fit.error_budget) if row["output"] == "omega_2")
    line = grip_slip_fit.error_budget.lines["omega_2"]
    assert row["unit"] == "rad/s"
    assert float(row["measurement error, sd"]) == pytest.approx(line.measurement, rel=0.05)
    assert float(row["parameters, half of 68 %"]) == pytest.approx(line.posterior, rel=0.05)
    # 1e-12 m/s over the smaller of 0.2 and 0.02; the angle in degrees.
    made = ErrorBudget(3, "x", {"v_x2": BudgetLine(1e-12, 0.2, 0.02), "theta_2": BudgetLine(0.0, 0.01, 0.1)})
    assert [tuple(row.values()) for row in budget_rows(made)] == [
        ("v_x2", "m/s", "1.0e-12", "0.20", "0.020", "5e-11"),
        ("theta_2", "deg", "none found", "0.57", "5.7", "none found"),
    ]
    assert "at most 5e-11" in budget_sentence(made)
    assert "some outputs" in budget_sentence(made)
    assert "parameters dominate" in budget_sentence(replace(made, lines={"v_x2": BudgetLine(1e-9, 0.1, 0.5)}))


def test_the_page_says_how_to_repeat_it(grip_slip_fit, text):
    assert grip_slip_fit.problem.table.digest in text
    assert "fitball repeat" in text
    assert "Seed 4" in text
    assert f"numpy {np.__version__}" in text
    assert "fitball.calibrate" in text
    assert "fitball calibrate a &amp; b.csv --seed 3" in page(
        grip_slip_fit, {}, "fitball calibrate a & b.csv --seed 3"
    )


def test_the_command_line_is_that_of_the_run(tmp_path, monkeypatch):
    from fitball.cli.main import main

    told = []
    monkeypatch.setattr(
        "fitball.report.fit.folder.write_all", lambda fit, folder, command, figures: told.append(command)
    )
    out = tmp_path / "with space"
    words = ["calibrate", "wang_zero_spin.csv", "--model", "brody", "--point-only", "--out", str(out), "--quiet"]
    assert main(words) == 0
    assert told == [f"fitball calibrate wang_zero_spin.csv --model brody --point-only --out '{out}' --quiet"]


@pytest.mark.parametrize(
    ("value", "count", "said"),
    [
        (0.3, 2, "0.30"),
        (113.2, 2, "113"),
        (1000.0, 3, "1000"),
        (0.0431, 3, "0.0431"),
        (0.0, 2, "0"),
        (9.99, 2, "10.0"),
    ],
)
def test_digits(value, count, said):
    assert digits(value, count) == said


def test_public_fit_without_posterior_has_a_page(point_page):
    text = point_page.read_text(encoding="utf-8")
    assert "Point fit only" in text
    assert "<th>median</th>" not in text
    assert fitball.load_fit(point_page.parent).status == "point only"
