"""Draws and data of a saved fit for ArviZ, built from what the fit saved."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import xarray as xr

from fitball.errors import ResultFolderError
from fitball.inference.results.results import Posterior, RunStatus
from fitball.observables import SI_UNITS
from fitball.report.form.atomic_write import write_whole
from fitball.report.saved.data_file import DATA_NAME, INCIDENT
from fitball.report.saved.posterior_file import variable
from fitball.report.saved.saved_fit import POSTERIOR_NAME, SavedFit
from fitball.version import __version__


def arviz_tree(saved: SavedFit) -> tuple[xr.DataTree, str]:
    """Groups `posterior`, `sample_stats`, `prior` (those two with all draws only), `observed_data`, `constant_data`
    (incident states), and a note: empty when all draws and measurements were there.

    All draws are in `posterior.nc` beside `fit.json`; where that is missing, the thinned ones of `fit.json` make one
    chain. Measurements are in `data.nc`. Raises ResultFolderError for a point fit, and for either file when it is
    damaged or of another fit.
    """
    if saved.status is RunStatus.POINT_ONLY or saved.fitted.draws.shape[0] == 0:
        raise ResultFolderError(f"{saved.place}: a point fit has no draws to export; calibrate without --point-only")
    place, data = (saved.place.with_name(name) for name in (POSTERIOR_NAME, DATA_NAME))
    notes = [] if data.exists() else [f"{data} is missing: the file holds no measurements"]
    groups = _measured(saved) if data.exists() else {}
    if place.exists():
        posterior = saved.posterior()
        assert posterior is not None
        groups = _all_draws(saved, posterior) | groups
    else:
        count = saved.fitted.draws.shape[0]
        notes.append(f"{place} is missing: the file holds the {count} draws of fit.json as one chain, out of order")
        free = [name for name in saved.fitted.names if _is_free(saved, name)]
        columns = [saved.fitted.names.index(name) for name in free]
        groups = {"posterior": _draws(saved, free, saved.fitted.draws[None][:, :, columns])} | groups
    tree = xr.DataTree.from_dict(groups)
    tree.attrs = {
        "created_by": f"fitball {__version__}",
        "model": saved.fitted.model_name,
        "status": str(saved.status),
    }
    return tree, "; ".join(notes)


def write_arviz(saved: SavedFit, path: Path) -> str:
    """Write the file whole; returns the note. Raises ResultFolderError as `arviz_tree` does."""
    tree, note = arviz_tree(saved)
    write_whole(path, lambda place: tree.to_netcdf(place, engine="h5netcdf"))
    return note


def _is_free(saved: SavedFit, name: str) -> bool:
    return name in saved.parameters and saved.parameters[name].sd is not None


def _draws(saved: SavedFit, names: list[str], chains: np.ndarray) -> xr.Dataset:
    """`chains` (chains, draws, names) as a dataset with units and meanings."""
    known = saved.parameters
    return xr.Dataset(
        {
            variable(name): (
                ("chain", "draw"),
                chains[:, :, k],
                {"units": known[name].unit, "long_name": known[name].meaning},
            )
            for k, name in enumerate(names)
        },
        coords={"chain": np.arange(chains.shape[0]), "draw": np.arange(chains.shape[1])},
    )


def _all_draws(saved: SavedFit, posterior: Posterior) -> dict[str, xr.Dataset]:
    ensembles, steps, walkers, size = posterior.values.shape
    chains = posterior.values.transpose(0, 2, 1, 3).reshape(ensembles * walkers, steps, size)
    scores = posterior.log_posterior.transpose(0, 2, 1).reshape(ensembles * walkers, steps)
    names = list(posterior.names)
    draws = _draws(saved, names, chains).assign_coords(ensemble=("chain", np.repeat(np.arange(ensembles), walkers)))
    coords = {"chain": draws["chain"], "draw": draws["draw"]}
    return {
        "posterior": draws,
        "sample_stats": xr.Dataset({"lp": (("chain", "draw"), scores)}, coords=coords),
        "prior": _draws(saved, names, posterior.prior_draws[None]),
    }


def _measured(saved: SavedFit) -> dict[str, xr.Dataset]:
    """Rebounds and incident states, as the fit took them."""
    data, _force = saved.measured()
    rebounds = {measurement.name: measurement.values for measurement in data.measurements}
    incident = {name: getattr(data.impacts, name) for name in INCIDENT}
    return {
        group: xr.Dataset(
            {name: ("impact", column, {"units": SI_UNITS[name]}) for name, column in columns.items()},
            coords={"impact": list(data.ids)},
        )
        for group, columns in (("observed_data", rebounds), ("constant_data", incident))
    }
