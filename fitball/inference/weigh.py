"""The posterior of a table of many rows: proposals from a Student distribution about the mode, each weighed by its
density on all rows.

With rows a posterior becomes normal, and a density as dear as there are rows: walkers that feel their way cost a
hundred times what weighing costs. The weights are those of importance sampling, the tail of which Pareto's k tells
(Vehtari et al. 2024, JMLR 25, 72); draws follow from them by the independence sampler (Tierney 1994, Ann. Statist.
22, 1701), whose stationary distribution is the posterior itself: what is asked of chains can be asked of these.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

from fitball.inference.identifiability.fisher import DRAWN_ABOUT, about
from fitball.inference.likelihood.posterior import log_posterior
from fitball.inference.problem.problem import Problem
from fitball.inference.sampling.convergence import convergence
from fitball.inference.sampling.ensembles import ENSEMBLES, Progress, Sampled, Settings
from fitball.inference.sampling.importance import smoothed
from fitball.inference.sampling.importance_posterior import fitted_to
from fitball.inference.sampling.moves import StudentProposal
from fitball.values import FloatArray

# Rows beyond which a posterior is weighed: below, ensembles cost seconds, and find what no mode tells of.
WEIGHED = 3000
# Proposals of a trial, of each chain; trials, each from a distribution fitted to all before it.
TRIAL, TRIALS = 125, 10
# What a distribution must be worth to be drawn from: effective draws a draw, and the tail of its weights.
LEAST_WORTH, LEAST_K = 0.2, 0.7
# Proposals that each chain makes before it counts: of the first nobody has decided yet.
WARM_UP = 25
# Rounds until which chains have what was asked for, each made as long as the last says it takes.
ROUNDS = 6


@dataclass(frozen=True)
class Mixture:
    """Student distributions of equal shares."""

    parts: Sequence[StudentProposal]

    def draw(self, rng: np.random.Generator, count: int) -> FloatArray:
        """Coordinates (count, free)."""
        drawn = np.stack([part.draw(rng, count) for part in self.parts])
        return np.asarray(drawn[rng.integers(len(self.parts), size=count), np.arange(count)])

    def log_density(self, coordinates: FloatArray) -> FloatArray:
        """Log density (draws,) up to a constant that all mixtures share."""
        logs = [part.log_density(coordinates) - part.log_volume for part in self.parts]
        return np.asarray(logsumexp(logs, axis=0) - np.log(len(logs)))


@dataclass(frozen=True)
class Proposals:
    """Proposals (chains, proposals, free) in coordinates, their log posterior and the logs of their weights, each
    (chains, proposals).
    """

    coordinates: FloatArray
    score: FloatArray
    log_weights: FloatArray

    def joined(self, other: Proposals) -> Proposals:
        """These, and then the others."""
        return Proposals(
            *(
                np.concatenate([mine, others], axis=1)
                for mine, others in zip(*map(_columns, (self, other)), strict=True)
            )
        )

    @property
    def worth(self) -> float:
        """Effective draws a proposal."""
        weights = self.log_weights.ravel() - logsumexp(self.log_weights)
        return float(np.exp(-logsumexp(2.0 * weights)) / weights.size)

    @property
    def pareto_k(self) -> float:
        """How heavy the tail of the weights is."""
        return smoothed(self.log_weights.ravel(), 1.0)[1]


def _columns(made: Proposals) -> tuple[FloatArray, FloatArray, FloatArray]:
    return made.coordinates, made.score, made.log_weights


def weigh(
    problem: Problem, optima: FloatArray, settings: Settings, report: Callable[[Progress], None]
) -> tuple[Sampled | None, str]:
    """Draws of the posterior about its `optima` (optima, free), in coordinates, each chain an ensemble of one walker;
    in words what came of it. None where no Student distribution comes near the posterior.
    """
    streams = np.random.default_rng(np.random.SeedSequence(settings.seed, spawn_key=(11,))).spawn(ENSEMBLES)
    rows = f"{len(problem.impacts):,} rows"
    found = _near(problem, optima, streams)
    if isinstance(found, str):
        return None, f"weights of draws on all {rows} did not settle ({found}): sampled by ensembles of walkers"
    proposal, made = found
    target, sampled = settings.schedule.target_ess, None
    for _ in range(ROUNDS):
        sampled = _sampled(problem, made, settings)
        report(Progress(sampled.steps, sampled.steps, sampled.convergence))
        if sampled.converged or sampled.steps >= settings.max_steps:
            break
        share = min(max(sampled.convergence.min_ess / sampled.kept.shape[1], 0.1), ENSEMBLES)
        wanted = max(int(1.15 * target / share) + WARM_UP, int(1.2 * sampled.steps))
        more = min(wanted, settings.max_steps) - sampled.steps
        made = made.joined(_made(problem, proposal, streams, more))
    assert sampled is not None
    words = (
        f"the posterior was drawn by weights, not by walkers: each of {made.score.size:,} draws from a Student "
        f"distribution about the mode was weighed by its density on all {rows} (Pareto k of the weights "
        f"{made.pareto_k:.2f}, to be trusted below {LEAST_K:g})"
    )
    return sampled, words


def _near(
    problem: Problem, optima: FloatArray, streams: Sequence[np.random.Generator]
) -> tuple[Mixture, Proposals] | str:
    """A distribution near enough to the posterior, with proposals from it; else how far the last one was."""
    proposal = Mixture([about(problem, optimum) for optimum in optima[:DRAWN_ABOUT]])
    tried: list[tuple[Mixture, Proposals]] = []
    found = ""
    for _ in range(TRIALS):
        made = _made(problem, proposal, streams, TRIAL)
        found = "no draw of them is possible"
        if np.isfinite(made.score).any():
            k, worth = made.pareto_k, made.worth
            if worth >= LEAST_WORTH and k < LEAST_K:
                return proposal, made
            found = f"Pareto k {k:.2f}, {100.0 * worth:.2g} effective draws of 100"
        tried.append((proposal, made))
        following = _following(tried)
        if following is None:
            break
        proposal = following
    return found


def _following(tried: Sequence[tuple[Mixture, Proposals]]) -> Mixture | None:
    """The Student distribution fitted to all draws so far, weighed by the mixture of all that they were drawn from
    (Cornuet et al. 2012); None where they do not span the space.
    """
    free = tried[0][1].coordinates.shape[-1]
    draws = np.concatenate([made.coordinates.reshape(-1, free) for _, made in tried])
    score = np.concatenate([made.score.ravel() for _, made in tried])
    if not np.isfinite(score).any():
        return None
    ratios = score - logsumexp([one.log_density(draws) for one, _ in tried], axis=0)
    fitted = fitted_to(draws, ratios - logsumexp(ratios))
    return None if fitted is None else Mixture([fitted])


def _made(problem: Problem, proposal: Mixture, streams: Sequence[np.random.Generator], count: int) -> Proposals:
    """`count` proposals of each chain."""
    drawn = np.stack([proposal.draw(stream, count) for stream in streams])
    flat = drawn.reshape(-1, drawn.shape[-1])
    score = log_posterior(problem, flat)
    weights = score - proposal.log_density(flat)
    return Proposals(drawn, score.reshape(len(streams), count), weights.reshape(len(streams), count))


def _sampled(problem: Problem, made: Proposals, settings: Settings) -> Sampled:
    """Chains of the independence sampler over all proposals.

    Each draw's place in a stream of its own decides whether a chain moves there, so that chains made longer begin as
    they began.
    """
    chances = np.random.default_rng(np.random.SeedSequence(settings.seed, spawn_key=(12,))).spawn(ENSEMBLES)
    places = np.stack(
        [
            _walk(weights, np.log(one.uniform(size=len(weights))))
            for weights, one in zip(made.log_weights, chances, strict=True)
        ]
    )
    chains = np.take_along_axis(made.coordinates, places[..., None], axis=1)[:, :, None]
    scores = np.take_along_axis(made.score, places, axis=1)[:, :, None]
    mixing = convergence(problem.free_names, chains[:, WARM_UP:])
    plan = settings.schedule
    return Sampled(
        chains,
        scores,
        tuple(float(np.mean(row[1:] != row[:-1])) for row in places),
        steps=places.shape[1],
        warm_up=WARM_UP,
        first=WARM_UP,
        convergence=mixing,
        converged=mixing.meets(plan.target_ess, plan.target_r_hat),
        moved=np.zeros((ENSEMBLES, 1), dtype=bool),
        pareto_k=made.pareto_k,
    )


def _walk(log_weights: FloatArray, log_chances: FloatArray) -> NDArray[np.int64]:
    """At which of its proposals (proposals,) a chain is, step by step."""
    places: NDArray[np.int64] = np.empty(len(log_weights), dtype=np.int64)
    at = int(np.argmax(np.isfinite(log_weights)))
    for step, (weight, chance) in enumerate(zip(log_weights, log_chances, strict=True)):
        if chance < weight - log_weights[at]:
            at = step
        places[step] = at
    return places
