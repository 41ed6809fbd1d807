"""Point fits, sampling and verdicts on Wang's tables and on synthetic ones."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import emcee
import numpy as np
import pytest
from samples import TWO_MASS, problem_of

from fitball.data.read import load_table
from fitball.data.scene import Scene, load_scene
from fitball.data.table import Measurement
from fitball.inference.calibrate import fingerprint, run
from fitball.inference.effort import Effort
from fitball.inference.likelihood.posterior import log_likelihood, log_posterior, log_scene_density
from fitball.inference.point.least_squares import least_squares
from fitball.inference.point.point_fit import STARTS, maximum_posterior, starting_points
from fitball.inference.problem.build import Choices, build_problem
from fitball.inference.results.assumptions import CONTACT_TIME
from fitball.inference.results.results import RunStatus, Verdict
from fitball.inference.sampling import ensembles as sampling
from fitball.inference.sampling.chain_file import ChainFile, read_chains
from fitball.inference.sampling.ensembles import SamplingInterrupted, Schedule, Settings, sample
from fitball.models.types import Status


def starts_of(problem, seed=1):
    return starting_points(problem, np.random.default_rng(seed), STARTS)


# Root mean square residuals of the least-squares fits of all 21 impacts, weighted with 0.25 m/s and
# 10 rad/s. Those of `two-mass` and `grip-slip` agree with an earlier, independent sketch of both models
# (0.50 m/s, 0.28 m/s, 14 rad/s and 16 rad/s).
RMS = {
    "two-mass": (0.495, 0.279, 13.68),
    "thesis-exact": (0.429, 0.279, 11.45),
    "grip-slip": (0.497, 0.279, 16.42),
    "brody": (1.329, 0.279, 27.21),
}


@pytest.mark.parametrize("name", RMS)
def test_least_squares_finds_the_best_optimum_of_wang_all(name):
    problem = problem_of("wang_all.csv", model=name)
    for seed in (1, 2, 3):
        found = least_squares(problem, starts_of(problem, seed))
        residuals = [found.rms[key] for key in ("v_x2", "v_y2", "omega_2")]
        np.testing.assert_allclose(residuals, RMS[name], rtol=5e-3)


def test_the_poor_optima_of_k_theta_are_seen_and_not_taken():
    problem = problem_of("wang_all.csv")
    found = least_squares(problem, starts_of(problem))
    assert found.values["k_theta"] == pytest.approx(16.2, rel=0.1)
    assert any(optimum["k_theta"] > 100.0 for optimum in found.optima)
    assert found.optima_chi_square[0] < 0.6 * found.optima_chi_square[1]


def test_least_squares_agrees_with_scipy_on_a_smooth_model():
    """`brody` on impacts that all slide is linear in mu (1 + COR) and COR: numpy's own solution."""
    table = load_table("wang_zero_spin.csv")
    problem = build_problem(table, replace(load_scene(table.source), mu=None), Choices(model="brody"))
    found = least_squares(problem, starts_of(problem))
    speed = table.impacts.v_y1
    design = np.stack([speed, speed * (speed - 10.0)], axis=1)
    line = np.linalg.lstsq(design, table.measurement("v_y2").values, rcond=None)[0]
    # v_y2 alone sees the restitution line, apart from the friction impulses of sliding balls.
    assert found.values["cor_10"] == pytest.approx(line[0], abs=0.01)
    assert found.values["cor_slope"] == pytest.approx(line[1], abs=0.002)


def test_every_missing_error_is_explained():
    problem = problem_of("wang_zero_spin.csv", fix={"eps_slope": 0.0})
    found = least_squares(problem, starts_of(problem))
    for name, error in found.stderr.items():
        assert (error is None) == (name in found.missing)
    assert "fixed on request" in found.missing["eps_slope"]
    # The best mass ratio of this table lies on the wall mass_ratio = COR.
    assert "COR" in found.missing["mass_ratio"]


def test_without_contact_time_k_y_has_no_error():
    scene = replace(load_scene("wang_zero_spin.csv"), contact_time=None)
    problem = build_problem(load_table("wang_zero_spin.csv"), scene, Choices())
    found = least_squares(problem, starts_of(problem))
    assert found.stderr["k_y"] is None
    assert "k_theta" in found.missing["k_y"]
    assert found.stderr["cor_10"] is not None


def test_maximum_posterior_is_a_maximum():
    problem = problem_of("wang_all.csv")
    point = maximum_posterior(problem, starts_of(problem))
    top = problem.to_coordinates(np.array([[point.values[name] for name in problem.free_names]]))[0]
    rng = np.random.default_rng(0)
    for reach in (1e-4, 1e-3, 1e-2):
        steps = top + reach * problem.prior.width * rng.standard_normal((300, problem.dimension))
        assert log_posterior(problem, steps).max() <= point.log_posterior + 2e-3
    assert point.values["v_x_sd"] == pytest.approx(0.49, abs=0.02)
    assert point.values["v_y_sd"] == pytest.approx(0.28, abs=0.02)


