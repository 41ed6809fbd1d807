"""Kinds of noise: how deviations scatter in units of their scale. Whatever depends on the kind is asked of its class.

A new kind is a class here and a place among `KINDS`. It needs a parameter of its own, such as Student's degrees of
freedom, which identifies the noise of a fit that was read back.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Collection, Mapping

import numpy as np
from scipy.special import gammaln, ndtri, polygamma

from fitball.errors import ParameterError, suggestion
from fitball.models.specs import ParameterSpec
from fitball.values import FloatArray

# Noise parameters by name, (draws,) or numbers.
Sizes = Mapping[str, FloatArray] | Mapping[str, float]
LOG_TAU = math.log(2.0 * math.pi)
# Step of differences, in standard deviations: their errors, curvature and rounding, are some 1e-10 of a slope.
DIFFERENCE = 1e-5
# Draws that tell a quantile or an average.
REACH_DRAWS = 20_000


class NoiseKind(ABC):
    """A distribution of standardised deviations `z` (draws, impacts), for its own `parameters` among `sizes`."""

    name: str
    parameters: tuple[ParameterSpec, ...] = ()

    @abstractmethod
    def log_density(self, z: FloatArray, sizes: Sizes) -> FloatArray:
        """Log density of each deviation."""

    @abstractmethod
    def draw(self, rng: np.random.Generator, shape: tuple[int, ...], sizes: Sizes) -> FloatArray:
        """Deviations of a shape (draws, impacts)."""

    @abstractmethod
    def information(self, sizes: Sizes) -> FloatArray:
        """The information of one deviation on its centre (Fisher), () or (draws,); 1 is that of a normal one."""

    def scale_information(self, sizes: Sizes) -> FloatArray:  # noqa: ARG002
        """The information of one deviation on the logarithm of its scale (Fisher), () or (draws,); as of a normal
        one.
        """
        return np.asarray(2.0)

    def shape_information(self, sizes: Mapping[str, float]) -> FloatArray:
        """The information of one deviation on the logarithm of its scale and each of the kind's own `parameters`
        (Fisher), (1 + parameters, 1 + parameters); by draws, for kinds that do not know it exactly.
        """
        columns = {name: np.full(REACH_DRAWS, value) for name, value in sizes.items()}
        z = self.draw(np.random.default_rng(0), (REACH_DRAWS, 1), columns)

        def moved(step: float, name: str) -> FloatArray:
            own = {key: column + (step if key == name else 0.0) for key, column in columns.items()}
            scale = 0.0 if name else step
            return self.log_density(z * math.exp(-scale), own)[:, 0] - scale

        names = ("", *(spec.name for spec in self.parameters))
        slopes = [(moved(DIFFERENCE, name) - moved(-DIFFERENCE, name)) / (2.0 * DIFFERENCE) for name in names]
        return np.asarray(np.array(slopes) @ np.array(slopes).T / REACH_DRAWS)

    def reach(self, share: float, sizes: Mapping[str, float]) -> float:
        """The deviation within which lies `share` of all, by draws; for kinds that do not know it exactly."""
        columns = {name: np.full(REACH_DRAWS, value) for name, value in sizes.items()}
        return float(np.quantile(np.abs(self.draw(np.random.default_rng(0), (REACH_DRAWS, 1), columns)), share))

    def residual(self, z: FloatArray, sizes: Sizes) -> FloatArray:
        """A residual whose square is minus twice the log density but for a constant: what least squares minimise.

        This version is for densities that are highest at zero.
        """
        drop = self.log_density(np.zeros_like(z), sizes) - self.log_density(z, sizes)
        return np.asarray(np.copysign(np.sqrt(2.0 * drop), z))

    def residual_rate(self, z: FloatArray, sizes: Sizes) -> FloatArray:
        """Derivative of `residual` with respect to `z`: a difference, for kinds that do not know it exactly."""
        return (self.residual(z + DIFFERENCE, sizes) - self.residual(z - DIFFERENCE, sizes)) / (2.0 * DIFFERENCE)


class NormalNoise(NoiseKind):
    """The normal distribution, whose scale is its standard deviation."""

    name = "normal"

    def log_density(self, z: FloatArray, sizes: Sizes) -> FloatArray:  # noqa: ARG002
        """See `NoiseKind`."""
        return np.asarray(-0.5 * (z * z + LOG_TAU))

    def draw(self, rng: np.random.Generator, shape: tuple[int, ...], sizes: Sizes) -> FloatArray:  # noqa: ARG002
        """See `NoiseKind`."""
        return rng.standard_normal(shape)

    def information(self, sizes: Sizes) -> FloatArray:  # noqa: ARG002
        """See `NoiseKind`."""
        return np.ones(())

    def shape_information(self, sizes: Mapping[str, float]) -> FloatArray:  # noqa: ARG002
        """See `NoiseKind`."""
        return np.full((1, 1), 2.0)

    def reach(self, share: float, sizes: Mapping[str, float]) -> float:  # noqa: ARG002
        """See `NoiseKind`."""
        return float(ndtri(0.5 + 0.5 * share))

    def residual(self, z: FloatArray, sizes: Sizes) -> FloatArray:  # noqa: ARG002
        """See `NoiseKind`."""
        return z

    def residual_rate(self, z: FloatArray, sizes: Sizes) -> FloatArray:  # noqa: ARG002
        """See `NoiseKind`."""
        return np.ones_like(z)


class StudentNoise(NoiseKind):
    """Student's t: its scale is no standard deviation, and its degrees of freedom measure how heavy its tails are."""

    name = "student-t"
    # Beyond a hundred nobody can tell it from a normal distribution; below two it has no variance.
    parameters = (
        ParameterSpec(
            "degrees_of_freedom", "", 2.0, 100.0, "lognormal(8, 0.8)",
            "degrees of freedom, of the noise: few allow outliers", r"$\nu$",
            logarithmic=True,
        ),
    )  # fmt: skip

    def _freedom(self, sizes: Sizes) -> FloatArray:
        return np.asarray(sizes[self.parameters[0].name])

    def log_density(self, z: FloatArray, sizes: Sizes) -> FloatArray:
        """See `NoiseKind`."""
        nu = self._freedom(sizes)[..., None]
        constant = gammaln(0.5 * (nu + 1.0)) - gammaln(0.5 * nu) - 0.5 * np.log(math.pi * nu)
        return np.asarray(constant - 0.5 * (nu + 1.0) * np.log1p(z * z / nu))

    def draw(self, rng: np.random.Generator, shape: tuple[int, ...], sizes: Sizes) -> FloatArray:
        """See `NoiseKind`."""
        return rng.standard_t(np.broadcast_to(self._freedom(sizes)[..., None], shape))

    def information(self, sizes: Sizes) -> FloatArray:
        """See `NoiseKind`: (nu + 1)/(nu + 3) (Lange, Little and Taylor 1989)."""
        nu = self._freedom(sizes)
        return np.asarray((nu + 1.0) / (nu + 3.0))

    def scale_information(self, sizes: Sizes) -> FloatArray:
        """See `NoiseKind`: 2 nu/(nu + 3), of the same source."""
        nu = self._freedom(sizes)
        return np.asarray(2.0 * nu / (nu + 3.0))

    def shape_information(self, sizes: Mapping[str, float]) -> FloatArray:
        """See `NoiseKind`, of the same source."""
        nu = float(self._freedom(sizes))
        both = -2.0 / ((nu + 1.0) * (nu + 3.0))
        own = 0.25 * float(polygamma(1, 0.5 * nu) - polygamma(1, 0.5 * (nu + 1.0)))
        own -= (nu + 5.0) / (2.0 * nu * (nu + 1.0) * (nu + 3.0))
        return np.array([[float(self.scale_information(sizes)), both], [both, own]])

    def residual(self, z: FloatArray, sizes: Sizes) -> FloatArray:
        """See `NoiseKind`; without the difference of large densities."""
        nu = self._freedom(sizes)[..., None]
        return np.asarray(np.copysign(np.sqrt((nu + 1.0) * np.log1p(z * z / nu)), z))

    def residual_rate(self, z: FloatArray, sizes: Sizes) -> FloatArray:
        """See `NoiseKind`; at zero the limit of a ratio whose parts both vanish."""
        nu = self._freedom(sizes)[..., None]
        residual = self.residual(z, sizes)
        zero = residual == 0.0
        share = np.where(zero, np.sqrt(nu / (nu + 1.0)), z / np.where(zero, 1.0, residual))
        return np.asarray((nu + 1.0) * share / (nu + z * z))


NORMAL = NormalNoise()
KINDS: dict[str, NoiseKind] = {kind.name: kind for kind in (NORMAL, StudentNoise())}


def noise_kind(name: str) -> NoiseKind:
    """The kind called `name`. Raises ParameterError for one that there is not."""
    if name not in KINDS:
        raise ParameterError(f"unknown noise '{name}': {suggestion(name, tuple(KINDS))}")
    return KINDS[name]


def noise_with(names: Collection[str]) -> NoiseKind:
    """The kind of noise of a fit with parameters `names`."""
    own = (kind for kind in KINDS.values() if kind.parameters and kind.parameters[0].name in names)
    return next(own, NORMAL)
