"""`fit.json`: the fitted parameter set in full, written as the structure that `saved_fit` reads it back into."""

from __future__ import annotations

import platform
from collections.abc import Mapping
from functools import cache
from importlib.metadata import version
from pathlib import Path

import msgspec
import numpy as np

from fitball.inference.problem.parameters import NOISE_SPECS
from fitball.inference.results.quantiles import SUMMARY
from fitball.inference.results.results import Estimate, Fit, Golden
from fitball.inference.thesis.published_cases import wang_rows
from fitball.report.form.files import json_text
from fitball.report.form.numbers import THESIS
from fitball.report.saved import fit_file as parts
from fitball.report.saved.data_file import data_part
from fitball.report.saved.structure import part, plain
from fitball.values import FloatArray
from fitball.version import __version__

PACKAGES = ("numpy", "scipy", "numba", "lmfit", "emcee", "arviz-stats", "h5py")


def fit_file(fit: Fit) -> parts.FitFile:
    """The content of `fit.json`, all numbers in SI at full precision."""
    problem = fit.problem
    table = problem.table
    theirs = wang_rows(table) is not None
    return parts.FitFile(
        schema_version=parts.SCHEMA_VERSION,
        kind=parts.KIND,
        status=fit.status,
        verdict=fit.verdict,
        drop_test=fit.drop_test,
        model=parts.ModelPart(problem.model.name, problem.model.options),
        ball=part(parts.BallPart, problem.model.ball),
        table=parts.TablePart(
            table.name, Path(table.source).name, table.digest, len(table), table.flipped, dict(table.columns)
        ),
        notes=(*table.remarks, *fit.notes),
        parameters={estimate.name: _parameter(estimate, theirs) for estimate in fit.estimates},
        derived={estimate.name: _parameter(estimate, False) for estimate in fit.derived},
        covariance=_matrix(problem.free_names, fit.covariance),
        correlation=_matrix(problem.free_names, fit.correlation),
        noise={name: fit.point.values[name] for name in fit.point.values if name in NOISE_SPECS},
        scores=part(
            parts.Scores,
            fit.point,
            least_squares=part(parts.LeastSquaresPart, fit.least_squares, stderr_missing=fit.least_squares.missing),
        ),
        diagnostics=None if fit.diagnostics is None else part(parts.DiagnosticsPart, fit.diagnostics),
        versions=package_versions(),
        seed=fit.seed,
        levels=fit.levels,
        error_budget=part(parts.Budget, fit.error_budget),
        court_pace=fit.court_pace,
        adequacy=fit.adequacy,
        assumptions=fit.assumptions,
        golden=_golden(fit.golden),
        identifiability=fit.identifiability,
        data=data_part(problem),
        fitted=part(parts.FittedPart, fit.fitted, impacts=part(parts.Incident, fit.fitted.impacts)),
    )


@cache
def package_versions() -> Mapping[str, str]:
    """What a result depends on, with its version."""
    return {"fitball": __version__, "python": platform.python_version()} | {name: version(name) for name in PACKAGES}


def versions_line() -> str:
    """The same in a line, with system and machine."""
    versions = ", ".join(f"{name} {number}" for name, number in package_versions().items())
    return f"{versions}; {platform.system()} {platform.machine()}"


def fit_text(fit: Fit) -> str:
    """`fit.json` as text; NaN cannot occur."""
    return json_text(plain(fit_file(fit)))


def _parameter(estimate: Estimate, theirs: bool) -> parts.ParameterPart:
    """A parameter, and where the data are the thesis's (`theirs`) its numbers in the unit of the thesis."""
    scale = THESIS.get(estimate.name) if theirs else None
    if scale is None:
        return part(parts.ParameterPart, estimate, thesis_units=msgspec.UNSET)
    numbers = {name: getattr(estimate, name) for name in ("point", *SUMMARY)}
    scaled = {name: None if value is None else value * scale.factor for name, value in numbers.items()}
    return part(parts.ParameterPart, estimate, thesis_units=parts.ThesisNumbers(scale.unit, **scaled))


def _matrix(names: tuple[str, ...], matrix: FloatArray | None) -> parts.Matrix | None:
    return None if matrix is None else parts.Matrix(names, tuple(map(tuple, matrix.tolist())))


def _golden(golden: Golden) -> parts.GoldenPart:
    time = golden.rebound.contact_time
    return parts.GoldenPart(
        parameters=golden.parameters,
        impacts=part(parts.Incident, golden.impacts),
        rebound=part(parts.GoldenRebound, golden.rebound, contact_time=None if np.isnan(time).any() else time),
    )
