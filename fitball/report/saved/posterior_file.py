"""`posterior.nc`: draws, diagnostics and data in the layout ArviZ reads."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from fitball.data.hdf5_arrays import array, finite, group, opened
from fitball.inference.results.results import Fit, Posterior
from fitball.report.form.numbers import listed_places
from fitball.report.saved.netcdf import Variable, write_groups
from fitball.values import FloatArray
from fitball.wording import option

CHAINS = ("chain", "draw")


def variable(name: str) -> str:
    """The variable of a parameter: a slash, which a user's label may bring into its name, would open a group."""
    return name.replace("/", "\u2215")


def write_netcdf(fit: Fit, posterior: Posterior, path: Path) -> None:
    """Write groups posterior and sample_stats (chain = walker of an ensemble, draw = step), prior (all that was
    known before the table) and observed_data. Raises ResultFolderError.
    """
    groups = {
        "posterior": _draws(fit, posterior),
        "sample_stats": [Variable("lp", CHAINS, _chains(posterior.log_posterior))],
        "prior": _prior(posterior),
        "observed_data": _observed(fit),
    }
    write_groups(path, groups, model=fit.problem.model.name)


def _chains(values: FloatArray) -> FloatArray:
    """(ensembles, steps, walkers) as (chains, draws)."""
    ensembles, steps, walkers = values.shape
    return values.transpose(0, 2, 1).reshape(ensembles * walkers, steps)


def _draws(fit: Fit, posterior: Posterior) -> Iterator[Variable]:
    ensembles, steps, walkers, _ = posterior.values.shape
    yield Variable("chain", ("chain",), np.arange(ensembles * walkers))
    yield Variable("draw", ("draw",), np.arange(steps))
    yield Variable("ensemble", ("chain",), np.repeat(np.arange(ensembles), walkers))
    for k, name in enumerate(posterior.names):
        told = {"units": fit.parameters[name].unit, "coordinates": "ensemble"}
        yield Variable(variable(name), CHAINS, _chains(posterior.values[..., k]), told)


def _prior(posterior: Posterior) -> Iterator[Variable]:
    yield Variable("chain", ("chain",), np.arange(1))
    yield Variable("draw", ("draw",), np.arange(len(posterior.prior_draws)))
    for k, name in enumerate(posterior.names):
        yield Variable(variable(name), CHAINS, posterior.prior_draws[None, :, k])


def _observed(fit: Fit) -> Iterator[Variable]:
    table = fit.problem.table
    places = listed_places(len(table))
    yield Variable("impact", ("impact",), np.array([table.ids[k] for k in places], dtype=object))
    for observable in fit.problem.observables:
        yield Variable(observable.name, ("impact",), observable.everywhere(len(table)).observed[places])


def read_netcdf(path: Path, names: Sequence[str], shape: tuple[int, int, int]) -> Posterior:
    """The draws of `names` that `write_netcdf` wrote, of `shape` (ensembles, steps, walkers).

    Raises ResultFolderError for a file that is missing, damaged or foreign, or of another shape.
    """
    ensembles, steps, walkers = shape
    chains = (ensembles * walkers, steps)
    what = f"the posterior draws that belong to the fit.json beside it (a batch keeps them with {option('full')})"
    with opened(path, what) as file:
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
