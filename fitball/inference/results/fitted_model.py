"""A calibrated model: all it takes to predict new impacts, in memory or read back from `fit.json`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from fitball.errors import ParameterError, suggestion
from fitball.inference.problem.noise import NoiseKind, noise_with
from fitball.inference.problem.pooling import NEW, Levels
from fitball.models.model import Model
from fitball.models.registry import model
from fitball.models.types import Rebound
from fitball.values import Ball, FloatArray, Impacts
from fitball.wording import spoken

# Draws of a posterior from which intervals of predictions are made. Of a normal quantity each end of a 95 % interval
# then has a standard error of 0.011 of its length (`sqrt(p (1 - p)/n)` over the density there), and 0.035 from 400.
PREDICTING = 4000


@dataclass(frozen=True)
class FittedModel:
    """A model with its point estimate and a thinned set of posterior draws.

    `names` are all parameters (noise included), `point` their values, (names,), `draws` (draws, names) in SI, empty
    (0, names) for a point fit. `tangential` is false for a drop test. `impacts` are those it was calibrated on,
    of a long table those that span it (see `calibrated_range.spanning_impacts`). `levels` are the parameters that
    differ between surfaces, balls or tables; without one, `at` gives the model at a level.
    """

    model_name: str
    options: Mapping[str, str]
    ball: Ball
    tangential: bool
    names: tuple[str, ...]
    point: FloatArray
    draws: FloatArray
    impacts: Impacts
    levels: tuple[Levels, ...] = ()

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

    @cached_property
    def labels(self) -> Mapping[str, tuple[str, ...]]:
        """The labels of each column over which a parameter differs."""
        return {item.column: item.labels for item in self.levels}

    def at(self, labels: Mapping[str, str], rng: np.random.Generator | None = None) -> FittedModel:
        """The model on the surfaces and with the balls of `labels` (column -> label): without levels, each parameter
        at its value there.

        The label `new` is one of which nothing was measured: in each draw of the posterior it has a place of its
        own among the levels, drawn with `rng`; the point estimate is the common value. Raises ParameterError for a
        column without a label, and for a label that was not fitted.
        """
        point = dict(zip(self.names, self.point[:, None], strict=True))
        draws = dict(zip(self.names, self.draws.T, strict=True))
        own_point, own_draws = dict(point), dict(draws)
        # Each parameter of an unknown level has a place of its own, as those of the fitted ones have.
        for item in self.levels:
            label = checked_label(item, labels)
            if label != NEW:
                own_point[item.parameter] = item.value(point, label)
                own_draws[item.parameter] = item.value(draws, label)
            elif len(self.draws):
                assert rng is not None
                own_draws[item.parameter] = item.away(draws, rng.standard_normal(len(self.draws)))
        return replace(
            self,
            point=np.concatenate([own_point[name] for name in self.names]),
            draws=np.stack([own_draws[name] for name in self.names], axis=1),
            levels=(),
        )


def checked_label(levels: Levels, labels: Mapping[str, str]) -> str:
    """The label of `labels` (column -> label) for a parameter. Raises ParameterError where there is none, or where
    it was not fitted.
    """
    column, label = levels.column, labels.get(levels.column)

    def asked(name: str) -> str:
        return spoken(f"--level {column}={name}", f"levels={{{column!r}: {name!r}}}")

    if label is None:
        raise ParameterError(
            f"{levels.parameter} differs between the levels of {column} ({', '.join(levels.labels)}), and none is "
            f"named: name one, such as {asked(levels.labels[0])}"
        )
    if label != NEW and label not in levels.labels:
        raise ParameterError(
            f"{column} '{label}' was not fitted: {suggestion(label, levels.labels)}. For one of which nothing was "
            f"measured use {asked(NEW)}, with wider intervals"
        )
    return label


def at_values(chosen: Model, parameters: Mapping[str, float]) -> FittedModel:
    """A model at parameters that no table was asked about: no draws, no impacts."""
    none = np.empty(0)
    return FittedModel(
        chosen.name, chosen.options, chosen.ball, True, tuple(parameters), np.array([*parameters.values()]),
        np.empty((0, len(parameters))), Impacts(none, none, none),
    )  # fmt: skip
