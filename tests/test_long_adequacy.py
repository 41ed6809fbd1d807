"""Adequacy of long tables: looked at whole, beside made tables that are shorter."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from samples import problem_of

from fitball.bench.problems import enlarged
from fitball.data.read import load_table
from fitball.data.scene import load_scene
from fitball.inference.adequacy import made_tables
from fitball.inference.adequacy.describe import adequacy
from fitball.inference.adequacy.looks import Tables, scored
from fitball.inference.adequacy.refit import overlap, patterns, refit
from fitball.inference.likelihood.residuals import Weighting, residual_slopes, residuals
from fitball.inference.point.point_fit import maximum_posterior
from fitball.inference.problem import subsample
from fitball.inference.results import sentences
from fitball.inference.results.evidence import FALSE_FAILS, Answer
from fitball.models.registry import model

TRUTH = {"mu": 0.6, "e_x": 0.1, "offset": 0.0, "cor_10": 0.78, "cor_slope": -0.012}
ROWS = 1200


def simulated(bias=0.0, rows=ROWS, **choices):
    """A table that grip-slip made, `bias` m/s times the square of the speed in 20 m/s added to v_x2, and its fit."""
    table = enlarged(load_table("wang_all.csv"), rows)
    made, rng = model("grip-slip").rebound(TRUTH, table.impacts), np.random.default_rng(7)
    shift = {"v_x2": bias * (table.impacts.v_x1 / 20.0) ** 2}
    sizes = {"v_x2": 0.3, "v_y2": 0.3, "omega_2": 10.0}
    seen = {name: getattr(made, name) + sd * rng.standard_normal(rows) for name, sd in sizes.items()}
    measurements = tuple(
        replace(item, values=seen[item.name] + shift.get(item.name, 0.0)) for item in table.measurements
    )
    problem = problem_of(replace(table, measurements=measurements), model="grip-slip", **choices)
    start = {**TRUTH, "v_x_sd": 0.3, "v_y_sd": 0.3, "velocity_sd": 0.3, "spin_sd": 10.0}
    return problem, maximum_posterior(problem, np.array([[start[name] for name in problem.free_names]]))


@pytest.mark.parametrize(("bias", "answer"), [(0.0, Answer.DESCRIBES), (0.15, Answer.EXCEPT)])
def test_shorter_made_tables_give_the_same_answer(bias, answer, monkeypatch):
    problem, point = simulated(bias)
    monkeypatch.setattr(made_tables, "RESIDUALS", 500_000)
    whole = adequacy(problem, point, None, 3)
    monkeypatch.setattr(made_tables, "MADE", 900)
    short = adequacy(problem, point, None, 3)
    assert whole.answer is short.answer is answer
    made = sentences.SIMULATED.format(count=399)
    assert f"{made}." in whole.based_on and f"{made} of 300 impacts." in short.based_on
    others = {(check.kind, check.words): check for check in short.checks}
    assert len(others) == len(whole.checks)
    for check in whole.checks:
        other = others[check.kind, check.words]
        # What is seen is seen in all rows; what is usual is told by shorter tables, as it would be in longer ones.
        if check.kind != "loo-pit":
            assert other.statistic == pytest.approx(check.statistic, rel=1e-9, abs=1e-12)
        if check.kind not in ("loo-pit", "outlier", "tails"):
            assert other.usual == pytest.approx(check.usual, rel=0.6)
        assert check.found == other.found or 0.01 < check.p < 0.2
    assert short.moved == pytest.approx(whole.moved, rel=1e-6)


def test_a_long_table_that_is_far_off_is_not_described(monkeypatch):
    """So many tables are made that one chance in a hundred can be told; and the model's error is set beside that of
    the measurements.
    """
    assert 2.0 / (made_tables.LEAST_TABLES + 1) < FALSE_FAILS
    monkeypatch.setattr(made_tables, "RESIDUALS", 500_000)
    problem, point = simulated(2.5)
    found = adequacy(problem, point, None, 3)
    assert found.answer is Answer.FAILS
    name = max(found.moved, key=found.moved.get)
    assert found.moved[name] > 5.0
    assert f"{name} by {found.moved[name]:.0f} of its sds" in found.sentence
    assert "of its sds" not in adequacy(*simulated(0.0, rows=300), None, 3).sentence


def test_patterns_are_what_a_refit_leaves():
    """A pattern is kept as its shape and what the basis has of it; that is its projection, of length one."""
    problem, point = simulated(rows=60)
    fit = refit(problem, point)
    found = patterns(problem, point, fit)
    lefts = []
    for item in found:
        whole = np.zeros(fit.measured.size)
        whole[fit.rows(item.column)] = item.shape
        left = whole - fit.own @ (fit.own.T @ whole)
        np.testing.assert_allclose(item.left(fit), left / np.linalg.norm(left), atol=1e-10)
        lefts.append(item.left(fit))
    lefts = np.array(lefts)
    products = [[overlap(fit, one, other) for other in found] for one in found]
    np.testing.assert_allclose(products, lefts @ lefts.T, atol=1e-9)
    tables = Tables(fit, np.random.default_rng(1).standard_normal((5, fit.measured.size)))
    square, rank = tables.spanned([*found[:6], found[0]])
    # A pattern that is there twice spans nothing new.
    assert rank == 6
    np.testing.assert_allclose(square, np.sum((tables.even @ np.linalg.qr(lefts[:6].T)[0]) ** 2, axis=1), rtol=1e-6)


def test_parts_make_up_the_whole(monkeypatch):
    """Residuals and derivatives part by part are those of the whole, mean contact time and priors included."""
    table = enlarged(load_table("wang_all.csv"), 50)
    holed = table.measurements[0].values.copy()
    holed[::3] = np.nan
    table = replace(table, measurements=(replace(table.measurements[0], values=holed), *table.measurements[1:]))
    problem = problem_of(table, scene=load_scene("wang_all.csv"), model="two-mass")
    assert problem.contact_time is not None
    middle = np.array([0.5])
    values = np.array([[item.prior.quantile(middle)[0] for item in problem.free]])
    weighting = Weighting({"velocity_sd": 0.4, "v_x_sd": 0.4, "v_y_sd": 0.4, "spin_sd": 14.0}, penalised=True)
    made = [
        lambda part: residuals(part, values, weighting)[0],
        lambda part: residual_slopes(part, problem.to_coordinates(values), weighting)[0],
    ]
    whole = [of(problem) for of in made]
    monkeypatch.setattr(subsample, "PART", 12)
    for of, expected in zip(made, whole, strict=True):
        np.testing.assert_allclose(subsample.whole_of_parts(problem, of), expected, rtol=1e-10, atol=1e-12)


def test_a_correlation_of_longer_tables_scatters_less():
    """Correlations of independent residuals have the sd 1/sqrt(n): those of 400 tell the chances of one of 1,600."""
    rng = np.random.default_rng(2)
    made = rng.standard_normal((2000, 400)) @ rng.standard_normal(400) / 400.0
    seen = np.array([0.0, 1.96, 2.576]) / 40.0
    np.testing.assert_allclose(scored(seen, made, sides=2, shorter=0.25), [1.0, 0.05, 0.01], atol=0.02)
