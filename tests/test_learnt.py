"""The density that draws teach beside the exact one: equal where predictions are linear, close over
a posterior, and the exact one where nothing can be learnt.
"""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from made_tables import impact_table
from numpy.testing import assert_allclose, assert_array_equal
from support.density import REBOUND, problem_of, scene_of, table_of
from support.fits import best

import fitball
from fitball.data.scene import Scene
from fitball.inference import density
from fitball.inference.density import cells, log_posterior
from fitball.inference.judgement.first_order import proposal
from fitball.inference.learnt import learnt, unlearnt
from fitball.inference.problem.build import build_problem
from fitball.inference.problem.problem import Choices
from fitball.inference.sampling.importance import importance


def drawn(problem, count=400, seed=1):
    """Draws about the best fit of a problem, within bounds."""
    prior = problem.prior
    about = proposal(problem, best(problem))
    draws = about.draw(np.random.default_rng(seed), count)
    return np.clip(draws, prior.low, prior.high)


@pytest.fixture(scope="module", params=["grip-slip", "two-mass"])
def uncertain(request):
    return problem_of(table_of(REBOUND, "corr", gaps=True, count=12), scene_of(), request.param)


def test_over_a_posterior_it_is_the_exact_density(uncertain):
    rng = np.random.default_rng(2)
    about = [proposal(uncertain, best(uncertain))]
    x, log_weights, _ = importance(partial(log_posterior, uncertain), about, rng, 1000.0)
    draws = x[rng.choice(len(x), 800, p=np.exp(log_weights))]
    law = learnt(uncertain, draws[:400])
    others = draws[400:]
    exact = log_posterior(uncertain, others)
    off = log_posterior(law, others) - exact
    assert off.std() < 0.1
    # Without offsets incident states are exact, which is another posterior.
    offsets = law.rows.learnt
    nothing = offsets._replace(at_centre=0.0 * offsets.at_centre, slopes=0.0 * offsets.slopes)
    rows = replace(law.rows, learnt=nothing)
    of_none = log_posterior(replace(law, rows=rows), others)
    assert (of_none - exact).std() > 0.2


def linear(v_x1, v_y1, omega_1, ball, a="normal(0.7, 0.1)", b="normal(0, 0.1)"):
    return a * v_x1 + b * v_y1, a * v_y1, omega_1 + b * v_x1


def test_where_predictions_are_linear_it_is_exact():
    rng = np.random.default_rng(3)
    columns = ("v_x1", "v_y1", "omega_1", "v_x2", "v_y2", "omega_2")
    values = dict(zip(columns, rng.uniform(5.0, 15.0, (6, 9)), strict=True))
    sd = {name: rng.uniform(0.5, 2.0, 9) for name in columns[:3]}
    problem = build_problem(
        impact_table(values, sd=sd),
        Scene(),
        Choices(),
        fitball.model_from(linear),
    )
    law = learnt(problem, problem.prior.draw(rng, 60))
    assert law.rows.learnt is not None
    # Within the limits of the draws that taught it.
    q = 0.5 * problem.prior.draw(rng, 50) + 0.5 * problem.prior.location
    assert_allclose(log_posterior(law, q), log_posterior(problem, q), rtol=1e-10)
    assert_allclose(cells(law, q).mean, cells(problem, q).mean, rtol=1e-10)


def test_beyond_its_draws_offsets_stay_as_they_are_at_the_limit(uncertain):
    taught = drawn(uncertain)
    offsets = learnt(uncertain, taught).rows.learnt
    inside = taught.mean(axis=0)[None]
    k = uncertain.free.index("mu")
    places = np.repeat(inside, 3, axis=0)
    places[:, k] = np.array([1.0, 2.0, -np.inf]) * (taught[:, k].max() + 1.0)
    high, higher, low = offsets.offsets(places)
    assert_array_equal(high, higher)
    places[2, k] = taught[:, k].min()
    assert_array_equal(low, offsets.offsets(places)[2])
    assert np.abs(high - low).max() > 0.0


def test_a_lesson_is_forgotten_by_the_next_and_goes_with_its_rows(uncertain, monkeypatch):
    taught = drawn(uncertain)
    law = learnt(uncertain, taught)
    q = taught[:20]
    expected = log_posterior(law, q)
    again = learnt(learnt(uncertain, drawn(uncertain, seed=5)), taught)
    assert_array_equal(log_posterior(again, q), expected)
    assert_array_equal(log_posterior(unlearnt(law), q), log_posterior(uncertain, q))
    monkeypatch.setattr(density, "STATES_AT_ONCE", 500)
    assert len(list(density.row_blocks(law, len(q)))) > 1
    assert_allclose(log_posterior(law, q), expected, rtol=1e-12)
    in_blocks = learnt(uncertain, taught)
    assert_allclose(log_posterior(in_blocks, q), expected, rtol=1e-12)


def test_where_nothing_can_be_learnt_it_is_the_problem_itself(uncertain):
    certain = problem_of(table_of(REBOUND, "sd"), scene_of())
    assert learnt(certain, drawn(certain)) is certain
    # Too few draws, or none with a rebound at all points.
    taught = drawn(uncertain)
    assert learnt(uncertain, taught[:10]) is uncertain
    nowhere = np.full_like(taught, np.nan)
    assert learnt(uncertain, nowhere) is uncertain
