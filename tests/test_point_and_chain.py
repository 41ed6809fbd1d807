"""The point that is published: found from every regime, and nowhere below a draw of the chains."""

from __future__ import annotations

import re

import numpy as np
import pytest
from samples import (
    GRIP_SLIP,
    TWO_MASS,
    coordinates_of,
    drop_table,
    hard_sphere,
    linear_problem,
    problem_of,
    synthetic,
)

from fitball.errors import FitError
from fitball.inference import calibrate
from fitball.inference.calibrate import run, search_again
from fitball.inference.effort import Effort
from fitball.inference.likelihood.posterior import log_posterior
from fitball.inference.point.gauss_newton import Reached
from fitball.inference.point.least_squares import deeper, least_squares
from fitball.inference.point.point_fit import (
    _moved,
    higher_maximum,
    maximum_posterior,
    other_regimes,
    point_fit,
    starting_points,
)
from fitball.inference.results.results import RunStatus
from fitball.inference.sampling.ensembles import Sampled

SHARP = {"velocity_sd": 0.05, "spin_sd": 2.0}
# Where every impact grips, on the plateau that was once published.
PLATEAU = {
    "mu": 0.6, "e_x": -0.45, "offset": 9.1e-4, "cor_10": 0.918, "cor_slope": -0.01, "velocity_sd": 0.123,
    "spin_sd": 17.6,
}  # fmt: skip


@pytest.fixture(scope="module")
def sphere(tmp_path_factory):
    """The hard sphere under grip-slip, with its point fits."""
    problem = hard_sphere(tmp_path_factory.mktemp("sphere"), "grip-slip")
    return problem, *point_fit(problem, np.random.default_rng(0))


@pytest.mark.parametrize("seed", [1, 2])
def test_a_hard_sphere_is_found_although_every_draw_of_the_prior_grips(tmp_path, seed):
    """Four of six impacts slide, at a friction that lies nearly five sds below the middle of the prior."""
    problem = hard_sphere(tmp_path, "grip-slip")
    squares, point = point_fit(problem, np.random.default_rng(seed))
    assert point.log_posterior > 6.8
    assert point.values["mu"] == pytest.approx(0.092, abs=0.003)
    assert point.values["e_x"] == pytest.approx(0.40, abs=0.02)
    assert squares.chi_square < 0.21
    # Kharaz and his colleagues read a friction of 0.092 off the sliding impacts.
    assert squares.values["mu"] == pytest.approx(0.092, abs=0.001)


# Friction at which all of Wang's seven impacts slide, some do, and all grip; with the spread of Walton's and the
# two-mass ball's regimes.
@pytest.mark.parametrize("mu", [0.08, 0.2, 0.3, 0.45, 1.5])
@pytest.mark.parametrize(("model", "truth"), [("grip-slip", GRIP_SLIP), ("two-mass", TWO_MASS)])
def test_the_maximum_lies_nowhere_below_the_truth(model, truth, mu):
    truth = truth | SHARP | {"mu": mu}
    problem = synthetic(problem_of("wang_zero_spin.csv", model, without=("mu", "contact_time")), truth, 8)
    squares, point = point_fit(problem, np.random.default_rng(1))
    assert point.log_posterior >= log_posterior(problem, coordinates_of(problem, truth)[None, :])[0]
    weighted = least_squares(problem, problem.free_rows([truth]))
    assert squares.chi_square <= weighted.chi_square * (1.0 + 1e-3)
    if 0.2 <= mu <= 0.45:
        assert point.values["mu"] == pytest.approx(mu, rel=0.05)


def test_starts_reach_regimes_that_no_good_draw_has(sphere):
    problem = sphere[0]
    draws = problem.prior.draw(np.random.default_rng(1), 4000)
    grips = problem.rebound(draws).regime
    best = draws[np.argsort(-log_posterior(problem, problem.to_coordinates(draws)))[:16]]
    assert len(np.unique(problem.rebound(best).regime)) == 1
    reached = _moved(problem, best)[:, problem.free_names.index("mu")]
    assert reached.min() < 0.1 and reached.max() > 3.0
    found = other_regimes(problem, best, 5)
    patterns = problem.rebound(found).regime
    assert len(np.unique(patterns, axis=0)) == len(found) >= 3
    # From all grip to all slide, by way of some.
    slides = np.mean(patterns != grips[0, 0], axis=1)
    assert slides[0] == slides.max() > 0.8
    assert 0.0 < slides.min() < 0.8
    assert np.all(np.isfinite(log_posterior(problem, problem.to_coordinates(found))))
    every = starting_points(problem, np.random.default_rng(1), 16)
    assert len(every) > 16
    assert len(np.unique(problem.rebound(every).regime)) > 1


