"""What a figure needs of a fit, whether it was just made or read back from its folder."""

from __future__ import annotations

from typing import Protocol

from fitball.errors import ResultFolderError
from fitball.inference.problem.parameters import Parameter
from fitball.inference.problem.problem import Problem
from fitball.inference.results.evidence import Identifiability
from fitball.inference.results.results import PointFit, Posterior, Predictive
from fitball.wording import option


class Sampled(Protocol):
    """What figures need of the sampler."""

    @property
    def steps(self) -> int:
        """Steps made."""

    @property
    def warm_up(self) -> int:
        """Steps before those used."""


class Drawable(Protocol):
    """A fit as figures see it; `inference.results.Fit` is such."""

    @property
    def problem(self) -> Problem:
        """Table, model, priors."""

    @property
    def point(self) -> PointFit:
        """The maximum of the posterior."""

    @property
    def predictive(self) -> Predictive | None:
        """Posterior predictions, None for a point fit."""

    @property
    def diagnostics(self) -> Sampled | None:
        """How the sampler did, None for a point fit."""

    @property
    def posterior(self) -> Posterior | None:
        """Draws, None for a point fit."""

    @property
    def identifiability(self) -> Identifiability:
        """The evidence on every parameter."""


def drawn(fit: Drawable) -> Posterior:
    """The draws of a fit. Raises ResultFolderError for a point fit."""
    if fit.posterior is None:
        raise ResultFolderError(f"this figure needs a posterior; run calibrate without {option('point_only')}")
    return fit.posterior


def parameter(fit: Drawable, name: str) -> Parameter:
    """The parameter called `name`."""
    return next(item for item in fit.problem.parameters if item.name == name)
