"""Derivatives along lines: exact for parabolas within a run, and never across its ends."""

from __future__ import annotations

import numpy as np
import pytest

from fitball.inference.problem.along import runs


@pytest.mark.parametrize("lengths", [(1,), (2,), (3,), (7,), (1, 1, 1), (2, 5), (4, 1, 2, 9), (6, 3)])
def test_a_parabola_of_each_run_is_exact(lengths: tuple[int, ...]) -> None:
    rng = np.random.default_rng(sum(lengths))
    kind = np.repeat(np.arange(len(lengths)), lengths)[None].repeat(3, axis=0)
    # Shorter runs determine lines, or a level.
    powers = np.stack([np.where(np.array(lengths) > least, 1.0, 0.0) for least in range(3)])
    coefficients = rng.normal(size=(3, 3, len(lengths), 2)) * powers[None, :, :, None]
    places = np.arange(kind.shape[1])
    asked: list[tuple[int, int]] = []

    def compute(lines: np.ndarray, there: np.ndarray) -> np.ndarray:
        asked.extend(zip(lines.tolist(), there.tolist(), strict=True))
        return whole[lines, there]

    whole = sum(coefficients[:, k][:, kind[0]] * (places**k)[None, :, None] for k in range(3))
    found = runs(kind).interpolated(compute)
    assert np.allclose(found, whole, rtol=0.0, atol=1e-12 * np.abs(whole).max())
    assert len(asked) == len(set(asked)) == 3 * sum(min(length, 3) for length in lengths)


def test_what_is_missing_in_one_run_is_missing_there_alone() -> None:
    kind = np.array([[4, 4, 4, 4, -1, -1, 7, 7]])
    found = runs(kind).interpolated(lambda lines, there: np.where(kind[lines, there] < 0, np.nan, 1.0 * there))
    assert np.array_equal(np.isnan(found), kind < 0)
    assert np.allclose(found[kind >= 0], np.flatnonzero(kind[0] >= 0), rtol=0.0, atol=1e-12)
