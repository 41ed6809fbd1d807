"""Posterior sampling with emcee: independent ensembles, run in blocks until they agree.

Ensembles warm up with moves that need no tuning; then an independence proposal fitted to the warm-up of all of them
is added and frozen (see `moves`), walkers that are stuck restart from draws of their ensemble (see `stragglers`).
Only the steps after that are used. Ensembles step together, so that densities come in large batches; every one has
its own random generator, so the result depends neither on the others nor on interruptions.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from fitball.errors import FitError
from fitball.inference.likelihood.posterior import log_posterior
from fitball.inference.problem.problem import Problem
from fitball.inference.results.results import TARGET_ESS, TARGET_R_HAT
from fitball.inference.sampling.chain_file import ChainFile
from fitball.inference.sampling.convergence import Convergence, convergence
from fitball.inference.sampling.ensemble import Ensemble, advance
from fitball.inference.sampling.level_coordinates import straight_coordinates
from fitball.inference.sampling.moves import Moves, StudentProposal, production_moves, warm_up_moves
from fitball.inference.sampling.stragglers import left_behind, relocation
from fitball.values import FloatArray

ENSEMBLES = 4
# Steps never used for inference, of which the second half teaches the proposal; on long runs the first quarter
# is dropped instead. Twice as many teach it no better.
WARM_UP = 160
# Steps after the warm-up of which most posteriors have a fit's effective sample size; that of a comparison takes
# fewer, but so many at least.
COUNTED, LEAST_COUNTED = 160, 80
BLOCK = 100
# Candidates for the start of one ensemble, and the power of the posterior they are resampled with: starts are
# spread wider than the posterior, as R-hat needs.
POOL = 3000
TEMPERING = 0.3
# Memory that the steps after the warm-up may take, of all ensembles [bytes], and steps that are stored whatever they
# take.
STORED_BYTES, LEAST_STORED = 100_000_000, 200


@dataclass(frozen=True)
class Schedule:
    """When to look and when to stop: steps of warm-up, of the first check, and what every parameter must have."""

    warm_up: int = WARM_UP
    first_check: int = WARM_UP + COUNTED
    target_ess: float = TARGET_ESS
    target_r_hat: float = TARGET_R_HAT

    @classmethod
    def for_ess(cls, ess: float) -> Schedule:
        """That for an effective sample size: a smaller one than a fit's takes fewer steps too."""
        counted = max(LEAST_COUNTED, round(COUNTED * min(1.0, ess / TARGET_ESS)))
        return cls(WARM_UP, WARM_UP + counted, ess)


@dataclass(frozen=True)
class Settings:
    """How to sample: numbers of walkers (per ensemble), of ensembles, of steps at most, of threads."""

    walkers: int
    ensembles: int
    max_steps: int
    cores: int
    seed: int
    schedule: Schedule = Schedule()


@dataclass(frozen=True)
class Progress:
    """What a user sees while sampling; `convergence` is None before the first check."""

    step: int
    next_check: int
    convergence: Convergence | None


@dataclass(frozen=True)
class Sampled:
    """Chains of all ensembles in coordinates, (ensembles, stored, walkers, free): of so many `steps` those that were
    stored, warm-up included. `first` is the place of the first one after the `warm_up` steps; `moved` are the walkers
    (ensembles, walkers) that went on from a draw of others after it. Where draws were weighted `pareto_k` measures
    the tail of their weights.
    """

    chains: FloatArray
    log_posterior: FloatArray
    acceptance: tuple[float, ...]
    steps: int
    warm_up: int
    first: int
    convergence: Convergence
    converged: bool
    moved: NDArray[np.bool_]
    pareto_k: float | None = None

    @property
    def kept(self) -> FloatArray:
        """Coordinates after warm-up."""
        return self.chains[:, self.first :]


class SamplingInterrupted(KeyboardInterrupt):
    """The user stopped the run; the chain so far is on disk when there is a chain file."""

    def __init__(self, step: int) -> None:
        self.step = step
        super().__init__(f"interrupted at step {step}")


def default_walkers(dimension: int) -> int:
    """Walkers of an ensemble by default: four for each parameter, an even number of at least 16."""
    return max(16, 4 * dimension)


