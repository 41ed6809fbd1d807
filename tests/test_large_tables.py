"""Tables of many rows: shared among threads, and fitted by way of samples of them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from fitball.data.read import load_table
from fitball.data.scene import load_scene
from fitball.inference import information, parallel, point
from fitball.inference.least_squares import least_squares
from fitball.inference.maximum import maximum_posterior
from fitball.inference.point import point_fit
from fitball.inference.problem import Choices, build_problem
from fitball.inference.starts import STARTS, starting_points
from fitball.inference.subsample import thinned_problem
from fitball.studies.bench import enlarged, spread_draws


def problem_of(rows, **choices):
    table = enlarged(load_table("wang_all.csv"), rows)
    return build_problem(table, load_scene("wang_all.csv"), Choices(**choices))


@pytest.mark.parametrize("threads", [1, 2, 3])
def test_threads_change_no_digit(threads, wang_impacts):
    draws = spread_draws(50)
    problem = problem_of(21)
    names = problem.model.parameter_names
    whole = problem.model.evaluate(names, draws, wang_impacts)
    parts = parallel.evaluate_in_parts(problem.model, names, draws, wang_impacts, threads)
    for name in ("v_x2", "v_y2", "omega_2", "contact_time", "regime", "status"):
        np.testing.assert_array_equal(getattr(parts, name), getattr(whole, name))


def test_a_thinned_problem_is_the_same_problem_on_fewer_rows():
    problem = problem_of(500)
    small = thinned_problem(problem, 60)
    assert len(small.impacts) == 60
    rows = [int(name) - 1 for name in small.table.ids]
    np.testing.assert_array_equal(small.impacts.v_y1, problem.impacts.v_y1[rows])
    for thin, full in zip(small.channels, problem.channels, strict=True):
        np.testing.assert_array_equal(thin.observed, full.observed[rows])
    angles = np.arctan2(problem.impacts.v_y1, problem.impacts.v_x1)
    kept = angles[rows]
    assert kept.min() == angles.min()
    assert kept.max() == angles.max()
    assert np.max(np.diff(np.sort(kept))) < 0.2
    assert thinned_problem(small, 60) is small


@pytest.mark.parametrize("model", ["two-mass", "grip-slip"])
def test_the_road_by_way_of_samples_ends_where_the_direct_one_does(model, monkeypatch):
    problem = problem_of(300, model=model)
    starts = starting_points(problem, np.random.default_rng(3), STARTS)
    direct, peak = least_squares(problem, starts), maximum_posterior(problem, starts)
    monkeypatch.setattr(point, "SEARCHED", 40)
    monkeypatch.setattr(point, "GROWTH", 3)
    squares, found = point_fit(problem, np.random.default_rng(3))
    assert squares.chi_square == pytest.approx(direct.chi_square, rel=1e-6)
    assert squares.starts >= STARTS
    assert found.log_posterior == pytest.approx(peak.log_posterior, abs=0.01)
    # The problem that is fitted last is the whole one.
    assert found.rebound.v_x2.shape[-1] == 300


def test_a_sample_that_misleads_is_outvoted_by_the_table(monkeypatch):
    """Rows that the first search does not see still decide where the fit ends."""
    problem = problem_of(240, model="grip-slip")
    shift = np.where(np.arange(240) % 2 == 0, 0.4, -0.4)
    channels = tuple(
        replace(item, observed=item.observed + shift) if item.name == "v_x2" else item for item in problem.channels
    )
    shifted = replace(problem, channels=channels)
    monkeypatch.setattr(point, "SEARCHED", 20)
    squares, _ = point_fit(shifted, np.random.default_rng(1))
    starts = starting_points(shifted, np.random.default_rng(1), STARTS)
    assert squares.chi_square == pytest.approx(least_squares(shifted, starts).chi_square, rel=1e-6)


def test_a_part_of_a_large_table_counts_for_the_whole(monkeypatch):
    problem = problem_of(600, model="grip-slip")
    at = problem.to_coordinates(starting_points(problem, np.random.default_rng(2), 1))[0]
    whole = information.fisher_information(problem, at, scene=False)
    monkeypatch.setattr(information, "LOOKED_AT", 150)
    part = information.fisher_information(problem, at, scene=False)
    # A quarter of the rows, laid evenly over incidence, tells a sum over all of them to some percent.
    np.testing.assert_allclose(np.diag(part), np.diag(whole), rtol=0.15)
