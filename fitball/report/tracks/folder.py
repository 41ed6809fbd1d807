"""The folder of tracked impacts: the table with its covariances and scene, the frames, the page; all or none."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path

import tomli_w

from fitball.files import all_or_none
from fitball.report.form.document import as_page
from fitball.report.form.files import csv_text, write_csv, write_text
from fitball.report.tracks.document import picture_name, pictured, track_document
from fitball.tracks.frames import Tracks
from fitball.tracks.impacts import covariance_rows, frame_rows, impact_rows, scene_tree, spin_rows

# The table is written last: where it is, all others are.
TABLE = "impacts.csv"
SPINS = "spins.csv"
OTHERS = ("impacts_covariance.csv", "impacts.toml", "tracks.csv", SPINS, "tracks.html")


@all_or_none()
def write_all(
    tracks: Tracks,
    sources: Sequence[str],
    scene: str | os.PathLike[str] | None,
    folder: Path,
    command: str | None = None,
    figures: bool = True,
) -> tuple[Path, ...]:
    """Write every file, each whole or not at all; returns their places. Raises ResultFolderError."""
    images = rendered_images(tracks) if figures else {}
    covariances, toml, frames, spins, page = (folder / name for name in OTHERS)
    write_text(page, as_page(track_document(tracks, sources, None, images, command), images))
    write_csv(frames, frame_rows(tracks))
    rows = spin_rows(tracks)
    if rows:
        write_text(spins, csv_text(rows))
    write_text(toml, tomli_w.dumps(scene_tree(tracks, scene, [Path(name).name for name in sources])))
    write_csv(covariances, covariance_rows(tracks))
    write_text(folder / TABLE, csv_text(impact_rows(tracks)))
    return tuple(place for place in (folder / TABLE, covariances, toml, frames, spins, page) if place.exists())


def rendered_images(tracks: Tracks) -> dict[str, bytes]:
    """The PNG files of the page, by name."""
    from fitball.report.figures.canvas import rendered
    from fitball.report.form.document import DPI
    from fitball.report.tracks.figure import impact_figure, session_figure

    images = {picture_name(it, tracks): rendered(impact_figure(it, tracks), "png", DPI) for it in pictured(tracks)}
    if len(tracks.impacts) > 1:
        images["session"] = rendered(session_figure(tracks), "png", DPI)
    return images
