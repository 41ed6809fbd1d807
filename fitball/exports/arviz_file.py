"""Draws and data of a fit for ArviZ, in its layout: groups of an xarray DataTree."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from fitball.data.table import ImpactTable
from fitball.errors import ParameterError, ResultFolderError, check_whole
from fitball.inference.prediction.posterior_predictive import replicated
from fitball.inference.results.results import Estimate, Fit, Posterior, RunStatus
from fitball.inference.results.source import INCIDENT
from fitball.observables import SI_UNITS
from fitball.report.saved.fit_file import complete
from fitball.report.saved.netcdf_files import DATA_NAME, POSTERIOR_NAME, read_data, variable
from fitball.values import FloatArray
from fitball.version import __version__
from fitball.wording import option

# Draws of each chain, and numbers of a group at most: draws times impacts, of which there may be thousands.
DRAWS = 1000
ENTRIES = 10_000_000
# The streams of random numbers of a run are three; that of replicated tables is apart from them.
STREAM = 4


def whole_tree(fit: Fit, draws: int | None = None) -> xr.DataTree:
    """Groups `posterior`, `sample_stats`, `log_likelihood`, `posterior_predictive`, `prior`, `observed_data` and
    `constant_data` (incident states).

    A chain is an ensemble of walkers; of its `draws` each is taken at random from one of as many equal stretches, by
    default DRAWS, of a long table so many that a group holds ENTRIES numbers. Raises ResultFolderError for a point
    fit, ParameterError for draws that there are not.
    """
    if fit.posterior is None:
        raise _no_draws()
    check_whole(draws=draws)
    posterior, problem = fit.posterior, fit.problem
    ensembles, steps, walkers, _ = posterior.values.shape
    held = steps * walkers
    count = min(DRAWS, held, max(1, ENTRIES // (ensembles * len(problem.impacts)))) if draws is None else draws
    if not 1 <= count <= held:
        raise ParameterError(f"draws = {draws}: expected 1 to {held} of each chain")
    values, scores = _chains(posterior, count)
    made = replicated(problem, values.reshape(-1, values.shape[-1]), np.random.default_rng([STREAM, fit.seed]))
    ids, shape = list(problem.table.ids), (ensembles, count, len(problem.impacts))
    groups = _sampled(fit.parameters, posterior, values, scores)
    groups["log_likelihood"] = _by_impact({"impact_log_likelihood": made.log_likelihood}, shape, ids)
    groups["posterior_predictive"] = _by_impact(made.measurements, shape, ids)
    return _tree(groups | _measured(problem.table), problem.model.name, fit.status)


def netcdf_file(saved: Fit) -> tuple[memoryview, str]:
    """The file, and a note on what is missing from it. Raises as `whole_tree` and `partial_tree` do."""
    tree, note = (whole_tree(saved), "") if complete(saved) else partial_tree(saved)
    return tree.to_netcdf(engine="h5netcdf"), note


def partial_tree(saved: Fit) -> tuple[xr.DataTree, str]:
    """What can be had of a `fit.json` that not all files of its folder lie beside, and a note on what is missing.

    Without `posterior.nc` the draws of `fit.json` make one chain. Raises ResultFolderError for a point fit, and for a
    file that is damaged or of another fit.
    """
    if saved.status is RunStatus.POINT_ONLY or saved.fitted.draws.shape[0] == 0:
        raise _no_draws()
    assert saved.place is not None
    places = {name: saved.place.with_name(name) for name in (POSTERIOR_NAME, DATA_NAME)}
    notes = (
        [] if places[DATA_NAME].exists() else [f"{places[DATA_NAME]} is missing: the new file has no measurements"]
    )
    posterior = saved.posterior if places[POSTERIOR_NAME].exists() else None
    if posterior is None:
        count = saved.fitted.draws.shape[0]
        notes.append(
            f"{places[POSTERIOR_NAME]} is missing: the file holds the {count} draws of fit.json as one chain, out of "
            "order"
        )
        columns = [saved.fitted.names.index(name) for name in saved.free_names]
        groups = {"posterior": _draws(saved.parameters, saved.free_names, saved.fitted.draws[None][:, :, columns])}
    else:
        held = posterior.values.shape[1] * posterior.values.shape[2]
        groups = _sampled(saved.parameters, posterior, *_chains(posterior, min(DRAWS, held)))
    measured = _measured(read_data(saved.source, places[DATA_NAME])[0]) if places[DATA_NAME].exists() else {}
    return _tree(groups | measured, saved.fitted.model_name, saved.status), "; ".join(notes)


def _no_draws() -> ResultFolderError:
    return ResultFolderError(f"a point fit has no draws to export; calibrate without {option('point_only')}")


def _tree(groups: Mapping[str, xr.Dataset], model: str, status: RunStatus) -> xr.DataTree:
    tree = xr.DataTree.from_dict(dict(groups))
    tree.attrs = {"created_by": f"fitball {__version__}", "model": model, "status": str(status)}
    return tree


def _chains(posterior: Posterior, count: int) -> tuple[FloatArray, FloatArray]:
    """Draws (ensembles, count, free) and their log density (ensembles, count), in the order of the steps."""
    ensembles, steps, walkers, free = posterior.values.shape
    edges = np.arange(count + 1) * (steps * walkers) // count
    picked: NDArray[np.int64] = np.random.default_rng([steps * walkers, count]).integers(
        edges[:-1], edges[1:], (ensembles, count)
    )
    values = posterior.values.reshape(ensembles, steps * walkers, free)
    scores = posterior.log_posterior.reshape(ensembles, steps * walkers)
    return np.take_along_axis(values, picked[:, :, None], axis=1), np.take_along_axis(scores, picked, axis=1)


def _sampled(
    known: Mapping[str, Estimate], posterior: Posterior, values: FloatArray, scores: FloatArray
) -> dict[str, xr.Dataset]:
    draws = _draws(known, posterior.names, values)
    coords = {"chain": draws["chain"], "draw": draws["draw"]}
    return {
        "posterior": draws,
        "sample_stats": xr.Dataset({"lp": (("chain", "draw"), scores)}, coords=coords),
        "prior": _draws(known, posterior.names, posterior.prior_draws[None]),
    }


def _draws(known: Mapping[str, Estimate], names: tuple[str, ...], chains: FloatArray) -> xr.Dataset:
    """`chains` (chains, draws, names) as a dataset with units and meanings."""
    said = {name: {"units": known[name].unit, "long_name": known[name].meaning} for name in names}
    columns = {variable(name): (("chain", "draw"), chains[:, :, k], said[name]) for k, name in enumerate(names)}
    return xr.Dataset(columns, {"chain": np.arange(chains.shape[0]), "draw": np.arange(chains.shape[1])})


def _by_impact(columns: Mapping[str, FloatArray], shape: tuple[int, int, int], ids: list[str]) -> xr.Dataset:
    """Columns (draws, impacts) as (chain, draw, impact)."""
    dims = ("chain", "draw", "impact")
    made = {name: (dims, one.reshape(shape), {"units": SI_UNITS.get(name, "")}) for name, one in columns.items()}
    return xr.Dataset(made, {"chain": np.arange(shape[0]), "draw": np.arange(shape[1]), "impact": ids})


def _measured(table: ImpactTable) -> dict[str, xr.Dataset]:
    """Rebounds and incident states, as the fit took them."""
    groups = {
        "observed_data": {measurement.name: measurement.values for measurement in table.measurements},
        "constant_data": {name: getattr(table.impacts, name) for name in INCIDENT},
    }
    coords = {"impact": list(table.ids)}
    return {
        group: xr.Dataset({name: ("impact", one, {"units": SI_UNITS[name]}) for name, one in columns.items()}, coords)
        for group, columns in groups.items()
    }
