"""The page and the files of `fitball rederive`; `report.html` last."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from fitball.data.scene import load_scene
from fitball.data.thesis_tables import thesis_table
from fitball.errors import ResultFolderError
from fitball.report.figures.embed import embed
from fitball.report.figures.save import save_figure
from fitball.report.form.atomic_write import write_text
from fitball.report.form.template import render_template
from fitball.studies.thesis import appendix_c, appendix_d, printed_tables, ranking, recalibration
from fitball.studies.thesis.chapter_five import ChapterFive
from fitball.studies.thesis.chapter_five_figures import CAPTIONS, draw_all


@dataclass(frozen=True)
class ShownTable:
    """A table as text: `heads` and `rows` of equal length."""

    heads: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]


def shown(frame: pd.DataFrame) -> ShownTable:
    """A frame with numbers to four significant digits."""
    return ShownTable(
        tuple(str(name) for name in frame.columns),
        tuple(tuple(_text(value) for value in row) for row in frame.itertuples(index=False)),
    )


def _text(value: object) -> str:
    if isinstance(value, (bool, np.bool_)):
        return "yes" if value else "no"
    if isinstance(value, (float, np.floating)):
        return "" if np.isnan(value) else f"{value:.4g}"
    return str(value)


def tables(chapter: ChapterFive) -> dict[str, pd.DataFrame]:
    """Every table that is written beside the page, by the stem of its file."""
    frames = {
        "appendix_c": chapter.appendix_c.rows,
        "appendix_c_shares": appendix_c.shares(chapter.appendix_c.rows),
        "appendix_c_shares_as_printed": appendix_c.shares(chapter.strict),
        "appendix_c_shares_by_case": appendix_c.shares_by_case(chapter.appendix_c.rows),
        "appendix_c_exceptions": chapter.appendix_c.exceptions,
        "slips": chapter.slips,
        "appendix_d": chapter.appendix_d,
        "appendix_d_exceptions": appendix_d.deviations(chapter.appendix_d),
        "energies": chapter.energies,
        "mean_friction": chapter.friction,
        "damping": chapter.damping,
        "examples": chapter.examples,
        "figures_36_to_44": printed_tables.figures_36_to_44(),
        "rankings": ranking.side_by_side(chapter.rankings),
        "computation_slips": chapter.computation_slips,
        "fits": recalibration.fit_table(chapter.fits),
        "parameters": recalibration.parameter_table(chapter.fits),
        "offsets": recalibration.offset_table(chapter.fits),
        "errata": thesis_table("errata"),
    }
    for name, one in {**chapter.rankings, "chapter_v": chapter.ranking_chapter_five}.items():
        frames |= {f"ranking_{name}": one.scores, f"ranking_{name}_certainty": one.certainty}
    return frames | {f"credible_levels_{name}": item.points for name, item in chapter.fits.items()}


def _rows_beyond(chapter: ChapterFive) -> pd.DataFrame:
    """Rows of Appendix C beyond 1 % in velocity or spin, with their cause."""
    off = chapter.appendix_c.exceptions
    return off[off["column"].isin(("v_x2", "omega_2")) & (off["error [%]"].abs() > 1.0)]


def write(chapter: ChapterFive, folder: Path) -> None:
    """Write CSV files, figures and the page, each whole or not at all. Raises ResultFolderError."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ResultFolderError(f"{folder}: cannot be made: {error.strerror}; name another with --out") from None
    frames = tables(chapter)
    for name, frame in frames.items():
        write_text(folder / f"{name}.csv", frame.to_csv(index=False, float_format="%.6g", lineterminator="\n"))
    images: dict[str, bytes] = {}
    for name, draw in draw_all(chapter).items():
        images[name] = save_figure(draw(), folder / f"{name}.png")
    write_text(folder / "report.html", page(chapter, frames, images))


def page(chapter: ChapterFive, frames: Mapping[str, pd.DataFrame], images: Mapping[str, bytes]) -> str:
    """The page as text."""
    scene = load_scene(recalibration.TABLE)
    return render_template(
        "fitball.studies",
        "chapter_five.html.j2",
        found=chapter,
        figures={name: embed(images[name], said, said) for name, said in CAPTIONS.items() if name in images},
        tables={name: shown(frame) for name, frame in frames.items()},
        brief=shown(ranking.in_brief(chapter.rankings)),
        scene=scene,
        scales=ranking.SCALE,
        resamples=ranking.RESAMPLES,
        beyond=shown(_rows_beyond(chapter)),
        inertia_shares=", ".join(f"{name} {100.0 * share:.0f} %" for name, share in chapter.inertia_shares.items()),
    )
