"""The result folder: may it be written, and the writing of it, `fit.json` last."""

from __future__ import annotations

from pathlib import Path

from fitball.errors import ResultFolderError
from fitball.files import all_or_none
from fitball.inference.results.results import Fit
from fitball.report.figures.names import FIGURES
from fitball.report.fit.csv_tables import prediction_rows, regime_rows, summary_rows
from fitball.report.fit.html import page
from fitball.report.form.atomic_write import OWN_FILES, remove, write_text
from fitball.report.form.csv import write_csv
from fitball.report.form.folders import clear_leftovers, make_folder
from fitball.report.form.listed import listed_places
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


def write_figures(fit: Fit, folder: Path) -> dict[str, bytes]:
    """Draw every figure that the fit can show; returns the files written by name. Raises ResultFolderError."""
    # Whoever wants no figures does not load what draws them.
    from fitball.report.figures.kinds import draw, drawable_kinds
    from fitball.report.figures.save import save_figure

    return {name: save_figure(draw(name, fit), folder / f"{name}.png") for name in drawable_kinds(fit)}
