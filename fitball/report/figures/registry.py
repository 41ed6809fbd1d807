"""The figures of a fit by name, what is said of each, and the module that draws it, loaded when it is asked to."""

from __future__ import annotations

import gc
from collections.abc import Mapping
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Protocol, cast

from fitball.errors import ResultFolderError

if TYPE_CHECKING:
    from fitball.inference.results.results import Fit
    from fitball.report.figures.canvas import Figure


@dataclass(frozen=True)
class FigureText:
    """What is said of a figure: a line of help, its `caption`, and the section of the page it stands in."""

    summary: str
    caption: str
    section: str


# In the order of the page; each is drawn by the module of its name.
FIGURES: Mapping[str, FigureText] = {
    "sketch": FigureText(
        "the ball of the model, with the symbols of its parameters",
        "The ball as the model has it, with the symbols of its parameters and the signs of the state.",
        "parameters",
    ),
    "predictive": FigureText(
        "measured against predicted rebounds, with intervals",
        "Measured against predicted, beside the line where both are equal. Bars at each prediction: 95 % of a new "
        "measurement, with noise (light), and, where there are draws, of what the parameters leave open (dark).",
        "predictions",
    ),
    "curves": FigureText(
        "rebound over incidence angle at stated speeds and spins",
        "What the model makes of impacts at a stated speed and spin, with those near it (both within a tenth of the "
        "speed, the spin by its surface speed); all others stand back. Of drops: over the speed.",
        "predictions",
    ),
    "residuals": FigureText(
        "standardised residuals against every incident quantity and group",
        "Standardised residuals against every incident quantity, by group, and against normal quantiles.",
        "predictions",
    ),
    "force": FigureText(
        "force-time records against the posterior prediction",
        "Force records (points: means of samples, with the sensor's noise) against the model: 95 % of its force "
        "(dark) and of a record (light: with sensor noise and misfit).",
        "predictions",
    ),
    "regimes": FigureText(
        "posterior probability of each phase sequence, impact by impact",
        "Posterior probability of each sequence of slip and grip, impact by impact.",
        "predictions",
    ),
    "profiles": FigureText(
        "profile likelihood of every parameter",
        "Profile likelihood of every parameter: the best fit for each of its values, below the best of all; "
        "intervals of 68 and 95 % end at -0.5 and -1.92. Bars: 95 % of the posterior.",
        "evidence",
    ),
    "corner": FigureText(
        "posterior of all pairs of parameters, with priors",
        "Posterior of all pairs of parameters, with the prior on the diagonal and the point estimate.",
        "evidence",
    ),
    "trace": FigureText(
        "walkers of every ensemble after warm-up",
        "Walkers of every ensemble after warm-up, or chains of weighed draws, and the marginals of each.",
        "diagnosis",
    ),
}


class Drawing(Protocol):
    """The module of a figure."""

    def figure(self, fit: Fit) -> Figure:
        """The figure of a fit that has what it shows."""

    def missing(self, fit: Fit) -> str:
        """Why a fit cannot show it, "" where it can."""

    def words(self, fit: Fit) -> str:
        """What it shows, for readers who do not see it."""


def drawing(name: str) -> Drawing:
    """The module of the figure `name`."""
    return cast(Drawing, import_module(f"fitball.report.figures.{name}"))


def draw(name: str, fit: Fit) -> Figure:
    """A figure by name. Raises ResultFolderError where the fit has not what it shows."""
    from fitball.report.figures.canvas import own_style

    if missing := drawing(name).missing(fit):
        raise ResultFolderError(f"{name}: {missing}")
    with own_style():
        return drawing(name).figure(fit)


def drawable_kinds(fit: Fit) -> list[str]:
    """The figures this fit can show."""
    return [name for name in FIGURES if not drawing(name).missing(fit)]


def write_figures(fit: Fit, folder: Path) -> dict[str, bytes]:
    """Draw every figure that the fit can show; returns the files written by name. Raises ResultFolderError."""
    # Whoever wants no figures does not load what draws them.
    from fitball.report.figures.canvas import save_figure

    images = {}
    # A drawing is ten thousand objects, which do not make those of the fit garbage: looking through these again and
    # again would take an eighth of the time.
    gc.freeze()
    try:
        for name in drawable_kinds(fit):
            images[name] = save_figure(draw(name, fit), folder / f"{name}.png")
    finally:
        gc.unfreeze()
    return images


def alt_text(name: str, fit: Fit) -> str:
    """What a figure that this fit can show shows, in words and numbers."""
    return drawing(name).words(fit)
