"""Effective draws a CPU second on Wang's 21 impacts: fitball, and samplers that users would take.

`python scripts/peers.py [PEER ...]` runs each in a process of its own, and prints a table. dynesty
is not among the pinned packages: `pip install dynesty`. Only ratios within one run carry over.
"""

import argparse
import json
import subprocess
import sys
import time
from collections.abc import Callable
from typing import NamedTuple

import emcee
import numpy as np
from benchmark import TIMED_STEPS, ScriptFit

import fitball
from fitball.base.environment import threads
from fitball.inference.density import log_likelihood, log_posterior, scene_density
from fitball.inference.effort import Effort
from fitball.inference.judgement.first_order import proposal
from fitball.inference.problem.build import problem_from_sources
from fitball.inference.problem.problem import Problem
from fitball.inference.sampling.convergence import Mixing
from fitball.inference.sampling.importance import effective_size
from fitball.inference.search.best_fit import best_fit

TABLE = "wang_all.csv"
# A usual run of emcee, of which the first quarter is dropped.
WALKERS = 32
STEPS = 6_000
LIVE_POINTS = 250


class Peer(NamedTuple):
    """Effective draws of a sampler, and the CPU seconds of its process."""

    draws: float
    seconds: float


def by_fitball() -> Peer:
    """A whole fit: search, draws, profiles, tests and model variants."""
    fit = fitball.calibrate(TABLE, cores=1, progress=False)
    sizes = fit.diagnostics
    assert sizes is not None
    return Peer(min(*sizes.ess_bulk.values(), *sizes.ess_tail.values()), time.process_time())


def _problem() -> Problem:
    """The problem of the table, as fitball fits it."""
    problem, _ = problem_from_sources([TABLE])
    return problem


def by_emcee() -> Peer:
    """Emcee's default move on the density of fitball, from its best fit, without a search of its
    own.
    """
    problem = _problem()
    rng = np.random.default_rng(1)
    point = best_fit(problem, Effort().stream("search"))
    begin = proposal(problem, problem.coordinates(point.optima[0])).draw(rng, WALKERS)

    def density(q: np.ndarray) -> np.ndarray:
        return log_posterior(problem, q)

    sampler = emcee.EnsembleSampler(WALKERS, len(problem.free), density, vectorize=True)
    np.random.seed(1)  # noqa: NPY002 - emcee draws from it
    sampler.run_mcmc(begin, STEPS, skip_initial_state_check=True)
    chains = sampler.get_chain(discard=STEPS // 4)[None]
    return Peer(Mixing(problem.free, chains).smallest_ess, time.process_time())


def by_dynesty() -> Peer:
    """Dynesty on the density of fitball; its effective draws are Kish's, as of weights."""
    import dynesty  # type: ignore[import-not-found]

    problem = _problem()
    priors = [parameter.prior for parameter in problem.prior.parameters]

    def coordinates(shares: np.ndarray) -> np.ndarray:
        pairs = zip(priors, shares, strict=True)
        return np.array([float(prior.coordinate_quantile(share)) for prior, share in pairs])

    def likelihood(q: np.ndarray) -> float:
        total, contact = log_likelihood(problem, q[None])
        value = float(total[0] + scene_density(problem, contact)[0])
        return value if np.isfinite(value) else -1e300

    sampler = dynesty.NestedSampler(
        likelihood,
        coordinates,
        len(priors),
        nlive=LIVE_POINTS,
        sample="rwalk",
        rstate=np.random.default_rng(1),
    )
    sampler.run_nested(print_progress=False)
    weights = sampler.results.logwt - sampler.results.logz[-1]
    return Peer(effective_size(weights - np.logaddexp.reduce(weights)), time.process_time())


def by_script() -> Peer:
    """A step of a script as users write it, with emcee and `solve_ivp`: one draw a walker."""
    fit = ScriptFit(TABLE)
    begin = fit.best() * (1.0 + 1e-3 * np.random.default_rng(1).standard_normal((WALKERS, 7)))
    begun = time.process_time()
    emcee.EnsembleSampler(WALKERS, 7, fit.log_density).run_mcmc(begin, TIMED_STEPS)
    # The walkers are evaluated once before the first step.
    return Peer(WALKERS, (time.process_time() - begun) / (TIMED_STEPS + 1))


PEERS: dict[str, Callable[[], Peer]] = {
    "fitball": by_fitball,
    "emcee": by_emcee,
    "dynesty": by_dynesty,
    "script": by_script,
}


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    # Without `choices`, to which argparse would hold a list that is the default.
    parser.add_argument("peers", nargs="*", default=[*PEERS], help=", ".join(PEERS))
    parser.add_argument("--here", action="store_true", help="measure the one peer in this process")
    arguments = parser.parse_args()
    if unknown := {*arguments.peers} - {*PEERS}:
        parser.error(f"no peer is {', '.join(sorted(unknown))}: choose from {', '.join(PEERS)}")
    if arguments.here:
        with threads(1):
            print(json.dumps(PEERS[arguments.peers[0]]()))
        return
    found = {}
    for name in arguments.peers:
        command = [sys.executable, __file__, "--here", name]
        answer = subprocess.run(command, stdout=subprocess.PIPE, text=True, check=True).stdout
        found[name] = Peer(*json.loads(answer.splitlines()[-1]))
    if {"script", "emcee"} <= {*found}:
        # As many effective draws a step as emcee has on the density of fitball.
        drawn, of_emcee = found["script"], found["emcee"].draws
        steps = 0.75 * STEPS
        found["script"] = Peer(of_emcee, drawn.seconds * steps / 0.75)
    for name, peer in found.items():
        rate = peer.draws / peer.seconds
        print(
            f"{name}: {peer.draws:.0f} effective draws, {peer.seconds:.1f} s, {rate:.3g} a second"
        )


if __name__ == "__main__":
    main()
