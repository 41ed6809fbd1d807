"""`fit.json`: the fitted parameter set in full, and back."""

from __future__ import annotations

import json
import platform
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from fitball.errors import FitballError, ResultFolderError
from fitball.inference.channels import Channel
from fitball.inference.fitted import FittedModel
from fitball.inference.new_impacts import DRAWS, NewPrediction, predict_new
from fitball.inference.parameters import NOISE_SPECS
from fitball.inference.results import Estimate, Fit, Golden, RunStatus, Verdict
from fitball.models.types import Rebound
from fitball.report.data_file import DATA_NAME, data_content, read_data
from fitball.report.looks_content import looks_content
from fitball.report.netcdf import saved_draws
from fitball.report.units import THESIS
from fitball.values import Ball, FloatArray, Impacts
from fitball.version import __version__

# Version 1 held the measurements themselves, which lie in `data.nc` now.
SCHEMA_VERSION = 2
FIT_NAME = "fit.json"
POSTERIOR_NAME = "posterior.nc"
PACKAGES = ("numpy", "scipy", "numba", "lmfit", "emcee", "arviz-stats", "h5py")
INCIDENT = ("v_x1", "v_y1", "omega_1")
NUMBERS = ("point", "median", "sd", "q025", "q05", "q16", "q84", "q95", "q975")


def fit_content(fit: Fit) -> dict[str, Any]:
    """The content of `fit.json`, all numbers in SI at full precision."""
    problem = fit.problem
    return {
        "schema_version": SCHEMA_VERSION,
        "kind": "fitball fit",
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
        "identifiability": looks_content(fit.examination),
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


@dataclass(frozen=True)
class SavedParameter:
    """A parameter as read back; absent numbers are None."""

    name: str
    unit: str
    meaning: str
    prior: str
    point: float
    median: float | None
    sd: float | None
    q025: float | None
    q05: float | None
    q16: float | None
    q84: float | None
    q95: float | None
    q975: float | None
    contraction: float | None
    verdict: Verdict
    reason: str


@dataclass(frozen=True)
class SavedFit:
    """A fit read back from `fit.json`; `content` is the file itself, `place` where it is."""

    status: RunStatus
    verdict: str
    parameters: Mapping[str, SavedParameter]
    fitted: FittedModel
    golden: Golden
    content: Mapping[str, Any]
    place: Path

    def predict_interval(
        self,
        impacts: Impacts,
        observed: Sequence[Channel] = (),
        *,
        seed: int = 1,
        incident_covariance: FloatArray | None = None,
    ) -> NewPrediction:
        """See `new_impacts.predict_new`, with draws of the posterior saved beside `fit.json`.

        Raises ResultFolderError when that is missing, damaged or of another fit.
        """
        point_only = self.status is RunStatus.POINT_ONLY
        posterior = self.place.with_name(POSTERIOR_NAME)
        fitted = self.fitted if point_only else saved_draws(self.fitted, posterior, DRAWS)
        return predict_new(fitted, impacts, observed, seed, incident_covariance)

    @property
    def impacts(self) -> Impacts:
        """Every impact of the fit. Of a long table `fit.json` holds those alone that span its range, and the others
        are read from `data.nc`; ResultFolderError where that is missing, damaged or of another fit.
        """
        known = self.fitted.impacts
        if len(known) == self.content["table"]["impacts"]:
            return known
        return read_data(self.content["data"], self.place.with_name(DATA_NAME)).impacts

    def predict(self, impacts: Impacts) -> Mapping[str, FloatArray]:
        """See `FittedModel.predict`: the same numbers as from the fit that was saved."""
        return self.fitted.predict(impacts)


def read_fit(path: Path) -> SavedFit:
    """Read `fit.json`, or the one in a folder.

    Raises ResultFolderError for a missing, damaged or foreign file and for an unknown schema version.
    """
    place = path / FIT_NAME if path.is_dir() else path
    try:
        content = json.loads(place.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise ResultFolderError(f"{place}: there is no such file; expected a {FIT_NAME} made by fitball") from None
    except (OSError, UnicodeDecodeError, json.JSONDecodeError) as error:
        raise ResultFolderError(f"{place}: not a readable {FIT_NAME}: {error}") from None
    if not isinstance(content, dict) or content.get("kind") != "fitball fit":
        raise ResultFolderError(f"{place}: valid JSON, but not a {FIT_NAME} of fitball")
    if content.get("schema_version") != SCHEMA_VERSION:
        raise ResultFolderError(
            f"{place}: schema_version {content.get('schema_version')!r}; this fitball reads version "
            f"{SCHEMA_VERSION}: run calibrate again"
        )
    try:
        return _from_content(content, place)
    except (KeyError, TypeError, ValueError, FitballError) as error:
        raise ResultFolderError(f"{place}: damaged: {type(error).__name__}: {error}") from None


def _from_content(content: Mapping[str, Any], place: Path) -> SavedFit:
    fields = SavedParameter.__dataclass_fields__
    parameters = {
        name: SavedParameter(
            **{"name": name, **{key: item[key] for key in fields if key not in ("name", "verdict")}},
            verdict=Verdict(item["verdict"]),
        )
        for name, item in content["parameters"].items()
    }
    names = tuple(content["fitted"]["names"])
    fitted = FittedModel(
        model_name=content["model"]["name"],
        options=content["model"]["closures"],
        ball=Ball(**content["ball"]),
        tangential=content["fitted"]["tangential"],
        names=names,
        point=np.array(content["fitted"]["point"], dtype=np.float64),
        draws=np.array(content["fitted"]["draws"], dtype=np.float64).reshape(-1, len(names)),
        impacts=Impacts(*(np.array(content["fitted"]["impacts"][name], dtype=np.float64) for name in INCIDENT)),
    )
    return SavedFit(
        status=RunStatus(content["status"]),
        verdict=content["verdict"],
        parameters=parameters,
        fitted=fitted,
        golden=_read_golden(content["golden"]),
        content=content,
        place=place,
    )


def _read_golden(content: Mapping[str, Any]) -> Golden:
    given, made = content["impacts"], content["rebound"]
    count = len(made["v_x2"])
    time = np.full(count, np.nan) if made["contact_time"] is None else np.array(made["contact_time"])
    return Golden(
        parameters=content["parameters"],
        impacts=Impacts(
            given["v_x1"], given["v_y1"], given["omega_1"], None if given["cor"] is None else np.array(given["cor"])
        ),
        rebound=Rebound(
            np.array(made["v_x2"]),
            np.array(made["v_y2"]),
            np.array(made["omega_2"]),
            time,
            np.array(made["regime"], dtype=np.int64),
            np.zeros(count, dtype=np.int8),
        ),
    )
