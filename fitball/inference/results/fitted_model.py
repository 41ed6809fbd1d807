"""A calibrated model: all it takes to predict new impacts, in memory or read back from `fit.json`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from fitball.errors import ParameterError
from fitball.inference.problem.level_names import at_level, checked_label, columns_of, labels_of
from fitball.inference.problem.noise import NoiseKind, noise_with
from fitball.inference.problem.pooling import Levels
from fitball.models.model import Model
from fitball.models.registry import model
from fitball.models.types import Rebound
from fitball.values import Ball, FloatArray, Impacts
from fitball.wording import option

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
        return labels_of(self.levels)

    def at(self, labels: Mapping[str, str], rng: np.random.Generator | None = None) -> FittedModel:
        """The model on the surfaces and with the balls of `labels` (column -> label): without levels, each parameter
        at its value there.

        The label `new` is one of which nothing was measured, unless a fitted one has that name. In each draw of the
        posterior it has a place of its own among the levels, drawn with `rng` (default: seeded with 1); the point
        estimate is the median of these draws. Raises ParameterError for a column without a label, for one over which
        no parameter differs, for a label that was not fitted, and for a new one of a point fit.
        """
        names = checked_labels(self, labels)
        for column, label in names.items():
            if label not in self.labels[column] and not len(self.draws):
                raise ParameterError(
                    f"{at_level(column, label)}: a {column} of which nothing was measured is predicted from the "
                    f"posterior, and a point fit has none: fit again without {option('point_only')}"
                )
        point = dict(zip(self.names, self.point[:, None], strict=True))
        draws = dict(zip(self.names, self.draws.T, strict=True))
        own_point, own_draws = dict(point), dict(draws)
        # Each parameter of an unknown level has a place of its own, as those of the fitted ones have. It is the same
        # whatever the labels of other columns are.
        generator = np.random.default_rng(1) if rng is None else rng
        chances = generator.random((len(self.levels), len(self.draws)))
        for item, chance in zip(self.levels, chances, strict=True):
            label = names[item.column]
            if label in item.labels:
                own_point[item.parameter] = item.value(point, label)
                own_draws[item.parameter] = item.value(draws, label)
            else:
                own_draws[item.parameter] = item.elsewhere(draws, chance)
                own_point[item.parameter] = np.atleast_1d(np.median(own_draws[item.parameter]))
        return replace(
            self,
            point=np.concatenate([own_point[name] for name in self.names]),
            draws=np.stack([own_draws[name] for name in self.names], axis=1),
            levels=(),
        )


def checked_labels(fitted: FittedModel, labels: Mapping[str, str]) -> dict[str, str]:
    """The labels of `labels` (column -> label) as they were fitted, one for each column over which a parameter
    differs, or `new`. Raises ParameterError as `FittedModel.at` does.
    """
    named = columns_of(fitted.levels, labels)
    return {column: checked_label(fitted.levels, column, named.get(column)) for column in fitted.labels}


def at_values(chosen: Model, parameters: Mapping[str, float]) -> FittedModel:
    """A model at parameters that no table was asked about: no draws, no impacts."""
    none = np.empty(0)
    return FittedModel(
        chosen.name, chosen.options, chosen.ball, True, tuple(parameters), np.array([*parameters.values()]),
        np.empty((0, len(parameters))), Impacts(none, none, none),
    )  # fmt: skip
