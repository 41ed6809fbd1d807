"""A long run keeps some of its steps, within a bound; interrupted, it goes on to the same chain."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from fitball.errors import ResultFolderError
from fitball.inference.sampling import ensemble as walking
from fitball.inference.sampling import ensembles as sampling
from fitball.inference.sampling.chain_file import ChainFile, read_chains
from fitball.inference.sampling.ensemble import kept_steps, stride_of
from fitball.inference.sampling.ensembles import SamplingInterrupted, Schedule, Settings, sample

DIMENSION, WARM_UP, MOST = 3, 100, 40
PROBLEM = SimpleNamespace(
    dimension=DIMENSION, pooling=(), free_names=("a", "b", "c"),
    free=tuple(SimpleNamespace(prior=SimpleNamespace(log=False)) for _ in range(DIMENSION)),
)  # fmt: skip
# Every check but the last falls short.
SCHEDULE = Schedule(warm_up=WARM_UP, first_check=130, target_ess=1e9)


@pytest.fixture(autouse=True)
def normal(monkeypatch):
    """Walkers in a standard normal density; no more than `MOST` steps are stored after the warm-up."""
    for module in (sampling, walking):
        monkeypatch.setattr(module, "log_posterior", lambda _problem, x: -0.5 * np.sum(x**2, axis=1))
    monkeypatch.setattr(
        sampling, "starting_positions", lambda _problem, _optima, _first, walkers, rng: rng.normal(size=(walkers, 3))
    )
    monkeypatch.setattr(sampling, "STORED_BYTES", MOST * 8 * 2 * 12 * (DIMENSION + 1))
    monkeypatch.setattr(sampling, "LEAST_STORED", 1)
    # Checks fall where all digits of what was found put them: looked at again with fewer steps, elsewhere.
    monkeypatch.setattr(
        sampling, "next_check", lambda step, mixing, _plan: step + 20 + int(1e6 * mixing.min_ess) % 50
    )


def run(steps, file=None, resume=False, report=lambda _progress: None):
    return sample(PROBLEM, np.zeros((1, 3)), Settings(12, 2, steps, 1, 5, SCHEDULE), file, resume, report)


def stop_at(step):
    def report(progress):
        if progress.step >= step:
            raise KeyboardInterrupt

    return report


def test_what_is_stored_is_bounded_and_evenly_spaced(monkeypatch):
    short = run(600)
    monkeypatch.setattr(sampling, "LEAST_STORED", 10_000)
    whole = run(600)
    assert whole.chains.shape[1] == whole.steps == short.steps == 600
    assert short.chains.shape[1] == WARM_UP + 31
    np.testing.assert_array_equal(short.chains[:, :WARM_UP], whole.chains[:, :WARM_UP])
    np.testing.assert_array_equal(short.chains[:, WARM_UP:], whole.chains[:, WARM_UP + 15 :: 16])
    np.testing.assert_array_equal(short.log_posterior[:, WARM_UP:], whole.log_posterior[:, WARM_UP + 15 :: 16])
    assert short.acceptance == whole.acceptance
    # Of a long run the first quarter is dropped: steps to 150, of which 100 + 3 are stored.
    assert (short.warm_up, short.first, whole.first) == (150, WARM_UP + 3, 150)


@pytest.mark.parametrize("step", [100, 200, 300, 500])
def test_an_interrupted_run_goes_on_to_the_same_bytes(tmp_path, step):
    whole, went_on = ChainFile(tmp_path / "whole.h5", "one"), ChainFile(tmp_path / "parts.h5", "one")
    there = run(600, whole)
    with pytest.raises(SamplingInterrupted):
        run(600, went_on, report=stop_at(step))
    again = run(600, went_on, resume=True)
    np.testing.assert_array_equal(again.chains, there.chains)
    assert again.convergence == there.convergence
    assert whole.path.read_bytes() == went_on.path.read_bytes()


def test_more_steps_than_asked_for_at_first(tmp_path):
    """An end amid a block, at a step of which nothing is stored, and checks that the longer run would not make."""
    file, whole = ChainFile(tmp_path / "file.h5", "one"), ChainFile(tmp_path / "whole.h5", "one")
    run(433, file)
    *_, last = read_chains(file.path)[2]
    assert last.going is not None and (last.going.steps, last.going.stride) == (433, 16)
    assert not np.array_equal(last.going.coordinates, last.chain[-1])
    again, there = run(700, file, resume=True), run(700, whole)
    np.testing.assert_array_equal(again.chains, there.chains)
    assert again.convergence == there.convergence


def test_a_file_that_was_changed_is_refused(tmp_path):
    import h5py

    file = ChainFile(tmp_path / "file.h5", "one")
    run(300, file)
    with h5py.File(file.path, "r+") as opened:
        opened["ensemble_0/going/coordinates"][0, 0] += 1e-12
    with pytest.raises(ResultFolderError, match="damaged"):
        run(600, file, resume=True)


def test_strides_are_nested():
    for steps in (100, 141, 180, 181, 260, 261, 10_000):
        stride = stride_of(steps, 100, MOST)
        kept = kept_steps(steps, 100, stride)
        assert (kept > 100).sum() <= MOST
        assert stride == 1 or (kept > 100).sum() > MOST // 2 - 1
        assert set(kept) <= set(kept_steps(steps, 100, max(stride // 2, 1)))
