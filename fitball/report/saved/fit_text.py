"""`fit.json`: the fitted parameter set in full; `saved_fit` reads it back."""

from __future__ import annotations

import json
import platform
from dataclasses import asdict
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from fitball.inference.problem.parameters import NOISE_SPECS
from fitball.inference.results.results import Estimate, Fit, Golden
from fitball.report.form.display_units import THESIS
from fitball.report.saved.data_file import data_content
from fitball.report.saved.evidence_content import evidence_content
from fitball.report.saved.fit_file import KIND, SCHEMA_VERSION
from fitball.values import Ball, FloatArray
from fitball.version import __version__

PACKAGES = ("numpy", "scipy", "numba", "lmfit", "emcee", "arviz-stats", "h5py")
INCIDENT = ("v_x1", "v_y1", "omega_1")
NUMBERS = ("point", "median", "sd", "q025", "q05", "q16", "q84", "q95", "q975")


def fit_content(fit: Fit) -> dict[str, Any]:
    """The content of `fit.json`, all numbers in SI at full precision."""
    problem = fit.problem
    return {
        "schema_version": SCHEMA_VERSION,
        "kind": KIND,
        "status": str(fit.status),
        "verdict": fit.verdict,
        "model": {"name": problem.model.name, "closures": dict(problem.model.options)},
        "ball": _ball(problem.model.ball),
        "table": {
            "name": problem.table.name,
            "file": Path(problem.table.source).name,
            "sha256": problem.table.digest,
            "impacts": len(problem.table),
        },
        "notes": [*problem.table.remarks, *fit.notes],
        "parameters": {item.name: _estimate(item) for item in fit.estimates},
        "covariance": _matrix(problem.free_names, fit.covariance),
        "correlation": _matrix(problem.free_names, fit.correlation),
        "noise": {name: fit.point.values[name] for name in fit.point.values if name in NOISE_SPECS},
        "scores": {
            "log_posterior": fit.point.log_posterior,
            "log_likelihood": fit.point.log_likelihood,
            "rms": dict(fit.point.rms),
            "least_squares": {
                "chi_square": fit.least_squares.chi_square,
                "degrees_of_freedom": fit.least_squares.degrees_of_freedom,
                "rms": dict(fit.least_squares.rms),
                "values": dict(fit.least_squares.values),
                "stderr": dict(fit.least_squares.stderr),
                "stderr_missing": dict(fit.least_squares.missing),
            },
        },
        "diagnostics": _diagnostics(fit),
        "versions": package_versions(),
        "seed": fit.seed,
        "levels": [asdict(item) for item in fit.levels],
        "error_budget": asdict(fit.error_budget) | {"share": fit.error_budget.share},
        "court_pace": None if fit.court_pace is None else asdict(fit.court_pace),
        "golden": _golden(fit.golden),
        "identifiability": evidence_content(fit.identifiability),
        "data": data_content(problem),
        "fitted": {
            "tangential": fit.fitted.tangential,
            "names": list(fit.fitted.names),
            "point": fit.fitted.point.tolist(),
            "draws": fit.fitted.draws.tolist(),
            "impacts": {name: getattr(fit.fitted.impacts, name).tolist() for name in INCIDENT},
        },
    }


def package_versions() -> dict[str, str]:
    """What a result depends on, with its version."""
    return {"fitball": __version__, "python": platform.python_version()} | {name: version(name) for name in PACKAGES}


def fit_text(fit: Fit) -> str:
    """`fit.json` as text; NaN cannot occur."""
    return json.dumps(fit_content(fit), indent=1, allow_nan=False) + "\n"


def _ball(ball: Ball) -> dict[str, float]:
    return {"mass": ball.mass, "radius": ball.radius, "inertia": ball.inertia}


def _estimate(item: Estimate) -> dict[str, Any]:
    found: dict[str, Any] = {"unit": item.unit, "meaning": item.meaning}
    found |= {name: getattr(item, name) for name in NUMBERS}
    found |= {
        "prior": item.prior,
        "contraction": item.contraction,
        "verdict": str(item.verdict),
        "reason": item.reason,
        "ess_bulk": item.ess_bulk,
        "ess_tail": item.ess_tail,
        "r_hat": item.r_hat,
    }
    scale = THESIS.get(item.name)
    if scale is not None:
        found["thesis_units"] = {"unit": scale.unit} | {
            name: None if getattr(item, name) is None else getattr(item, name) * scale.factor for name in NUMBERS
        }
    return found


def _matrix(names: tuple[str, ...], matrix: FloatArray | None) -> dict[str, Any] | None:
    return None if matrix is None else {"names": list(names), "values": matrix.tolist()}


def _diagnostics(fit: Fit) -> dict[str, Any] | None:
    found = fit.diagnostics
    if found is None:
        return None
    return {
        "ensembles": found.ensembles,
        "walkers": found.walkers,
        "steps": found.steps,
        "warm_up": found.warm_up,
        "max_steps": found.max_steps,
        "acceptance": list(found.acceptance),
        "min_ess_bulk": found.min_ess_bulk,
        "min_ess_tail": found.min_ess_tail,
        "max_r_hat": found.max_r_hat,
        "converged": found.converged,
        "complaints": list(found.complaints),
    }


def _golden(golden: Golden) -> dict[str, Any]:
    time = golden.rebound.contact_time
    return {
        "parameters": dict(golden.parameters),
        "impacts": {
            "v_x1": golden.impacts.v_x1.tolist(),
            "v_y1": golden.impacts.v_y1.tolist(),
            "omega_1": golden.impacts.omega_1.tolist(),
            "cor": None if golden.impacts.cor is None else golden.impacts.cor.tolist(),
        },
        "rebound": {
            "v_x2": golden.rebound.v_x2.tolist(),
            "v_y2": golden.rebound.v_y2.tolist(),
            "omega_2": golden.rebound.omega_2.tolist(),
            "contact_time": None if np.isnan(time).any() else time.tolist(),
            "regime": golden.rebound.regime.tolist(),
        },
    }
