"""The page of a fit: its numbers are those of the frames, every row is there, no text of a table is
obeyed.
"""

import re
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from msgspec.structs import replace
from support.fit_by_hand import fit_by_hand, table_of

import fitball
from fitball.base import itf
from fitball.base.numbers import percent
from fitball.data.scene import Scene
from fitball.report import cite, fit_page, fit_tables, fit_words, lab, lab_lines, plotted, style
from fitball.report.blocks import Table
from fitball.report.frame_rows import FrameRow
from fitball.report.quantities import MAIN_KINDS, unit_of
from fitball.report.render import to_text
from fitball.uses.measured import LabTests

SURFACES = ("clay", "grass", "hard", "carpet", "wood")


@pytest.fixture(scope="module")
def fit():
    return fit_by_hand()


@pytest.fixture(scope="module")
def point():
    return fit_by_hand(sampled=False)


@pytest.fixture(scope="module")
def pooled():
    return fit_by_hand(table_of(60, SURFACES), model="two-mass")


def near(text, value):
    """Whether a number is shown as it is, but for rounding of its last digit."""
    shown = float(re.search(r"-?[\d.]+(e-?\d+)?", text)[0])
    _, _, decimals = text.partition(".")
    places = len(decimals.split(" ")[0])
    return shown == pytest.approx(value, abs=0.5000001 * 10.0**-places)


def ends_of(text):
    """The two ends of an interval."""
    return re.fullmatch(r"\[(.+), (.+)\]", text).groups()


def tone_of(z):
    """How a residual of so many sds is marked."""
    if abs(z) > 3.0:
        return "poor"
    if abs(z) > 2.0:
        return "part"
    return ""


def test_speeds_of_heights_are_named_as_the_table_has_them():
    frame = pd.DataFrame({"drop_height [cm]": 254.0, "rebound_height [cm]": 140.0 + np.arange(8)})
    fit = fitball.calibrate(frame, point_only=True, progress=False)
    (measured,) = fit_words.data_lines(fit)
    assert "rebound_height" in measured
    # The median is 143.5 cm; v dv = g dh, and the air brakes a little of it.
    sd = float(fit.summary["point"]["v_y_sd"])
    rise = float(re.search(r"([\d.]+) cm", fit_words.quality(fit))[1])
    assert rise == pytest.approx(100.0 * sd * np.sqrt(2.0 * 1.435 / 9.81), rel=0.1)
    speeds = pd.DataFrame({"v_y1": 7.0, "v_y2": 5.0 + 0.01 * np.arange(8)})
    of_speeds = fitball.calibrate(speeds, point_only=True, progress=False)
    assert "height" not in fit_words.quality(of_speeds) + fit_words.data_lines(of_speeds)[0]
    for name in ("predictive", "residuals"):
        (of_height,), (of_speed,) = (
            [axes.get_title("left") + axes.get_ylabel() for axes in one.plot(name).axes[:1]]
            for one in (fit, of_speeds)
        )
        assert "h_2" in of_height
        assert "h_2" not in of_speed


def test_the_first_table_has_medians_intervals_and_verdicts_of_the_frame(fit):
    summary = fit.summary
    rows = fit_tables.main_table(fit, 30).rows
    names = [row["parameter"] for row in rows]
    assert names == [*summary.index[summary["kind"].isin(MAIN_KINDS)]]
    for name, row in zip(names, rows, strict=True):
        expected = summary.loc[name]
        unit = unit_of(fit, name)
        assert near(row["median"], expected["median"] * unit.factor)
        assert row["verdict"] == expected["verdict"]
        low, high = ends_of(row["95 %"])
        assert near(low, expected["q025"] * unit.factor)
        assert near(high, expected["q975"] * unit.factor)
        assert row["verdict"].hint == expected["reason"]
        assert row["unit"] == unit.name


