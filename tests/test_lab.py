"""What a lab asks for besides: places on a court, ball temperature, priors from the literature, a certificate."""

from __future__ import annotations

import json
import subprocess
from dataclasses import replace

import numpy as np
import pytest
from headless import find_browser
from samples import restored, save_without_figures
from test_court_pace import sliding_rows

import fitball
from fitball.api import pose
from fitball.cli.main import main
from fitball.data.published import published_priors, with_published
from fitball.data.read import load_table
from fitball.data.scene import Scene
from fitball.errors import FitballError, ParameterError
from fitball.exports.parameters import certificate
from fitball.inference.prediction.court_pace import court_pace
from fitball.inference.prediction.measured_pace import measured_paces
from fitball.inference.problem.build import Choices
from fitball.inference.problem.parameters import parse_prior
from fitball.inference.results.lab import BallRebound, CourtPace, Passing, adjusted
from fitball.inference.results.quantiles import Spread
from fitball.inference.results.results import PointFit, Posterior
from fitball.inference.results.source import Circumstances
from fitball.models.registry import parameter_spec
from fitball.report.fit.itf_tests import court_lines, drop_class, place_rows, warmth_words

MU = {"A": 0.60, "B": 0.66, "C": 0.54, "D": 0.62, "E": 0.58}


@pytest.fixture(scope="module")
def court(tmp_path_factory):
    """Five places, three sliding impacts each at exactly 30 m/s and 16 degrees, restitution 0.80; without spin."""
    place = tmp_path_factory.mktemp("court") / "court.csv"
    v_x1, v_y1 = 30.0 * np.cos(np.radians(16.0)), 30.0 * np.sin(np.radians(16.0))
    lines = ["v_x1,v_y1,v_x2,v_y2,location"]
    for name, mu in MU.items():
        for shift in (-0.01, 0.0, 0.01):
            row = sliding_rows(mu + shift, [v_x1], [v_y1])[0]
            lines.append(",".join(f"{value:.9f}" for value in (*row[:2], *row[3:5])) + f",{name}")
    place.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return place


def measured(table, seed=0, **scene):
    found = measured_paces(table, Scene(**scene), np.random.default_rng(seed))
    return found[0] if found else None


def test_places_on_a_court_by_hand(court):
    table = load_table(court)
    found = measured(table)
    # 100 (1 - mu) + 150 (0.81 - 0.80), the mean of all 15 impacts.
    assert (found.impacts, found.total, found.court.places) == (15, 15, 5)
    assert found.court.column == "location"
    assert found.court.rating.point == pytest.approx(100 * (1 - 0.6) + 1.5, abs=1e-5)
    assert {item.label: round(item.mean, 4) for item in found.places} == {
        name: round(101.5 - 100 * mu, 4) for name, mu in MU.items()
    }
    assert found.court.largest_difference == pytest.approx(12.0, abs=1e-4)
    # Three impacts one point apart on each side: sd 1 within a place; the mean of 15 of them is known to 1/sqrt(15).
    assert found.court.within.median == pytest.approx(1.0, rel=0.1)
    mean = found.court.rating
    assert (mean.q975 - mean.q025) / 3.92 == pytest.approx(1.0 / np.sqrt(15), rel=0.2)
    between = np.std([100 * mu for mu in MU.values()], ddof=1)
    assert found.court.between.q025 < between < found.court.between.q975
    assert found.court.elsewhere.q975 - found.court.elsewhere.q025 > 4 * (mean.q975 - mean.q025)
    assert sum(found.court.categories.values()) == pytest.approx(1.0)
    assert found.court.categories["medium-fast"] > 0.95
    said = court_lines(CourtPace((), "", measured=(found,)))[0]
    assert "mean of 5 places (location)" in said and "largest difference 12.0" in said
    assert [row["place"] for row in place_rows(CourtPace((), "", measured=(found,)))] == list(MU)


