"""Predictions without an impact: leave-one-out of a line in closed form, by quadrature, ArviZ."""

from dataclasses import replace

import numpy as np
import pytest
from arviz_stats.base.array import array_stats
from numpy.testing import assert_allclose, assert_array_equal
from scipy import special, stats
from support import line
from support.fit_by_hand import table_of

from fitball.data.load import load_data
from fitball.data.scene import Scene
from fitball.inference.density import pointwise
from fitball.inference.effort import Effort
from fitball.inference.problem.problem import Choices
from fitball.inference.search.best_fit import best_fit
from fitball.uses import compare, left_out
from fitball.uses.left_out import WeightedDraws, leave_one_out, maxima_without


def line_with_draws(change=None):
    """The problem of a line, with changed measurements, its maximum, and independent draws of its
    posterior.
    """
    problem = line.line_problem()
    if change is not None:
        y = change(problem.rows.y.copy())
        problem = replace(problem, rows=replace(problem.rows, y=y))
    centre, covariance = line.exact(problem)
    draws = np.random.default_rng(4).multivariate_normal(centre, covariance, 4000)
    q = problem.prior.coordinate(draws)
    best = problem.prior.coordinate(centre[None])
    equal_weights = np.full(4000, -np.log(4000))
    return problem, best, WeightedDraws(q, equal_weights, 1.0, True)


def without(problem, rows):
    """Mean and sd (impacts,) of what a line predicts of rows that it was not fitted to, in closed
    form.
    """
    others = np.setdiff1d(np.arange(len(problem.rows.y)), rows)
    centre, covariance = line.exact(problem.on_rows(others))
    design = np.column_stack([problem.rows.states.v_x1[rows], np.ones(len(rows))])
    variance = np.einsum("ri,ij,rj->r", design, covariance, design)
    return design @ centre, np.sqrt(variance + line.SD**2)


def exact_scores(problem):
    """Mean and log density (impacts,) of each impact by a line fitted to all others."""
    means = []
    scores = []
    for row, (y,) in enumerate(problem.rows.y):
        (mean,), (sd,) = without(problem, np.array([row]))
        means.append(mean)
        scores.append(stats.norm.logpdf(y, mean, sd))
    return np.array(means), np.array(scores)


def scored(problem, best, draws):
    """Leave-one-out scores of the one column of a line."""
    return leave_one_out(problem, best, draws, ("v_x2",), Effort())


def drawn_about(problem, best, least):
    """Draws from the proposal at a maximum."""
    begin = [left_out.proposal(problem, best[0])]
    return left_out.weighted_draws(problem, begin, Effort(), least, "here")


@pytest.mark.parametrize("weighted", [False, True])
def test_scores_and_predictions_of_a_line_are_those_in_closed_form(weighted):
    problem, best, draws = line_with_draws()
    if weighted:
        # From a proposal that is far too wide: without their weights draws would be no posterior.
        proposal = left_out.proposal(problem, best[0])
        wide = replace(proposal, factor=8.0 * proposal.factor)
        draws = left_out.weighted_draws(problem, [wide], Effort(), 1500.0, "here")
    result = scored(problem, best, draws)
    mean, scores = exact_scores(problem)
    assert not result.refitted.all()
    assert result.settled.all()
    assert_allclose(result.elpd, scores, atol=0.06 if weighted else 0.03)
    # Means without an impact, known to some hundredths of their sds.
    error = 0.15 if weighted else 0.1
    assert_allclose(result.predicted[:, 0], mean, atol=error * line.SD)
    # Those with it lie elsewhere.
    (slope, shift), _ = line.exact(problem)
    with_impact = slope * problem.rows.states.v_x1 + shift
    assert np.abs(with_impact - mean).max() > 0.3 * line.SD


def test_scores_are_those_of_arviz(monkeypatch):
    monkeypatch.setattr(left_out, "REFIT", np.inf)
    problem, best, draws = line_with_draws()
    result = scored(problem, best, draws)
    likelihood = pointwise(problem, draws.q, ("v_x2",))
    of_one_chain = likelihood.T[:, None]
    elpd, k, _ = array_stats.loo(of_one_chain, chain_axis=-2, draw_axis=-1, r_eff=1.0)
    assert_allclose(result.elpd, elpd, rtol=1e-12)
    assert_allclose(result.k, k, rtol=1e-9)


def scores_by_quadrature(problem, median, log_sd):
    """Log densities (impacts,) of each impact by a line fitted to all others, whose noise has a
    lognormal prior: over the noise by sums.
    """
    log_noise = np.log(median) + log_sd * np.linspace(-4.0, 6.0, 401)
    prior = stats.norm.logpdf(log_noise, np.log(median), log_sd)
    v_x1 = problem.rows.states.v_x1
    design = np.column_stack([v_x1, np.ones(v_x1.size)])
    # Of the priors of `line`: means 0.5 and 0, sds 0.3 and 2.
    mean = design @ [0.5, 0.0]
    spread = design @ np.diag([0.3**2, 2.0**2]) @ design.T

    def evidence(rows):
        densities = [
            stats.multivariate_normal.logpdf(
                problem.rows.y[rows, 0],
                mean[rows],
                spread[np.ix_(rows, rows)] + np.exp(2.0 * log_sd_here) * np.eye(len(rows)),
            )
            for log_sd_here in log_noise
        ]
        return special.logsumexp(prior + densities)

    every = np.arange(v_x1.size)
    return np.array([evidence(every) - evidence(np.delete(every, row)) for row in every])


