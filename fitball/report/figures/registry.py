"""The figures of a fit by name, what is said of each, why a fit may not have it, and what draws it, loaded when it is
asked to.
"""

from __future__ import annotations

import gc
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

from fitball.errors import ResultFolderError
from fitball.wording import option

if TYPE_CHECKING:
    from fitball.inference.results.results import Fit
    from fitball.report.figures.canvas import Figure


def nothing(_fit: Fit) -> str:
    """Every fit has such a figure."""
    return ""


def no_posterior(fit: Fit) -> str:
    """Why a fit has no figure of its posterior, "" where it has; so the others."""
    return "" if fit.posterior is not None else f"it needs a posterior; run calibrate without {option('point_only')}"


def no_records(fit: Fit) -> str:
    """Of force records."""
    return "" if fit.problem.force is not None else "there are no force records in this fit"


def no_regimes(fit: Fit) -> str:
    """Of the regimes of its impacts."""
    if fit.predictive is None:
        return f"the probability of regimes needs a posterior; run calibrate without {option('point_only')}"
    return "" if fit.problem.table.has_tangential else "no motion along the court was measured: there are no regimes"


def no_profiles(fit: Fit) -> str:
    """Of profiles."""
    if any(evidence.profile is not None for evidence in fit.identifiability.evidence.values()):
        return ""
    return f"there are no profiles: {fit.identifiability.profiles_missing}"


@dataclass(frozen=True)
class Kind:
    """A figure: a line of help, its `caption`, the section of the page it stands in, the `module` whose functions
    `NAME_figure` and `NAME_words` draw it and put it in words and numbers for who does not see it; and why a fit is
    `without` it, "" where it has what it shows.
    """

    summary: str
    caption: str
    section: str
    module: str
    without: Callable[[Fit], str] = nothing

    def of(self, name: str) -> Callable[[Fit], Any]:
        """A function of its module."""
        found: Callable[[Fit], Any] = getattr(import_module(f"fitball.report.figures.{self.module}"), name)
        return found


# In the order of the page.
FIGURES: Mapping[str, Kind] = {
    "sketch": Kind(
        "the ball of the model, with the symbols of its parameters",
        "The ball as the model has it, with the symbols of its parameters and the signs of the state.",
        "parameters",
        "sketch",
    ),
    "predictive": Kind(
        "measured against predicted rebounds, with intervals",
        "Measured against predicted, beside the line where both are equal. Bars at each prediction: 95 % of a new "
        "measurement, with noise (light), and, where there are draws, of what the parameters leave open (dark).",
        "predictions",
        "measured",
    ),
    "curves": Kind(
        "rebound over incidence angle at stated speeds and spins",
        "What the model makes of impacts at a stated speed and spin, with those near it (both within a tenth of the "
        "speed, the spin by its surface speed); all others stand back. Of drops: over the speed.",
        "predictions",
        "predictions",
    ),
    "residuals": Kind(
        "standardised residuals against every incident quantity and group",
        "Standardised residuals against every incident quantity, by group, and against normal quantiles.",
        "predictions",
        "measured",
    ),
    "force": Kind(
        "force-time records against the posterior prediction",
        "Force records (points: means of samples, with the sensor's noise) against the model: 95 % of its force "
        "(dark) and of a record (light: with sensor noise and misfit).",
        "predictions",
        "predictions",
        no_records,
    ),
    "regimes": Kind(
        "posterior probability of each phase sequence, impact by impact",
        "Posterior probability of each sequence of slip and grip, impact by impact.",
        "predictions",
        "predictions",
        no_regimes,
    ),
    "profiles": Kind(
        "profile likelihood of every parameter",
        "Profile likelihood of every parameter: the best fit for each of its values, below the best of all; "
        "intervals of 68 and 95 % end at -0.5 and -1.92. Bars: 95 % of the posterior.",
        "evidence",
        "evidence",
        no_profiles,
    ),
    "corner": Kind(
        "posterior of all pairs of parameters, with priors",
        "Posterior of all pairs of parameters, with the prior on the diagonal and the point estimate.",
        "evidence",
        "evidence",
        no_posterior,
    ),
    "trace": Kind(
        "walkers of every ensemble after warm-up",
        "Walkers of every ensemble after warm-up, or chains of weighed draws, and the marginals of each.",
        "diagnosis",
        "evidence",
        no_posterior,
    ),
}


def draw(name: str, fit: Fit) -> Figure:
    """A figure by name. Raises ResultFolderError where the fit has not what it shows."""
    from fitball.report.figures.canvas import own_style

    kind = FIGURES[name]
    if missing := kind.without(fit):
        raise ResultFolderError(f"{name}: {missing}")
    with own_style():
        figure: Figure = kind.of(f"{name}_figure")(fit)
    return figure


def drawable_kinds(fit: Fit) -> list[str]:
    """The figures this fit can show."""
    return [name for name, kind in FIGURES.items() if not kind.without(fit)]


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
    return str(FIGURES[name].of(f"{name}_words")(fit))