def test_what_the_user_derives_is_shown_where_room_is_short():
    asked = fit_by_hand()
    assert fit_tables.main_table(asked, 3).rows[0]["parameter"] != "court_pace"
    asked.run.choices.derive["court_pace"] = "44 + mu"
    rows = fit_tables.main_table(asked, 3).rows
    assert rows[0]["parameter"] == "court_pace"
    assert len(rows) <= 4


def test_what_moves_a_value_has_its_own_column(fit):
    rests = {row["parameter"]: row["rests on"] for row in fit_tables.main_table(fit, 30).rows}
    assert rests["mu"] == "offset=contact (2.6 sd) and 1 more"
    assert rests["mu"].hint == "offset=contact; ball_radius"
    assert rests["e_x"] == ""
    untried = FrameRow({"given": "model", "moved": np.nan})
    assert fit_tables.rests_on(untried) == "model"


def test_every_quantity_choice_and_impact_appears(fit):
    full = {row["parameter"]: row for row in fit_tables.full_table(fit).rows}
    assert [*full] == [*fit.summary.index]
    for name, row in full.items():
        expected = fit.summary.loc[name]
        unit = unit_of(fit, name)
        assert near(row["best fit"], expected["point"] * unit.factor)
        low, high = ends_of(row["68 %"])
        assert near(low, expected["q16"] * unit.factor)
        assert near(high, expected["q84"] * unit.factor)
        assert row["verdict"].hint == expected["reason"]
        assert row["prior (SI)"] == expected["prior"]
    assert full["mu"]["why"] == "if offset=contact, ball_radius"
    assert full["e_x"]["why"] == ""
    assert full["offset"]["why"] == "reason of offset"
    assumptions = [re.findall("`(.*?)`", words)[0] for words in fit_words.explanations(fit)]
    assert assumptions == ["offset=contact", "ball_radius"]
    choices = {row["variant"]: row for row in fit_tables.variant_table(fit).rows}
    assert [*choices] == [*dict.fromkeys(fit.variants["choice"])]
    grip = choices["offset=grip"]
    heavy_tails = choices["noise=student-t"]
    shell = choices["spin=shell"]
    assert grip["moves most"] == "mu"
    assert grip["by [sd]"] == "2.6"
    assert heavy_tails["fits"] == "worse"
    assert heavy_tails["score"] == "-9.0 ± 1.0"
    assert shell["not fitted"] == "no answer"
    assert "fits" not in shell
    impacts = fit_tables.impact_table(fit).rows
    assert len(impacts) == 24
    assert len(fit.run.table) == 24
    headings = {
        "v_x2": "v_x2 [m/s]",
        "v_y2": "v_y2 [m/s]",
        "omega_2": "omega_2 [rad/s]",
    }
    for record in fit.predictions.to_dict("records"):
        cell = impacts[record["row"]][headings[record["column"]]]
        value, z = cell.split(" ")
        assert near(value, record["observed"])
        assert near(z.strip("()"), record["z"])
        assert cell.tone == tone_of(record["z"])


def test_a_first_screen_has_at_most_forty_lines(fit, pooled):
    warned = fit_by_hand(table_of(60, SURFACES), model="two-mass")
    complaints = tuple(f"complaint {k} " + 12 * "of chains " for k in range(9))
    diagnostics = replace(warned.diagnostics, converged=False, complaints=complaints)
    object.__setattr__(warned, "diagnostics", diagnostics)
    for each in (fit, pooled, warned):
        text = to_text(fit_page.report(each), full=False)
        lines = text.split("\n")
        assert len(lines) <= 40
        assert max(map(len, lines)) <= 100
    rows = fit_tables.main_table(pooled, 12).rows
    assert len(rows) < 14
    assert rows[-1]["parameter"] == f"{17 - len(rows) + 1} more"
    assert "complaint 2" in to_text(fit_page.report(warned), full=False)


