"""Proposals for the ensembles.

Differential evolution (ter Braak 2006; Nelson et al. 2014) and the stretch move (Goodman and Weare 2010) come from
emcee and need no tuning. Once the ensembles have warmed up, an independence proposal is added: a multivariate
Student distribution fitted to the warm-up and frozen, which jumps along curved, correlated edges in one step. Where
parameters are pooled all of them are then made in coordinates without a funnel (see `level_coordinates`).
emcee's snooker move is not used: in its releases up to 3.1.6 the Metropolis factor is too small by its square root,
and the posterior comes out too narrow (pull request 531 of its repository).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from fitball.inference.sampling.emcee_package import emcee
from fitball.inference.sampling.level_coordinates import Straight
from fitball.values import FloatArray

# Heavier tails than any posterior with normal or Student noise over a dozen measurements.
DEGREES_OF_FREEDOM = 8.0
WIDENING = 1.1
# Share of steps made with the independence proposal, and of the stretch move among the others.
INDEPENDENT = 0.6
STRETCH = 0.25

Moves = list[tuple[Any, float]]


@dataclass(frozen=True)
class StudentProposal:
    """A multivariate Student distribution: centre (free,), Cholesky factor of its scale (free, free)."""

    centre: FloatArray
    factor: FloatArray

    @staticmethod
    def fit(coordinates: FloatArray, weights: FloatArray | None = None) -> StudentProposal | None:
        """Fit to coordinates (draws, free) of equal `weights` or others; None when they do not span the space."""
        covariance = np.atleast_2d(np.cov(coordinates, rowvar=False, aweights=weights))
        scale = np.sqrt(np.diag(covariance))
        if not np.all(scale > 0.0) or np.linalg.cond(covariance / np.outer(scale, scale)) > 1e12:
            return None
        factor: FloatArray = np.linalg.cholesky(WIDENING * covariance).astype(np.float64)
        centre = coordinates.mean(axis=0) if weights is None else np.average(coordinates, axis=0, weights=weights)
        return StudentProposal(centre, factor)

    @property
    def log_volume(self) -> float:
        """What `log_density` lacks to be comparable between proposals."""
        return float(np.sum(np.log(np.diag(self.factor))))

    def draw(self, random: np.random.RandomState | np.random.Generator, count: int) -> FloatArray:
        """Coordinates (count, free)."""
        normal = random.standard_normal((count, self.centre.size))
        stretch = np.sqrt(random.chisquare(DEGREES_OF_FREEDOM, size=count) / DEGREES_OF_FREEDOM)
        return np.asarray(self.centre + (normal / stretch[:, None]) @ self.factor.T)

    @cached_property
    def _whitening(self) -> FloatArray:
        """What makes deviations (draws, free) standard ones."""
        return np.asarray(np.linalg.inv(self.factor).T)

    def log_density(self, coordinates: FloatArray) -> FloatArray:
        """Log density (draws,) up to a constant."""
        z = (coordinates - self.centre) @ self._whitening
        freedom = DEGREES_OF_FREEDOM
        density: FloatArray = -0.5 * (freedom + z.shape[1]) * np.log1p(np.einsum("ij,ij->i", z, z) / freedom)
        return density

    def __call__(self, coordinates: FloatArray, random: np.random.RandomState) -> tuple[FloatArray, FloatArray]:
        """Propose for every walker; returns proposals and the log of the Metropolis-Hastings factor."""
        proposed = self.draw(random, len(coordinates))
        return proposed, self.log_density(coordinates) - self.log_density(proposed)


def warm_up_moves() -> Moves:
    """Moves that need nothing but the ensemble itself."""
    return [(emcee.moves.DEMove(), 1.0 - STRETCH), (emcee.moves.StretchMove(), STRETCH)]


def production_moves(proposal: StudentProposal | None, straight: Straight) -> Moves:
    """The same with the independence proposal, where there is one, all made in `straight` coordinates."""
    moves = warm_up_moves()
    if proposal is not None:
        others = [(move, (1.0 - INDEPENDENT) * share) for move, share in moves]
        moves = [*others, (emcee.moves.MHMove(proposal), INDEPENDENT)]
    return [(_made_in(straight, move), share) for move, share in moves] if straight.levels else moves


def _made_in(straight: Straight, move: Any) -> Any:
    """A move of emcee, its proposal made in straight coordinates instead of those of the chain."""
    propose = move.get_proposal

    def get_proposal(walkers: FloatArray, *rest: Any) -> tuple[FloatArray, FloatArray]:
        # Red-blue moves are given the other walkers, in parts, before the random generator.
        *others, random = rest
        start, before = straight.straighten(walkers)
        others = [[straight.straighten(part)[0] for part in parts] for parts in others]
        proposed, factors = propose(start, *others, random)
        end = straight.bend(proposed)
        return end, factors + before - straight.straighten(end)[1]

    move.get_proposal = get_proposal
    return move
