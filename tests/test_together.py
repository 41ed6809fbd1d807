"""Ensembles that step together: each walks as emcee alone would walk it."""

from __future__ import annotations

import threading
from types import SimpleNamespace

import emcee
import numpy as np
import pytest

from fitball.inference.sampling import ensemble as walking
from fitball.inference.sampling.ensemble import Ensemble, advance
from fitball.inference.sampling.level_coordinates import Straight
from fitball.inference.sampling.moves import INDEPENDENT, STRETCH, StudentProposal, production_moves

WALKERS, DIMENSION, STEPS = 14, 3, 60
PROBLEM = SimpleNamespace(dimension=DIMENSION)
PROPOSAL = StudentProposal(np.array([0.1, -0.2, 0.0]), np.array([[1.2, 0.0, 0.0], [0.3, 0.9, 0.0], [-0.2, 0.1, 1.1]]))


def curved(x):
    return -0.5 * np.sum(x**2, axis=1) - 2.0 * (x[:, 0] - x[:, 1] ** 2) ** 2


def by_emcee(seed, start):
    """An ensemble on its own, with nothing of ours but the proposal."""
    moves = [
        (emcee.moves.DEMove(), (1.0 - INDEPENDENT) * (1.0 - STRETCH)),
        (emcee.moves.StretchMove(), (1.0 - INDEPENDENT) * STRETCH),
        (emcee.moves.MHMove(PROPOSAL), INDEPENDENT),
    ]
    sampler = emcee.EnsembleSampler(WALKERS, DIMENSION, curved, vectorize=True, moves=moves)
    sampler.random_state = np.random.RandomState(np.random.MT19937(seed)).get_state()
    sampler.run_mcmc(start, STEPS)
    return sampler


def test_each_ensemble_walks_as_emcee_walks_it(monkeypatch):
    asked = []

    def density(_problem, x):
        asked.append(len(x))
        return curved(x)

    monkeypatch.setattr(walking, "log_posterior", density)
    seeds = np.random.SeedSequence(7).spawn(3)
    starts = np.random.default_rng(1).standard_normal((3, WALKERS, DIMENSION))
    ensembles = [Ensemble(WALKERS, DIMENSION, seed) for seed in seeds]
    for ensemble, start in zip(ensembles, starts, strict=True):
        ensemble.start(start)
    # In two pieces, as blocks are.
    for step in (25, STEPS):
        advance(PROBLEM, ensembles, production_moves(PROPOSAL, Straight()), step, threading.Event())
    for ensemble, seed, start in zip(ensembles, seeds, starts, strict=True):
        alone = by_emcee(seed, start)
        np.testing.assert_array_equal(ensemble.coordinates, alone.get_chain())
        np.testing.assert_array_equal(ensemble.log_posterior, alone.get_log_prob())
        np.testing.assert_array_equal(ensemble.accepted, alone.backend.accepted)
        np.testing.assert_array_equal(ensemble.stream.get_state()[1], alone.random_state[1])
    # The starts, and two batches a step at most: halves where any ensemble moves by halves.
    assert asked[0] == 3 * WALKERS
    assert len(asked) <= 1 + 2 * STEPS
    assert sum(asked) == 3 * WALKERS * (STEPS + 1)


def test_a_density_that_is_no_number_stops_the_walk(monkeypatch):
    monkeypatch.setattr(walking, "log_posterior", lambda _problem, x: np.where(x[:, 0] > 0.3, np.nan, curved(x)))
    ensemble = Ensemble(WALKERS, DIMENSION, np.random.SeedSequence(1))
    ensemble.start(np.random.default_rng(1).uniform(-1.0, 0.2, (WALKERS, DIMENSION)))
    with pytest.raises(ValueError, match="no number"):
        advance(PROBLEM, [ensemble], production_moves(PROPOSAL, Straight()), 20, threading.Event())


def test_a_stop_that_was_asked_for_ends_the_walk_between_steps(monkeypatch):
    stop = threading.Event()

    def density(_problem, x):
        stop.set()
        return curved(x)

    monkeypatch.setattr(walking, "log_posterior", density)
    ensemble = Ensemble(WALKERS, DIMENSION, np.random.SeedSequence(1))
    ensemble.start(np.random.default_rng(1).standard_normal((WALKERS, DIMENSION)))
    moves = production_moves(PROPOSAL, Straight())
    # The step that was under way, and with a stop already asked for none.
    for _ in range(2):
        advance(PROBLEM, [ensemble], moves, 20, stop)
        assert (ensemble.steps, len(ensemble.coordinates)) == (1, 1)
    np.testing.assert_array_equal(ensemble.state.coords, ensemble.coordinates[-1])
