"""`posterior.nc`: draws, diagnostics and data in the layout ArviZ reads."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import xarray as xr

from fitball.data.hdf5_arrays import array, finite, group, opened
from fitball.inference.results.results import Fit, Posterior
from fitball.report.form.atomic_write import write_whole
from fitball.version import __version__


def variable(name: str) -> str:
    """The variable of a parameter: a slash, which a user's label may bring into its name, would open a group."""
    return name.replace("/", "\u2215")


def write_netcdf(fit: Fit, posterior: Posterior, path: Path) -> None:
    """Write groups posterior and sample_stats (chain = walker of an ensemble, draw = step), prior (all that was
    known before the table) and observed_data. Raises ResultFolderError.
    """
    ensembles, steps, walkers, _ = posterior.values.shape
    chains = posterior.values.transpose(0, 2, 1, 3).reshape(ensembles * walkers, steps, -1)
    scores = posterior.log_posterior.transpose(0, 2, 1).reshape(ensembles * walkers, steps)
    owner = np.repeat(np.arange(ensembles), walkers)
    draws = xr.Dataset(
        {
            variable(name): (("chain", "draw"), chains[:, :, k], {"units": fit.parameters[name].unit})
            for k, name in enumerate(posterior.names)
        },
        coords={"chain": np.arange(ensembles * walkers), "draw": np.arange(steps), "ensemble": ("chain", owner)},
        attrs={"created_by": f"fitball {__version__}", "model": fit.problem.model.name},
    )
    prior = xr.Dataset(
        {
            variable(name): (("chain", "draw"), posterior.prior_draws[None, :, k])
            for k, name in enumerate(posterior.names)
        },
        coords={"chain": [0], "draw": np.arange(len(posterior.prior_draws))},
    )
    data = xr.Dataset(
        {
            observable.name: ("impact", observable.everywhere(len(fit.problem.table)).observed)
            for observable in fit.problem.observables
        },
        coords={"impact": list(fit.problem.table.ids)},
    )
    tree = xr.DataTree.from_dict(
        {
            "posterior": draws,
            "sample_stats": xr.Dataset({"lp": (("chain", "draw"), scores)}),
            "prior": prior,
            "observed_data": data,
        }
    )
    write_whole(path, lambda place: tree.to_netcdf(place, engine="h5netcdf"))


def read_netcdf(path: Path, names: Sequence[str], shape: tuple[int, int, int]) -> Posterior:
    """The draws of `names` that `write_netcdf` wrote, of `shape` (ensembles, steps, walkers).

    Raises ResultFolderError for a file that is missing, damaged or foreign, or of another shape.
    """
    ensembles, steps, walkers = shape
    chains = (ensembles * walkers, steps)
    with opened(path, "the posterior draws that belong to the fit.json beside it") as file:
        kept, known = group(file, "posterior"), group(file, "prior")
        owner = array(kept, "ensemble", chains[:1], "iu")
        if not np.array_equal(owner, np.repeat(np.arange(ensembles), walkers)):
            raise ValueError(f"/posterior/ensemble: expected {walkers} chains of each of {ensembles} ensembles")
        draws = np.stack([finite(kept, variable(name), chains) for name in names], axis=-1)
        scores = finite(group(file, "sample_stats"), "lp", chains)
        reference = np.stack([finite(known, variable(name), (1, None))[0] for name in names], axis=-1)
    return Posterior(
        tuple(names),
        np.ascontiguousarray(draws.reshape(ensembles, walkers, steps, -1).transpose(0, 2, 1, 3)),
        np.ascontiguousarray(scores.reshape(ensembles, walkers, steps).transpose(0, 2, 1)),
        reference,
    )
