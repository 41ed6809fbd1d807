"""A truth drawn, the measurements of a table that it makes, and the posterior of one by a short chain."""

from __future__ import annotations

import numpy as np

from fitball.errors import FitError
from fitball.inference.prediction.posterior_predictive import with_noise
from fitball.inference.problem.problem import Problem
from fitball.inference.results.results import PointFit
from fitball.inference.sampling.ensembles import ENSEMBLES, Sampled, Schedule, Settings, default_walkers, sample
from fitball.inference.sampling.prior_draws import prior_draws
from fitball.models.types import Rebound
from fitball.values import FloatArray

# Ends of a 95 % interval from so many effective draws are right within a tenth of its width.
SCHEDULE = Schedule(warm_up=160, first_check=320, target_ess=400.0, target_r_hat=1.05)
# Some tables put the core's mass near the whole ball's, where mixing is slow: what is not done here did not converge.
MAX_STEPS = 2000


def drawn_truth(known: Problem, rng: np.random.Generator, who: str) -> FloatArray:
    """One draw (free,) of all that is known before the table. Raises FitError, naming `who`, where there is none."""
    drawn = prior_draws(known, rng, wanted=1, batch=400)
    if not len(drawn):
        raise FitError(f"{who}: no draw of the priors agrees with what the scene knows")
    truth: FloatArray = drawn[0]
    return truth


def simulated_columns(
    known: Problem, row: FloatArray, rng: np.random.Generator, rebound: Rebound | None = None
) -> dict[str, FloatArray]:
    """Measurements (impacts,) by column that true values (1, free) make, noise and gaps of the table included;
    `rebound` is what else makes them.
    """
    rebound, columns = known.rebound(row) if rebound is None else rebound, known.all_values(row)
    return {
        observable.name: observable.spread_out(
            with_noise(known.noise, observable, columns, rebound, rng)[2][0], len(known.impacts), np.nan
        )
        for observable in known.observables
    }


def short_chain(problem: Problem, point: PointFit, seed: int) -> Sampled:
    """Ensembles begun at the optima of a point fit, on one thread."""
    optima = np.array([[optimum[name] for name in problem.free_names] for optimum in point.optima])
    settings = Settings(default_walkers(problem.dimension), ENSEMBLES, MAX_STEPS, 1, seed, SCHEDULE)
    return sample(problem, problem.to_coordinates(optima), settings, None, False, lambda _progress: None)
