"""Posteriors of long tables: draws weighed by their density on all rows, instead of walkers."""

from __future__ import annotations

import numpy as np
import pytest
from samples import problem_of
from scipy.special import logsumexp
from scipy.stats import multivariate_t, norm, t

from fitball.bench.problems import enlarged
from fitball.data.read import load_table
from fitball.inference import calibrate
from fitball.inference.effort import Effort
from fitball.inference.likelihood.posterior import log_posterior
from fitball.inference.point.point_fit import point_fit
from fitball.inference.prediction.posterior_predictive import evenly
from fitball.inference.problem.noise import KINDS
from fitball.inference.sampling.importance import importance_posterior
from fitball.inference.sampling.moves import DEGREES_OF_FREEDOM, StudentProposal
from fitball.report.fit.document import page
from fitball.report.saved.fit_file import fit_text, read_fit
from fitball.report.saved.run_file import read_run, run_text

HELD = {"e_x": 0.1, "offset": 0.0, "cor_slope": -0.01, "spin_sd": 14.0, "cor_10": 0.75}


def long_problem(rows, **choices):
    return problem_of(enlarged(load_table("wang_all.csv"), rows), model="grip-slip", **choices)


@pytest.fixture(scope="module")
def fits():
    """The same table of 400 rows, by one thread and by two."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(calibrate, "LOOKED_AT", 300)
        return [calibrate.run(long_problem(400), Effort(seed=4, cores=cores)) for cores in (1, 2)]


def test_weighed_draws_are_those_of_the_posterior():
    """Of two parameters the posterior is a sum over a grid; with five rows that of a noise leans far to one side."""
    problem = long_problem(5, fix=HELD, velocity_noise="tied")
    assert problem.free_names == ("mu", "velocity_sd")
    _, point = point_fit(problem, np.random.default_rng(1))
    optima = problem.to_coordinates(np.array([[point.values[name] for name in problem.free_names]]))
    sampled, words = calibrate.weigh(problem, optima, Effort(ess=4000.0).settings(problem), lambda _progress: None)
    assert sampled is not None and sampled.converged and "density on all 5 rows" in words
    draws = sampled.kept.reshape(-1, 2)
    low, high = draws.min(axis=0), draws.max(axis=0)
    axes = [np.linspace(a - 0.2 * (b - a), b + 0.2 * (b - a), 161) for a, b in zip(low, high, strict=True)]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    density = log_posterior(problem, grid.reshape(-1, 2)).reshape(161, 161)
    density = np.exp(density - density.max())
    for k in range(2):
        marginal = density.sum(axis=1 - k) / density.sum()
        mean = np.sum(marginal * axes[k])
        sd = np.sqrt(np.sum(marginal * (axes[k] - mean) ** 2))
        skew = np.sum(marginal * (axes[k] - mean) ** 3) / sd**3
        z = (draws[:, k] - mean) / sd
        assert abs(z.mean()) < 0.1 and abs(z.std() - 1.0) < 0.06
        assert np.mean(z**3) == pytest.approx(skew, abs=0.2)
    assert skew > 0.3


def test_weights_are_the_posterior_over_what_was_drawn_from():
    problem = long_problem(5, fix=HELD, velocity_noise="tied")
    factor = np.array([[0.1, 0.0], [0.05, 0.2]])
    centre = problem.to_coordinates(np.array([[0.55, 0.4]]))[0]
    proposals = [StudentProposal(centre, factor), StudentProposal(centre + 0.3, 2.0 * factor)]
    drawn = importance_posterior(problem, proposals, np.random.default_rng(2), enough=1.0)
    at = problem.to_coordinates(drawn.values)
    outside = [
        multivariate_t(one.centre, one.factor @ one.factor.T, df=DEGREES_OF_FREEDOM).logpdf(at) for one in proposals
    ]
    np.testing.assert_allclose(drawn.score, log_posterior(problem, at), rtol=1e-12)
    expected = drawn.score - logsumexp(outside, axis=0)
    np.testing.assert_allclose(drawn.log_weights, expected - logsumexp(expected), atol=1e-9)


def test_long_tables_are_weighed_and_short_ones_walked(fits):
    diagnostics = fits[0].diagnostics
    assert diagnostics is not None and diagnostics.converged and diagnostics.walkers == 1
    assert diagnostics.pareto_k is not None and diagnostics.pareto_k < 0.7
    assert diagnostics.evaluations < 20_000
    assert not calibrate.weighs(long_problem(calibrate.LOOKED_AT), Effort())
    assert calibrate.weighs(long_problem(calibrate.LOOKED_AT + 1), Effort())
    assert not calibrate.weighs(long_problem(calibrate.LOOKED_AT + 1), Effort(walkers=40))


def test_threads_change_no_draw(fits):
    one, other = (fit.posterior for fit in fits)
    np.testing.assert_array_equal(one.values, other.values)
    np.testing.assert_array_equal(one.log_posterior, other.log_posterior)


def test_weighed_fits_say_so_and_are_read_back(fits, tmp_path):
    (tmp_path / "fit.json").write_text(fit_text(fits[0]), encoding="utf-8")
    (tmp_path / "run.toml").write_text(run_text(fits[0], tmp_path), encoding="utf-8")
    saved = read_fit(tmp_path)
    assert saved.diagnostics is not None
    assert saved.diagnostics.pareto_k == fits[0].diagnostics.pareto_k
    assert "density on all 400 rows. Pareto k" in " ".join(saved.notes)
    text = page(fits[0], {})
    assert "weighted by their density" in text and "ensembles of 1 walkers" not in text
    # Made again, it is weighed again.
    assert read_run(tmp_path).effort.walkers is None


def test_where_no_distribution_comes_near_walkers_go(monkeypatch):
    monkeypatch.setattr(calibrate, "LOOKED_AT", 4)
    monkeypatch.setattr(calibrate, "K_TRUSTED", -10.0)
    fit = calibrate.run(long_problem(5, fix=HELD), Effort(max_steps=100, cores=1))
    assert fit.diagnostics is not None and fit.diagnostics.walkers > 1 and fit.diagnostics.pareto_k is None
    assert any("unreliable" in note and "sampled by ensembles of walkers" in note for note in fit.notes)


def test_few_draws_give_intervals_of_new_measurements_all_the_same():
    """Of a normal noise, and of Student's: 95 % of new measurements lie within, by as many even deviations."""
    sizes = {"normal": {}, "student-t": {"degrees_of_freedom": np.full(120, 4.0)}}
    for kind, freedom in (("normal", norm), ("student-t", t(4.0))):
        steps = evenly(KINDS[kind], sizes[kind], (120, 7), np.random.default_rng(1))
        assert steps.shape == (120, 7)
        for column in steps.T:
            low, high = np.quantile(column, (0.025, 0.975), method="hazen")
            assert freedom.cdf(high) - freedom.cdf(low) == pytest.approx(0.95, abs=0.004)
