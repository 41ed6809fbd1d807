"""All priors of a problem at once, as arrays: a sampler asks for their density at every step."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from fitball.inference.problem.priors import Prior
from fitball.models.kernels.dual import NumberArray
from fitball.values import FloatArray


@dataclass(frozen=True)
class JointPrior:
    """Independent `priors`, one per column."""

    priors: tuple[Prior, ...]

    @cached_property
    def _logs(self) -> list[int]:
        return [k for k, prior in enumerate(self.priors) if prior.log]

    @cached_property
    def limits(self) -> tuple[FloatArray, FloatArray]:
        """Lower and upper ends of the supports, each (priors,), in coordinates."""
        ends = np.array([prior.support for prior in self.priors])
        return ends[:, 0].copy(), ends[:, 1].copy()

    @cached_property
    def shape(self) -> tuple[FloatArray, FloatArray, float]:
        """Centre and precision of each column (precision 0 where it is flat), and the joint constant."""
        centre = np.array([prior.a for prior in self.priors])
        precision = np.array([1.0 / prior.b if prior.normal else 0.0 for prior in self.priors])
        return centre, precision, float(sum(prior.log_scale for prior in self.priors))

    @cached_property
    def width(self) -> FloatArray:
        """A length along each coordinate, (priors,)."""
        return np.array([prior.width for prior in self.priors])

    def value(self, coordinates: NumberArray) -> NumberArray:
        """Values (draws, priors) of coordinates (draws, priors)."""
        values = coordinates.copy()
        values[:, self._logs] = np.exp(coordinates[:, self._logs])
        return values

    def coordinate(self, values: FloatArray) -> FloatArray:
        """Inverse of `value`."""
        coordinates = values.copy()
        coordinates[:, self._logs] = np.log(values[:, self._logs])
        return coordinates

    def rates(self, values: FloatArray) -> FloatArray:
        """Derivatives (draws, priors) of values (draws, priors) with respect to their coordinates."""
        rates = np.ones(values.shape)
        rates[:, self._logs] = values[:, self._logs]
        return rates

    def draw(self, rng: np.random.Generator, size: int) -> FloatArray:
        """Values (size, priors)."""
        return np.stack([prior.draw(rng, size) for prior in self.priors], axis=1)

    def log_density(self, coordinates: FloatArray) -> FloatArray:
        """Log density (draws,) with respect to coordinates; -inf outside the bounds."""
        low, high = self.limits
        centre, precision, constant = self.shape
        z = (coordinates - centre) * precision
        density = -0.5 * np.einsum("ij,ij->i", z, z) - constant
        inside = np.all((coordinates >= low) & (coordinates <= high), axis=1)
        return np.where(inside, density, -np.inf)
