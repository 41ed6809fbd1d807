"""What a comparison found: frozen values and the differences between any two models. Beside them the parameter sets
that Jafri (2004) published, as predictions of Wang's impacts.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from fitball.data.published import SPINS, thesis_table
from fitball.data.table import ImpactTable
from fitball.inference.comparison.left_out import IMPACTS, LeaveOneOut, Missed
from fitball.inference.identifiability.profile_walk import free_searches
from fitball.inference.point.gauss_newton import descend
from fitball.inference.point.surface import surface_of
from fitball.inference.prediction.outputs import measured_outputs, output_errors, root_mean_square
from fitball.inference.problem.problem import Problem
from fitball.inference.results.assumptions import FEW, ElpdDifference, Quantity, elpd_difference
from fitball.inference.results.results import Fit, RunStatus, Verdict
from fitball.inference.thesis.published_cases import case_errors, set_name, wang_rows
from fitball.values import FloatArray

# Akaike's and the Bayesian information criterion, from the maximised likelihood without priors.

# A promised gain of log likelihood below which the maximum is found.
SETTLED = 1e-7


@dataclass(frozen=True)
class Criteria:
    """`log_likelihood` at its maximum; `parameters` free ones, noise included, whether or not the data determine
    them; `measurements` n of the criteria. `aicc` is None where n leaves it undefined.
    """

    log_likelihood: float
    parameters: int
    measurements: int

    @property
    def aicc(self) -> float | None:
        """-2 ln L + 2 k + 2 k (k + 1) / (n - k - 1) (Hurvich and Tsai 1989)."""
        k, n = self.parameters, self.measurements
        if n - k - 1 <= 0:
            return None
        return -2.0 * self.log_likelihood + 2.0 * k + 2.0 * k * (k + 1) / (n - k - 1)

    @property
    def bic(self) -> float:
        """-2 ln L + k ln n (Schwarz 1978)."""
        return -2.0 * self.log_likelihood + self.parameters * math.log(self.measurements)


def criteria(problem: Problem, starts: Sequence[Mapping[str, float]]) -> Criteria:
    """Maximise the likelihood from `starts` (values by name), noise included, within the bounds of the parameters.

    The scene's contact time is prior knowledge and does not enter.
    """
    objective = surface_of(replace(problem, contact_time=None), SETTLED)
    begun = objective.from_values(np.array([[start[name] for name in problem.free_names] for start in starts]))
    reached = descend(objective, free_searches(objective, begun))
    measurements = sum(observable.observed.size for observable in problem.observables)
    return Criteria(-float(reached.cost.min()), problem.dimension, measurements)


RESAMPLES = 4000


@dataclass(frozen=True)
class FixedPrediction:
    """A published parameter set: nothing is fitted. `errors` output -> (impacts,) in SI; `given_columns` are
    measured ones that it takes as input.
    """

    name: str
    source: str
    errors: Mapping[str, FloatArray]
    given_columns: tuple[str, ...]


TABLE_9 = (
    "Jafri (2004), Table 9 with Eq. (53) and Chapter V's damping and mean restitution; hand-tuned on these impacts"
)
APPENDIX_C = "Jafri (2004), Appendix C as printed; each impact's own measured restitution is its input"


def published_sets(table: ImpactTable) -> tuple[FixedPrediction, ...]:
    """Errors of the three cases of Table 9 and the seven sets of Appendix C; empty where the data are not Wang's."""
    rows = wang_rows(table)
    measured = measured_outputs(table)
    if rows is None or not {"v_x2", "v_y2", "omega_2"} <= measured.keys():
        return ()
    made = [
        FixedPrediction(f"Table 9, case {case}", TABLE_9, errors, ()) for case, errors in case_errors(table).items()
    ]
    printed = thesis_table("appendix_c")
    for case in sorted(printed["case"].unique()):
        mine = printed[printed["case"] == case]

        def column(name: str, mine: object = mine) -> FloatArray:
            parts = [mine[mine["spin"] == spin][name].to_numpy() for spin in SPINS]  # type: ignore[index]
            return np.concatenate(parts)[rows]

        predicted = {"v_x2": column("v_x2 [m/s]"), "omega_2": column("omega_2 [rad/s]")}
        predicted["theta_2"] = np.arctan2(measured["v_y2"], predicted["v_x2"])
        name = f"Appendix C, {set_name(mine.iloc[0].to_dict())}"
        made.append(FixedPrediction(name, APPENDIX_C, output_errors(measured, predicted), ("v_y2",)))
    return tuple(made)


