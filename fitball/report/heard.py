"""Page of bounces that were heard: times, intervals, speeds, restitution, pictures."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from functools import partial

import numpy as np
from matplotlib.axes import Axes

from fitball.base.display_units import M_PER_S, MS, PLAIN
from fitball.base.numbers import counted
from fitball.base.text import one_line
from fitball.base.values import DataFrame, Figure
from fitball.report.blocks import Block, Mark, Picture, Report, Section, Table, Text
from fitball.report.own_folder import FOLDER
from fitball.report.style import GUIDE_COLOUR, MEASURED_COLOUR, MOVED_COLOUR, new_figure
from fitball.tracks.film import Filmed
from fitball.tracks.sounds import Heard
from fitball.video.onsets import Bounces
from fitball.video.sound import Recording

# Bounces of a table, which a page can still show.
_BOUNCES_LISTED = 300
# Recordings that a page has a picture of.
_MOST_PICTURES = 6
# Bounces that are shown near, and how much before and after each begin [s].
_NEAR = 4
_BEFORE = 4e-3
_AFTER = 12e-3
# Parts of a recording of which the least and the largest sample are drawn.
_PARTS = 3000
_NEXT = f"Next: `fitball calibrate {FOLDER}/impacts.csv`, which has a row a bounce, with its time."
_PICTURE = (
    "lines are begins of bounces, dotted ones other sudden sounds. Below, begins of bounces "
    "nearer, with a band of two standard errors to either side."
)


def report(film: Filmed) -> Report:
    """The report of recordings: the answer, the table of bounces, notes, pictures."""
    heard = _heard(film)
    bounces = heard.bounces
    runs = bounces["run"].nunique()
    drops = f" of {counted(runs, 'drop')}" if runs > 1 else ""
    answer = f"{counted(len(bounces), 'bounce')}{drops} heard."
    without = f"{counted(len(film.refused), 'recording')} without bounces." if film.refused else ""
    cor = bounces["cor"].dropna()
    range_of_cor = ""
    if len(cor):
        low, high = (PLAIN.number(end, 3) for end in (cor.min(), cor.max()))
        range_of_cor = f"Coefficient of restitution {low} to {high}."
    rows = [*_rows(bounces)]
    summary: list[Block] = [
        Text([Mark(answer, "good"), *filter(None, (range_of_cor, without))], "lead"),
        Table("Bounces", rows[:_BOUNCES_LISTED], (), "`bounces.csv`", len(rows)),
        Text([note.text for note in film.notes], "list"),
        Text([_NEXT]),
        *(Picture(name, f"{title}: {_PICTURE}") for name, title in _pictures(heard)),
    ]
    refused = [{"recording": one_line(name), "reason": why} for name, why in film.refused.items()]
    sections = [Section("Recordings without bounces", [Table("", refused, ("reason",))])]
    return Report(f"{counted(len(bounces), 'bounce')} heard", summary, sections)


def figures(film: Filmed) -> Mapping[str, Callable[[], Figure]]:
    """Functions that draw figures, by name: `recording-1` and so on."""
    heard = _heard(film)
    names = [name for name, _ in _pictures(heard)]
    return {
        name: partial(_draw, recording, series)
        for name, (recording, series) in zip(names, heard.recordings, strict=False)
    }


def _heard(film: Filmed) -> Heard:
    """What was heard, of a film that was."""
    if film.heard is None:
        raise ValueError("nothing was heard")
    return film.heard


def _pictures(heard: Heard) -> Iterator[tuple[str, str]]:
    """Names and titles of the pictures of recordings."""
    for number, (recording, _) in enumerate(heard.recordings[:_MOST_PICTURES], 1):
        yield f"recording-{number}", one_line(recording.name)


def _rows(bounces: DataFrame) -> Iterator[dict[str, str]]:
    """Rows of the table of bounces."""
    for row in bounces.to_dict("records"):
        texts = {"run": one_line(str(row["run"])), "bounce": str(row["bounce"])}
        texts["time [s]"] = PLAIN.plus_minus(row["time [s]"], row["time_sd [s]"])
        interval = MS.plus_minus(row["interval [s]"], row["interval_sd [s]"])
        texts["interval [ms]"] = interval
        for name in ("v_y1", "v_y2"):
            head = f"{name} [m/s]"
            texts[head] = M_PER_S.plus_minus(row[head], row[f"{name}_sd [m/s]"])
        texts["cor"] = PLAIN.plus_minus(row["cor"], row["cor_sd"])
        yield texts


def _draw(recording: Recording, series: tuple[Bounces, ...]) -> Figure:
    """Draw a recording with the begins of its bounces, and some of these nearer."""
    figure, panels = new_figure(2, _NEAR, high=4.2, wide=8.0)
    grid = panels[0, 0].get_gridspec()
    for axes in panels[0]:
        axes.remove()
    whole = figure.add_subplot(grid[0, :])
    _draw_whole(whole, recording)
    times = np.concatenate([bounces.time for bounces in series])
    sds = np.concatenate([bounces.sd for bounces in series])
    others = np.concatenate([bounces.others for bounces in series])
    for time in times:
        whole.axvline(time, color=MOVED_COLOUR, linewidth=0.8)
    for time in others:
        whole.axvline(time, color=GUIDE_COLOUR, linewidth=0.8, linestyle=":")
    whole.set(xlabel="time [s]", ylabel="sound", title=one_line(recording.name))
    shown = np.unique(np.linspace(0, times.size - 1, _NEAR).round().astype(int))
    for axes, k in zip(panels[1], shown, strict=False):
        _draw_near(axes, recording, float(times[k]), float(sds[k]))
    for axes in panels[1][shown.size :]:
        axes.remove()
    return figure


def _draw_whole(axes: Axes, recording: Recording) -> None:
    """Draw the least and largest sample of each part of a recording."""
    length = max(recording.signal.size // _PARTS, 1)
    parts = recording.signal[: recording.signal.size // length * length].reshape(-1, length)
    clock = (np.arange(len(parts)) + 0.5) * length / recording.rate
    low, high = parts.min(axis=1), parts.max(axis=1)
    axes.fill_between(clock, low, high, color=MEASURED_COLOUR, linewidth=0.4)
    axes.set_xlim(0.0, recording.signal.size / recording.rate)


def _draw_near(axes: Axes, recording: Recording, time: float, sd: float) -> None:
    """Draw the samples around the begin of a bounce [s], with two sds to either side."""
    first = max(int((time - _BEFORE) * recording.rate), 0)
    last = int((time + _AFTER) * recording.rate)
    samples = recording.signal[first:last]
    clock = MS.factor * ((first + np.arange(samples.size)) / recording.rate - time)
    axes.plot(clock, samples, color=MEASURED_COLOUR, linewidth=0.8)
    axes.axvspan(-2.0 * MS.factor * sd, 2.0 * MS.factor * sd, color=MOVED_COLOUR, alpha=0.3)
    axes.axvline(0.0, color=MOVED_COLOUR, linewidth=0.8)
    axes.set(xlabel="time [ms]", title=f"{time:.4f} s")
    axes.set_yticks([])