def test_likelihood_is_the_normal_density_written_out():
    from scipy.stats import norm

    problem = problem_of("wang_zero_spin.csv")
    values = np.array([[TWO_MASS[name] for name in problem.free_names]])
    rebound = problem.rebound(values)
    expected = 0.0
    for name, sd in (("v_x2", "velocity_sd"), ("v_y2", "velocity_sd"), ("omega_2", "spin_sd")):
        observed = problem.table.measurement(name).values
        expected += norm.logpdf(observed, getattr(rebound, name)[0], TWO_MASS[sd]).sum()
    assert log_likelihood(problem, values, rebound)[0] == pytest.approx(expected, rel=1e-12)
    time = norm.logpdf(rebound.contact_time.mean(), 5.0e-3, 0.5e-3)
    assert log_scene_density(problem, rebound)[0] == pytest.approx(time, rel=1e-12)
    total = log_posterior(problem, problem.to_coordinates(values))[0]
    prior = problem.prior.log_density(problem.to_coordinates(values))[0]
    assert total == pytest.approx(prior + expected + time, rel=1e-12)


def test_impossible_parameters_have_no_density():
    problem = problem_of("wang_zero_spin.csv")
    values = np.array([[(TWO_MASS | {"mass_ratio": 0.5})[name] for name in problem.free_names]])
    rebound = problem.rebound(values)
    assert Status.COR_EXCEEDS_MASS_RATIO in rebound.status
    assert log_posterior(problem, problem.to_coordinates(values))[0] == -np.inf


QUICK = Effort(seed=5, cores=2)


@pytest.fixture(scope="module")
def quick_fit():
    """`grip-slip` on seven impacts: seven parameters, a second."""
    return run(problem_of("wang_zero_spin.csv", model="grip-slip"), QUICK)


def test_a_fit_converges_and_says_so(quick_fit):
    assert quick_fit.status is RunStatus.CONVERGED
    assert quick_fit.diagnostics.min_ess_bulk >= 1000
    assert quick_fit.diagnostics.min_ess_tail >= 1000
    assert quick_fit.diagnostics.max_r_hat < 1.01
    assert "Sampling converged" in quick_fit.verdict


def test_log_posterior_stays_aligned_with_its_draws(quick_fit):
    posterior = quick_fit.posterior
    problem = quick_fit.problem
    flat = posterior.values.reshape(-1, problem.dimension)[::997]
    scores = posterior.log_posterior.reshape(-1)[::997]
    np.testing.assert_allclose(log_posterior(problem, problem.to_coordinates(flat)), scores, rtol=1e-10)


def test_posterior_agrees_with_importance_sampling(quick_fit):
    """Moments of the chain against self-normalised importance sampling from a wide Student proposal."""
    from scipy.stats import multivariate_t

    problem = quick_fit.problem
    draws = problem.to_coordinates(quick_fit.posterior.draws)
    centre, covariance = draws.mean(axis=0), np.cov(draws, rowvar=False)
    proposal = multivariate_t(centre, 1.5 * covariance, df=6, seed=np.random.default_rng(2))
    candidates = proposal.rvs(60000)
    weights = log_posterior(problem, candidates) - proposal.logpdf(candidates)
    weights = np.exp(weights - weights.max())
    weights /= weights.sum()
    assert 1.0 / np.sum(weights**2) > 5000
    means = weights @ candidates
    sds = np.sqrt(weights @ (candidates - means) ** 2)
    np.testing.assert_allclose((means - centre) / np.sqrt(np.diag(covariance)), 0.0, atol=0.12)
    np.testing.assert_allclose(np.sqrt(np.diag(covariance)) / sds, 1.0, atol=0.1)


def test_the_same_seed_gives_the_same_bytes_on_any_number_of_threads(quick_fit):
    again = run(quick_fit.problem, replace(QUICK, cores=1))
    assert again.posterior.values.tobytes() == quick_fit.posterior.values.tobytes()
    other = run(quick_fit.problem, replace(QUICK, seed=6, max_steps=100))
    assert other.posterior.values.tobytes() != quick_fit.posterior.values.tobytes()


def test_too_few_steps_are_not_called_converged():
    fit = run(problem_of("wang_zero_spin.csv", model="grip-slip"), Effort(max_steps=200))
    assert fit.status is RunStatus.NOT_CONVERGED
    assert "did NOT converge in 200 steps" in fit.verdict
    assert any("effective sample size" in item for item in fit.diagnostics.complaints)


