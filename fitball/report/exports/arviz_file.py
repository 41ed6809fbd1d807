"""Draws and data of a saved fit for ArviZ, built from what the fit saved."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import xarray as xr

from fitball.errors import ResultFolderError
from fitball.inference.results import Posterior, RunStatus
from fitball.report.files import write_whole
from fitball.report.saved_fit import POSTERIOR_NAME, SavedFit
from fitball.version import __version__

_UNITS = {"v_x1": "m/s", "v_y1": "m/s", "omega_1": "rad/s", "omega_2": "rad/s", "theta_2": "rad", "contact_time": "s"}


def arviz_tree(saved: SavedFit) -> tuple[xr.DataTree, str]:
    """Groups `posterior`, `sample_stats`, `prior` (those two with all draws only), `observed_data`, `constant_data`
    (incident states), and a note: empty when all draws were there.

    All draws are in `posterior.nc` beside `fit.json`; where that is missing, the thinned ones of `fit.json` make one
    chain. Raises ResultFolderError for a point fit, and for a `posterior.nc` that is damaged or of another fit.
    """
    if saved.status is RunStatus.POINT_ONLY or saved.fitted.draws.shape[0] == 0:
        raise ResultFolderError(f"{saved.place}: a point fit has no draws to export; calibrate without --point-only")
    groups = {"observed_data": _observed(saved), "constant_data": _incident(saved)}
    place = saved.place.with_name(POSTERIOR_NAME)
    note = ""
    if place.exists():
        posterior = saved.posterior()
        assert posterior is not None
        groups = _all_draws(saved, posterior) | groups
    else:
        count = saved.fitted.draws.shape[0]
        note = f"{place} is missing: the file holds the {count} draws of fit.json as one chain, out of order"
        free = [name for name in saved.fitted.names if _is_free(saved, name)]
        columns = [saved.fitted.names.index(name) for name in free]
        groups = {"posterior": _draws(saved, free, saved.fitted.draws[None][:, :, columns])} | groups
    tree = xr.DataTree.from_dict(groups)
    tree.attrs = {
        "created_by": f"fitball {__version__}",
        "model": saved.fitted.model_name,
        "status": str(saved.status),
    }
    return tree, note


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
            name: (("chain", "draw"), chains[:, :, k], {"units": known[name].unit, "long_name": known[name].meaning})
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
        "prior": _draws(saved, names, posterior.reference[None]),
    }


def _observed(saved: SavedFit) -> xr.Dataset:
    data = saved.content["data"]
    return xr.Dataset(
        {
            item["name"]: ("impact", np.array(item["values"]), {"units": _UNITS.get(item["name"], "m/s")})
            for item in data["measurements"]
        },
        coords={"impact": list(data["ids"])},
    )


def _incident(saved: SavedFit) -> xr.Dataset:
    data = saved.content["data"]
    return xr.Dataset(
        {name: ("impact", np.array(column), {"units": _UNITS[name]}) for name, column in data["impacts"].items()},
        coords={"impact": list(data["ids"])},
    )
