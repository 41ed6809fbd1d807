"""Few balls, places and surfaces: the spread between them, its prior, and what the study of it finds."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats
from validation import few_levels as study
from validation.command import main
from validation.harness import run

import fitball
from fitball.api.calibrating import pose
from fitball.data.labels import Role
from fitball.errors import ParameterError
from fitball.inference.prediction.drop_test import one_way, spread_of_balls
from fitball.inference.problem.parameters import parse_prior
from fitball.inference.problem.problem import Choices
from fitball.inference.problem.spreads import kind_of, published_spread, spread_prior
from fitball.models.specs import SPECS
from fitball.report.fit.drop_words import drop_remarks
from fitball.scheduling.engine import engine

# Rebounds [cm] from 254 cm of three balls by three drops, as a lab wrote them.
REBOUNDS = {"1": (139.2, 140.0, 139.6), "2": (141.5, 142.0, 141.1), "3": (134.1, 134.8, 133.9)}


def default(name):
    spec = SPECS[name]
    return parse_prior(name, spec.prior, spec.lower, spec.upper)


def quadrature(values, index, scale, freedom):
    """Distribution functions of mean and sd between, by a sum over both sds; the mean is normal given these."""
    count, total = np.bincount(index), np.bincount(index, values)
    between, within = np.geomspace(1e-5, 0.3, 700)[:, None], np.geomspace(2e-4, 0.05, 500)
    variance = between[..., None] ** 2 + within[:, None] ** 2 / count
    precision = np.sum(1.0 / variance, axis=-1)
    middle = np.sum(total / count / variance, axis=-1) / precision
    away = np.sum((total / count - middle[..., None]) ** 2 / variance, axis=-1)
    inner = np.sum((values - (total / count)[index]) ** 2)
    log = -0.5 * (np.sum(np.log(variance), axis=-1) + np.log(precision) + away + inner / within**2)
    log -= (len(values) - len(count)) * np.log(within)
    # Both sds on a logarithmic grid; the noise has a flat prior of its logarithm.
    log += stats.t(freedom, 0.0, scale).logpdf(between) + np.log(between)
    mass = np.exp(log - log.max())
    mass /= mass.sum()
    below = np.cumsum(mass.sum(axis=1))
    return (
        lambda value: float(np.sum(mass * stats.norm(middle, precision**-0.5).cdf(value))),
        lambda value: float(np.interp(value, between[:, 0], below)),
    )


@pytest.mark.parametrize("balls", [2, 3, 6])
def test_mean_and_spread_of_few_balls_agree_with_quadrature(balls):
    rng = np.random.default_rng(balls)
    index = np.repeat(np.arange(balls), 3)
    values = 0.745 + 0.008 * rng.standard_normal(balls)[index] + 0.0015 * rng.standard_normal(index.size)
    prior = parse_prior("spread", "half-t(0.008, 4)", 0.0, np.inf)
    found = one_way(values, np.ones((index.size, 1)), index, prior, rng)
    mean, between = quadrature(values, index, 0.008, 4.0)
    for draws, below in ((found.coefficients[:, 0], mean), (found.between, between)):
        shares = [below(end) for end in np.quantile(draws, (0.025, 0.25, 0.5, 0.75, 0.975))]
        assert shares == pytest.approx([0.025, 0.25, 0.5, 0.75, 0.975], abs=0.02)


def test_three_balls_are_known_no_worse_than_by_students_t():
    """Mean and a new ball: at most 1.5 times as wide as Student's t on the means of three balls; each ball: on its
    own three drops.
    """
    cor = {name: np.sqrt(np.array(heights) / 254.0) for name, heights in REBOUNDS.items()}
    index, values = np.repeat([0, 1, 2], 3), np.concatenate(list(cor.values()))
    rng = np.random.default_rng(1)
    found = one_way(values, np.ones((9, 1)), index, spread_of_balls(True), rng)
    means = np.array([own.mean() for own in cor.values()])
    student = 2.0 * stats.t.ppf(0.975, 2) * means.std(ddof=1)
    new = found.coefficients[:, 0] + found.between * rng.standard_normal(len(found.between))
    asked = [(found.coefficients[:, 0], student * 3.0**-0.5), (new, student * (4.0 / 3.0) ** 0.5)]
    for k, own in enumerate(cor.values()):
        asked.append((found.levels[:, k], 2.0 * stats.t.ppf(0.975, 2) * own.std(ddof=1) * 3.0**-0.5))
    for draws, wide in asked:
        low, high = np.quantile(draws, (0.025, 0.975))
        assert 0.2 * wide < high - low < 1.5 * wide
    # A flat prior, which was that of older versions, is far wider.
    flat = one_way(values, np.ones((9, 1)), index, parse_prior("spread", "uniform(0, 1000)", 0.0, 1000.0), rng)
    low, high = np.quantile(flat.coefficients[:, 0], (0.025, 0.975))
    assert high - low > 2.0 * student * 3.0**-0.5


def test_scales_are_those_of_what_is_known():
    scale = {
        (name, kind): published_spread(name, kind).prior.b
        for name, kind in (("mu", Role.SURFACE), ("mu", Role.PLACE), ("cor_10", Role.SURFACE),
                           ("cor_10", Role.PLACE), ("cor_10", Role.BALL), ("cor_10", "make"), ("rating", Role.PLACE))
    }  # fmt: skip
    # 12 cm of 141 as four sds, halved for the restitution, which goes as the root of the height.
    assert scale["cor_10", Role.BALL] == pytest.approx(0.745 * 12.0 / 4.0 / 141.0 / 2.0, rel=0.05)
    assert scale["cor_10", "make"] == pytest.approx(0.733 * 29.0 / 6.0 / 137.0 / 2.0, rel=0.05)
    # Points of the rating: 100 for a friction of 1, 150 for a restitution of 1.
    assert scale["rating", Role.PLACE] == 5.0 / 2.0
    assert scale["mu", Role.PLACE] == pytest.approx(2.5 / 100.0 / 0.63, rel=0.02)
    assert scale["cor_10", Role.PLACE] == pytest.approx(2.5 / 150.0, rel=0.03)
    surfaces = np.std(np.log([0.55, 0.73, 0.53]), ddof=1)
    assert surfaces < scale["mu", Role.SURFACE] < 1.3 * surfaces
    # Other balls, and what was not published: a share of the parameter, less between alike ones.
    assert spread_prior("cor_10", Role.BALL, False, default("cor_10"), tennis=False).text == "half-t(0.074101, 4)"
    assert spread_prior("e_x", Role.SURFACE, False, default("e_x")).text == "half-t(0.5, 4)"
    assert spread_prior("mu", None, True, default("mu")).text == "half-t(0.3, 4)"
    assert spread_prior("mu", Role.BALL, True, default("mu")).text == "half-t(0.1, 4)"
    assert [kind_of(name) for name in ("Court", "Ball No", "Brand", "position", "day")] == [
        Role.SURFACE, Role.BALL, "make", Role.PLACE, None,
    ]  # fmt: skip


def drops(tmp_path):
    place = tmp_path / "drops.csv"
    lines = [f"254,{height},{ball}" for ball, heights in REBOUNDS.items() for height in heights]
    place.write_text("\n".join(["drop_height [cm],rebound_height [cm],ball", *lines]) + "\n", encoding="utf-8")
    return place


def test_the_prior_of_a_spread_is_chosen_also_where_no_parameter_has_it(tmp_path):
    """Balls of a drop test: a narrower prior brings them together; a table without balls refuses it."""
    place = drops(tmp_path)
    between = {}
    for text in ("", "half-normal(0.0005)"):
        priors = {"cor_10_spread": text} if text else {}
        fit = fitball.calibrate(place, "brody", priors=priors, point_only=True, cores=1)
        between[text] = fit.drop_test.variation.between.median
        said = next(line for line in drop_remarks(fit.drop_test) if "hardly determine" in line)
        assert f"depends on its prior, {text or 'half-t(0.008, 4)'} (" in said
    assert between["half-normal(0.0005)"] < 0.5 * between[""]
    with pytest.raises(ParameterError, match="prior for unknown parameter 'rating_spread'"):
        pose(place, Choices(model="brody", priors={"rating_spread": "half-t(1, 4)"}))


def test_the_spread_of_a_pooled_parameter_has_the_published_prior_and_its_source():
    sheet, _true = study.draw_sheet(False, np.random.default_rng(1))
    pool = {"all": "none", "mu": "surface", "e_x": "surface"}
    known = {item.name: item for item in pose(sheet, Choices(model="grip-slip", pool=pool)).parameters}
    assert known["mu_spread"].prior.text == "half-t(0.2, 4)" and "ITF CS 01/02" in known["mu_spread"].prior_source
    assert known["e_x_spread"].prior_source == ""
    priors = {"mu_spread": "half-normal(0.1)"}
    chosen = {
        item.name: item for item in pose(sheet, Choices(model="grip-slip", pool=pool, priors=priors)).parameters
    }
    assert chosen["mu_spread"].prior.text == "half-normal(0.1)" and chosen["mu_spread"].prior_source == ""


@pytest.fixture(scope="module")
def labs(tmp_path_factory):
    """Forty labs of two to six balls and places."""
    return run(study.studies()[0], 1, 40, tmp_path_factory.mktemp("few"), engine(1))


def judged(labs, surfaces):
    return study.judge({"labs": labs, "surfaces": surfaces}, 1).content


def counted(inside, of=400, name="mu", what=study.SURFACE, fit=study.STATED):
    about = {"of": name, "fit": fit, "what": what, "truth": 0.2, "zero": False, "width": 0.1}
    return [[{**about, "inside": k < inside}] for k in range(of)]


def test_labs_hold_under_the_stated_prior_and_not_under_one_that_is_too_narrow(labs):
    found = {(one["quantity"], one["what"], one["fit"]): one for one in judged(labs, counted(380))["coverages"]}
    for kind in study.LABS:
        for what in study.OF_LABS:
            stated = found[kind, what, study.STATED]
            assert stated["of"] == 40 and stated["low"] <= 0.95 <= stated["high"] and stated["width"] <= study.WIDEST
        assert found[kind, "new one", study.CONTROL]["high"] < 0.95


def test_surfaces_hold_their_truth_by_a_short_chain(tmp_path):
    rows = [row for some in run(study.studies()[1], 3, 4, tmp_path, engine(1)) for row in some]
    stated = [row for row in rows if row["fit"] == study.STATED]
    assert len(stated) == 4 * 2 * 3 and sum(row["inside"] for row in stated) >= 20
    one = [row for row in rows if row["fit"] == study.CONTROL and row["of"] == "mu"]
    # Two tables, an equal one and a different one, with one value for both surfaces.
    assert len(one) == 4 and not all(row["inside"] for row in one)


def test_the_verdict_asks_for_coverage_of_all_and_for_controls_that_fail(labs):
    controls = [row for name in study.POOL for row in counted(20, 40, name, fit=study.CONTROL)]
    good = [*counted(380), *counted(380, name="cor_10"), *controls]
    assert judged(labs, good)["holds"] is True
    assert judged(labs, [*counted(360), *good[400:]])["holds"] is False
    assert judged(labs, [*counted(400), *good[400:]])["holds"] is False
    # Equal surfaces may be drawn together.
    assert judged(labs, [*good, *counted(400, what=study.EQUAL)])["holds"] is True
    assert judged(labs, [*good, *counted(360, what=study.EQUAL)])["holds"] is False
    passing = [row for name in study.POOL for row in counted(39, 40, name, fit=study.CONTROL)]
    assert judged(labs, [*counted(380), *counted(380, name="cor_10"), *passing])["holds"] is False
    found = judged(labs, [*good, *counted(300, what=study.DIFFERENT)])["differences"]
    assert found == {"apart": study.APART, "found": 400, "of": 400}


def test_a_number_of_labs_that_cannot_be_is_refused(capsys):
    assert main(["--few", "--replicates", "0"]) == 2
    assert "replicates = 0" in capsys.readouterr().err