def test_fewer_than_five_places_predict_no_other_one(court):
    table = load_table(court)
    rows = np.arange(9)
    three = replace(
        table, impacts=table.impacts.take(rows), labels={"Position": table.labels["location"][:9]},
        measurements=tuple(replace(item, values=item.values[:9]) for item in table.measurements),
        ids=table.ids[:9], redundant=(),
    )  # fmt: skip
    found = measured(three)
    assert (found.court.column, found.court.places, found.court.elsewhere) == ("Position", 3, None)
    assert found.court.between is not None and measured(table).court.elsewhere is not None
    said = court_lines(CourtPace((), "", measured=(found,)))
    assert "untested place" not in said[0] and "sd between places" in said[0]
    assert said[1] == "3 places are too few to predict a place that was not tested: at least 5 are needed."
    assert len(court_lines(CourtPace((), "", measured=(measured(table),)))) == 1


def test_each_surface_is_rated_by_its_own_impacts(court):
    table = load_table(court)
    surfaces = tuple("clay" if k < 6 else "grass" for k in range(15))
    found = measured_paces(
        replace(table, labels={**table.labels, "court": surfaces}), Scene(), np.random.default_rng(0)
    )
    assert [(one.surface, one.impacts, one.total) for one in found] == [("clay", 6, 6), ("grass", 9, 9)]
    # mu is 0.60 and 0.66 on clay, 0.54, 0.62 and 0.58 on grass.
    assert [one.court.rating.point for one in found] == pytest.approx([101.5 - 63.0, 101.5 - 58.0], abs=1e-4)
    assert [[item.label for item in one.places] for one in found] == [["A", "B"], ["C", "D", "E"]]
    pace = CourtPace((), "", measured=found)
    assert [row["surface"] for row in place_rows(pace)] == ["clay"] * 2 + ["grass"] * 3
    assert court_lines(pace)[0].startswith(
        "ITF court pace of clay as measured, without a model (6 test impacts): 38.5"
    )
    assert [(one.surface, one.category, one.measured) for one in pace.classes] == [
        ("clay", "medium", True), ("grass", "medium-fast", True),
    ]  # fmt: skip


def test_the_prior_of_the_spread_between_places_is_chosen_as_any_other(court):
    """A narrow one brings five places together that the default keeps apart, as by the option of a fit."""
    spread = {}
    for text in ("", "half-normal(0.1)"):
        priors = {"rating_spread": text} if text else {}
        problem = pose(court, Choices(model="grip-slip", fix={"mu": 0.6}, priors=priors))
        best = {parameter.name: parameter.fixed or 0.1 for parameter in problem.parameters}
        found = court_pace(problem, PointFit(best, 0, 0, {}, None, (), ()), None, np.random.default_rng(1))
        (measured,) = found.measured
        spread[text] = measured.court.between.median
    assert spread["half-normal(0.1)"] < 1.0 < 3.0 < spread[""]


def test_ball_temperature_brings_the_restitution_to_23_degrees(court):
    table = load_table(court)
    plain, warm = measured(table), measured(table, ball_temperature=31.0)
    # e_T = e + 0.003 (23 - 31): 0.024 less, 3.6 points more.
    assert adjusted(np.array([0.8]), 31.0)[0] == pytest.approx(0.776)
    assert warm.court.rating.point - plain.court.rating.point == pytest.approx(3.6, abs=1e-9)
    unsure = measured(table, ball_temperature=31.0, ball_temperature_sd=4.0).court.rating
    assert (unsure.q975 - unsure.q025) / 3.92 == pytest.approx(np.hypot(1.0 / np.sqrt(15), 0.45 * 4.0), rel=0.1)
    assert "e - 0.024, +3.6 points" in warmth_words(CourtPace((), "", temperature=31.0))
    assert "states no ball temperature" in warmth_words(CourtPace((), ""))


def test_impacts_that_are_not_those_of_the_test_are_not_rated(court, tmp_path):
    table = load_table(court)
    assert measured(load_table("wang_all.csv")) is None
    slow = replace(table, impacts=replace(table.impacts, v_x1=0.9 * table.impacts.v_x1))
    assert measured(slow) is None
    alone = measured(replace(table, labels={}))
    assert alone.places == () and alone.court.between is None and alone.court.column == ""
    assert measured(replace(table, labels={"group": table.labels["location"]})).court.column == "group"
    once = measured(replace(table, labels={"location": tuple(str(k) for k in range(15))}))
    assert "too few repeats" in once.remark and once.places[0].rating is None