def test_scores_with_a_free_noise_are_those_by_quadrature(monkeypatch):
    """Its weights have no heavy tail, as it is integrated out: chains are not needed."""
    monkeypatch.delattr(left_out, "sample")
    monkeypatch.setattr(left_out, "REFIT", 0.2)
    rng = np.random.default_rng(1)
    problem = line.line_problem(noise=None, prior={"v_x_sd": "lognormal(0.1, 1)"})
    best = np.stack([problem.coordinates(x) for x in best_fit(problem, rng).optima])
    draws = drawn_about(problem, best, 3000.0)
    result = scored(problem, best, draws)
    assert result.refitted.any()
    assert_allclose(result.elpd, scores_by_quadrature(problem, 0.1, 1.0), atol=0.06)


def last_beside_line(y):
    """The impact at the end of the line lies six sds beside it."""
    last = np.argmax(line.line_problem().rows.states.v_x1)
    y[last, 0] += 6.0 * line.SD
    return y


def test_an_impact_without_which_weights_are_unreliable_is_refitted(monkeypatch):
    problem, best, draws = line_with_draws(last_beside_line)
    result = scored(problem, best, draws)
    _, scores = exact_scores(problem)
    row = np.argmax(problem.rows.states.v_x1)
    assert result.settled.all()
    assert_array_equal(result.refitted, result.k > left_out.REFIT)
    assert result.k[row] > 0.7
    assert result.refitted[row]
    assert not result.refitted.all()
    assert_allclose(result.elpd, scores, atol=0.1)
    # Without a refit the score is wrong.
    monkeypatch.setattr(left_out, "REFIT", np.inf)
    wrong = scored(problem, best, draws)
    assert not wrong.refitted.any()
    assert abs(wrong.elpd[row] - scores[row]) > 0.5


def test_long_tables_are_scored_by_parts(monkeypatch):
    problem, best, draws = line_with_draws()
    at_once = scored(problem, best, draws).elpd
    monkeypatch.setattr(left_out, "MOST_DENSITIES", 4000 * 5)
    monkeypatch.setattr(left_out, "LEAST_SCORING_DRAWS", 4000)
    in_parts = scored(problem, best, draws).elpd
    assert_allclose(in_parts, at_once, rtol=1e-12)
    # Fewer draws, evenly spread, are less sure.
    monkeypatch.setattr(left_out, "LEAST_SCORING_DRAWS", 1000)
    thinned = scored(problem, best, draws).elpd
    assert 0.0 < np.abs(thinned - at_once).max() < 0.1


def without_reliable_weights(monkeypatch):
    """Importance sampling says of all its weights that they are no good."""
    adapted = left_out.adapted

    def unreliable(*arguments):
        drawn, evaluated = adapted(*arguments)
        return drawn._replace(k=np.inf), evaluated

    monkeypatch.setattr(left_out, "adapted", unreliable)


@pytest.mark.parametrize("chain", [False, True])
def test_weighted_draws_and_draws_of_chains_are_those_of_the_posterior(chain, monkeypatch):
    problem, best, _ = line_with_draws()
    if chain:
        without_reliable_weights(monkeypatch)
    draws = drawn_about(problem, best, 2000.0)
    centre, covariance = line.exact(problem)
    values = problem.prior.value(draws.q)
    weights = np.exp(draws.weights)
    assert draws.settled
    assert weights.sum() == pytest.approx(1.0)
    assert (np.ptp(weights) > 0.0) is not chain
    assert (draws.efficiency < 0.9) is chain
    sd = np.sqrt(np.diagonal(covariance))
    assert np.abs(weights @ values - centre).max() < 0.1 * sd.max()
    sd_of_draws = np.sqrt(weights @ (values - centre) ** 2)
    assert_allclose(sd_of_draws, sd, rtol=0.08)


def test_chains_are_short_and_none_are_made_of_three_impacts(monkeypatch):
    """Of four rows a two-mass ball took 20,000 steps, and again without each of them."""
    problem, best, _ = line_with_draws()
    efforts = []

    def chains(_problem, _begin, effort, _progress):
        efforts.append(effort)
        raise RuntimeError

    without_reliable_weights(monkeypatch)
    monkeypatch.setattr(left_out, "sample", chains)
    begin = [left_out.proposal(problem, best[0])]
    three = problem.without_rows(np.arange(3, 12))
    draws = left_out.weighted_draws(three, begin, Effort(), 2000.0, "here")
    assert not efforts
    assert not draws.settled
    assert len(draws.q) > 2000
    loaded = load_data([table_of(18).iloc[:4]], Scene(), True)
    (four, *_) = compare.problems_of(*loaded, Choices(pool={"all": "none"}), ["grip-slip"], False)
    task = compare._Task(four, ("v_x2",), {}, Effort())
    with pytest.raises(RuntimeError):
        compare._scored(task)
    assert efforts[0].max_steps == compare.MOST_CHAIN_STEPS
    assert Effort().max_steps > compare.MOST_CHAIN_STEPS


def test_labels_left_out_are_predicted_by_the_maximum_without_them():
    problem, best, _ = line_with_draws()
    folds = [np.arange(3), np.arange(3, 12)]
    maxima, predicted = maxima_without(problem, best, folds)
    for rows, maximum in zip(folds, maxima, strict=True):
        mean, _ = without(problem, rows)
        assert_allclose(predicted[rows, 0], mean, atol=2e-3 * line.SD)
        others = np.setdiff1d(np.arange(12), rows)
        centre, _ = line.exact(problem.on_rows(others))
        values = problem.prior.value(maximum[None])[0]
        assert_allclose(values, centre, atol=2e-3)
