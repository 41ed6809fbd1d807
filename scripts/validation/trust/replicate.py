"""One simulated table, fitted: what the fit says of itself, and whether it is true."""

from __future__ import annotations

import zlib
from collections.abc import Mapping
from dataclasses import asdict, dataclass

import numpy as np

from fitball.errors import FitballError, FitError
from fitball.inference.adequacy.describe import adequacy
from fitball.inference.assemble import qualified
from fitball.inference.assumptions.look import look
from fitball.inference.identifiability.examine import examine, profile_all
from fitball.inference.point.point_fit import point_fit
from fitball.inference.prediction.posterior_predictive import regime_shares
from fitball.inference.problem.problem import Problem
from fitball.inference.results.adequacy import Adequacy
from fitball.inference.results.results import Posterior, Verdict, thinned
from fitball.inference.sampling.prior_draws import prior_draws
from fitball.inference.second_search import search_again
from fitball.version import __version__
from validation.shared.simulated import MAX_STEPS, SCHEDULE, short_chain
from validation.trust.foreign import FAULTS, foreign_problem
from validation.trust.pinned import pinned
from validation.trust.scenarios import SCENARIOS, Scenario

LEVELS = (0.025, 0.975)
# What is said of a table that is not read.
REFUSED = "refused"


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
    """One table: the answer (`REFUSED` where it is not read), the least probability of any of its checks, what is
    said of each parameter by name, and whether the chain converged. Without a fit `failed` says why, and the rest is
    empty.
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
    if scenario.fault is not None:
        return _described(scenario, seed, number)
    # The scenario counts too: with the same numbers in each, scenarios would be no independent draws.
    roots = np.random.SeedSequence(seed, spawn_key=(zlib.crc32(name.encode()), number)).spawn(3)
    values = scenario.truth(np.random.default_rng(roots[0]))
    problem = scenario.simulated(values, np.random.default_rng(roots[1]))
    truth = dict(zip(scenario.problem.free_names, values, strict=True))
    try:
        return _fitted(scenario, problem, truth, roots[2])
    except FitError as error:
        return Told("", float("nan"), {}, False, str(error))


def _described(scenario: Scenario, seed: int, number: int) -> Told:
    """The answer alone, as a point fit gives it; the same tables for each model."""
    fault, name = FAULTS[str(scenario.fault)], f"{scenario.fault} {scenario.size:g}"
    rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(zlib.crc32(name.encode()), number)))
    try:
        problem = foreign_problem(str(scenario.fault), scenario.size, scenario.model, rng)
    except FitballError:
        return Told(REFUSED, 0.0, {}, True)
    try:
        _squares, point = point_fit(problem, rng)
        looked = look(problem, point, None, rng) if fault.looked else None
        described = adequacy(problem, point, None, seed, looked)
    except FitError as error:
        return Told("", float("nan"), {}, False, str(error))
    return Told(str(described.answer), _least(described), {}, True)


def _least(described: Adequacy) -> float:
    checks = (*(check.p for check in described.checks), *(check.adjusted for check in described.noise))
    return min(checks, default=1.0)


def _fitted(scenario: Scenario, problem: Problem, truth: Mapping[str, float], root: np.random.SeedSequence) -> Told:
    """The road of `calibrate` with a shorter chain, up to verdicts."""
    rng = np.random.default_rng(root)
    seed = int(root.generate_state(1)[0])
    squares, point = point_fit(problem, rng)
    sampled = short_chain(problem, point, seed)
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
    ends = np.quantile(posterior.draws, LEVELS, axis=0).T.tolist()
    said = {
        name: Said(verdicts[name], low, high, truth[name] if scenario.knows(name) else None, pins.get(name))
        for name, (low, high) in zip(posterior.names, ends, strict=True)
    }
    return Told(str(described.answer), _least(described), said, sampled.converged)
