"""Walkers left behind in a mode that holds nothing: found, moved before production, and only they."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from fitball.inference.sampling import ensemble as walking
from fitball.inference.sampling import ensembles as sampling
from fitball.inference.sampling import stragglers
from fitball.inference.sampling.chain_file import ChainFile
from fitball.inference.sampling.ensembles import SamplingInterrupted, Schedule, Settings, sample
from fitball.inference.sampling.stragglers import left_behind, left_behind_words

DIMENSION = 5
AWAY = np.full(DIMENSION, 40.0)
SETTINGS = Settings(20, 2, 300, 1, 3, Schedule(warm_up=200, first_check=300))


def normal_mode(x, centre, sd, log_mass):
    return log_mass - 0.5 * np.sum(((x - centre) / sd) ** 2, axis=1) - DIMENSION * np.log(sd)


class Density:
    """As much of a problem as the sampler sees: a standard normal mode and another one, far away."""

    dimension = DIMENSION
    pooling = ()
    free_names = tuple(f"x{k}" for k in range(DIMENSION))
    free = tuple(SimpleNamespace(prior=SimpleNamespace(log=False)) for _ in range(DIMENSION))

    def __init__(self, sd, log_mass):
        self.sd, self.log_mass = sd, log_mass

    def log_posterior(self, x):
        return np.logaddexp(normal_mode(x, 0.0, 1.0, 0.0), normal_mode(x, AWAY, self.sd, self.log_mass))


SPURIOUS = Density(sd=0.1, log_mass=-30.0)


@pytest.fixture(autouse=True)
def sampled_density(monkeypatch):
    """The sampler asks the density of what stands for the problem."""
    for module in (sampling, walking):
        monkeypatch.setattr(module, "log_posterior", Density.log_posterior)


@pytest.fixture
def planted(monkeypatch):
    """Start `planted.away` walkers of the first ensemble (or of all) in the far mode."""
    place = SimpleNamespace(away=(1, 0))

    def positions(problem, _optima, first, walkers, rng):
        found = rng.standard_normal((walkers, DIMENSION))
        away = place.away[first % len(place.away)]
        found[:away] = AWAY + problem.sd * found[:away]
        return found

    monkeypatch.setattr(sampling, "starting_positions", positions)
    return place


def run(problem, settings=SETTINGS, file=None, resume=False, report=lambda _progress: None):
    return sample(problem, np.zeros((1, DIMENSION)), settings, file, resume, report)


def far(found):
    return np.linalg.norm(found.kept, axis=-1) > 0.5 * np.linalg.norm(AWAY)


def test_a_walker_in_a_spurious_mode_is_moved_before_production(planted, monkeypatch):
    found = run(SPURIOUS)
    assert np.argwhere(found.moved).tolist() == [[0, 0]]
    assert found.warm_up == 200
    assert np.linalg.norm(found.chains[0, 199, 0] - AWAY) < 5.0
    assert not far(found).any()
    (words,) = left_behind_words(found.moved)
    assert words.startswith("1 of 40 walkers was")
    # Left where it is, it counts.
    monkeypatch.setattr(sampling, "left_behind", lambda chains, _scores: np.zeros(chains.shape[::2], dtype=bool))
    assert far(run(SPURIOUS)).any()


@pytest.mark.parametrize(("share", "sd", "away"), [(0.5, 8.0, 10), (0.25, 8.0, 5), (0.05, 0.1, 1)])
def test_a_posterior_of_two_modes_is_not_mended(planted, share, sd, away):
    """A wide mode lies lower by far and holds as much; a narrow one lies higher. Both stay as they are."""
    planted.away = (away,)
    found = run(Density(sd, np.log(share / (1.0 - share))))
    there = np.linalg.norm(found.chains[:, 199] - AWAY, axis=-1) < 0.5 * np.linalg.norm(AWAY)
    assert there.any()
    assert np.count_nonzero(found.moved) <= 0.2 * np.count_nonzero(there)


def test_walkers_that_mix_are_hardly_ever_taken_for_stragglers():
    """Autocorrelated normal walkers: none of tens of thousands, of any dimension."""
    rng = np.random.default_rng(5)
    taken = 0
    for dimension in (1, 4, 12):
        for _ in range(40):
            steps = np.empty((4, 200, 24, dimension))
            steps[:, 0] = rng.standard_normal((4, 24, dimension))
            for t in range(1, 200):
                steps[:, t] = 0.95 * steps[:, t - 1] + np.sqrt(1 - 0.95**2) * rng.standard_normal((4, 24, dimension))
            taken += np.count_nonzero(left_behind(steps, -0.5 * np.sum(steps**2, axis=-1)))
    assert taken <= 3  # of 11,520


def test_several_stragglers_do_not_hide_each_other():
    rng = np.random.default_rng(6)
    steps = rng.standard_normal((4, 100, 25, DIMENSION))
    scores = -0.5 * np.sum(steps**2, axis=-1)
    behind = np.zeros((4, 25), dtype=bool)
    behind[0, :5] = behind[2, 7] = True
    scores -= 25.0 * behind[:, None, :]
    np.testing.assert_array_equal(left_behind(steps, scores), behind)
    # A walker that has come back by the end is none, and one that has just been thrown out is none.
    scores[0, 60:, 0] += 25.0
    scores[1, -1, 3] -= 25.0
    behind[0, 0] = False
    np.testing.assert_array_equal(left_behind(steps, scores), behind)


@pytest.mark.parametrize("seen", [1.0, 0.2])
def test_a_wide_mode_with_few_walkers_holds_more_than_its_density_says(seen):
    """Four of a hundred walkers in a mode eight times as wide, which lies lower by 13: a twentieth of all there is.
    Even a fifth of it, all that was seen, is recognised as a part; as narrow as the other, it would be spurious.
    """
    rng = np.random.default_rng(8)
    wide = Density(8.0, np.log(0.05))
    steps = rng.standard_normal((4, 100, 25, DIMENSION))
    place = 8.0 * rng.standard_normal(DIMENSION)
    place *= 8.0 * np.sqrt(DIMENSION) / np.linalg.norm(place)
    steps[:, :, 0] = AWAY + (1.0 - seen) * place + 8.0 * seen * steps[:, :, 0]
    scores = wide.log_posterior(steps.reshape(-1, DIMENSION)).reshape(steps.shape[:-1])
    scores[:, -1, 0] = scores[:, :, 0].min()
    assert not left_behind(steps, scores).any()
    if seen == 1.0:
        steps[:, :, 0] = AWAY + (steps[:, :, 0] - AWAY) / 8.0
        assert left_behind(steps, scores)[:, 0].all()


def test_stragglers_teach_the_proposal_nothing(planted, monkeypatch):
    taught = []
    # Without a proposal the walkers go on as they did.
    silent = SimpleNamespace(fit=taught.append)
    monkeypatch.setattr(sampling, "StudentProposal", silent)
    run(SPURIOUS)
    (draws,) = taught
    assert np.linalg.norm(draws, axis=1).max() < 0.5 * np.linalg.norm(AWAY)
    assert len(draws) == 100 * 39


def test_a_degenerate_ensemble_has_no_stragglers():
    """Columns that never move, and walkers on one spot: no volume, and no error of linear algebra."""
    still = np.zeros((2, 50, 12, 3))
    assert not left_behind(still, np.zeros((2, 50, 12))).any()
    rng = np.random.default_rng(7)
    still[..., :2] = rng.standard_normal((2, 50, 12, 2))
    assert not left_behind(still, -0.5 * np.sum(still**2, axis=-1)).any()


class _StopAt:
    def __init__(self, step):
        self.step = step

    def __call__(self, progress):
        if progress.step >= self.step:
            raise KeyboardInterrupt


def test_with_a_straggler_a_run_resumes_to_the_same_chain(planted, tmp_path):
    settings = replace(SETTINGS, max_steps=400, schedule=replace(SETTINGS.schedule, target_ess=1e9))
    whole = run(SPURIOUS, settings)
    assert whole.moved.any() and whole.chains.shape[1] == 400
    for step in (100, 200, 300):
        file = ChainFile(tmp_path / f"{step}.h5", "same")
        with pytest.raises(SamplingInterrupted):
            run(SPURIOUS, settings, file, report=_StopAt(step))
    # Ensembles are interrupted where they are: one may have gone on when another has just ended its warm-up.
    mixed = ChainFile(tmp_path / "mixed.h5", "same")
    of = (settings.ensembles, settings.walkers, SPURIOUS.free_names)
    at_end, later = (ChainFile(tmp_path / f"{step}.h5", "same").read(*of) for step in (200, 300))
    mixed.write([later[0], at_end[1]], SPURIOUS.free_names, [False] * DIMENSION)
    swapped = ChainFile(tmp_path / "swapped.h5", "same")
    swapped.write([at_end[0], later[1]], SPURIOUS.free_names, [False] * DIMENSION)
    for name in ("100", "200", "300", "mixed", "swapped"):
        resumed = run(SPURIOUS, settings, ChainFile(tmp_path / f"{name}.h5", "same"), resume=True)
        np.testing.assert_array_equal(resumed.chains, whole.chains)
        np.testing.assert_array_equal(resumed.moved, whole.moved)


class Rounding(np.ndarray):
    """A matrix whose products round equal rows differently, as those of some processors do."""

    __array_priority__ = 1.0

    def __rmatmul__(self, other):
        product = other @ np.asarray(self)
        product[..., ::2, :] = np.nextafter(product[..., ::2, :], np.inf)
        return product


def test_a_walker_that_stood_still_has_not_moved_however_products_round(monkeypatch):
    rng = np.random.default_rng(1)
    chains, scores = rng.standard_normal((1, 200, 40, 3)), rng.standard_normal((1, 200, 40))
    chains[0, :, 7], scores[0, :, 7] = 0.1, -50.0
    plain = stragglers._axes
    monkeypatch.setattr(stragglers, "_axes", lambda draws: (plain(draws)[0].view(Rounding), plain(draws)[1]))
    assert np.argwhere(left_behind(chains, scores)).tolist() == [[0, 7]]
