"""One simulated table, fitted: what the fit says of itself, and whether it is true."""

from __future__ import annotations

import zlib
from collections.abc import Mapping
from dataclasses import asdict, dataclass

import numpy as np

from fitball.errors import FitError
from fitball.inference.adequacy.describe import adequacy
from fitball.inference.identifiability.examine import examine, profile_all
from fitball.inference.point.point_fit import point_fit
from fitball.inference.prediction.posterior_predictive import regime_shares
from fitball.inference.problem.problem import Problem
from fitball.inference.qualify import qualified
from fitball.inference.results.adequacy import Adequacy
from fitball.inference.results.results import Posterior, Verdict, thinned
from fitball.inference.sampling.ensembles import ENSEMBLES, Schedule, Settings, default_walkers, sample
from fitball.inference.sampling.prior_draws import prior_draws
from fitball.inference.second_search import search_again
from fitball.studies.trust.pinned import pinned
from fitball.studies.trust.scenarios import SCENARIOS, Scenario
from fitball.values import FloatArray
from fitball.version import __version__

# Ends of a 95 % interval from so many effective draws are right within a tenth of its width.
SCHEDULE = Schedule(warm_up=160, first_check=320, target_ess=400.0, target_r_hat=1.05)
MAX_STEPS = 2000
LEVELS = (0.025, 0.975)


@dataclass(frozen=True)
class Said:
    """Of one parameter: the verdict, the ends of the 95 % interval, the truth (None where there is none), and whether
    the likelihood pins it (see `pinned`; None where that cannot be said).
    """

    verdict: Verdict
    low: float
    high: float
    truth: float | None
    pinned: bool | None = None

    @property
    def holds(self) -> bool | None:
        """Whether the interval holds the truth."""
        return None if self.truth is None else bool(self.low <= self.truth <= self.high)


@dataclass(frozen=True)
class Told:
    """One table: the answer, the least probability of any of its checks, what is said of each parameter by name, and
    whether the chain converged. Without a fit `failed` says why, and the rest is empty.
    """

    answer: str
    p: float
    parameters: Mapping[str, Said]
    converged: bool
    failed: str = ""


def settings_of(scenario: Scenario) -> Mapping[str, object]:
    """All that a replicate depends on but the seed."""
    known = scenario.problem
    return {
        "version": __version__,
        "scenario": scenario.name,
        "model": scenario.model,
        "words": scenario.words,
        "rows": len(known.impacts),
        "parameters": [[item.name, item.prior.text, item.fixed] for item in known.parameters],
        "max_steps": MAX_STEPS,
        **asdict(SCHEDULE),
    }


def replicate(name: str, seed: int, number: int) -> Told:
    """Replicate `number` of the scenario called `name`: a truth, its table, the fit of that, and what is said."""
    scenario = SCENARIOS[name]
    # The scenario counts too: with the same numbers in each, scenarios would be no independent draws.
    roots = np.random.SeedSequence(seed, spawn_key=(zlib.crc32(name.encode()), number)).spawn(3)
    values = scenario.truth(np.random.default_rng(roots[0]))
    problem = scenario.simulated(values, np.random.default_rng(roots[1]))
    truth = dict(zip(scenario.problem.free_names, values, strict=True))
    try:
        return _fitted(scenario, problem, truth, roots[2])
    except FitError as error:
        return Told("", float("nan"), {}, False, str(error))


def _fitted(scenario: Scenario, problem: Problem, truth: Mapping[str, float], root: np.random.SeedSequence) -> Told:
    """The road of `calibrate` with a shorter chain, up to verdicts."""
    rng = np.random.default_rng(root)
    seed = int(root.generate_state(1)[0])
    squares, point = point_fit(problem, rng)
    optima = np.array([[optimum[name] for name in problem.free_names] for optimum in point.optima])
    settings = Settings(default_walkers(problem.dimension), ENSEMBLES, MAX_STEPS, 1, seed, SCHEDULE)
    sampled = sample(problem, problem.to_coordinates(optima), settings, None, False, lambda _progress: None)
    shape = sampled.kept.shape
    posterior = Posterior(
        problem.free_names,
        problem.to_values(sampled.kept.reshape(-1, shape[-1])).reshape(shape),
        sampled.log_posterior[:, sampled.warm_up :],
        prior_draws(problem, rng),
    )
    squares, point, _said = search_again(problem, squares, point, sampled)
    profiled = profile_all(problem, point, [*point.optima, *squares.optima])
    described = adequacy(problem, point, posterior, seed)
    regimes = regime_shares(problem.rebound(thinned(posterior, 400)))
    correlation = np.atleast_2d(np.corrcoef(posterior.draws, rowvar=False))
    _evidence, judged = examine(problem, point, profiled, posterior, correlation, regimes)
    verdicts = {name: qualified(name, judged[name], described, None)[0] for name in problem.free_names}
    pins = pinned(problem, truth) if scenario.made else {}
    return _told(scenario, described, verdicts, posterior, truth, pins, sampled.converged)


def _told(
    scenario: Scenario,
    described: Adequacy,
    verdicts: Mapping[str, Verdict],
    posterior: Posterior,
    truth: Mapping[str, float],
    pins: Mapping[str, bool | None],
    converged: bool,
) -> Told:
    ends: FloatArray = np.quantile(posterior.draws, LEVELS, axis=0)
    said = {
        name: Said(
            verdicts[name],
            float(ends[0, k]),
            float(ends[1, k]),
            truth[name] if scenario.knows(name) else None,
            pins.get(name),
        )
        for k, name in enumerate(posterior.names)
    }
    least = min(
        (*(check.p for check in described.checks), *(check.adjusted for check in described.noise)), default=1.0
    )
    return Told(str(described.answer), least, said, converged)
