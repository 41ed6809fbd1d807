"""A calibrated model: all it takes to predict new impacts, in memory or read back from `fit.json`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from fitball.inference.problem.noise import NoiseKind, noise_with
from fitball.models.model import Model
from fitball.models.registry import model
from fitball.models.types import Rebound
from fitball.values import Ball, FloatArray, Impacts

# Draws of a posterior from which intervals of predictions are made. Of a normal quantity each end of a 95 % interval
# then has a standard error of 0.011 of its length (`sqrt(p (1 - p)/n)` over the density there), and 0.035 from 400.
PREDICTING = 4000


@dataclass(frozen=True)
class FittedModel:
    """A model with its point estimate and a thinned set of posterior draws.

    `names` are all parameters (noise included), `point` their values, (names,), `draws` (draws, names) in SI, empty
    (0, names) for a point fit. `tangential` is false for a drop test. `impacts` are those it was calibrated on,
    of a long table those that span it (see `calibrated_range.spanning_impacts`).
    """

    model_name: str
    options: Mapping[str, str]
    ball: Ball
    tangential: bool
    names: tuple[str, ...]
    point: FloatArray
    draws: FloatArray
    impacts: Impacts

    @cached_property
    def model(self) -> Model:
        """The model, composed anew."""
        return model(self.model_name, ball=self.ball, tangential=self.tangential, **self.options)

    @cached_property
    def model_columns(self) -> list[int]:
        """Places, among `names`, of the parameters that the model itself takes."""
        return [k for k, name in enumerate(self.names) if name in self.model.specs]

    @cached_property
    def noise(self) -> NoiseKind:
        """The noise of the table it was calibrated on."""
        return noise_with(self.names)

    def rebound(self, impacts: Impacts, values: FloatArray | None = None) -> Rebound:
        """Rebounds (draws, impacts) at `values` (draws, names), by default at the point estimate (1, impacts)."""
        rows = self.point[None, :] if values is None else values
        kept = self.model_columns
        return self.model.evaluate([self.names[k] for k in kept], np.ascontiguousarray(rows[:, kept]), impacts)

    def with_draws(self, names: Sequence[str], draws: FloatArray) -> FittedModel:
        """The same model with other draws (draws, names) of its free parameters; the fixed ones keep their value."""
        columns = dict(zip(names, draws.T, strict=True))
        fixed = dict(zip(self.names, self.point, strict=True))
        rows = [columns[name] if name in columns else np.full(draws.shape[0], fixed[name]) for name in self.names]
        return replace(self, draws=np.stack(rows, axis=1))


def at_values(chosen: Model, parameters: Mapping[str, float]) -> FittedModel:
    """A model at parameters that no table was asked about: no draws, no impacts."""
    none = np.empty(0)
    return FittedModel(
        chosen.name, chosen.options, chosen.ball, True, tuple(parameters), np.array([*parameters.values()]),
        np.empty((0, len(parameters))), Impacts(none, none, none),
    )  # fmt: skip
