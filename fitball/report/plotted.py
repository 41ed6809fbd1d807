"""Figures of a fit by name."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial

from fitball.base.errors import Note, ParameterError, suggestion
from fitball.base.text import listed
from fitball.base.values import Figure
from fitball.inference.fitted import Fitted
from fitball.report.blocks import Report, Text
from fitball.report.figures import FIGURES, drawable
from fitball.report.page import Page
from fitball.report.style import FIGURE_FORMATS


@dataclass(frozen=True, eq=False)
class Plotted:
    """Figures `names` of a fit, which are to be files of the format `form`."""

    fit: Fitted
    names: tuple[str, ...]
    form: str
    notes: tuple[Note, ...] = ()


def choose_figures(fit: Fitted, names: Sequence[str], form: str) -> Plotted:
    """The figures `names` of a fit, or all that it has data for.

    Raises:
        ParameterError: There is no such format (`format`) or figure (`unknown-figure`), or the fit
            has no data for it (`no-such-data`).
    """
    if form not in FIGURE_FORMATS:
        raise ParameterError(
            f"format: read '{form}', expected {listed(FIGURE_FORMATS, last='or')}",
            "format",
        )
    available = drawable(fit)
    for name in names:
        if name not in FIGURES:
            raise ParameterError(
                f"no figure '{name}': {suggestion(name, FIGURES)}",
                "unknown-figure",
            )
        if name not in available:
            text = (
                f"figure {name}: this fit has no data for it; it has {listed(available, most=20)}"
            )
            raise ParameterError(text, "no-such-data")
    if names:
        return Plotted(fit, tuple(dict.fromkeys(names)), form)
    missing = [name for name in FIGURES if name not in available]
    notes = []
    if missing:
        text = f"This fit has no data for {listed(missing, most=20)}."
        notes.append(Note("not-drawn", text))
    return Plotted(fit, available, form, tuple(notes))


def report(result: Plotted) -> Report:
    """A report that lists the figures."""
    text = f"{listed(result.names, most=20)}, as {result.form}."
    return Report(
        f"Figures of {result.fit.run.table.name}",
        [Text([text, *(note.text for note in result.notes)])],
    )


def figures(result: Plotted) -> Mapping[str, Callable[[], Figure]]:
    """Functions that draw the figures, by name."""
    return {name: partial(FIGURES[name].draw, result.fit) for name in result.names}


PAGE = Page(report, figures)
