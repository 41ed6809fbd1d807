"""What a fit found, under the same names whether it was just made or lies in a folder."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property
from pathlib import Path

from fitball.data.balances import Balances
from fitball.data.table import ImpactTable
from fitball.inference.problem.problem import Problem
from fitball.inference.results import results
from fitball.inference.results.adequacy import Adequacy
from fitball.inference.results.assumptions import Assumptions
from fitball.inference.results.drop_test import DropTest
from fitball.inference.results.evidence import Identifiability
from fitball.inference.results.fitted_model import FittedModel
from fitball.inference.results.pace_rating import CourtPace
from fitball.report.saved.fit_file import FitFile
from fitball.report.saved.restore import restored
from fitball.report.saved.saved_fit import SavedFit, as_saved
from fitball.values import FloatArray, Impacts


class Found:
    """Numbers and verdicts; of a fit that was read back, files beside `fit.json` are read when asked for."""

    def __init__(self, found: results.Fit | SavedFit) -> None:
        self._made = found if isinstance(found, results.Fit) else None
        self._read = found if isinstance(found, SavedFit) else None

    @cached_property
    def result(self) -> results.Fit:
        """Everything as frozen values: what reports and figures are made from."""
        return self._made if self._made is not None else restored(self.saved)

    @property
    def saved(self) -> SavedFit:
        """The content of `fit.json`, as it is or would be written."""
        return self._read if self._read is not None else as_saved(self.result)

    @property
    def _known(self) -> results.Fit | FitFile:
        """What says the same under the same names, without a file being read."""
        return self._made if self._made is not None else self.saved.file

    @property
    def status(self) -> results.RunStatus:
        """How the run ended: converged, not converged, point only."""
        return self._known.status

    @property
    def verdict(self) -> str:
        """The outcome in a sentence or two."""
        return self._known.verdict

    @property
    def parameters(self) -> Mapping[str, results.Estimate]:
        """Estimates by parameter name."""
        return self._made.parameters if self._made is not None else self.saved.parameters

    @property
    def estimates(self) -> tuple[results.Estimate, ...]:
        """The same, in order."""
        return tuple(self.parameters.values())

    @property
    def derived(self) -> tuple[results.Estimate, ...]:
        """Estimates of what follows from several parameters: the ratio of the stiffnesses, and restitution
        and offset at a measured speed where 10 m/s was not measured.
        """
        return self.saved.derived if self._made is None else self._made.derived

    @property
    def notes(self) -> tuple[str, ...]:
        """What one should know: of the table's reading, assumptions, what was left out, what the search met."""
        made = self._made
        return self.saved.file.notes if made is None else (*made.problem.table.remarks, *made.notes)

    @property
    def seed(self) -> int:
        """The seed of all random numbers."""
        return self._known.seed

    @property
    def levels(self) -> tuple[results.LevelEstimate, ...]:
        """Parameters that differ between surfaces, balls or tables, level by level."""
        return self._known.levels

    @property
    def court_pace(self) -> CourtPace | None:
        """The court pace rating; None where the table cannot tell it."""
        return self._known.court_pace

    @property
    def drop_test(self) -> DropTest | None:
        """Restitution at the tested speed and the ITF's rebound; None for other tables."""
        return self._known.drop_test

    @property
    def adequacy(self) -> Adequacy | None:
        """Whether the model describes the table."""
        return self._known.adequacy

    @property
    def assumptions(self) -> Assumptions | None:
        """What rests on assumptions that the table cannot tell apart."""
        return self._known.assumptions

    @property
    def identifiability(self) -> Identifiability:
        """The evidence on every parameter: profiles, information, contraction."""
        return self._known.identifiability

    @property
    def fitted(self) -> FittedModel:
        """The model with its point estimate and a few hundred draws."""
        return self._made.fitted if self._made is not None else self.saved.fitted

    @property
    def golden(self) -> results.Golden:
        """Impacts with their rebounds, to check a port of the model with."""
        return self._made.golden if self._made is not None else self.saved.golden

    @property
    def impacts(self) -> Impacts:
        """The incident states that it was made from."""
        return self._made.problem.table.impacts if self._made is not None else self.saved.impacts

    @property
    def problem(self) -> Problem:
        """Table, scene, model, priors and noise: all that was asked."""
        return self.result.problem

    @property
    def table(self) -> ImpactTable:
        """The measurements."""
        return self.problem.table

    @property
    def posterior(self) -> results.Posterior | None:
        """All draws; None for a point fit."""
        return self.result.posterior

    @property
    def predictive(self) -> results.Predictive | None:
        """What the posterior predicts at the table's impacts; None for a point fit."""
        return self.result.predictive

    @property
    def point(self) -> results.PointFit:
        """The maximum of the posterior density."""
        return self.result.point

    @property
    def least_squares(self) -> results.LeastSquares:
        """The least-squares fit."""
        return self.result.least_squares

    @property
    def diagnostics(self) -> results.Diagnostics | None:
        """How the sampler did; None for a point fit."""
        return self.result.diagnostics

    @property
    def error_budget(self) -> results.ErrorBudget:
        """Numerical errors beside those of measurement and posterior."""
        return self.result.error_budget

    @property
    def covariance(self) -> FloatArray | None:
        """Of the free parameters in SI, (free, free); None for a point fit."""
        return self.result.covariance

    @property
    def correlation(self) -> FloatArray | None:
        """Of the free parameters, (free, free); None for a point fit."""
        return self.result.correlation

    @property
    def timings(self) -> tuple[results.Timing, ...]:
        """Wall time by stage; a folder does not keep it."""
        return self.result.timings

    @property
    def balances(self) -> Balances:
        """What the measurements say without a model (see `data.balances`)."""
        return self.result.balances

    @property
    def place(self) -> Path | None:
        """The `fit.json` it was read from; None for a fit just made."""
        return None if self._read is None else self._read.place
