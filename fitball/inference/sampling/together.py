"""One step of several ensembles at once: each keeps its generator, its choice among the moves and its other half; the
densities of all their proposals are asked for in one batch.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

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
