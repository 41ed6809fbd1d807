"""Figures of a fit by name."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial

from matplotlib.axes import Axes

from fitball.base.errors import Note, ParameterError, suggestion
from fitball.base.text import listed
from fitball.base.values import Figure
from fitball.inference.fitted import Fitted
from fitball.report.blocks import Report, Text
from fitball.report.figures import FIGURES, drawable
from fitball.report.figures.chosen import ALL, Chosen
from fitball.report.page import Page
from fitball.report.style import FIGURE_FORMATS, Canvas, draw_styled, drawn_on

_WIDTH = re.compile(r"(\d+\.?\d*) ?(mm|cm|in)")
_PER_INCH = {"mm": 25.4, "cm": 2.54, "in": 1.0}
# Narrowest and widest figure [in]: 30 and 500 mm.
_NARROWEST = 30.0 / 25.4
_WIDEST = 500.0 / 25.4


@dataclass(frozen=True, eq=False)
class Plotted:
    """Figures `names` of a fit with what was `chosen` of them, which are to be files of the format
    `form`, of a `width` [in], or the usual one (0).
    """

    fit: Fitted
    names: tuple[str, ...]
    form: str
    chosen: Chosen = ALL
    width: float = 0.0
    notes: tuple[Note, ...] = ()


def width_of(text: str) -> float:
    """A width in words, `88mm` or `3.5 in`, in inches; 0 without one.

    Raises:
        ParameterError: it is no length of a figure (`width`).
    """
    if not text:
        return 0.0
    found = _WIDTH.fullmatch(text.strip())
    width = float(found[1]) / _PER_INCH[found[2]] if found else 0.0
    if not _NARROWEST <= width <= _WIDEST:
        wanted = "expected 30 to 500 mm, as in 88mm, 8.8cm or 3.5in"
        raise ParameterError(f"width: read '{text}', {wanted}", "width")
    return width


def choose_figures(
    fit: Fitted, names: Sequence[str], form: str, chosen: Chosen = ALL, width: float = 0.0
) -> Plotted:
    """The figures `names` of a fit, or all that it has data for and that show what was `chosen`.

    Raises:
        ParameterError: There is no such format (`format`) or figure (`unknown-figure`), the fit has
            no data for it (`no-such-data`), or it cannot show what was chosen
            (`not-for-this-figure`).
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
    options = [option for option, value in chosen._asdict().items() if value]
    for option in options:
        takers = [name for name, figure in FIGURES.items() if option in figure.takes]
        for name in names:
            if name not in takers:
                text = f"{option}: not for figure {name}; for {listed(takers, last='and')}"
                raise ParameterError(text, "not-for-this-figure")
    if names:
        return Plotted(fit, tuple(dict.fromkeys(names)), form, chosen, width)
    if options:
        fitting = [name for name in available if {*options} <= {*FIGURES[name].takes}]
        return Plotted(fit, tuple(fitting), form, chosen, width)
    missing = [name for name in FIGURES if name not in available]
    notes = []
    if missing:
        text = f"This fit has no data for {listed(missing, most=20)}."
        notes.append(Note("not-drawn", text))
    return Plotted(fit, available, form, width=width, notes=tuple(notes))


def report(result: Plotted) -> Report:
    """A report that lists the figures."""
    text = f"{listed(result.names, most=20)}, as {result.form}."
    return Report(
        f"Figures of {result.fit.run.table.name}",
        [Text([text, *(note.text for note in result.notes)])],
    )


def figures(result: Plotted) -> Mapping[str, Callable[[], Figure]]:
    """Functions that draw the figures, by name."""
    return {name: partial(drawn, result, name) for name in result.names}


def drawn(result: Plotted, name: str, axes: Axes | None = None) -> Figure:
    """A figure with what was chosen, of the width, or on axes of a user.

    Raises:
        ParameterError: there is no such parameter, column or group (`unknown-quantity`,
            `unknown-label`), or axes for several panels (`several-panels`).
    """
    with drawn_on(Canvas(result.width, axes)):
        return draw_styled(FIGURES[name].draw, result.fit, result.chosen)


PAGE = Page(report, figures)