def test_differences_between_levels_are_those_of_draws(pooled):
    shown = {row["parameter"]: row for row in fit_tables.difference_table(pooled).rows}
    for name, row in shown.items():
        highest = pooled.draws.values[f"{name}[{row['highest']}]"]
        lowest = pooled.draws.values[f"{name}[{row['lowest']}]"]
        apart = highest - lowest
        value, interval = row["difference, 95 %"].split(" ", 1)
        low, high = ends_of(interval)
        assert near(value, np.median(apart))
        assert near(low, np.quantile(apart, 0.025))
        assert near(high, np.quantile(apart, 0.975))
        # Ten pairs of five surfaces, on either side.
        chance = 20.0 * np.mean(apart <= 0.0)
        assert (row[""] == "differs") == (chance < 0.05)
    assert {*shown} == {"mu", "cor_10"}


def test_a_point_fit_has_best_values_and_profiles(point):
    rows = {row["parameter"]: row for row in fit_tables.main_table(point, 30).rows}
    assert near(rows["mu"]["best fit"], point.summary.loc["mu", "point"])
    assert "median" not in rows["mu"]
    low, high = ends_of(rows["cor_10"]["profile, 95 %"])
    assert low == "..."
    assert near(high, point.summary.loc["cor_10", "profile_high"])
    text = to_text(fit_page.report(point))
    assert not re.search(r"\bnan\b|\binf\b|None\b(?! of)", text)
    assert "R-hat" not in text
    assert "probability" not in "".join(lab.sentences(point))
    # An open profile is not the same as none.
    for low, high, value, interval in (
        (-np.inf, np.inf, "20.70", "open"),
        (np.nan, np.nan, "20.70", ""),
        (0.05, 13500.0, "21", "[0.050, 13500]"),
    ):
        cells = {
            "median": np.nan,
            "point": 20.7,
            "profile_low": low,
            "profile_high": high,
        }
        assert fit_words.value_texts(FrameRow(cells), unit_of(point, "mu")) == (value, interval)


def test_shares_that_are_not_all_are_never_all(fit):
    frame = fit.predictions.copy()
    frame["observed"] = frame["median"]
    assert "72 of 72 measurements (100 %)" in fit_words.inside(frame)
    frame.loc[0, "observed"] = frame.loc[0, "new_q975"] + 1.0
    assert f"71 of 72 measurements ({percent(71 / 72)})" in fit_words.inside(frame)
    # All draws are fast, which is no certainty.
    ratings = fit.quantity("court_pace").rule(fit.draws.values)
    assert itf.pace_categories(ratings)["fast"] == 1.0
    assert "> 99 %" in "".join(lab.sentences(fit))
    assert "100 %" not in to_text(fit_page.report(fit))


def test_methods_have_every_value_with_its_unit(fit, point):
    text = fit_words.methods(fit)
    for name in fit.summary.index[fit.summary["kind"] == "model"]:
        row = fit.summary.loc[name]
        unit = unit_of(fit, name)
        median = unit.estimate(row["median"], 0.25 * (row["q975"] - row["q025"]))
        value = f"{median} {unit.interval(row['q025'], row['q975'], *fit.end_errors[name])}"
        assert f"{name} = {value}" in text
    assert "24 impacts" in text
    assert "2 independent ensembles of 8 walkers and 25 steps" in text
    of_point = fit_words.methods(point)
    assert "ensemble" not in of_point
    assert "assumptions: cor=saturating." in of_point
    other_model = fit_by_hand(model="two-mass+normal=total", sampled=False)
    assert "assumptions: normal=total" in fit_words.methods(other_model)


def test_a_description_of_the_data_is_quoted_as_it_is():
    described = "Balls at .9 bar, felt worn"
    (line,) = fit_words.data_lines(fit_by_hand(scene=Scene(source={"description": described})))
    assert line.endswith(f". {described}.")
    (bare,) = fit_words.data_lines(fit_by_hand())
    assert bare.count(".") == 1


