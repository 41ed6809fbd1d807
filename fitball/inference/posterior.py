"""The posterior density of one table under one model: pure functions of coordinates, batched over draws.

Coordinates are those in which the priors have their shape: the natural logarithm for log priors, the value in
SI for the others. Densities are with respect to coordinates.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from fitball.data.scene import Scene
from fitball.data.table import ImpactTable
from fitball.inference.channels import Channel
from fitball.inference.joint_prior import JointPrior
from fitball.inference.parallel import LARGE_BATCH, evaluate_in_parts
from fitball.inference.parameters import NOISE_SPECS, Parameter
from fitball.models.model import Model
from fitball.models.types import Rebound
from fitball.values import FloatArray, Impacts

LOG_TAU = float(np.log(2.0 * np.pi))


@dataclass(frozen=True)
class Problem:
    """A table, a model and priors: all that defines a posterior.

    `contact_time` is what the scene knows of the mean contact time of the table, (value, sd) [s], or None.
    `notes` are the sentences that tell what was left out or assumed, and why. `threads` share large batches.
    """

    table: ImpactTable
    scene: Scene
    model: Model
    parameters: tuple[Parameter, ...]
    channels: tuple[Channel, ...]
    impacts: Impacts
    contact_time: tuple[float, float] | None
    notes: tuple[str, ...]
    threads: int = 1

    @cached_property
    def free(self) -> tuple[Parameter, ...]:
        """Parameters the data may move, in order."""
        return tuple(item for item in self.parameters if item.free)

    @cached_property
    def free_names(self) -> tuple[str, ...]:
        """Their names."""
        return tuple(item.name for item in self.free)

    @cached_property
    def model_names(self) -> tuple[str, ...]:
        """Names of all parameters that the model itself takes."""
        return tuple(item.name for item in self.parameters if item.name not in NOISE_SPECS)

    @property
    def dimension(self) -> int:
        """Number of free parameters."""
        return len(self.free)

    @cached_property
    def prior(self) -> JointPrior:
        """The priors of all free parameters together."""
        return JointPrior(tuple(item.prior for item in self.free))

    def to_values(self, coordinates: FloatArray) -> FloatArray:
        """Values (draws, free) in SI of coordinates (draws, free)."""
        return self.prior.value(coordinates)

    def to_coordinates(self, values: FloatArray) -> FloatArray:
        """Inverse of `to_values`."""
        return self.prior.coordinate(values)

    def all_values(self, values: FloatArray) -> Mapping[str, FloatArray]:
        """Every parameter by name, free and fixed, as (draws,)."""
        columns = {name: values[:, k] for k, name in enumerate(self.free_names)}
        for item in self.parameters:
            if item.fixed is not None:
                columns[item.name] = np.full(values.shape[0], item.fixed)
        return columns

    def rebound(self, values: FloatArray, impacts: Impacts | None = None) -> Rebound:
        """Rebounds (draws, impacts) for free values (draws, free), of the table's impacts by default."""
        columns = self.all_values(values)
        rows = np.stack([columns[name] for name in self.model_names], axis=1)
        given = self.impacts if impacts is None else impacts
        if rows.shape[0] * len(given) <= LARGE_BATCH:
            return self.model.evaluate(self.model_names, rows, given)
        return evaluate_in_parts(self.model, self.model_names, rows, given, self.threads)

    def log_prior(self, coordinates: FloatArray) -> FloatArray:
        """Log prior density (draws,)."""
        return self.prior.log_density(coordinates)

    def log_knowledge(self, rebound: Rebound) -> FloatArray:
        """Log density (draws,) of what the scene knows of the mean contact time; zero where it knows nothing."""
        if self.contact_time is None:
            return np.zeros(rebound.contact_time.shape[0])
        value, sd = self.contact_time
        z: FloatArray = (rebound.contact_time.mean(axis=1) - value) / sd
        return -0.5 * (z * z + LOG_TAU) - math.log(sd)

    def log_likelihood_terms(self, values: FloatArray, rebound: Rebound) -> Mapping[str, FloatArray]:
        """Log density of each measurement, channel name -> (draws, impacts)."""
        columns = self.all_values(values)
        terms: dict[str, FloatArray] = {}
        for channel in self.channels:
            noise = columns[channel.noise][:, None] if channel.noise is not None else 0.0
            sd = channel.spread(noise, rebound)
            z = (channel.observed - channel.predict(rebound)) / sd
            terms[channel.name] = -0.5 * (z * z + LOG_TAU) - np.log(sd)
        return terms

    def log_likelihood(self, values: FloatArray, rebound: Rebound) -> FloatArray:
        """Log likelihood (draws,); NaN where the model cannot be evaluated."""
        total = np.zeros(values.shape[0])
        for term in self.log_likelihood_terms(values, rebound).values():
            total += term.sum(axis=1)
        return total

    def log_posterior(self, coordinates: FloatArray) -> FloatArray:
        """Log posterior density up to a constant, (draws,); -inf where it is zero or the model has no answer."""
        return self._log_density(coordinates, measured=True)

    def log_reference(self, coordinates: FloatArray) -> FloatArray:
        """Log density of all that is known before the table: prior, possibility, and the scene's contact time."""
        return self._log_density(coordinates, measured=False)

    def _log_density(self, coordinates: FloatArray, measured: bool) -> FloatArray:
        total = self.log_prior(coordinates)
        inside = np.flatnonzero(np.isfinite(total))
        if inside.size == 0:
            return total
        values = self.to_values(coordinates[inside])
        rebound = self.rebound(values)
        # A marked impact (see models.types.Status) has no density: the parameters are impossible there.
        possible = ~np.any(rebound.status, axis=1)
        density = self.log_knowledge(rebound)
        if measured:
            density = density + self.log_likelihood(values, rebound)
        total[inside] += np.where(possible, density, -np.inf)
        return total
