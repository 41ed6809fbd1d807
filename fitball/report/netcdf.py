"""`posterior.nc`: draws, diagnostics and data in the layout ArviZ reads."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import xarray as xr

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