def warm_up_length(steps: int, least: int = WARM_UP) -> int:
    """Steps to drop of a run of `steps`, where `least` teach the proposal."""
    return max(least, steps // 4) if 2 * steps >= 3 * least else steps // 2


def starting_positions(
    problem: Problem, optima: FloatArray, first: int, walkers: int, rng: np.random.Generator
) -> FloatArray:
    """Positions (walkers, free) drawn around the optima (optima, free), all in coordinates and inside the prior.

    Half of the candidates surround the optimum number `first`, half any of them, at distances from a hundredth of
    the prior's width to all of it; they are resampled by a power of their posterior density. Raises FitError when
    too few candidates are possible.
    """
    low, high = problem.prior.limits
    for attempt in range(10):
        centre = np.where(rng.uniform(size=POOL) < 0.5, first % len(optima), rng.integers(len(optima), size=POOL))
        reach = np.exp(rng.uniform(math.log(0.01), 0.0, size=(POOL, 1)) - attempt)
        pool = optima[centre] + problem.prior.width * reach * rng.standard_normal((POOL, problem.dimension))
        if attempt:
            # Where data leave a small part of the prior, or optima are at bounds: nearer, and turned back inside.
            pool = np.where(pool < low, 2.0 * low - pool, np.where(pool > high, 2.0 * high - pool, pool))
        density = log_posterior(problem, pool)
        if not np.any(np.isfinite(density)):
            continue
        weight = np.exp(TEMPERING * (density - density.max()))
        if np.count_nonzero(weight) >= 2 * walkers:
            return pool[rng.choice(POOL, walkers, replace=False, p=weight / weight.sum())]
    raise FitError("too few starting points of finite posterior density around the optima: widen the priors")


def sample(
    problem: Problem,
    optima: FloatArray,
    settings: Settings,
    chain_file: ChainFile | None,
    resume: bool,
    report: Callable[[Progress], None],
) -> Sampled:
    """Run the ensembles until `settings.schedule` is content, or for `settings.max_steps`.

    Checks fall on steps that depend on the chains alone, so a resumed run stops where an uninterrupted one does.
    Raises SamplingInterrupted on Ctrl-C, after writing the chain.
    """
    plan = settings.schedule
    roots = np.random.SeedSequence(settings.seed).spawn(2 * settings.ensembles + 1)
    ensembles = [Ensemble(settings.walkers, problem.dimension, roots[k]) for k in range(settings.ensembles)]
    checks: dict[int, int] = {}
    if resume and chain_file is not None:
        kept = chain_file.read(settings.ensembles, settings.walkers, problem.free_names)
        for ensemble, stored in zip(ensembles, kept, strict=True):
            ensemble.restore(stored, plan.warm_up)
            checks |= {} if stored.going is None else stored.going.checks
    for k, ensemble in enumerate(ensembles):
        if ensemble.state is None:
            rng = np.random.default_rng(roots[settings.ensembles + k])
            ensemble.start(starting_positions(problem, optima, k, settings.walkers, rng))
    check = min(plan.first_check, settings.max_steps)
    mixing: Convergence | None = None
    going = Run(problem, ensembles, settings, chain_file, report, checks)
    moves = warm_up_moves()
    going.advance_to(min(plan.warm_up, settings.max_steps), moves, check, mixing)
    moved = np.zeros((settings.ensembles, settings.walkers), dtype=bool)
    if settings.max_steps > plan.warm_up:
        moved, taught = _end_warm_up(ensembles, plan.warm_up, np.random.default_rng(roots[-1]))
        straight = straight_coordinates(problem, taught)
        proposal = StudentProposal.fit(straight.straighten(taught)[0])
        moves = production_moves(proposal, straight)
    while True:
        if check in checks and check < settings.max_steps:
            # It was looked at before some of its steps were dropped, and did not suffice.
            check = min(checks[check], settings.max_steps)
            continue
        going.advance_to(check, moves, check, mixing)
        chains = np.stack([ensemble.chain(check)[0] for ensemble in ensembles])
        warm_up = warm_up_length(check, plan.warm_up)
        first = int(np.searchsorted(ensembles[0].kept, warm_up, side="right"))
        mixing = convergence(problem.free_names, chains[:, first:])
        report(Progress(check, check, mixing))
        reached = mixing.meets(plan.target_ess, plan.target_r_hat)
        if reached or check >= settings.max_steps:
            break
        checks[check] = next_check(check, mixing, plan)
        check = min(checks[check], settings.max_steps)
    scores = np.stack([ensemble.chain(check)[1] for ensemble in ensembles])
    acceptance = tuple(ensemble.acceptance for ensemble in ensembles)
    return Sampled(chains, scores, acceptance, check, warm_up, first, mixing, reached, moved)


def _end_warm_up(
    ensembles: Sequence[Ensemble], steps: int, rng: np.random.Generator
) -> tuple[NDArray[np.bool_], FloatArray]:
    """Move stragglers to draws of their ensembles: which (ensembles, walkers), and what the others teach the proposal
    (draws, free).

    All of it follows from the `steps` of warm-up alone, so a run that was interrupted later and goes on finds the
    same; an ensemble that has gone on already is left as it is.
    """
    chains = np.stack([ensemble.chain(steps)[0][steps // 2 :] for ensemble in ensembles])
    scores = np.stack([ensemble.chain(steps)[1][steps // 2 :] for ensemble in ensembles])
    behind = left_behind(chains, scores)
    for k, ensemble in enumerate(ensembles):
        walkers, step, owner = relocation(behind[k], chains.shape[1], rng)
        if walkers.size and ensemble.steps == steps:
            ensemble.move(walkers, chains[k, step, owner], scores[k, step, owner])
    return behind, chains.transpose(0, 2, 1, 3)[~behind].reshape(-1, chains.shape[-1])


def next_check(step: int, mixing: Convergence, plan: Schedule) -> int:
    """The step at which the effective sample size should suffice, between 1.15 and 2 times the present one."""
    kept = step - warm_up_length(step, plan.warm_up)
    wanted = step + kept * (1.1 * plan.target_ess / max(mixing.min_ess, 1.0) - 1.0)
    bounded = min(max(wanted, 1.15 * step), 2.0 * step)
    return math.ceil(bounded / BLOCK) * BLOCK


@dataclass(frozen=True)
class Run:
    """The ensembles of a run on their way; `checks` are the steps checked so far with those that followed."""

    problem: Problem
    ensembles: Sequence[Ensemble]
    settings: Settings
    chain_file: ChainFile | None
    report: Callable[[Progress], None]
    checks: Mapping[int, int]

    @cached_property
    def most(self) -> int:
        """Steps after the warm-up that fit into what may be stored."""
        of_a_step = 8 * self.settings.ensembles * self.settings.walkers * (self.problem.dimension + 1)
        return max(LEAST_STORED, STORED_BYTES // of_a_step)

    @property
    def step(self) -> int:
        """Steps that every ensemble has made."""
        return min(ensemble.steps for ensemble in self.ensembles)

    def advance_to(self, goal: int, moves: Moves, check: int, mixing: Convergence | None) -> None:
        """Bring every ensemble to step `goal`, a block at a time; on Ctrl-C write what there is and stop."""
        stop = threading.Event()
        # Ctrl-C is heard by the main thread, which is not in the midst of a step then.
        with ThreadPoolExecutor(max_workers=1) as pool:
            try:
                while (step := self.step) < goal:
                    following = min(step - step % BLOCK + BLOCK, goal)
                    behind = [ensemble for ensemble in self.ensembles if ensemble.steps == step]
                    # Those that an interrupted run left further on are waited for.
                    following = min([following, *(other.steps for other in self.ensembles if other.steps > step)])
                    pool.submit(advance, self.problem, behind, moves, following, stop).result()
                    self.thin()
                    self.report(Progress(following, check, mixing))
            except KeyboardInterrupt:
                stop.set()
                pool.shutdown(wait=True)
                self.thin()
                self.write()
                raise SamplingInterrupted(self.step) from None
        self.write()

    def thin(self) -> None:
        """Drop what is more than may be stored."""
        for ensemble in self.ensembles:
            ensemble.thin(self.settings.schedule.warm_up, self.most)

    def write(self) -> None:
        """Write the chain file, where there is to be one."""
        if self.chain_file is not None:
            logs = [parameter.prior.log for parameter in self.problem.free]
            stored = [ensemble.stored(self.checks) for ensemble in self.ensembles]
            self.chain_file.write(stored, self.problem.free_names, logs)
