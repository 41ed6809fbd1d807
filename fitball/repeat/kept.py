"""A run as it lies in its folder, or as it was just made again: what a repetition compares."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from fitball.errors import ResultFolderError
from fitball.files import all_or_none
from fitball.inference.problem.problem import Problem
from fitball.inference.results.results import Fit, Posterior
from fitball.inference.results.source import data_columns
from fitball.inference.sampling.chain_file import EnsembleChain, read_chains
from fitball.report.fit.folder import CHAIN_NAME
from fitball.report.form.files import write_text
from fitball.report.saved.fit_file import fit_text, read_fit, read_posterior
from fitball.report.saved.netcdf_files import DATA_NAME, POSTERIOR_NAME, read_columns, write_data, write_netcdf
from fitball.report.saved.structure import FIT_NAME


@dataclass(frozen=True)
class Kept:
    """What a result folder says: `fit.json`, the draws in `posterior.nc` (None for a point fit), and the chains with
    their warm-up (None where there is no `posterior.h5`: a fit saved from Python has none).
    """

    folder: Path
    saved: Fit
    posterior: Posterior | None
    chains: tuple[EnsembleChain, ...] | None

    @cached_property
    def content(self) -> Mapping[str, Any]:
        """`fit.json`."""
        content: Mapping[str, Any] = json.loads(fit_text(self.saved))
        return content


def read_kept(folder: Path) -> Kept:
    """Read a result folder. Raises ResultFolderError for what is missing, damaged or foreign."""
    saved = read_fit(folder)
    posterior, chain = read_posterior(saved, folder / FIT_NAME, agreeing=False), folder / CHAIN_NAME
    chains = tuple(read_chains(chain)[2]) if chain.exists() and posterior is not None else None
    return Kept(folder, saved, posterior, chains)


def check_rows(problem: Problem, original: Kept) -> None:
    """Raise ResultFolderError unless the rows of the files are those the fit was made from, to the last digit."""
    place = original.folder / DATA_NAME
    kept, now = read_columns(original.saved.source, place), data_columns(problem.table, problem.force)
    # Names of tables, and so ids and labels, may differ: a file may lie elsewhere under another name.
    numbers = [name for name, column in now.items() if column.dtype.kind in "fi"]
    changed = [
        name for name in numbers if name not in kept or not np.array_equal(now[name], kept[name], equal_nan=True)
    ]
    if changed:
        raise ResultFolderError(
            f"{place}: its {' and '.join(changed)} are not those of {problem.table.source}: the "
            "table was changed in Python before it was fitted, or this file was changed since; calibrate anew"
        )


@all_or_none()
def write_numbers(fit: Fit, folder: Path) -> None:
    """Write what a repetition compares, and no figures. Raises ResultFolderError."""
    if fit.posterior is not None:
        write_netcdf(fit, fit.posterior, folder / POSTERIOR_NAME)
    write_data(fit.problem, folder / DATA_NAME)
    write_text(folder / FIT_NAME, fit_text(fit))
