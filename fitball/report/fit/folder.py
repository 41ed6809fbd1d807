"""The result folder: may it be written, and the writing of it, `fit.json` last."""

from __future__ import annotations

import os
from functools import partial
from pathlib import Path

from matplotlib.figure import Figure

from fitball.errors import ResultFolderError
from fitball.inference.results.results import Fit
from fitball.report.figures.kinds import KINDS, drawable_kinds
from fitball.report.fit.alt_texts import alt_texts
from fitball.report.fit.csv_tables import prediction_rows, regime_rows, summary_rows, write_csv
from fitball.report.fit.embedded_figures import page_figures
from fitball.report.fit.html import CAPTIONS, page
from fitball.report.form.atomic_write import remove, write_text, write_whole
from fitball.report.saved.data_file import DATA_NAME, write_data
from fitball.report.saved.fit_text import fit_text
from fitball.report.saved.posterior_file import write_netcdf
from fitball.report.saved.run_file import RUN_NAME, run_text
from fitball.report.saved.saved_fit import FIT_NAME, POSTERIOR_NAME

CHAIN_NAME = "posterior.h5"
DPI = 150


def prepare(folder: Path, *, overwrite: bool, resume: bool) -> None:
    """Make the folder, or refuse.

    Raises ResultFolderError when it cannot be made or written, or when it holds an older result and neither
    `overwrite` nor `resume` was asked for. With `overwrite` an old chain and `fit.json` are removed first, so
    that no mixture of two results can remain.
    """
    make_folder(folder)
    older = [name for name in (FIT_NAME, CHAIN_NAME) if (folder / name).exists()]
    if not older or resume:
        return
    if not overwrite:
        raise ResultFolderError(
            f"{folder}: holds {' and '.join(older)} of an older run; use --resume to go on with it, --overwrite to "
            "replace it, or --out to write elsewhere"
        )
    for name in older:
        remove(folder / name)


def holds_older(folder: Path, record: str, *, overwrite: bool) -> bool:
    """Make a folder that can be written; whether it holds an older `record` that is to be replaced.

    Raises ResultFolderError when it cannot be made, or holds one that may not.
    """
    make_folder(folder)
    if not (folder / record).exists():
        return False
    if not overwrite:
        raise ResultFolderError(
            f"{folder}: holds {record} of an older run; use --overwrite to replace it, or --out to write elsewhere"
        )
    return True


def make_folder(folder: Path) -> None:
    """Make a folder that can be written. Raises ResultFolderError."""
    if folder.exists() and not folder.is_dir():
        raise ResultFolderError(f"{folder}: is a file; name a folder with --out")
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ResultFolderError(f"{folder}: cannot be made: {error.strerror}; name another with --out") from None
    if not os.access(folder, os.W_OK | os.X_OK):
        raise ResultFolderError(f"{folder}: not writable; name another with --out")


def write_all(fit: Fit, folder: Path, command: str | None = None) -> None:
    """Write every file of a result, each whole or not at all; `command` is the line that asked for it.

    Raises ResultFolderError.
    """
    remove(folder / FIT_NAME)
    posterior = fit.posterior
    if posterior is not None:
        write_netcdf(fit, posterior, folder / POSTERIOR_NAME)
    if fit.predictive is not None:
        write_csv(folder / "regimes.csv", regime_rows(fit, fit.predictive))
    figures = {name: KINDS[name].draw(fit, posterior) for name in drawable_kinds(fit, posterior)}
    for name, figure in figures.items():
        write_whole(folder / f"{name}.png", partial(save_png, figure))
        # Laid out once: the page draws it again as it stands.
        figure.set_layout_engine("none")
    write_data(fit.problem, folder / DATA_NAME)
    write_csv(folder / "summary.csv", summary_rows(fit))
    write_csv(folder / "predictions.csv", prediction_rows(fit))
    write_csv(folder / "balances.csv", fit.balances.rows())
    write_text(folder / RUN_NAME, run_text(fit, folder))
    shown = page_figures(figures, CAPTIONS, alt_texts(fit), len(fit.problem.table))
    write_text(folder / "report.html", page(fit, shown, command))
    write_text(folder / FIT_NAME, fit_text(fit))


def save_png(figure: Figure, place: Path) -> None:
    """Save without the version stamp, so that equal figures are equal files."""
    figure.savefig(place, format="png", dpi=DPI, metadata={"Software": None})
