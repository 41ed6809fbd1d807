"""Shared fixtures: Wang's incident conditions and draws from the default priors."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from fitball.data.read import load_table
from fitball.inference.priors import parse_prior
from fitball.models.model import Model
from fitball.values import FloatArray, Impacts


@pytest.fixture(scope="session")
def wang_impacts() -> Impacts:
    """The 21 incident conditions of Wang's three tables."""
    return load_table("wang_all.csv").impacts


@pytest.fixture(scope="session")
def draw_priors() -> Callable[[Model, np.random.Generator, int], FloatArray]:
    """A function that draws (draws, parameters) from a model's default priors."""

    def draw(model: Model, rng: np.random.Generator, count: int) -> FloatArray:
        columns = [
            parse_prior(spec.name, spec.prior, spec.lower, spec.upper).draw(rng, count) for spec in model.parameters
        ]
        return np.stack(columns, axis=1)

    return draw
