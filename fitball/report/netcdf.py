"""`posterior.nc`: draws, diagnostics and data in the layout ArviZ reads."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import xarray as xr

from fitball.errors import ResultFolderError
from fitball.inference.fitted import FittedModel
from fitball.inference.predictive import thinned
from fitball.inference.results import Fit, Posterior
from fitball.report.files import write_whole
from fitball.version import __version__


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
            name: (("chain", "draw"), chains[:, :, k], {"units": fit.parameters[name].unit})
            for k, name in enumerate(posterior.names)
        },
        coords={"chain": np.arange(ensembles * walkers), "draw": np.arange(steps), "ensemble": ("chain", owner)},
        attrs={"created_by": f"fitball {__version__}", "model": fit.problem.model.name},
    )
    prior = xr.Dataset(
        {name: (("chain", "draw"), posterior.reference[None, :, k]) for k, name in enumerate(posterior.names)},
        coords={"chain": [0], "draw": np.arange(len(posterior.reference))},
    )
    data = xr.Dataset(
        {channel.name: ("impact", channel.observed) for channel in fit.problem.channels},
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


def read_netcdf(path: Path) -> Posterior:
    """What `write_netcdf` wrote. Raises ResultFolderError for a missing, damaged or foreign file."""
    if not path.exists():
        raise ResultFolderError(
            f"{path}: there is no such file; it holds the posterior draws and belongs to fit.json"
        )
    try:
        with xr.open_datatree(path, engine="h5netcdf") as tree:
            draws, scores = tree["posterior"].dataset, tree["sample_stats"].dataset["lp"].to_numpy()
            names = tuple(str(name) for name in draws.data_vars)
            ensembles = int(np.unique(draws["ensemble"].to_numpy()).size)
            chains = np.stack([draws[name].to_numpy() for name in names], axis=-1)
            reference = np.stack([tree["prior"].dataset[name].to_numpy()[0] for name in names], axis=-1)
            walkers, steps = chains.shape[0] // ensembles, chains.shape[1]
            values = chains.reshape(ensembles, walkers, steps, -1).transpose(0, 2, 1, 3)
            log_posterior = scores.reshape(ensembles, walkers, steps).transpose(0, 2, 1)
    except (OSError, KeyError, ValueError) as error:
        raise ResultFolderError(f"{path}: not a posterior written by fitball, or damaged: {error}") from None
    return Posterior(names, values, log_posterior, reference)


def saved_draws(fitted: FittedModel, path: Path, count: int) -> FittedModel:
    """`fitted` with `count` draws of the posterior at `path`, evenly spaced.

    `fit.json` holds some of the same draws: unless they are equal to the last digit the two files belong to different
    runs. Raises ResultFolderError for that, and as `read_netcdf` does.
    """
    posterior = read_netcdf(path)
    unknown = set(posterior.names) - set(fitted.names)
    kept = None if unknown else fitted.with_draws(posterior.names, thinned(posterior, fitted.draws.shape[0])).draws
    if kept is None or not np.array_equal(kept, fitted.draws):
        raise ResultFolderError(
            f"{path}: these draws are of another fit than the fit.json beside them; calibrate again, or put the "
            "files of one run together"
        )
    return fitted.with_draws(posterior.names, thinned(posterior, count))
