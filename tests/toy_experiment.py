"""An experiment of simulation-based calibration whose posterior is known."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.stats import norm
from validation.harness import Study
from validation.ranks import RANKED, ranks_among


@dataclass(frozen=True)
class Toy:
    """Normal data of known sigma with a normal prior of the mean: the posterior is known, and drawn from exactly.

    `told` is the sigma the fit believes in, over the true one. `blind` forgets the data and returns the prior.
    """

    told: float = 1.0
    blind: bool = False
    fails_at: int = -1

    @property
    def study(self):
        return Study("ranks_toy", self.replicate, {"toy": self.told, "blind": self.blind}, "toy")

    def replicate(self, seed, number):
        if number == self.fails_at:
            raise KeyboardInterrupt
        rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(number,)))
        truth, sigma, count = rng.standard_normal(), 1.5, 6
        data = truth + sigma * rng.standard_normal(count)
        believed = self.told * sigma
        precision = 1.0 + count / believed**2
        draws = data.sum() / believed**2 / precision + rng.standard_normal(RANKED) / np.sqrt(precision)
        if self.blind:
            draws = rng.standard_normal(RANKED)
        means = np.append(truth, draws)
        score = norm.logpdf(data, means[:, None], believed).sum(axis=1)
        both = np.column_stack([means, score])
        ranks = ranks_among(both[0], both[1:])
        named = dict(zip(("mean", "log_likelihood"), ranks, strict=True))
        return [{"ranks": named, "converged": True, "steps": 1, "ess": float(RANKED), "r_hat": 1.0, "failed": ""}]
