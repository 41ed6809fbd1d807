"""The result folder of a fit: may it be written, the writing of it, `fit.json` last, and its tables for machines."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path

import numpy as np

from fitball.errors import ResultFolderError
from fitball.files import all_or_none
from fitball.inference.results.quantiles import ESSENTIALS
from fitball.inference.results.results import Estimate, Fit, Predictive
from fitball.report.figures.quantities import prediction_of
from fitball.report.figures.registry import FIGURES, write_figures
from fitball.report.fit.document import page
from fitball.report.fit.rows import summary_rows
from fitball.report.form.files import OWN_FILES, remove, write_csv, write_text
from fitball.report.form.folders import clear_leftovers, make_folder
from fitball.report.form.numbers import listed_places
from fitball.report.saved.fit_file import fit_text
from fitball.report.saved.netcdf_files import DATA_NAME, POSTERIOR_NAME, write_data, write_netcdf
from fitball.report.saved.run_file import RUN_NAME, run_text
from fitball.report.saved.structure import FIT_NAME
from fitball.wording import spoken

CHAIN_NAME = "posterior.h5"
# What is derived from a fit, figures besides.
DERIVED = ("summary.csv", "predictions.csv", "balances.csv", "regimes.csv", "report.html")


def older_result(folder: Path) -> list[str]:
    """Names of the files of a fit that lie in the folder."""
    return [name for name in (FIT_NAME, CHAIN_NAME) if (folder / name).exists()]


def prepare_folder(folder: Path, *, overwrite: bool, resume: bool) -> None:
    """Make the folder, or refuse.

    Raises ResultFolderError when it cannot be made or written, or when it holds an older result and neither
    `overwrite` nor `resume` was asked for. All files of an old one that is replaced, or of one that was not finished,
    are removed first, so that no mixture of two results can remain: the new one may have fewer.
    """
    make_folder(folder)
    # The folder of a table of a batch, which is held as a whole.
    clear_leftovers(folder)
    older = older_result(folder)
    if older and not (overwrite or resume):
        raise ResultFolderError(
            f"{folder}: holds {' and '.join(older)} of an older run; use "
            + spoken(
                "--resume to go on with it, --overwrite to replace it, or --out to write elsewhere",
                "overwrite=True to replace it, or name another folder",
            )
        )
    # What was killed while it wrote left some files and no `fit.json`.
    ours = any((folder / name).exists() for name in OWN_FILES)
    if ours and not resume and (overwrite or not older):
        pictures = (f"{name}.png" for name in FIGURES)
        for name in (FIT_NAME, CHAIN_NAME, DATA_NAME, POSTERIOR_NAME, RUN_NAME, *DERIVED, *pictures):
            remove(folder / name)


@all_or_none()
def write_all(fit: Fit, folder: Path, command: str | None = None, *, figures: bool = True) -> None:
    """Write every file of a result, each whole or not at all; `command` is the line that asked for it. Figures of an
    older result that this one has not, or is to be without, are removed.

    Raises ResultFolderError.
    """
    remove(folder / FIT_NAME)
    # First: by this one knows what a killed run has left.
    write_data(fit.problem, folder / DATA_NAME)
    posterior = fit.posterior
    if posterior is not None:
        write_netcdf(fit, posterior, folder / POSTERIOR_NAME)
    if fit.predictive is not None:
        write_csv(folder / "regimes.csv", regime_rows(fit, fit.predictive))
    images = write_figures(fit, folder) if figures else {}
    for name in FIGURES.keys() - images.keys():
        remove(folder / f"{name}.png")
    write_csv(folder / "summary.csv", summary_rows(fit))
    write_csv(folder / "predictions.csv", prediction_rows(fit))
    write_csv(folder / "balances.csv", fit.balances.rows(listed_places(len(fit.problem.table))))
    write_text(folder / RUN_NAME, run_text(fit, folder))
    write_text(folder / "report.html", page(fit, images, command))
    write_text(folder / FIT_NAME, fit_text(fit))


def prediction_rows(fit: Fit) -> Iterator[dict[str, object]]:
    """One row per impact and measured column: measured (empty where it was not), predicted, with intervals in SI
    (angles in radians).
    """
    for observable in (item.everywhere(len(fit.problem.table)) for item in fit.problem.observables):
        point, prediction = observable.predict(fit.point.rebound)[0], prediction_of(fit, observable)
        for k in listed_places(len(fit.problem.table)):
            row: dict[str, object] = {
                "id": fit.problem.table.ids[k],
                "output": observable.name,
                "measured": float(observable.observed[k]),
                "point": float(point[k]),
            }
            for key in ("median", "mean_q025", "mean_q16", "mean_q84", "mean_q975", "data_q025", "data_q975", "sd"):
                row[key] = None if prediction is None else float(getattr(prediction, key)[k])
            yield row


def regime_rows(fit: Fit, predictive: Predictive) -> Iterator[dict[str, object]]:
    """One row per impact and phase sequence with its posterior probability."""
    for k in listed_places(len(fit.problem.table)):
        for regime, share in predictive.regimes[k].items():
            yield {"id": fit.problem.table.ids[k], "regime": regime, "probability": float(np.round(share, 6))}


def render_json(fit: Fit, folder: Path) -> str:
    """The summary for machines: everything but draws; the full parameter set is in `fit.json`."""
    content = {
        "status": fit.status,
        "verdict": fit.verdict,
        "drop_test": None if fit.drop_test is None else asdict(fit.drop_test),
        "adequacy": None if fit.adequacy is None else asdict(fit.adequacy),
        "model": fit.problem.model.name,
        "table": fit.problem.table.name,
        "folder": str(folder),
        "parameters": {estimate.name: _numbers(estimate) for estimate in fit.estimates},
        "derived": {estimate.name: _numbers(estimate) for estimate in fit.derived.values()},
        "rms": dict(fit.point.rms),
        "court_pace": None if fit.court_pace is None else asdict(fit.court_pace),
        "assumptions": None if fit.assumptions is None else asdict(fit.assumptions),
        "notes": fit.notes,
        "seconds": {timing.stage: timing.seconds for timing in fit.timings},
    }
    return json.dumps(content, indent=2, allow_nan=False)


def _numbers(estimate: Estimate) -> dict[str, object]:
    names = ("unit", *ESSENTIALS, "point", "verdict", "given", "reason")
    return {name: getattr(estimate, name) for name in names}
