"""What is left undone because nothing of it is asked for leaves the rest as it was, to the bit."""

from __future__ import annotations

import math

import numpy as np
import pytest
from samples import problem_of

from fitball.data.scene import Scene
from fitball.errors import FitError
from fitball.inference.identifiability import information
from fitball.inference.identifiability.information import known_before, prior_draws
from fitball.inference.point import least_squares as least_squares_module
from fitball.inference.point.gauss_newton import Searches, descend
from fitball.inference.point.least_squares import deeper
from fitball.inference.point.point_fit import starting_points
from fitball.inference.point.surface import surface_of
from fitball.inference.results.results import LeastSquares

RIVALS = 12.0


@pytest.fixture(scope="module")
def wang():
    return problem_of("wang_all.csv")


def test_searches_that_creep_far_above_the_best_are_given_up(wang):
    """Twenty-one starts of Wang's table: some end in minima that lie far above, after sixty rounds."""
    surface = surface_of(wang)
    x = surface.from_values(starting_points(wang, np.random.default_rng(1), 16))
    begun = Searches(x, np.full(len(x), -1), surface.free(x))
    whole, near = descend(surface, begun), descend(surface, begun, rivals=RIVALS)
    kept = whole.settled & (whole.cost < whole.cost.min() + RIVALS)
    assert kept.any()
    np.testing.assert_array_equal(near.x[kept], whole.x[kept])
    np.testing.assert_array_equal(near.settled[kept], True)
    given_up = np.any(near.x != whole.x, axis=1)
    assert given_up.any()
    assert (whole.cost[given_up] > whole.cost.min() + RIVALS).all()


def test_prior_draws_do_not_depend_on_the_parts_they_are_looked_at_in(wang, monkeypatch):
    few = prior_draws(wang, np.random.default_rng(3), 60, 400)
    monkeypatch.setattr(information, "AT_ONCE", 37)
    np.testing.assert_array_equal(prior_draws(wang, np.random.default_rng(3), 60, 400), few)


def test_what_was_known_of_a_ball_that_priors_hardly_reach():
    """A contact as short as a golf ball's, five sds of the stiffness' prior away: no draw by rejection. Since contact
    times go as one over the root of `k_y` exactly, all else drawn from its prior leaves one weight.
    """
    value, sd = 4.5e-4, 0.5e-4
    problem = problem_of("wang_zero_spin.csv", scene=Scene(contact_time=(value, sd)))
    assert len(prior_draws(problem, np.random.default_rng(1))) == 0
    rng, place = np.random.default_rng(2), problem.free_names.index("k_y")
    values = problem.prior.draw(rng, 20_000)
    wanted = value + sd * rng.standard_normal(len(values))
    made = problem.rebound(values)
    values[:, place] *= (made.contact_time.mean(axis=1) / wanted) ** 2
    # Of the shifted ones those are left whose shell can swing with so stiff a core.
    left = np.isfinite(values[:, place])
    left[left] = ~problem.rebound(values[left]).status.any(axis=1)
    stiff = np.log(values[left, place])
    weight = np.exp(-0.5 * (stiff - np.log(2e4)) ** 2 + 12.0) / wanted[left]
    expected = np.average(stiff, weights=weight)
    width = np.sqrt(np.average((stiff - expected) ** 2, weights=weight))
    begun = problem.to_coordinates(values[left][np.argmax(weight)][None])[0]
    found = np.log(known_before(problem, begun, rng)[:, place])
    assert found.mean() == pytest.approx(expected, abs=0.3 * width) and found.std() == pytest.approx(width, rel=0.3)
    # Where the priors have it, draws are those of the rejection, to the bit.
    usual = problem_of("wang_zero_spin.csv", scene=Scene(contact_time=(5e-3, 1e-3)))
    by_rejection = prior_draws(usual, np.random.default_rng(3))
    np.testing.assert_array_equal(known_before(usual, begun, np.random.default_rng(3)), by_rejection)


def test_a_start_that_leads_nowhere_leaves_the_known_minimum(monkeypatch):
    """Starts of another model's fit may be such that this one can evaluate nothing about them."""

    def nowhere(problem, starts):
        raise FitError("no parameters the model can evaluate")

    known = LeastSquares({}, {}, {}, 1.0, 1, {}, 1, (), (), 1)
    monkeypatch.setattr(least_squares_module, "least_squares", nowhere)
    problem = type("Posed", (), {"free_names": ("mu",)})
    assert deeper(problem, known, [{"mu": math.nan}]) is known
