"""What `fit.json` holds: the structure it is read into. `fit.schema.json` beside this file is made from it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Literal

import msgspec
import numpy as np

from fitball.inference.results.adequacy import Adequacy
from fitball.inference.results.assumptions import Assumptions
from fitball.inference.results.drop_test import DropTest
from fitball.inference.results.evidence import Identifiability
from fitball.inference.results.pace_rating import CourtPace
from fitball.inference.results.results import BudgetLine, LevelEstimate, RunStatus, Verdict, verdict_words
from fitball.report.saved.structure import Counted, Digest, Part, Positive
from fitball.values import Ball

# Version 1 held the measurements themselves, which lie in `data.nc` now.
SCHEMA_VERSION: Literal[4] = 4
KIND: Literal["fitball fit"] = "fitball fit"
Numbers = tuple[float, ...]
Texts = tuple[str, ...]
# Speeds and spins far beyond any that could be measured, and far below where squares overflow.
Motion = Annotated[float, msgspec.Meta(ge=-1e6, le=1e6)]
Motions = tuple[Motion, ...]
Share = Annotated[float, msgspec.Meta(ge=0.0, le=1.0)]
IncidentName = Literal["v_x1", "v_y1", "omega_1"]
NotNegative = Annotated[float, msgspec.Meta(ge=0.0)]


class ModelPart(Part, frozen=True):
    """The model and the closures it is composed of."""

    name: str
    closures: Mapping[str, str]


class BallPart(Part, frozen=True):
    """The ball: mass [kg], radius [m], moment of inertia [kg m^2]."""

    mass: Positive
    radius: Positive
    inertia: Positive

    def __post_init__(self) -> None:
        """Raise ParameterError for a ball that cannot be."""
        self.ball()

    def ball(self) -> Ball:
        """The same as the models know it."""
        return Ball(self.mass, self.radius, self.inertia)


class TablePart(Part, frozen=True):
    """The table that was fitted; flipped are columns that were counted the other way round on request, columns those
    that were named, by our names.
    """

    name: str
    file: str
    sha256: Digest
    impacts: Annotated[int, msgspec.Meta(ge=2)]
    flipped: Texts
    columns: Mapping[str, str] = {}


class ThesisNumbers(Part, frozen=True):
    """A parameter in the unit of the thesis."""

    unit: str
    point: float | None = None
    median: float | None = None
    sd: float | None = None
    q025: float | None = None
    q05: float | None = None
    q16: float | None = None
    q84: float | None = None
    q95: float | None = None
    q975: float | None = None


class ParameterPart(Part, frozen=True):
    """One parameter: its prior, the point estimate, quantiles of its posterior (null without one), in SI; contraction
    is 1 - posterior variance / prior variance. prior_source is where a prior from the literature was published.
    """

    unit: str
    meaning: str
    point: float
    median: float | None
    sd: NotNegative | None
    q025: float | None
    q05: float | None
    q16: float | None
    q84: float | None
    q95: float | None
    q975: float | None
    prior: str
    contraction: float | None
    verdict: Verdict
    given: Texts
    reason: str
    ess_bulk: float | None
    ess_tail: float | None
    r_hat: float | None
    prior_source: str = ""
    thesis_units: ThesisNumbers | msgspec.UnsetType = msgspec.UNSET

    @property
    def verdict_words(self) -> str:
        """The verdict with the assumptions it is given."""
        return verdict_words(self.verdict, self.given)


class Matrix(Part, frozen=True):
    """A square matrix over the free parameters."""

    names: Texts
    values: tuple[Numbers, ...]


class LeastSquaresPart(Part, frozen=True):
    """Weighted least squares, no prior but the bounds; errors that do not exist are null, with the cause."""

    chi_square: float
    degrees_of_freedom: int
    rms: Mapping[str, float]
    values: Mapping[str, float]
    stderr: Mapping[str, float | None]
    stderr_missing: Mapping[str, str]


class Scores(Part, frozen=True):
    """Log densities at the point estimate, and root mean square residuals by column in SI."""

    log_posterior: float
    log_likelihood: float
    rms: Mapping[str, float]
    least_squares: LeastSquaresPart


class DiagnosticsPart(Part, frozen=True):
    """How the sampler did; kept is the number of steps after the warm-up whose draws were stored; pareto_k is
    that of the weights where draws were weighed by their density.
    """

    ensembles: Counted
    walkers: Counted
    steps: Counted
    kept: Counted
    warm_up: Annotated[int, msgspec.Meta(ge=0)]
    max_steps: Counted
    acceptance: tuple[Share, ...]
    min_ess_bulk: float
    min_ess_tail: float
    max_r_hat: float
    converged: bool
    complaints: Texts
    pareto_k: float | None = None


class Budget(Part, frozen=True):
    """Numerical error of the rebounds beside measurement error and posterior width, in SI by column; share is the
    largest ratio.
    """

    impacts: Counted
    reference: str
    lines: Mapping[str, BudgetLine]
    share: NotNegative


class Incident(Part, frozen=True):
    """Incident states, columns of equal length in SI; cor is null unless the model takes the measured restitution."""

    v_x1: Motions
    v_y1: Motions
    omega_1: Motions
    cor: Numbers | None = None


class GoldenRebound(Part, frozen=True):
    """Their rebounds in SI at the point estimate; contact_time is null for models without a time axis."""

    v_x2: Numbers
    v_y2: Numbers
    omega_2: Numbers
    contact_time: Numbers | None
    regime: tuple[int, ...]


class GoldenPart(Part, frozen=True):
    """Impacts with their rebounds to the last digit, for checking a port of the model."""

    parameters: Mapping[str, float]
    impacts: Incident
    rebound: GoldenRebound


class ForcePart(Part, frozen=True):
    """Force-time records as the likelihood took them, only where there were any; their means lie in data.nc. start_sd
    is how well t = 0 is known to be the start of contact.
    """

    file: str
    sha256: Digest
    start_sd: Positive | None


class DataPart(Part, frozen=True, omit_defaults=True):
    """The measurements the fit was made from, which lie in data.nc: names of incident and of measured columns, of
    those with a stated sd, of label columns; SHA-256 over all columns; contact_time is (value, sd) as known to the
    scene.
    """

    incident_columns: tuple[IncidentName, ...]
    incident_sd: tuple[IncidentName, ...]
    measurements: Texts
    with_sd: Texts
    labels: Texts
    contact_time: tuple[Positive, Positive] | None
    sha256: Digest
    force: ForcePart | None = None


class FittedPart(Part, frozen=True):
    """What prediction needs: names of all parameters, their point estimate, and rows of posterior draws."""

    tangential: bool
    names: Texts
    point: Numbers
    draws: tuple[Numbers, ...]
    impacts: Incident


class FitFile(Part, frozen=True, kw_only=True):
    """A fitted parameter set. Numbers are in SI units unless a unit stands beside them."""

    schema_version: Literal[4]
    kind: Literal["fitball fit"]
    status: RunStatus
    verdict: str
    drop_test: DropTest | None = None
    model: ModelPart
    ball: BallPart
    table: TablePart
    notes: Texts
    parameters: Mapping[str, ParameterPart]
    derived: Mapping[str, ParameterPart] = {}
    covariance: Matrix | None
    correlation: Matrix | None
    noise: Mapping[str, Positive]
    scores: Scores
    diagnostics: DiagnosticsPart | None
    versions: Mapping[str, str]
    seed: Annotated[int, msgspec.Meta(ge=0)]
    levels: tuple[LevelEstimate, ...]
    error_budget: Budget
    court_pace: CourtPace | None = None
    adequacy: Adequacy | None = None
    assumptions: Assumptions | None = None
    golden: GoldenPart
    identifiability: Identifiability
    data: DataPart
    fitted: FittedPart


def fit_schema() -> dict[str, Any]:
    """The structure as JSON Schema."""
    made = msgspec.json.schema(FitFile, schema_hook=_column)
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", "title": KIND, **made}


def _column(kind: type) -> dict[str, Any]:
    if getattr(kind, "__origin__", kind) is np.ndarray:
        return {"type": "array", "items": {"type": "number"}}
    raise TypeError(f"a field of fit.json is of type {kind!r}, which JSON Schema does not know")