def test_surface_and_court_are_named_apart():
    scene = Scene(laboratory={"operator": "two"}, surface={"court": "court 3", "name": "acrylic"})
    assert fit_words.data_lines(fit_by_hand(scene=scene))[-1] == (
        "Operator: two; surface: acrylic; court: court 3."
    )


def test_differences_of_best_values_are_not_judged(pooled):
    judged = "differ more than by chance"
    assert judged in to_text(fit_page.report(pooled))
    point = fit_by_hand(table_of(60, SURFACES), sampled=False, model="two-mass")
    text = to_text(fit_page.report(point))
    assert "no difference has an interval" in text
    assert judged not in text


@pytest.fixture
def found(monkeypatch):
    """A function that makes pages find these rows of laboratory tests."""

    def set_tests(pace, drops):
        tests = LabTests(pd.DataFrame(pace), pd.DataFrame(drops))
        for module in (lab, lab_lines):
            monkeypatch.setattr(module, "lab_tests", lambda _: tests)

    return set_tests


def test_court_pace_is_laid_out(fit, found):
    shares = dict.fromkeys(itf.PACE_CATEGORIES, 0.0) | {"slow": 0.67, "medium-slow": 0.33}
    paced = {
        "surface": "",
        "place": "",
        "impacts": 9,
        "rating": 28.4,
        "q025": 25.0,
        "q975": 32.0,
        **shares,
    }
    paced |= {"variation": 6.2, "by_chance": 0.01}
    places = [{**paced, "place": place, "rating": 27.1, "impacts": 4} for place in ("net", "far")]
    found([paced, *places], [])
    # What was measured stands for what the model says.
    assert lab.sentences(fit) == []
    first, of_places, asked = lab_lines.measured_lines(fit)
    assert "28.4" in first
    assert "slow" in first
    assert "67 %" in first
    assert "uneven" in of_places
    assert "partially pooled" in of_places
    assert "unpooled means 6.2" in of_places
    assert "9 impacts a location (here 4)" in asked
    assert lab.section(fit).title == "Court pace"
    rows = lab.section(fit).blocks[0].rows
    shown = [(row["place"], row["impacts"]) for row in rows]
    assert shown == [("", "9"), ("net", "4"), ("far", "4"), ("", "")]
    assert near(rows[0]["rating, 95 %"], 28.4)
    assert rows[0]["category"] == "slow 67 %, medium-slow 33 %"
    found([{**paced, "by_chance": 0.3}, *places], [])
    assert "uneven" not in "".join(lab_lines.measured_lines(fit))


def test_drop_tests_are_laid_out(found):
    drop = {
        "surface": "",
        "label": "",
        "drops": 6,
        "speed": 7.06,
        "cor": 0.745,
        "cor_q025": 0.741,
        "cor_q975": 0.749,
        "rebound": 1.41,
        "rebound_q025": 1.39,
        "rebound_q975": 1.43,
        "passes": 1.0,
        "ratio": 0.9,
        "ratio_q025": 0.88,
        "ratio_q975": 0.92,
        "balls": 1,
        "agree": True,
        "by_chance": np.nan,
        "outlying": False,
    }
    drop |= dict.fromkeys(["sd_balls", "sd_balls_q025", "sd_balls_q975"], np.nan)
    drop |= {"sd_repeats": 0.01, "sd_repeats_q025": 0.008, "sd_repeats_q975": 0.013}
    kinds = [{**drop, "kind": kind} for kind in ("speed", "ball", "mean", "another")]
    found([], kinds)
    fallen = fit_by_hand(table_of(12, drop=True))
    lines = lab_lines.measured_lines(fallen)
    assert "141.0" in lines[0]
    assert "> 99 %" in lines[0]
    # Of which nothing is stated is said to be assumed.
    assert "type-2 (assumed)" in lines[0]
    assert "24 balls (here 1)" in lines[-1]
    assert lab.section(fallen).title == "Drop test"
    table = lab.section(fallen).blocks[1].rows
    assert len(table) == 4
    assert table[2]["COR, 95 %"] == "0.7450 [0.7410, 0.7490]"