def test_a_drop_has_no_regimes_and_no_further_starts():
    problem = linear_problem(drop_table(np.random.default_rng(1)))
    assert len(starting_points(problem, np.random.default_rng(1), 3)) == 3


def test_a_search_that_begins_where_nothing_can_be_evaluated_leads_nowhere(sphere):
    """Restitution above 1 at the slowest impact: no minimum, and no error of a library."""
    problem = sphere[0]
    beyond = problem.free_rows([PLATEAU | {"cor_slope": -0.0102}])
    assert np.any(problem.rebound(beyond).status)
    found = maximum_posterior(problem, np.concatenate([beyond, problem.free_rows([PLATEAU])]))
    assert np.isfinite(found.log_posterior)
    with pytest.raises(FitError, match="no parameters the model can evaluate"):
        least_squares(problem, problem.free_rows([PLATEAU | {"cor_10": 0.99, "cor_slope": -0.09}]))


def test_a_point_below_its_chain_is_searched_again(sphere, monkeypatch):
    """Whatever the first search found, what is published is no lower than any draw, and the fit says so."""
    problem = sphere[0]
    missed = maximum_posterior(problem, problem.free_rows([PLATEAU]))
    squares = least_squares(problem, problem.free_rows([PLATEAU]))
    assert missed.log_posterior < -10.0
    monkeypatch.setattr(calibrate, "point_fit", lambda *_: (squares, missed))
    fit = run(problem, Effort(seed=1, cores=1, max_steps=700))
    assert fit.point.log_posterior >= fit.posterior.log_posterior.max()
    assert fit.point.log_posterior > 6.8
    assert fit.point.values["mu"] == pytest.approx(0.092, abs=0.003)
    assert fit.least_squares.chi_square < 0.21
    (note,) = (note for note in fit.notes if "second search" in note)
    assert re.search(r"\bmu changed from 0\.(59\d|60\d|6) to 0\.09", note) and "least squares fell" in note
    assert ("do not agree yet" in note) == (fit.status is RunStatus.NOT_CONVERGED)
    # What hangs on the point follows it.
    assert fit.parameters["mu"].point == fit.point.values["mu"]
    assert fit.golden.parameters["mu"] == fit.point.values["mu"]
    assert fit.identifiability.evidence["mu"].profile.best == pytest.approx(0.092, abs=0.003)


def chains(problem, draws, score=None):
    coordinates = problem.to_coordinates(draws)
    scores = log_posterior(problem, coordinates) if score is None else score
    moved = np.zeros((1, len(draws)), dtype=bool)
    return Sampled(coordinates[None, None], scores[None, None], (), 1, 0, 0, None, True, moved)


def test_a_chain_below_the_point_changes_nothing(sphere):
    problem, squares, point = sphere
    lower = problem.free_rows([point.values]) * np.linspace(1.01, 1.05, 8)[:, None]
    assert search_again(problem, squares, point, chains(problem, lower)) == (squares, point, ())


def test_a_draw_that_no_search_improves_becomes_the_point(sphere, monkeypatch):
    """A search from it may end lower, at a wall or a kink: then the draw itself is published, not what lies below."""
    problem, squares, point = sphere
    missed = maximum_posterior(problem, problem.free_rows([PLATEAU]))
    draw = problem.free_rows([point.values]) * 1.002
    score = log_posterior(problem, problem.to_coordinates(draw))
    assert missed.log_posterior < score[0]
    monkeypatch.setattr("fitball.inference.point.point_fit.descend", lost(problem, missed))
    monkeypatch.setattr("fitball.inference.point.point_fit._climb", lambda _problem, start: start)
    _, found, notes = search_again(problem, squares, missed, chains(problem, draw))
    assert found.log_posterior >= score[0] - 1e-9
    assert len(notes) == 1


def lost(problem, point):
    """A search that always ends at `point`."""

    def descend(surface, searches, **_):
        x = np.repeat(surface.from_values(problem.free_rows([point.values])), len(searches.x), axis=0)
        return Reached(x, surface.cost(x, searches.given), np.zeros(len(x), dtype=bool))

    return descend


def test_known_optima_are_kept_where_a_search_finds_nothing_better(sphere):
    problem, squares, point = sphere
    again = higher_maximum(problem, point, problem.free_rows([PLATEAU]))
    assert again.log_posterior >= point.log_posterior - 1e-9
    assert deeper(problem, squares, [PLATEAU]) is squares
    worse = least_squares(problem, problem.free_rows([PLATEAU]))
    assert deeper(problem, worse, [squares.values]).chi_square == pytest.approx(squares.chi_square, rel=1e-6)