class _StopAt:
    """A progress report that interrupts the run at a step, as Ctrl-C does."""

    def __init__(self, step):
        self.step = step

    def __call__(self, _stage, progress):
        if progress is not None and progress.step >= self.step:
            raise KeyboardInterrupt


# Warm-up, a first check and another at the last step.
SHORT = Settings(walkers=16, ensembles=2, max_steps=300, cores=1, seed=5, schedule=Schedule(100, 200, 1e6))


def sampled_bytes(fit, chain, resume=False, report=lambda _progress: None):
    """What a short run gives, and the bytes of its chain file."""
    optima = np.array([[optimum[name] for name in fit.problem.free_names] for optimum in fit.point.optima])
    problem = fit.problem
    found = sample(problem, problem.to_coordinates(optima), SHORT, chain, resume, report)
    return found.chains.tobytes(), found.log_posterior.tobytes(), found.acceptance, chain.path.read_bytes()


@pytest.fixture(scope="module")
def uninterrupted(tmp_path_factory, quick_fit):
    return sampled_bytes(quick_fit, ChainFile(tmp_path_factory.mktemp("whole") / "posterior.h5", "one"))


@pytest.mark.parametrize("step", [100, 200, 300])
def test_an_interrupted_run_resumes_to_the_same_bytes(tmp_path, quick_fit, uninterrupted, step):
    """At the end of the warm-up, at a check, and after the last step, when nothing is left to sample."""
    chain = ChainFile(tmp_path / "posterior.h5", "one")
    with pytest.raises(SamplingInterrupted):
        sampled_bytes(quick_fit, chain, report=partial(_StopAt(step), "sampling"))
    assert [len(item.chain) for item in read_chains(chain.path)[2]] == [step, step]
    assert sampled_bytes(quick_fit, chain, resume=True) == uninterrupted


def test_a_run_stopped_within_a_block_resumes_to_the_same_bytes(tmp_path, quick_fit, uninterrupted, monkeypatch):
    """As by Ctrl-C; also where ensembles of an older run had been stopped at different steps."""
    advance, chains = sampling.advance, {}
    for calls, steps in ((1, 37), (2, 137), (3, 237)):
        made = []

        def stopped(problem, ensembles, moves, step, stop, made=made, calls=calls):
            made.append(step)
            advance(problem, ensembles, moves, step - 63 if len(made) == calls else step, stop)
            if len(made) == calls:
                raise KeyboardInterrupt

        chain = ChainFile(tmp_path / f"{steps}.h5", "one")
        with monkeypatch.context() as patch:
            patch.setattr(sampling, "advance", stopped)
            with pytest.raises(SamplingInterrupted):
                sampled_bytes(quick_fit, chain)
        chains[steps] = read_chains(chain.path)[2]
        assert [len(item.chain) for item in chains[steps]] == [steps, steps]
        assert sampled_bytes(quick_fit, chain, resume=True) == uninterrupted
    problem = quick_fit.problem
    mixed = ChainFile(tmp_path / "mixed.h5", "one")
    mixed.write([chains[137][0], chains[37][1]], problem.free_names, [p.prior.log for p in problem.free])
    assert sampled_bytes(quick_fit, mixed, resume=True) == uninterrupted


def test_emcee_reads_the_chain(tmp_path, quick_fit):
    problem = quick_fit.problem
    chain = ChainFile(tmp_path / "posterior.h5", fingerprint(problem, QUICK))
    fit = run(problem, replace(QUICK, max_steps=200), chain)
    backend = emcee.backends.HDFBackend(str(chain.path), name="ensemble_0", read_only=True)
    assert backend.iteration == 200
    kept = problem.to_coordinates(fit.posterior.values[0].reshape(-1, problem.dimension))
    tail = backend.get_chain()[-fit.posterior.values.shape[1] :]
    np.testing.assert_allclose(tail.reshape(-1, problem.dimension), kept, rtol=1e-12)


def test_a_chain_of_another_problem_is_refused(tmp_path, quick_fit):
    from fitball.errors import ResultFolderError

    chain = ChainFile(tmp_path / "posterior.h5", fingerprint(quick_fit.problem, QUICK))
    run(quick_fit.problem, replace(QUICK, max_steps=100), chain)
    other = replace(QUICK, seed=9)
    assert fingerprint(quick_fit.problem, other) != chain.fingerprint
    with pytest.raises(ResultFolderError, match="another problem"):
        run(quick_fit.problem, other, ChainFile(chain.path, fingerprint(quick_fit.problem, other)), resume=True)


