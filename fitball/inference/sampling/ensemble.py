"""Ensembles of walkers, advanced together by one emcee sampler, and what is kept of their steps.

A chain of many parameters over many steps would fill memory and disk, and its neighbouring steps are nearly
equal: beyond a number of steps every second is kept, then every fourth and so on. Which ones follows from the number
of steps alone, so an interrupted run that goes on keeps the same.
"""

from __future__ import annotations

import threading
from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from fitball.inference.likelihood.posterior import log_posterior
from fitball.inference.problem.problem import Problem
from fitball.inference.sampling.chain_file import EnsembleChain, Going
from fitball.inference.sampling.emcee_package import emcee
from fitball.inference.sampling.moves import Moves
from fitball.values import FloatArray


class Proposal(NamedTuple):
    """Where the walkers numbered `walkers` of an ensemble may go (walkers, free), and the logs of the
    Metropolis-Hastings factors.
    """

    walkers: NDArray[np.intp]
    coordinates: FloatArray
    factors: FloatArray


class Together:
    """A move, as emcee calls it, of the walkers of several ensembles, which stand one after the other: each ensemble
    is moved by one of `moves` as emcee itself would, by random numbers of its own of `streams`, asked for in the same
    order.
    """

    def __init__(self, moves: Moves, streams: Sequence[np.random.RandomState]) -> None:
        self.moves = [move for move, _share in moves]
        shares = np.cumsum([share for _move, share in moves])
        self.chances = shares / shares[-1]
        self.streams = streams

    def propose(self, model: Any, state: emcee.State) -> tuple[emcee.State, NDArray[np.bool_]]:
        """One step of every ensemble: the state, changed, and which walkers accepted, (walkers,)."""
        size = len(state.coords) // len(self.streams)
        accepted = np.zeros(len(state.coords), dtype=bool)
        walks = [
            (k * size, stream, self._walk(state.coords[k * size : (k + 1) * size], stream))
            for k, stream in enumerate(self.streams)
        ]
        while True:
            parts = [(first, stream, made) for first, stream, walk in walks if (made := next(walk, None)) is not None]
            if not parts:
                return state, accepted
            walkers = np.concatenate([first + made.walkers for first, _stream, made in parts])
            proposed = np.concatenate([made.coordinates for _first, _stream, made in parts])
            factors = np.concatenate([made.factors for _first, _stream, made in parts])
            scores = model.log_prob_fn(proposed)
            if np.isnan(scores).any():
                raise ValueError("a log posterior is no number")
            chance = np.concatenate([stream.rand(made.walkers.size) for _first, stream, made in parts])
            won = np.log(chance) < factors + scores - state.log_prob[walkers]
            gone = walkers[won]
            state.coords[gone], state.log_prob[gone], accepted[gone] = proposed[won], scores[won], True

    def _walk(self, coordinates: FloatArray, stream: np.random.RandomState) -> Iterator[Proposal]:
        """The proposals of one ensemble's step in turn; between them its `coordinates` have changed."""
        move = self.moves[self.chances.searchsorted(stream.random_sample(), side="right")]
        if not isinstance(move, emcee.moves.RedBlueMove):
            yield Proposal(np.arange(len(coordinates)), *move.get_proposal(coordinates, stream))
            return
        move.setup(coordinates)
        colour = np.arange(len(coordinates)) % move.nsplits
        stream.shuffle(colour)
        for half in range(move.nsplits):
            others = [coordinates[colour == other] for other in range(move.nsplits) if other != half]
            walkers = np.flatnonzero(colour == half)
            yield Proposal(walkers, *move.get_proposal(coordinates[walkers], others, stream))


class _Sampler(emcee.EnsembleSampler):  # type: ignore[misc]
    """emcee's sampler without a generator of its own to be copied at every step: those of the ensembles are asked."""

    random_state = None


