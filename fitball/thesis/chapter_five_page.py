"""The page and the files of `fitball rederive`; `report.html` last."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from fitball.data.scene import load_scene
from fitball.files import all_or_none
from fitball.report.figures.embed import embed
from fitball.report.figures.save import save_figure
from fitball.report.form.atomic_write import write_text
from fitball.report.form.folders import make_folder
from fitball.report.form.template import render_template
from fitball.thesis import ranking, recalibration
from fitball.thesis.chapter_five import ChapterFive
from fitball.thesis.chapter_five_figures import CAPTIONS, draw_all


@all_or_none()
def write(chapter: ChapterFive, folder: Path) -> None:
    """Write CSV files, figures and the page, each whole or not at all. Raises ResultFolderError."""
    make_folder(folder)
    for name, frame in chapter.tables.items():
        write_text(folder / f"{name}.csv", frame.to_csv(index=False, float_format="%.6g", lineterminator="\n"))
    images = {name: save_figure(draw(), folder / f"{name}.png") for name, draw in draw_all(chapter).items()}
    write_text(folder / "report.html", page(chapter, images))


def page(chapter: ChapterFive, images: Mapping[str, bytes]) -> str:
    """The page as text."""
    off = chapter.appendix_c.exceptions
    beyond = off[off["column"].isin(("v_x2", "omega_2")) & (off["error [%]"].abs() > 1.0)]
    return render_template(
        "fitball.thesis",
        "chapter_five.html.j2",
        found=chapter,
        figures={name: embed(images[name], said, said) for name, said in CAPTIONS.items() if name in images},
        tables=chapter.tables,
        text=_text,
        brief=ranking.in_brief(chapter.rankings),
        scene=load_scene(recalibration.TABLE),
        scales=ranking.SCALE,
        resamples=ranking.RESAMPLES,
        beyond=beyond,
        inertia_shares=", ".join(f"{name} {100.0 * share:.0f} %" for name, share in chapter.inertia.shares.items()),
    )


def _text(value: object) -> str:
    """A cell, numbers to four significant digits."""
    if isinstance(value, (bool, np.bool_)):
        return "yes" if value else "no"
    if isinstance(value, (float, np.floating)):
        return "" if np.isnan(value) else f"{value:.4g}"
    return str(value)