def synthetic(problem, values, seed, only=None):
    """The problem's table with rebounds made from known values (free,) and noise, optionally fewer columns."""
    rng = np.random.default_rng(seed)
    rebound = problem.rebound(values[None, :])
    columns = problem.all_values(values[None, :])
    measured = []
    for observable in problem.observables:
        if only is None or observable.name in only:
            noise = float(columns[observable.noise][0])
            made = observable.predict(rebound)[0] + noise * rng.standard_normal(len(problem.table))
            measured.append(Measurement(observable.name, made))
    return replace(problem.table, measurements=tuple(measured), redundant=())


def test_verdicts_of_wang_zero_spin():
    fit = run(problem_of("wang_zero_spin.csv"), Effort(seed=1, cores=2, max_steps=300))
    verdicts = {item.name: item.verdict for item in fit.estimates}
    for name in ("k_y", "k_theta"):
        assert (verdicts[name], fit.parameters[name].given) == (Verdict.GIVEN, (CONTACT_TIME,))
        assert "absolute value comes from the scene's contact time" in fit.parameters[name].reason
    for name in ("mu", "eps_10", "cor_10", "cor_slope"):
        assert verdicts[name] is Verdict.IDENTIFIED
    # The posterior of a contact time known to 10 % is known to 10 %: k_y cannot be sharper than twice that.
    k_y = fit.parameters["k_y"]
    assert k_y.sd / k_y.median > 0.15


def test_a_parameter_that_acts_nowhere_is_prior_dominated():
    problem = problem_of("wang_zero_spin.csv", model="grip-slip")
    truth = {
        "mu": 0.2, "e_x": 0.1, "offset": 2e-3, "cor_10": 0.76, "cor_slope": -0.013,
        "velocity_sd": 0.1, "spin_sd": 5.0,
    }  # fmt: skip
    values = np.array([truth[name] for name in problem.free_names])
    table = synthetic(problem, values, seed=9)
    steep = problem.rebound(values[None, :]).regime[0]
    sliding = np.flatnonzero(steep == 1)
    rows = sliding[: max(2, sliding.size)]
    table = replace(
        table,
        impacts=type(table.impacts)(*(getattr(table.impacts, k)[rows] for k in ("v_x1", "v_y1", "omega_1"))),
        measurements=tuple(Measurement(m.name, m.values[rows]) for m in table.measurements),
        ids=tuple(table.ids[k] for k in rows),
        labels={},
    )
    scene = replace(problem.scene, mu=(0.2, 0.05))
    fit = run(build_problem(table, scene, Choices(model="grip-slip")), Effort(seed=2, cores=2, max_steps=300))
    assert fit.parameters["e_x"].verdict in (Verdict.PRIOR_DOMINATED, Verdict.ONE_SIDED)
    assert fit.parameters["mu"].verdict is Verdict.IDENTIFIED


def coverage(problem, scale, replicates, effort, seed):
    """How often 90 % intervals hold the truth, for tables drawn from the priors; `scale` falsifies the noise.

    Of maximum and chain: what `run` makes of them besides has tests of its own.
    """
    rng = np.random.default_rng(seed)
    inside = total = 0
    while total < replicates * problem.dimension:
        values = np.array([item.prior.draw(rng, 1)[0] for item in problem.free])
        if problem.rebound(values[None, :]).status.any():
            continue
        table = synthetic(problem, values, int(rng.integers(2**31)))
        fixed = {item.name: item.fixed * scale for item in problem.parameters if item.fixed is not None}
        refitted = build_problem(table, problem.scene, Choices(model=problem.model.name, fix=fixed))
        top = maximum_posterior(refitted, starting_points(refitted, rng, 4)).values
        optimum = refitted.to_coordinates(np.array([[top[name] for name in refitted.free_names]]))
        sampled = sample(refitted, optimum, effort.settings(refitted), None, False, lambda _progress: None)
        draws = refitted.to_values(sampled.kept.reshape(-1, refitted.dimension))
        low, high = np.quantile(draws, (0.05, 0.95), axis=0)
        inside += np.count_nonzero((low <= values) & (values <= high))
        total += values.size
    return inside / total


def test_recovery_covers_and_a_wrong_sigma_does_not():
    """Eight synthetic tables from the priors of `grip-slip` with known noise; four with its sigma a quarter of it."""
    scene = replace(Scene(ball=load_scene("wang_all.csv").ball), velocity_sd=0.25, spin_sd=10.0)
    problem = build_problem(load_table("wang_all.csv"), scene, Choices(model="grip-slip"))
    effort = Effort(seed=3, cores=1, ensembles=2, max_steps=400)
    # 40 intervals of 90 %: 75 % is three standard deviations below.
    assert coverage(problem, 1.0, 8, effort, 11) > 0.75
    assert coverage(problem, 0.25, 4, effort, 11) < 0.65
