"""The marginal likelihood of uncertain incident states against sampling those states themselves."""

from __future__ import annotations

import emcee
import numpy as np
import pandas as pd

from fitball.errors import FitError
from fitball.inference.likelihood.posterior import log_posterior
from fitball.inference.likelihood.regime_mixture import displaced, roots
from fitball.inference.problem.problem import Problem
from fitball.values import FloatArray


def compare(problem: Problem, steps: int, seed: int) -> pd.DataFrame:
    """Posterior of each free parameter both ways: `median`, `sd` marginal, `latent_median`, `latent_sd`.

    `shift` is the difference of the medians in units of the latent sd, `width` the ratio of the sds. The first half
    of `steps` is warm-up. Raises FitError for a problem without incident errors. Some minutes for seven impacts.
    """
    if problem.errors is None:
        raise FitError("this table states no error of the incident state: there is nothing to compare")
    rng = np.random.default_rng(seed)
    start = _start(problem, rng)
    marginal = _sampled(lambda at: log_posterior(problem, at), start, steps, rng)
    states = 0.3 * rng.standard_normal((start.shape[0], 3 * len(problem.impacts)))
    wide = np.concatenate([start, states], axis=1)
    # An ensemble needs twice as many walkers as it has dimensions.
    wide = np.concatenate([wide] * (1 + 2 * wide.shape[1] // wide.shape[0]))
    wide = wide + 1e-4 * rng.standard_normal(wide.shape) * np.abs(wide)
    latent = _sampled(lambda at: _log_latent(problem, at), wide, steps, rng)[:, : problem.dimension]
    one, other = problem.to_values(marginal), problem.to_values(latent)
    frame = pd.DataFrame(
        {
            "median": np.median(one, axis=0), "sd": one.std(axis=0),
            "latent_median": np.median(other, axis=0), "latent_sd": other.std(axis=0),
        },
        index=list(problem.free_names),
    )  # fmt: skip
    frame["shift"] = (frame["median"] - frame["latent_median"]) / frame["latent_sd"]
    frame["width"] = frame["sd"] / frame["latent_sd"]
    return frame


def _start(problem: Problem, rng: np.random.Generator) -> FloatArray:
    """The best draws of the priors, four a free parameter."""
    coordinates = problem.to_coordinates(problem.prior.draw(rng, 20_000))
    score = log_posterior(problem, coordinates[:2000])
    found: FloatArray = coordinates[:2000][np.argsort(-score)[: max(8, 4 * problem.dimension)]]
    return found


def _sampled(density: object, start: FloatArray, steps: int, rng: np.random.Generator) -> FloatArray:
    state = np.random.RandomState(rng.integers(2**31)).get_state()
    sampler = emcee.EnsembleSampler(
        start.shape[0], start.shape[1], density, vectorize=True,
        moves=[(emcee.moves.DEMove(), 0.7), (emcee.moves.StretchMove(), 0.3)],
    )  # fmt: skip
    sampler.run_mcmc(emcee.State(start, random_state=state), steps, skip_initial_state_check=True)
    chain: FloatArray = np.array(sampler.get_chain(discard=steps // 2, flat=True), dtype=np.float64)
    return chain


def _log_latent(problem: Problem, at: FloatArray) -> FloatArray:
    """Log density of parameters and of the incident states, these in principal axes and standard deviations."""
    assert problem.errors is not None
    count = len(problem.impacts)
    total = problem.prior.log_density(at[:, : problem.dimension])
    z = at[:, problem.dimension :].reshape(-1, count, 3)
    total = total - 0.5 * np.sum(z * z, axis=(1, 2))
    inside = np.flatnonzero(np.isfinite(total))
    values = problem.to_values(at[inside, : problem.dimension])
    columns = problem.all_values(values)
    root = roots(problem.errors.incident)
    states, possible = displaced(problem.impacts.states(), np.einsum("pij,dpj->dpi", root, z[inside]))
    rebound = problem.rebound_like(columns, states, np.arange(count))
    found = np.zeros(len(inside))
    for observable in problem.observables:
        sd = observable.sds(columns, rebound)
        gap = problem.deviation(columns, observable, rebound) / sd
        found += np.sum(-0.5 * gap * gap - np.log(sd), axis=1)
    total[inside] += np.where(np.all(possible & (rebound.status == 0), axis=1), found, -np.inf)
    return np.asarray(total)