def test_friction_is_fitted_to_each_place_unless_it_is_asked_not_to(court, tmp_path):
    problem = pose(court, Choices(model="grip-slip"))
    assert [(item.parameter, item.column, item.labels) for item in problem.pooling] == [("mu", "location", tuple(MU))]
    assert any("mu fitted to each" in note and "pool='none'" in note for note in problem.notes)
    assert pose(court, Choices(model="grip-slip", pool={"all": "none"})).pooling == ()
    assert pose(court, Choices(model="grip-slip", pool={"mu": "none"})).pooling == ()
    assert pose(court, Choices(model="grip-slip", fix={"mu": 0.6})).pooling == ()
    many = tmp_path / "many.csv"
    lines = court.read_text(encoding="utf-8").splitlines()
    many.write_text("\n".join([lines[0]] + [f"{line}{k}" for k, line in enumerate(lines[1:])]), encoding="utf-8")
    assert pose(many, Choices(model="grip-slip")).pooling == ()


def test_a_court_is_the_mean_of_its_places_by_the_model_too(court):
    """Draws of the pooled problem, each place's rating written out: all places slide at the test impact."""
    problem = pose(court, Choices(model="grip-slip"))
    source = np.random.default_rng(4)
    best = {parameter.name: parameter.fixed for parameter in problem.parameters}
    best |= {"mu": 0.6, "mu_spread": 0.1, "cor_10": 0.80, "cor_slope": 0.0, "e_x": 0.1}
    best |= {f"mu_place[{name}]": np.log(mu / 0.6) / 0.1 for name, mu in MU.items()}
    best |= {name: 0.1 for name in problem.free_names if name not in best or best[name] is None}
    values = np.tile([best[name] for name in problem.free_names], (500, 1))
    warm = problem.free_names.index("cor_10")
    values[:, warm] += 0.01 * source.standard_normal(500)
    posterior = Posterior(problem.free_names, values[None, :, None], np.zeros((1, 500, 1)), values[:1])
    found = court_pace(problem, PointFit(best, 0, 0, {}, None, (), ()), posterior, source)
    assert [rating.rating.point for rating in found.ratings] == pytest.approx(
        [101.5 - 100 * mu for mu in MU.values()]
    )
    assert (found.court.places, found.court.column) == (5, "location")
    # A common restitution moves all places alike: 1.5 points of each 0.01, and nothing between them.
    mean, between = found.court.rating, found.court.between
    assert mean.point == pytest.approx(41.5)
    assert (mean.q975 - mean.q025) / 3.92 == pytest.approx(1.5, rel=0.12)
    assert between.median == pytest.approx(np.std([100 * mu for mu in MU.values()], ddof=1))
    assert between.q975 - between.q025 < 1e-6
    assert found.measured[0].impacts == 15
    assert court_lines(found)[1].startswith("ITF court pace of the court by the model: 41.5")


@pytest.mark.parametrize("row", published_priors(), ids=lambda row: f"{row.parameter}-{row.key}")
def test_published_priors_are_priors_with_a_source(row):
    spec = parameter_spec(row.parameter)
    # A spread between levels is no parameter of a model.
    lower, upper = (0.0, np.inf) if row.parameter.endswith("_spread") else (spec.lower, spec.upper)
    prior = parse_prior(row.parameter, row.text, lower, upper)
    low, high = prior.quantile(np.array([0.025, 0.975]))
    assert lower < low < row.value < high < upper
    assert any(year in row.source for year in ("2002", "2004")) or "ITF" in row.source
    assert len(row.note) > 30
    assert with_published({row.parameter: f" Literature:{row.key} "}) == (
        {row.parameter: row.text}, {row.parameter: row.provenance}
    )  # fmt: skip