class Ensemble:
    """Walkers with their own random generator, started around the optima or from a stored chain."""

    def __init__(self, walkers: int, dimension: int, seeds: np.random.SeedSequence) -> None:
        self.walkers = walkers
        # emcee draws from a RandomState; it is seeded from the same tree as every other generator here.
        self.stream = np.random.RandomState(np.random.MT19937(seeds))
        self.state: emcee.State | None = None
        self.steps = 0
        # Of the steps made, those that are kept, with what is kept of them.
        self.kept: NDArray[np.int64] = np.empty(0, dtype=np.int64)
        self.stride = 1
        self.coordinates: FloatArray = np.empty((0, walkers, dimension))
        self.log_posterior: FloatArray = np.empty((0, walkers))
        self.accepted: FloatArray = np.zeros(walkers)

    def start(self, positions: FloatArray) -> None:
        """Begin at positions (walkers, free)."""
        self.state = emcee.State(positions)

    def restore(self, stored: EnsembleChain, warm_up: int) -> None:
        """Go on from a stored chain."""
        self.coordinates, self.log_posterior, self.accepted = stored.chain, stored.log_posterior, stored.accepted
        self.stream.set_state(stored.random_state)
        if not len(stored.chain):
            return
        now = stored.now
        self.steps, self.stride = now.steps, now.stride
        self.kept = kept_steps(now.steps, warm_up, now.stride)
        self.state = emcee.State(now.coordinates.copy(), log_prob=now.log_posterior.copy())

    def move(self, walkers: NDArray[np.intp], positions: FloatArray, log_posterior: FloatArray) -> None:
        """Let `walkers` go on from other positions (walkers, free), whose density is known; no step of the chain."""
        self.state = emcee.State(self.state, copy=True)
        self.state.coords[walkers], self.state.log_prob[walkers] = positions, log_posterior

    def append(self, coordinates: FloatArray, log_posterior: FloatArray, accepted: FloatArray) -> None:
        """Steps that were made: (steps, walkers, free), (steps, walkers), and how many each walker accepted."""
        self.coordinates = np.concatenate([self.coordinates, coordinates])
        self.log_posterior = np.concatenate([self.log_posterior, log_posterior])
        self.accepted = self.accepted + accepted
        self.kept = np.concatenate([self.kept, self.steps + 1 + np.arange(len(coordinates))])
        self.steps += len(coordinates)
        self.state = emcee.State(coordinates[-1].copy(), log_prob=log_posterior[-1].copy())

    def thin(self, warm_up: int, most: int) -> None:
        """Of the steps after `warm_up` keep every second, fourth, ... so that they are no more than `most`."""
        self.stride = stride_of(self.steps, warm_up, most)
        if self.stride == 1:
            return
        wanted = kept_steps(self.steps, warm_up, self.stride)
        rows = np.searchsorted(self.kept, wanted)
        self.coordinates, self.log_posterior, self.kept = self.coordinates[rows], self.log_posterior[rows], wanted

    def chain(self, step: int) -> tuple[FloatArray, FloatArray]:
        """Coordinates (kept, walkers, free) and log posterior (kept, walkers) of the first `step` steps."""
        rows = int(np.searchsorted(self.kept, step, side="right"))
        return self.coordinates[:rows], self.log_posterior[:rows]

    @property
    def acceptance(self) -> float:
        """Share of the proposals that were accepted."""
        return float(np.mean(self.accepted / self.steps))

    def stored(self, checks: Mapping[int, int]) -> EnsembleChain:
        """What the chain file keeps; `checks` as in `Going`."""
        going = None
        if self.stride > 1 and self.state is not None:
            going = Going(self.steps, self.stride, self.state.coords, self.state.log_prob, dict(checks))
        random_state = tuple(self.stream.get_state(legacy=True))
        return EnsembleChain(self.coordinates, self.log_posterior, self.accepted, random_state, going)


def advance(problem: Problem, ensembles: Sequence[Ensemble], moves: Moves, step: int, stop: threading.Event) -> None:
    """Let ensembles that have made as many steps as each other go on together until `step` steps have been made, or
    until `stop` is set.
    """
    steps, size = step - ensembles[0].steps, ensembles[0].walkers
    if steps <= 0 or stop.is_set():
        return
    together = Together(moves, [ensemble.stream for ensemble in ensembles])
    sampler = _Sampler(
        size * len(ensembles), problem.dimension, partial(log_posterior, problem), vectorize=True, moves=together
    )
    states = [ensemble.state for ensemble in ensembles if ensemble.state is not None]
    coordinates = np.concatenate([state.coords for state in states])
    known = None if states[0].log_prob is None else np.concatenate([state.log_prob for state in states])
    for _ in sampler.sample(
        emcee.State(coordinates, log_prob=known), iterations=steps, skip_initial_state_check=True
    ):
        if stop.is_set():
            break
    chain, scores, accepted = sampler.get_chain(), sampler.get_log_prob(), sampler.backend.accepted
    for k, ensemble in enumerate(ensembles):
        mine = slice(k * size, (k + 1) * size)
        ensemble.append(chain[:, mine], scores[:, mine], accepted[mine])


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