@dataclass(frozen=True)
class ModelScore:
    """One model on one table: its fit, its leave-one-out densities, its errors on left-out impacts."""

    name: str
    fit: Fit
    given_columns: tuple[str, ...]
    loo: LeaveOneOut
    missed: tuple[Missed, ...]
    criteria: Criteria | None
    notes: tuple[str, ...]
    seconds: float

    @property
    def free(self) -> int:
        """Number of free parameters, noise included."""
        return self.fit.problem.dimension

    def out_of_sample(self, scheme: str = IMPACTS) -> dict[str, float]:
        """Root mean square error of each output over the impacts a scheme left out and that have it; empty where it
        left none.
        """
        for missed in self.missed:
            if missed.scheme == scheme:
                known = {name: column for name, column in missed.errors.items() if not np.isnan(column).all()}
                return {name: root_mean_square(column) for name, column in known.items()}
        return {}

    @property
    def in_sample(self) -> dict[str, float]:
        """Root mean square residual of each measured column at the maximum of the posterior."""
        return dict(self.fit.point.rms)

    @property
    def unidentified(self) -> dict[str, Verdict]:
        """Parameters that the data do not determine, bound on one side only, or determine conditionally."""
        open_ones = (Verdict.PRIOR_DOMINATED, Verdict.ONE_SIDED, Verdict.CONDITIONAL)
        return {estimate.name: estimate.verdict for estimate in self.fit.estimates if estimate.verdict in open_ones}


@dataclass(frozen=True)
class RmsDifference:
    """Difference of two root mean square errors of one output [SI], with the central 90 % of a paired bootstrap."""

    value: float
    q05: float
    q95: float


@dataclass(frozen=True)
class Comparison:
    """All models on one table, best first by elpd. `columns` are the measured columns that are scored; `stacking`
    weights by model; `status` of the run as a whole; `assumptions` each quantity by model, and over all of them
    together.
    """

    table: ImpactTable
    columns: tuple[str, ...]
    models: tuple[ModelScore, ...]
    published: tuple[FixedPrediction, ...]
    stacking: Mapping[str, float]
    status: RunStatus
    notes: tuple[str, ...]
    seed: int
    quick: bool
    seconds: float
    assumptions: Mapping[str, Quantity]

    @cached_property
    def by_name(self) -> Mapping[str, ModelScore]:
        """Scores by model name."""
        return {score.name: score for score in self.models}

    @property
    def meaningful(self) -> bool:
        """Whether the table has enough impacts for a leave-one-out score to mean something."""
        return len(self.table) >= FEW

    def elpd_difference(self, one: str, other: str) -> ElpdDifference:
        """Score of `one` minus that of `other`."""
        return elpd_difference(self.by_name[one].loo.elpd, self.by_name[other].loo.elpd)

    def rms_difference(self, one: str, other: str, output: str) -> RmsDifference | None:
        """Leave-one-out root mean square error of `one` minus that of `other`; None where either has none."""
        first, second = (self._errors(name, output) for name in (one, other))
        if first is None or second is None:
            return None
        both = ~np.isnan(first + second)
        first, second = first[both], second[both]
        if not first.size:
            return None
        drawn = np.random.default_rng(self.seed).integers(0, first.size, (RESAMPLES, first.size))
        resampled = np.sqrt(np.mean(first[drawn] ** 2, axis=1)) - np.sqrt(np.mean(second[drawn] ** 2, axis=1))
        low, high = np.quantile(resampled, (0.05, 0.95))
        return RmsDifference(root_mean_square(first) - root_mean_square(second), float(low), float(high))

    def _errors(self, name: str, output: str) -> FloatArray | None:
        """Leave-one-out errors in the table's order; None where there are none or some fold failed."""
        for missed in self.by_name[name].missed:
            if missed.scheme == IMPACTS and output in missed.errors and missed.rows.size == len(self.table):
                return missed.errors[output][np.argsort(missed.rows)]
        return None

    @property
    def simplest(self) -> ModelScore:
        """Of the models that the best one does not surely beat, that with the fewest free parameters."""
        best = self.models[0].name
        close = [score for score in self.models if not self.elpd_difference(best, score.name).sure]
        return min(close, key=lambda score: score.free)