def test_the_itf_rows_follow_from_its_formula():
    rows = {row.key: row for row in published_priors() if row.parameter == "mu"}
    for key, rating in {"itf-medium-slow": 32, "itf-medium": 37, "itf-medium-fast": 42}.items():
        assert rows[key].value == pytest.approx(1 - rating / 100)
    cor = {row.key: row.value for row in published_priors() if row.parameter == "cor_10"}
    for key, ends in {"itf-type-1": (138, 151), "itf-type-2": (135, 147), "itf-high-altitude": (122, 135)}.items():
        low, high = np.sqrt(np.array(ends) / 254)
        assert low - 0.01 < cor[key] < high


def test_unknown_keys_are_answered_with_the_known_ones():
    with pytest.raises(
        ParameterError, match=r"did you mean 'clay'.*known keys of mu: acrylic, .*grass.*datasets priors"
    ):
        with_published({"mu": "literature:cley"})
    with pytest.raises(ParameterError, match=r"none for eps_10 .it has mu, cor_10"):
        with_published({"eps_10": "literature:clay"})
    with pytest.raises(FitballError, match="literature:granite"):
        pose("wang_all.csv", Choices(model="grip-slip", priors={"mu": "literature:granite"}))


@pytest.fixture(scope="module")
def drops(tmp_path_factory):
    """A drop test from the command line: 12 balls at one speed, a prior from the literature, a point fit."""
    folder = tmp_path_factory.mktemp("drops")
    cor = 0.745 + 0.004 * np.random.default_rng(3).standard_normal(12)
    lines = ["ball,v_y1,v_y2", *(f"b{k},7.06,{7.06 * value:.5f}" for k, value in enumerate(cor))]
    (folder / "drops.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
    (folder / "drops.toml").write_text('[ball]\ntemperature = 20\ntype = "type-1"\n', encoding="utf-8")
    return folder


@pytest.fixture(scope="module")
def dropped(drops, tmp_path_factory):
    """Its fit, as it is read from a folder."""
    fit = fitball.calibrate(
        drops / "drops.csv", "brody", priors={"cor_10": "literature:itf-type-2"}, point_only=True, cores=1
    )
    return fitball.load_fit(save_without_figures(fit, tmp_path_factory.mktemp("dropped") / "fit"))


def test_a_drop_test_from_table_to_certificate(drops, capsys, without_figures):
    out = drops / "fit"
    words = ["--model", "brody", "--prior", "cor_10=literature:itf-type-2", "--point-only", "--out", str(out)]
    assert main(["calibrate", str(drops / "drops.csv"), *words, "--cores", "1"]) == 0
    told = capsys.readouterr()
    lines = told.out.splitlines()
    assert lines[3].startswith("COR at 7.06 m/s: 0.74")
    assert "ITF type 1 (fast), 138 to 151 cm" in told.out
    assert "prior of cor_10 from literature:itf-type-2" in told.err
    content = json.loads((out / "fit.json").read_text(encoding="utf-8"))
    assert content["drop_test"]["speeds"][0]["cor"]["point"] == pytest.approx(0.745, abs=0.005)
    assert content["parameters"]["cor_10"]["prior"] == "normal(0.74, 0.03)"
    assert "ITF TB 04/01" in content["parameters"]["cor_10"]["prior_source"]
    assert content["parameters"]["cor_slope"]["prior_source"] == ""
    report = (out / "report.html").read_text(encoding="utf-8")
    assert report.replace("\u00a0", " ").index("COR at 7.06 m/s") < report.index("Contents")
    assert "literature:itf-type-2" in report
    problem = restored(out).problem
    assert {item.name: item.prior_source for item in problem.parameters if item.prior_source}.keys() == {"cor_10"}
    assert (problem.scene.ball_type, problem.scene.ball_temperature) == ("type-1", 20.0)
    assert main(["export", str(out), "--to", "certificate"]) == 0
    page = (out / "certificate.html").read_text(encoding="utf-8")
    sentence, software = content["adequacy"]["sentence"], content["versions"]["fitball"]
    words = ("COR at 7.06 m/s", "literature:itf-type-2", "12 impacts", sentence[:40], software)
    for word in (*words, content["source"]["sha256"]):
        assert word in page
    assert "http" not in page and "<script" not in page


def test_priors_are_listed(capsys):
    assert main(["datasets", "priors"]) == 0
    text = capsys.readouterr().out
    assert "mu=literature:clay  normal(0.73, 0.1)" in text and "Source: " in text
    assert main(["datasets", "priors", "--json"]) == 0
    rows = json.loads(capsys.readouterr().out)
    assert len(rows) == len(published_priors()) and all(row["source"] and row["note"] for row in rows)


def test_a_certificate_of_a_court(dropped, court):
    pace = CourtPace((), "", temperature=31.0, measured=(measured(load_table(court), ball_temperature=31.0),))
    page = certificate(replace(dropped, drop_test=None, court_pace=pace))
    for words in ("<h1>Court pace</h1>", "mean of 5 places (location)", "+3.6 points", "<td>A</td>"):
        assert words in page
    # One category, with its probability; the numbers of the test beside it.
    assert "medium" not in page and page.count("Classification") == 1
    assert "Classification: fast (probability" in page and "from the test impacts as measured" in page


def test_a_certificate_carries_who_measured_and_leaves_room_for_what_is_not_known(dropped):
    blank = '<dt>{}</dt><dd class="blank"></dd>'
    page = certificate(dropped)
    for name in ("Laboratory", "Operator", "Instrument", "Date of measurement", "Court", "Surface"):
        assert blank.format(name) in page
    assert "<dt>Ball temperature</dt><dd>20 degrees Celsius</dd>" in page
    known = Circumstances("Lab <1>", "A. Nother", "Camera", "2026-05-31", "Court 3", "acrylic", (25.5, 27.0), 20.0)
    page = certificate(replace(dropped, source=replace(dropped.source, circumstances=known)))
    assert 'class="blank"' not in page
    for words in ("Lab &lt;1&gt;", "A. Nother", "Camera", "2026-05-31", "Court 3", "acrylic", "25.5 to 27"):
        assert f"<dd>{words}" in page


def test_a_drop_test_is_classified_once(dropped):
    (first,) = drop_class(dropped.drop_test)
    assert first == "Classification: the mean rebound is within the limits of ITF type 1 (fast), 138 to 151 cm."
    passing = {name: Passing(0.2, 0.3, 0.4) for name in dropped.drop_test.rebound.passing}
    unsure = replace(
        dropped.drop_test, rebound=replace(dropped.drop_test.rebound, passing=passing), type_stated=False
    )
    (second,) = drop_class(unsure)
    assert second.startswith("Classification: the mean ball is outside the limits of ITF type 1 (fast)")
    assert second.endswith("(probability 80 %); the type is assumed.")
    assert "passes" not in certificate(replace(dropped, drop_test=unsure)).partition("Assumptions and remarks")[0]


def test_a_certificate_says_what_it_leaves_out(dropped, monkeypatch):
    assert "remarks stand" not in certificate(dropped)
    monkeypatch.setattr("fitball.exports.parameters.MOST_REMARKS", 2)
    assert "more remarks: report.html" in certificate(dropped)


@pytest.mark.slow
@pytest.mark.skipif(find_browser() is None, reason="no browser")
def test_a_full_certificate_prints_on_one_page(dropped, tmp_path):
    """Two dozen balls, every remark, a long verdict: still one sheet of A4."""
    rebound = Spread(1.4, 1.4, 1.38, 1.39, 1.41, 1.42)
    balls = tuple(BallRebound(f"ball number {k}", 4, rebound, 0.6) for k in range(30))
    test = replace(dropped.drop_test, balls=balls, shared_error=0.01)
    adequacy = replace(dropped.adequacy, sentence=(dropped.adequacy.sentence + " ") * 3)
    page = tmp_path / "certificate.html"
    page.write_text(certificate(replace(dropped, drop_test=test, adequacy=adequacy)), encoding="utf-8")
    pdf = tmp_path / "certificate.pdf"
    words = ["--headless", "--no-sandbox", "--disable-gpu", "--no-pdf-header-footer", f"--print-to-pdf={pdf}"]
    subprocess.run([find_browser(), *words, page.as_uri()], check=True, capture_output=True, timeout=300)
    assert pdf.read_bytes().count(b"/Type /Page\n") == 1
    assert "6 more balls: report.html" in page.read_text(encoding="utf-8")
