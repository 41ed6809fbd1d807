"""Draws and data of a fit for ArviZ, in its layout: groups of an xarray DataTree, or of the InferenceData that ArviZ
takes before version 1.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from importlib.metadata import PackageNotFoundError, version
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from fitball.data.table import ImpactTable
from fitball.errors import ParameterError, ResultFolderError, check_whole
from fitball.inference.identifiability.information import known_before
from fitball.inference.likelihood.force import force_log_likelihood
from fitball.inference.likelihood.posterior import log_posterior, log_scene_density, measured_terms
from fitball.inference.prediction.posterior_predictive import replicated
from fitball.inference.problem.observables import Observable
from fitball.inference.problem.problem import Problem
from fitball.inference.problem.subsample import batches
from fitball.inference.results.results import Estimate, Fit, Posterior, RunStatus
from fitball.inference.results.source import INCIDENT
from fitball.observables import SI_UNITS
from fitball.report.saved.netcdf_files import DATA_NAME, POSTERIOR_NAME, read_data, variable
from fitball.report.saved.run_file import RUN_NAME
from fitball.values import FloatArray
from fitball.version import __version__
from fitball.wording import option

# Draws of each chain, and numbers of a variable at most: draws times impacts, of which there may be thousands.
DRAWS = 1000
ENTRIES = 10_000_000
# The streams of random numbers of a run are three; those of replicated tables, and of prior draws where the run's are
# not at hand, are apart from them.
STREAM, PRIOR_STREAM = 4, 5
# What `log_likelihood` has a value for.
MEASUREMENT, IMPACT = "measurement", "impact"
UNITS = (MEASUREMENT, IMPACT)
SAMPLED = ("chain", "draw")


def inferencedata(tree: xr.DataTree) -> Any:
    """The tree as the installed ArviZ takes it: an `arviz.InferenceData` before version 1, else as it is."""
    try:
        major = int(version("arviz").split(".")[0])
    except PackageNotFoundError:
        return tree
    if major >= 1:
        return tree
    import arviz

    groups: dict[str, Any] = {name: group.to_dataset() for name, group in tree.children.items()}
    return arviz.InferenceData(attrs=dict(tree.attrs), **groups)


def datatree(fit: Fit, draws: int | None = None, unit: str = MEASUREMENT) -> xr.DataTree:
    """Groups `posterior`, `sample_stats`, `log_likelihood`, `log_prior`, `posterior_predictive`, `prior`,
    `prior_predictive`, `observed_data` and `constant_data` (incident states).

    A chain is an ensemble of walkers; of its `draws` each is taken at random from one of as many equal stretches, by
    default DRAWS, of a long table so many that a variable holds ENTRIES numbers. A fit without the file of its draws
    has those of `fit.json` as one chain. What else is missing beside a saved fit is left out, and said in the
    attribute `notes`. Raises ResultFolderError for a point fit, ParameterError for draws that there are not and for
    another `unit` than UNITS.
    """
    if fit.status is RunStatus.POINT_ONLY or fit.fitted.draws.shape[0] == 0:
        raise ResultFolderError(f"a point fit has no draws to export; calibrate without {option('point_only')}")
    check_whole(draws=draws)
    if unit not in UNITS:
        raise ParameterError(f"unit={unit!r}: expected {' or '.join(map(repr, UNITS))}")
    posterior = fit.posterior if _beside(fit, "posterior", POSTERIOR_NAME) else None
    problem = fit.problem if _beside(fit, "problem", DATA_NAME, RUN_NAME) else None
    notes = [] if posterior is not None else [_few(fit)]
    impacts = fit.source.impacts
    values, scores = _few_chain(fit, draws) if posterior is None else _chains(posterior, draws, impacts)
    groups = {"posterior": _draws(fit.parameters, fit.free_names, values)}
    if problem is None:
        notes.append(_missing(fit))
        groups |= _measured_only(fit)
    elif problem.model.without:
        notes.append(problem.model.without)
        groups |= _measured(problem.table)
    else:
        groups |= _Made(fit, problem, posterior, values, scores).groups(unit)
    tree = xr.DataTree.from_dict(groups)
    tree.attrs = {
        "created_by": f"fitball {__version__}", "model": fit.fitted.model_name, "status": str(fit.status),
        "notes": "; ".join(notes),
    }  # fmt: skip
    return tree


def netcdf_file(saved: Fit) -> tuple[memoryview, str]:
    """The file, and a note on what is missing from it. Raises as `datatree` does."""
    tree = datatree(saved)
    return tree.to_netcdf(engine="h5netcdf"), tree.attrs["notes"]


def _beside(fit: Fit, part: str, *files: str) -> bool:
    """Whether a part of a fit is in memory, or lies in files beside it."""
    return part in vars(fit) or (fit.place is not None and all(fit.place.with_name(name).exists() for name in files))


def _few(fit: Fit) -> str:
    assert fit.place is not None
    count = fit.fitted.draws.shape[0]
    place = fit.place.with_name(POSTERIOR_NAME)
    return f"{place} is missing: {count} draws of fit.json are one chain, out of order"


def _missing(fit: Fit) -> str:
    assert fit.place is not None
    gone = [place for name in (DATA_NAME, RUN_NAME) if not (place := fit.place.with_name(name)).exists()]
    words = " and ".join(map(str, gone))
    return f"{words} {'is' if len(gone) == 1 else 'are'} missing: there are no densities and no predictions"


def _few_chain(fit: Fit, draws: int | None) -> tuple[FloatArray, None]:
    """The draws of `fit.json` as one chain (1, draws, free), whose densities are not known."""
    held = fit.fitted.draws.shape[0]
    columns = [fit.fitted.names.index(name) for name in fit.free_names]
    return fit.fitted.draws[None, : _counted(draws, held, held), columns], None


def _chains(posterior: Posterior, draws: int | None, impacts: int) -> tuple[FloatArray, FloatArray]:
    """Draws (ensembles, count, free) and their log density (ensembles, count), in the order of the steps."""
    ensembles, steps, walkers, free = posterior.values.shape
    held = steps * walkers
    count = _counted(draws, held, min(DRAWS, held, max(1, ENTRIES // (ensembles * impacts))))
    edges = np.arange(count + 1) * held // count
    picked: NDArray[np.int64] = np.random.default_rng([held, count]).integers(
        edges[:-1], edges[1:], (ensembles, count)
    )
    values = posterior.values.reshape(ensembles, held, free)
    scores = posterior.log_posterior.reshape(ensembles, held)
    return np.take_along_axis(values, picked[:, :, None], axis=1), np.take_along_axis(scores, picked, axis=1)


def _counted(draws: int | None, held: int, usual: int) -> int:
    if draws is None:
        return usual
    if not 1 <= draws <= held:
        raise ParameterError(f"draws = {draws}: expected 1 to {held} of each chain")
    return draws


@dataclass(frozen=True)
class _Made:
    """What follows from the problem at draws `values` (chains, draws, free), with their log density where known."""

    fit: Fit
    problem: Problem
    posterior: Posterior | None
    values: FloatArray
    scores: FloatArray | None

    @cached_property
    def flat(self) -> FloatArray:
        return self.values.reshape(-1, self.values.shape[-1])

    @cached_property
    def coordinates(self) -> FloatArray:
        return self.problem.to_coordinates(self.flat)

    @cached_property
    def density(self) -> FloatArray:
        """Log posterior density (chains * draws,) with respect to coordinates."""
        return log_posterior(self.problem, self.coordinates) if self.scores is None else self.scores.ravel()

    def groups(self, unit: str) -> dict[str, xr.Dataset]:
        problem, shape = self.problem, self.values.shape[:2]
        before = self.known_before()
        seen = replicated(problem, self.flat, np.random.default_rng([STREAM, self.fit.seed]))
        expected = replicated(problem, before, np.random.default_rng([STREAM, self.fit.seed, 0]))
        return {
            "sample_stats": _by_draw({"lp": self.density}, shape),
            "log_likelihood": self.log_likelihood(unit),
            "log_prior": _by_draw(self.log_prior(), shape),
            "posterior_predictive": _by_impact(problem, seen, shape),
            "prior": _draws(self.fit.parameters, self.fit.free_names, before[None]),
            "prior_predictive": _by_impact(problem, expected, (1, len(before))),
            **_measured(problem.table, problem.observables),
        }

    def log_likelihood(self, unit: str) -> xr.Dataset:
        problem, shape = self.problem, self.values.shape[:2]
        terms = measured_terms(problem, self.flat)
        if unit == IMPACT:
            whole = np.sum(list(terms.values()), axis=0).reshape(*shape, -1)
            every = {**_counters(shape), "impact": list(problem.table.ids)}
            return xr.Dataset({"impact_log_likelihood": ((*SAMPLED, "impact"), whole)}, every)
        made = _by_impact(problem, terms, shape, units=False)
        if problem.force is None:
            return made
        force = force_log_likelihood(problem, problem.force, problem.all_values(self.flat))
        return made.assign(force=(SAMPLED, force.reshape(shape)))

    def log_prior(self) -> dict[str, FloatArray]:
        """Log densities (chains * draws,) with respect to the values of `posterior`, of each parameter and, if the
        scene has one, of the contact time.
        """
        problem = self.problem
        terms = {}
        for k, parameter in enumerate(problem.free):
            rate = self.coordinates[:, k] if parameter.prior.log else 0.0
            terms[variable(parameter.name)] = parameter.prior.log_density(self.coordinates[:, k]) - rate
        if problem.contact_time is not None:
            parts = batches(problem, len(self.flat))
            scene = [log_scene_density(problem, problem.rebound(self.flat[some])) for some in parts]
            terms["scene_contact_time"] = np.concatenate(scene)
        return terms

    def known_before(self) -> FloatArray:
        """Draws (draws, free) of all that was known before the table."""
        if self.posterior is not None:
            return self.posterior.prior_draws
        best = self.coordinates[np.argmax(self.density)]
        return known_before(self.problem, best, np.random.default_rng([PRIOR_STREAM, self.fit.seed]))


def _counters(shape: tuple[int, ...]) -> dict[str, NDArray[np.int64]]:
    return {name: np.arange(count) for name, count in zip(SAMPLED, shape, strict=True)}


def _draws(known: Mapping[str, Estimate], names: tuple[str, ...], chains: FloatArray) -> xr.Dataset:
    """`chains` (chains, draws, names) as a dataset with units and meanings."""
    said = {name: {"units": known[name].unit, "long_name": known[name].meaning} for name in names}
    columns = {variable(name): (SAMPLED, chains[:, :, k], said[name]) for k, name in enumerate(names)}
    return xr.Dataset(columns, _counters(chains.shape[:2]))


def _by_draw(columns: Mapping[str, FloatArray], shape: tuple[int, ...]) -> xr.Dataset:
    return xr.Dataset({name: (SAMPLED, one.reshape(shape)) for name, one in columns.items()}, _counters(shape))


def _by_impact(
    problem: Problem, columns: Mapping[str, FloatArray], shape: tuple[int, ...], *, units: bool = True
) -> xr.Dataset:
    """Columns (draws, impacts) as (chain, draw, impact), of the impacts at which they were measured."""
    made = {}
    for item in problem.observables:
        values = columns[item.name][:, item.places(len(problem.impacts))].reshape(*shape, -1)
        made[item.name] = ((*SAMPLED, _along(item)), values, {"units": item.column.unit} if units else {})
    return xr.Dataset(made, {**_counters(shape), **_ids(problem.table, problem.observables)})


def _along(item: Observable) -> str:
    """The dimension along the impacts with a measurement of a column: its own where some have none."""
    return "impact" if item.rows is None else f"{item.name}_impact"


def _ids(table: ImpactTable, observables: Sequence[Observable]) -> dict[str, list[str]]:
    return {_along(item): [table.ids[k] for k in item.places(len(table))] for item in observables}


def _measured(table: ImpactTable, observables: Sequence[Observable] | None = None) -> dict[str, xr.Dataset]:
    """Rebounds and incident states, as the fit took them; all rebounds of the table where it is not known which."""
    every = {"impact": list(table.ids)}
    states = {name: ("impact", getattr(table.impacts, name), {"units": SI_UNITS[name]}) for name in INCIDENT}
    if observables is None:
        seen = {one.name: ("impact", one.values, {"units": SI_UNITS[one.name]}) for one in table.measurements}
        rebounds = xr.Dataset(seen, every)
    else:
        taken = {item.name: (_along(item), item.observed, {"units": item.column.unit}) for item in observables}
        rebounds = xr.Dataset(taken, _ids(table, observables))
    return {"observed_data": rebounds, "constant_data": xr.Dataset(states, every)}


def _measured_only(fit: Fit) -> dict[str, xr.Dataset]:
    assert fit.place is not None
    place = fit.place.with_name(DATA_NAME)
    return _measured(read_data(fit.source, place)[0]) if place.exists() else {}
