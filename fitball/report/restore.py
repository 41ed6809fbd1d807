"""A fit read back from its files, so far as figures need it: nothing is fitted or sampled again."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from fitball.data.scene import Scene
from fitball.data.table import ImpactTable
from fitball.errors import FitballError, ResultFolderError
from fitball.inference.channels import build_channels
from fitball.inference.looks import Examination
from fitball.inference.measurement_noise import noise_in
from fitball.inference.parameters import NOISE_SPECS, Parameter
from fitball.inference.posterior import Problem
from fitball.inference.predictive import predictive, predictive_generator
from fitball.inference.priors import parse_prior
from fitball.inference.problem import impacts_with_cor
from fitball.inference.results import Diagnostics, PointFit, Posterior, Predictive, Verdict
from fitball.models.registry import model
from fitball.models.specs import SPECS
from fitball.report.data_file import DATA_NAME, MeasuredData, read_data
from fitball.report.export import FIT_NAME, SavedFit, read_fit
from fitball.report.looks_content import read_examination
from fitball.values import FloatArray

POSTERIOR_NAME = "posterior.nc"


@dataclass(frozen=True)
class Restored:
    """What figures need of a fit; see `drawable.Drawable`. `posterior` and `predictive` are None for a point fit."""

    problem: Problem
    point: PointFit
    predictive: Predictive | None
    diagnostics: Diagnostics | None
    examination: Examination
    posterior: Posterior | None


def restore(path: Path) -> Restored:
    """Read a `fit.json`, or the one in a folder, with the draws beside it.

    Raises ResultFolderError for files that are missing, damaged, foreign or older than the data they should hold.
    """
    saved = read_fit(path)
    place = path / FIT_NAME if path.is_dir() else path
    try:
        problem = _problem(saved, read_data(saved.content["data"], place.with_name(DATA_NAME)))
        point = _point(problem, saved)
        diagnostics = _diagnostics(saved.content)
        examination = read_examination(saved.content["identifiability"])
    except ResultFolderError:
        raise
    except (KeyError, TypeError, ValueError, FitballError) as error:
        raise ResultFolderError(f"{place}: damaged: {type(error).__name__}: {error}") from None
    posterior = None if diagnostics is None else read_posterior(place.with_name(POSTERIOR_NAME), problem)
    found = None
    if posterior is not None:
        found = predictive(problem, point, posterior, predictive_generator(saved.content["seed"]))
    return Restored(problem, point, found, diagnostics, examination, posterior)


def _problem(saved: SavedFit, measured: MeasuredData) -> Problem:
    content, data = saved.content, saved.content["data"]
    fitted = saved.fitted
    table = ImpactTable(
        name=content["table"]["name"],
        source=content["table"]["file"],
        digest=content["table"]["sha256"],
        ids=measured.ids,
        impacts=measured.impacts,
        incident_columns=tuple(data["incident_columns"]),
        incident_sd={},
        measurements=measured.measurements,
        redundant=(),
        labels=measured.labels,
        units={},
        notices=(),
    )
    time = None if data["contact_time"] is None else (data["contact_time"][0], data["contact_time"][1])
    chosen = model(fitted.model_name, ball=fitted.ball, tangential=fitted.tangential, **fitted.options)
    noise_of = noise_in(saved.parameters)
    channels, _unused = build_channels(table, table.has_tangential, chosen.has_time, chosen.needs_cor, noise_of)
    parameters = []
    for name, item in saved.parameters.items():
        spec = NOISE_SPECS.get(name) or SPECS[name]
        fixed = item.point if item.verdict is Verdict.FIXED else None
        prior = parse_prior(name, item.prior, spec.lower, spec.upper, spec.unit)
        parameters.append(Parameter(spec, prior, fixed, "" if fixed is None else item.reason))
    return Problem(
        table=table,
        scene=Scene(ball=fitted.ball, contact_time=time),
        model=chosen,
        parameters=tuple(parameters),
        channels=channels,
        impacts=impacts_with_cor(table, chosen),
        contact_time=time,
        notes=tuple(content["notes"]),
        force=measured.force,
    )


def _point(problem: Problem, saved: SavedFit) -> PointFit:
    scores = saved.content["scores"]
    values = {name: item.point for name, item in saved.parameters.items()}
    return PointFit(
        values=values,
        log_posterior=scores["log_posterior"],
        log_likelihood=scores["log_likelihood"],
        rms=scores["rms"],
        rebound=problem.rebound(np.array([[values[name] for name in problem.free_names]])),
        optima=(values,),
        optima_log_posterior=(scores["log_posterior"],),
    )


def _diagnostics(content: Mapping[str, Any]) -> Diagnostics | None:
    found = content["diagnostics"]
    if found is None:
        return None
    listed = content["parameters"].items()
    kept: dict[str, Any] = {key: value for key, value in found.items() if key not in ("acceptance", "complaints")}
    kept |= {
        key: {name: item[key] for name, item in listed if item[key] is not None}
        for key in ("ess_bulk", "ess_tail", "r_hat")
    }
    return Diagnostics(
        **kept,
        acceptance=tuple(found["acceptance"]),
        complaints=tuple(found["complaints"]),
        evaluations=found["ensembles"] * found["steps"] * found["walkers"],
    )


def read_posterior(place: Path, problem: Problem) -> Posterior:
    """The draws in `posterior.nc`. Raises ResultFolderError when it is missing, damaged or of another fit."""
    if not place.exists():
        raise ResultFolderError(f"{place}: missing, and with it the draws; run calibrate again")
    names = problem.free_names
    try:
        with xr.open_datatree(place, engine="h5netcdf") as tree:
            kept, known = tree["posterior"].to_dataset(), tree["prior"].to_dataset()
            draws = np.stack([kept[name].to_numpy() for name in names], axis=-1)
            ensembles = np.unique(kept["ensemble"].to_numpy()).size
            scores = tree["sample_stats"].to_dataset()["lp"].to_numpy()
            reference = np.stack([known[name].to_numpy()[0] for name in names], axis=-1)
    except (OSError, KeyError, ValueError) as error:
        raise ResultFolderError(f"{place}: not the draws of this fit, or damaged: {error}") from None
    return Posterior(names, _by_ensemble(draws, ensembles), _by_ensemble(scores, ensembles), reference)


def _by_ensemble(chains: FloatArray, ensembles: int) -> FloatArray:
    """From (ensembles x walkers, steps, ...) to (ensembles, steps, walkers, ...)."""
    split = chains.reshape(ensembles, -1, *chains.shape[1:])
    return np.ascontiguousarray(np.swapaxes(split, 1, 2))
