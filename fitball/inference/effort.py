"""How much a fit may cost, and what it did cost: sampler settings, threads, seed; wall time by stage."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

from fitball.errors import ParameterError, check_whole
from fitball.inference.problem.problem import Problem
from fitball.inference.results.results import TARGET_ESS, Timing
from fitball.inference.sampling.ensembles import ENSEMBLES, Schedule, Settings, default_walkers

MAX_STEPS = 20_000
# Walkers of all ensembles together: a hundred steps of more would fill the memory before anything could be diagnosed.
MOST_WALKERS = 20_000


@dataclass(frozen=True)
class Effort:
    """How much to spend: `walkers` of each ensemble (None: four a parameter), steps at most, threads, seed;
    `ess` is the effective sample size that every parameter must have.
    """

    seed: int = 1
    point_only: bool = False
    walkers: int | None = None
    ensembles: int = ENSEMBLES
    max_steps: int = MAX_STEPS
    cores: int = 2
    ess: float = TARGET_ESS

    def settings(self, problem: Problem) -> Settings:
        """Sampler settings for a problem. Raises ParameterError for numbers that cannot work."""
        check_whole(
            seed=self.seed, walkers=self.walkers, ensembles=self.ensembles, max_steps=self.max_steps, cores=self.cores
        )
        walkers = default_walkers(problem.dimension) if self.walkers is None else self.walkers
        least = max(4, 2 * problem.dimension)
        if walkers < least or walkers % 2:
            raise ParameterError(
                f"walkers = {walkers}: an ensemble over {problem.dimension} free parameters needs an even number "
                f"of at least {least}"
            )
        if self.max_steps < 100:
            raise ParameterError(f"max_steps = {self.max_steps}: expected at least 100, to diagnose convergence")
        if self.cores < 1:
            raise ParameterError(f"cores = {self.cores}: expected at least 1")
        if self.ensembles < 2:
            raise ParameterError(f"ensembles = {self.ensembles}: expected at least 2, to compare them")
        if walkers * self.ensembles > MOST_WALKERS:
            raise ParameterError(
                f"walkers = {walkers} in each of {self.ensembles} ensembles: expected at most {MOST_WALKERS} in all"
            )
        return Settings(walkers, self.ensembles, self.max_steps, self.cores, self.seed, Schedule.for_ess(self.ess))


@dataclass
class Stopwatch:
    """Wall time by stage."""

    timings: list[Timing] = field(default_factory=list)

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Time what happens inside."""
        begun = time.perf_counter()
        yield
        self.timings.append(Timing(name, time.perf_counter() - begun))
