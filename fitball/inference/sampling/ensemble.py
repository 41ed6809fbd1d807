"""One ensemble of walkers: an emcee sampler with its own random generator, and what is kept of its steps.

A chain of many parameters over many steps would fill memory and disk, and neighbouring steps of it say nearly the
same: beyond a number of steps every second is kept, then every fourth and so on. Which ones follows from the number
of steps alone, so an interrupted run that goes on keeps the same.
"""

from __future__ import annotations

import threading
from collections.abc import Mapping
from functools import partial

import emcee
import numpy as np
from numpy.typing import NDArray

from fitball.inference.likelihood.posterior import log_posterior
from fitball.inference.problem.problem import Problem
from fitball.inference.sampling.chain_file import EnsembleChain, Going
from fitball.inference.sampling.moves import Moves, warm_up_moves
from fitball.values import FloatArray


class Ensemble:
    """One emcee sampler with its own random generator, started around the optima or from a stored chain."""

    def __init__(self, problem: Problem, walkers: int, seeds: np.random.SeedSequence) -> None:
        self.problem = problem
        self.walkers = walkers
        self.sampler = self._make(warm_up_moves(), emcee.backends.Backend())
        # emcee draws from a RandomState; it is seeded from the same tree as every other generator here.
        legacy = np.random.RandomState(np.random.MT19937(seeds))
        self.sampler.random_state = legacy.get_state()
        self.state: emcee.State | None = None
        self.steps = 0
        # Of the steps made, those that are kept.
        self.kept: NDArray[np.int64] = np.empty(0, dtype=np.int64)
        self.stride = 1

    def _make(self, moves: Moves, backend: emcee.backends.Backend) -> emcee.EnsembleSampler:
        return emcee.EnsembleSampler(
            self.walkers,
            self.problem.dimension,
            partial(log_posterior, self.problem),
            vectorize=True,
            moves=moves,
            backend=backend,
        )

    def use(self, moves: Moves) -> None:
        """Go on with other moves, same chain, same random generator."""
        random_state = self.sampler.random_state
        self.sampler = self._make(moves, self.sampler.backend)
        self.sampler.random_state = random_state

    def start(self, positions: FloatArray) -> None:
        """Begin at positions (walkers, free)."""
        self.state = emcee.State(positions)

    def restore(self, stored: EnsembleChain, warm_up: int) -> None:
        """Go on from a stored chain."""
        backend = self.sampler.backend
        rows, walkers, dimension = stored.chain.shape
        backend.reset(walkers, dimension)
        backend.chain, backend.log_prob = stored.chain.copy(), stored.log_posterior.copy()
        backend.accepted, backend.iteration = stored.accepted.copy(), rows
        # Both keep it: emcee takes it from the state with the next step, which never comes where all have been made.
        backend.random_state = self.sampler.random_state = stored.random_state
        if not rows:
            return
        now = stored.now
        self.steps, self.stride = now.steps, now.stride
        self.kept = kept_steps(now.steps, warm_up, now.stride)
        self.state = emcee.State(now.coordinates, log_prob=now.log_posterior, random_state=stored.random_state)

    def move(self, walkers: NDArray[np.intp], positions: FloatArray, log_posterior: FloatArray) -> None:
        """Let `walkers` go on from other positions (walkers, free), whose density is known; no step of the chain."""
        self.state = emcee.State(self.state, copy=True)
        self.state.coords[walkers], self.state.log_prob[walkers] = positions, log_posterior

    def advance_to(self, step: int, stop: threading.Event) -> None:
        """Go on until `step` steps have been made, or until `stop` is set."""
        steps = step - self.steps
        if steps <= 0 or stop.is_set():
            return
        begun = self.steps
        for state in self.sampler.sample(self.state, iterations=steps, skip_initial_state_check=True):
            self.state = state
            self.steps += 1
            if stop.is_set():
                break
        self.kept = np.concatenate([self.kept, np.arange(begun, self.steps) + 1])

    def thin(self, warm_up: int, most: int) -> None:
        """Of the steps after `warm_up` keep every second, fourth, ... so that they are no more than `most`."""
        self.stride = stride_of(self.steps, warm_up, most)
        if self.stride == 1:
            return
        wanted = kept_steps(self.steps, warm_up, self.stride)
        rows = np.searchsorted(self.kept, wanted)
        backend = self.sampler.backend
        backend.chain, backend.log_prob = backend.chain[rows], backend.log_prob[rows]
        backend.iteration, self.kept = len(rows), wanted

    def chain(self, step: int) -> tuple[FloatArray, FloatArray]:
        """Coordinates (kept, walkers, free) and log posterior (kept, walkers) of the first `step` steps."""
        rows = int(np.searchsorted(self.kept, step, side="right"))
        return self.sampler.get_chain()[:rows], self.sampler.get_log_prob()[:rows]

    @property
    def acceptance(self) -> float:
        """Share of the proposals that were accepted."""
        return float(np.mean(self.sampler.backend.accepted / self.steps))

    def stored(self, checks: Mapping[int, int]) -> EnsembleChain:
        """What the chain file keeps; `checks` as in `Going`."""
        backend, state = self.sampler.backend, tuple(self.sampler.random_state)
        if not self.steps:
            # emcee has no chain to give before the first step.
            shape = (0, self.walkers, self.problem.dimension)
            return EnsembleChain(np.empty(shape), np.empty(shape[:2]), np.zeros(self.walkers), state)
        chain, log_posterior = backend.get_chain().copy(), backend.get_log_prob().copy()
        accepted = np.array(backend.accepted)
        going = None
        if self.stride > 1 and self.state is not None:
            going = Going(self.steps, self.stride, self.state.coords.copy(), self.state.log_prob.copy(), dict(checks))
        return EnsembleChain(chain, log_posterior, accepted, state, going)


def stride_of(steps: int, warm_up: int, most: int) -> int:
    """The power of two of which steps after `warm_up` are kept, of `steps` in all, lest they be more than `most`."""
    stride = 1
    while (steps - warm_up) // stride > most:
        stride *= 2
    return stride


def kept_steps(steps: int, warm_up: int, stride: int) -> NDArray[np.int64]:
    """The numbers, from 1, of the steps that are kept: all of the warm-up, and every `stride`-th after it."""
    every = np.arange(1, steps + 1)
    kept: NDArray[np.int64] = every[(every <= warm_up) | ((every - warm_up) % stride == 0)]
    return kept
