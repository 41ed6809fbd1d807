"""Simulation-based calibration of the calibration (Talts et al. 2018; Modrak et al. 2023).

A truth is drawn from everything a fit takes as known before the table, a table is simulated from it, and the table
is fitted. If the fits are right, the rank of the truth among posterior draws is uniform.

What is known before the table is the posterior's own reference density: the priors, truncated to parameters the
model can evaluate at every impact, times the scene's knowledge of the mean contact time. That knowledge is the same
in every replicate, as it is for a user, so it belongs to the prior here and is not simulated anew.

Beside the parameters the log likelihood is ranked: without a quantity that depends on the data, a sampler that
returned the prior would pass (Modrak et al. 2023).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from functools import cache
from typing import Protocol

import numpy as np

from fitball.data.read import load_table
from fitball.data.scene import load_scene
from fitball.data.table import Measurement
from fitball.errors import FitError
from fitball.inference.likelihood.posterior import log_likelihood
from fitball.inference.point.maximum_posterior import maximum_posterior
from fitball.inference.point.point_fit import STARTS, starting_points
from fitball.inference.problem.build import Choices, build_problem
from fitball.inference.problem.parameters import NOISE_SPECS
from fitball.inference.problem.problem import Problem
from fitball.inference.sampling.ensembles import ENSEMBLES, Sampled
from fitball.values import FloatArray
from fitball.version import __version__
from validation.shared.simulated import MAX_STEPS, SCHEDULE, drawn_truth, short_chain, simulated_columns

# Posterior draws among which a truth is ranked: 200 values have central intervals of exactly 50, 80 and 95 %.
RANKED = 199
LOG_LIKELIHOOD = "log_likelihood"


@dataclass(frozen=True)
class Ranked:
    """One replicate: the rank of each truth among RANKED draws, and how the sampler ended.

    `ranks` is empty, and `failed` says why, when there was no fit.
    """

    ranks: Mapping[str, int]
    converged: bool
    steps: int
    ess: float
    r_hat: float
    failed: str = ""


class Experiment(Protocol):
    """A way to draw a truth, simulate data, fit them and rank the truth."""

    @property
    def names(self) -> tuple[str, ...]:
        """What is ranked."""

    @property
    def settings(self) -> Mapping[str, object]:
        """All that the ranks depend on but the seed."""

    def replicate(self, seeds: np.random.SeedSequence) -> Ranked:
        """One replicate, which depends on `seeds` alone."""


def run_replicate(experiment: Experiment, seed: int, number: int) -> Ranked:
    """Replicate `number` of a run; all its random numbers have one root."""
    return experiment.replicate(np.random.SeedSequence(seed, spawn_key=(number,)))


def ranks_among(truth: FloatArray, draws: FloatArray) -> list[int]:
    """Rank of each truth (quantities,) among its draws (draws, quantities)."""
    return [int(below) for below in np.count_nonzero(draws < truth, axis=0)]


@cache
def _problem(table: str, model: str) -> Problem:
    return build_problem(load_table(table), load_scene(table), Choices(model=model))


@dataclass(frozen=True)
class BounceExperiment:
    """Fits of `model` to rebounds simulated at the incident conditions of `table`.

    With `wrong_sigma` the fit is told that the noise is known, and that many times what it is: a control that must
    fail.
    """

    table: str
    model: str
    wrong_sigma: float | None = None

    @property
    def problem(self) -> Problem:
        """The problem whose table is replaced by simulated ones."""
        return _problem(self.table, self.model)

    @property
    def names(self) -> tuple[str, ...]:
        """Free parameters of the fit, and the log likelihood."""
        free = self.problem.free_names
        kept = free if self.wrong_sigma is None else tuple(name for name in free if name not in NOISE_SPECS)
        return (*kept, LOG_LIKELIHOOD)

    @property
    def settings(self) -> Mapping[str, object]:
        """What the ranks depend on."""
        return {
            "version": __version__,
            "table": self.problem.table.digest,
            "model": self.model,
            "parameters": [
                [parameter.name, parameter.prior.text, parameter.fixed] for parameter in self.problem.parameters
            ],
            "contact_time": self.problem.contact_time,
            "wrong_sigma": self.wrong_sigma,
            "ranked": RANKED,
            "ensembles": ENSEMBLES,
            "max_steps": MAX_STEPS,
            **asdict(SCHEDULE),
        }

    def replicate(self, seeds: np.random.SeedSequence) -> Ranked:
        """See `Experiment`."""
        roots = seeds.spawn(4)
        values = self.truth(np.random.default_rng(roots[0]))
        problem = self.simulated(values, np.random.default_rng(roots[1]))
        try:
            # The real road to a posterior: starts, maxima, ensembles.
            starts = starting_points(problem, np.random.default_rng(roots[2]), STARTS)
            sampled = short_chain(problem, maximum_posterior(problem, starts), int(roots[3].generate_state(1)[0]))
        except FitError as error:
            return Ranked({}, False, 0, 0.0, float("nan"), str(error))
        return self._ranked(values, problem, sampled, np.random.default_rng(roots[3]))

    def truth(self, rng: np.random.Generator) -> FloatArray:
        """One draw (free,) of all that is known before the table. Raises FitError when there is none to be had."""
        return drawn_truth(self.problem, rng, f"model {self.model}")

    def simulated(self, values: FloatArray, rng: np.random.Generator) -> Problem:
        """The problem of a table simulated from true values (free,), with the gaps of the one there is."""
        known, count, row = self.problem, len(self.problem.impacts), values[None, :]
        made, columns = simulated_columns(known, row, rng), known.all_values(row)
        measured = tuple(
            Measurement(observable.name, made[observable.name], observable.everywhere(count).sd)
            for observable in known.observables
        )
        fix = {}
        if self.wrong_sigma is not None:
            fix = {name: self.wrong_sigma * float(columns[name][0]) for name in columns if name in NOISE_SPECS}
        table = replace(known.table, measurements=measured, redundant=())
        return build_problem(table, known.scene, Choices(model=self.model, fix=fix))

    def _ranked(self, values: FloatArray, problem: Problem, sampled: Sampled, rng: np.random.Generator) -> Ranked:
        kept = sampled.kept.reshape(-1, problem.dimension)
        draws = problem.to_values(kept[rng.choice(len(kept), RANKED, replace=False)])
        named = dict(zip(self.problem.free_names, values, strict=True))
        truth = np.array([[named[name] for name in problem.free_names]])
        together = np.concatenate([truth, draws])
        score = log_likelihood(problem, together, problem.rebound(together))
        quantities = np.column_stack([together, score])
        ranks = dict(zip(self.names, ranks_among(quantities[0], quantities[1:]), strict=True))
        convergence = sampled.convergence
        return Ranked(ranks, sampled.converged, sampled.steps, convergence.min_ess, convergence.max_r_hat)
