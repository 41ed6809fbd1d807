"""A calibrated model: all it takes to predict new impacts, in memory or read back from `fit.json`."""

from __future__ import annotations

import unicodedata
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from fitball.errors import ParameterError
from fitball.inference.problem.noise import NoiseKind, noise_with
from fitball.inference.problem.pooling import NEW, Levels
from fitball.models.model import Model
from fitball.models.registry import model
from fitball.models.types import Rebound
from fitball.values import Ball, FloatArray, Impacts
from fitball.visible import some
from fitball.wording import option, spoken

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

        The label `new` is one of which nothing was measured, unless a fitted one has that name. In each draw of the
        posterior it has a place of its own among the levels, drawn with `rng` (default: seeded with 1); the point
        estimate is the median of these draws. Raises ParameterError for a column without a label, for one over which
        no parameter differs, for a label that was not fitted, and for a new one of a point fit.
        """
        names = checked_labels(self, labels)
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
    refuse_unknown(fitted, labels)
    return {column: checked_label(fitted, column, labels.get(column)) for column in fitted.labels}


def refuse_unknown(fitted: FittedModel, columns: Collection[str]) -> None:
    """Raise ParameterError for a column over which no parameter differs."""
    for column in columns:
        if column not in fitted.labels:
            known = f" (columns: {', '.join(fitted.labels)})" if fitted.labels else ""
            raise ParameterError(
                f"{at_level(column, '...')}: no parameter of this fit differs between levels of {column}{known}: "
                "leave it out"
            )


def checked_label(fitted: FittedModel, column: str, label: str | None) -> str:
    """A label as it was fitted, whatever its case, blanks and accents, or `new`. Raises ParameterError for None, and
    for one that was not fitted.
    """
    known = fitted.labels[column]
    if label is None:
        names = [item.parameter for item in fitted.levels if item.column == column]
        raise ParameterError(
            f"{' and '.join(names)} {'differs' if len(names) == 1 else 'differ'} between the levels of {column} "
            f"({', '.join(known)}): name one, such as {at_level(column, known[0])}"
        )
    found = label if label in known else next((name for name in known if _plain(name) == _plain(label)), label)
    if found not in known and _plain(found) != NEW:
        raise ParameterError(
            f"{column} '{label}' was not fitted. Fitted: {some(known)}. For one of which nothing was measured use "
            f"{at_level(column, NEW)}; its intervals are wider"
        )
    if found not in known and not len(fitted.draws):
        raise ParameterError(
            f"{at_level(column, label)}: a {column} of which nothing was measured is predicted from the posterior, "
            f"and a point fit has none: fit again without {option('point_only')}"
        )
    return found if found in known else NEW


def _plain(label: str) -> str:
    """A label without case, accents and superfluous blanks."""
    apart = unicodedata.normalize("NFKD", label.casefold())
    return " ".join("".join(letter for letter in apart if not unicodedata.combining(letter)).split())


def at_level(column: str, label: str) -> str:
    """How a level is asked for."""
    return spoken(f"--level {column}={label}", f"levels={{{column!r}: {label!r}}}")


def at_values(chosen: Model, parameters: Mapping[str, float]) -> FittedModel:
    """A model at parameters that no table was asked about: no draws, no impacts."""
    none = np.empty(0)
    return FittedModel(
        chosen.name, chosen.options, chosen.ball, True, tuple(parameters), np.array([*parameters.values()]),
        np.empty((0, len(parameters))), Impacts(none, none, none),
    )  # fmt: skip