def test_constants_have_a_table_where_some_are_held(fit, monkeypatch):
    def titles():
        sections = {section.title: section for section in fit_page.report(fit).sections}
        blocks = sections["Model assumptions"].blocks
        return [block.title for block in blocks if isinstance(block, Table)]

    assert "Constants" in titles()
    monkeypatch.setitem(vars(fit), "constants", ())
    assert titles()
    assert "Constants" not in titles()


def test_a_folder_has_the_usual_figures_or_all(fit, monkeypatch, tmp_path):
    monkeypatch.setattr(plotted, "draw_styled", lambda draw, *_arguments: draw)
    monkeypatch.setattr(style, "image_bytes", lambda _: b"png")
    monkeypatch.setattr(fit_page.files_of_fit, "files", lambda _: {"fit.json": lambda: b"{}"})
    fit.save(tmp_path / "usual")
    usual = {path.stem for path in (tmp_path / "usual").glob("*.png")}
    assert usual == {"curves", "corner", "forest", "residuals", "predictive"}
    fit.save(tmp_path / "all", figures="all")
    all_figures = {path.stem for path in (tmp_path / "all").glob("*.png")}
    assert all_figures == usual | {"profiles", "trace", "regimes", "regime_map"}
    references = tmp_path / "usual" / "references.bib"
    assert references.read_text(encoding="utf-8").startswith("@misc{fitball,")


def keys_of(text):
    """Keys of the works of a BibTeX file."""
    return re.findall(r"^@\w+\{(\w+),", text, re.MULTILINE)


def test_works_are_those_of_model_sampler_and_data(fit, point):
    sampled = keys_of(cite.references(fit))
    used = {
        "fitball",
        "walton1993",
        "newville2014",
        "foremanmackey2013",
        "margossian2024",
        "vehtari2017",
    }
    assert used < {*sampled}
    assert len(sampled) == len({*sampled})
    assert "jafri2004" not in sampled
    assert "data" not in sampled
    of_sampling = {"foremanmackey2013", "vehtari2021", "cornuet2012"}
    assert of_sampling.isdisjoint(keys_of(cite.references(point)))
    wang = Scene(source={"citation": "J. C. Wang (1989) as printed by S. M. Jafri, 2004"})
    of_wang = keys_of(cite.references(fit_by_hand(scene=wang)))
    assert of_wang.count("jafri2004") == 1
    assert "data" not in of_wang
    lab_a = Scene(source={"citation": "50 % of {Lab_A} & others", "description": "a#b"})
    of_lab_a = cite.references(fit_by_hand(scene=lab_a))
    assert r"note = {50 \% of \{Lab\_A\} \& others}" in of_lab_a
    assert r"title = {a\#b}" in of_lab_a
    for text in (of_lab_a, *cite.works().values()):
        opened = text.replace(r"\{", "").count("{")
        closed = text.replace(r"\}", "").count("}")
        assert opened == closed
    assert "VERSION" not in of_lab_a
    assert "3.0" in of_lab_a


def test_a_move_at_the_limit_is_said_with_its_error(fit):
    assert fit_words.moves_at_limit(fit) == []
    first, *others = fit.alternatives
    unsure = replace(first, unsure={"mu": (1.98, 0.062)})
    (text,) = fit_words.moves_at_limit(SimpleNamespace(alternatives=(unsure, *others)))
    assert f"{first.choice} moves mu by 1.98 ± 0.06 sd" in text
    given = replace(first, unsure_given={"e_x": (2.01, 0.1)})
    (text,) = fit_words.moves_at_limit(SimpleNamespace(alternatives=(given, *others)))
    assert f"{first.choice} moves e_x by 2.01 ± 0.10 sd" in text
