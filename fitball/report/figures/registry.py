"""The figures of a fit by name: caption, why a fit may not have it, and the module that draws it."""

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
    if not fit.problem.table.has_tangential:
        return "no motion along the court was measured: there are no regimes"
    return "" if fit.problem.model.has_regimes else f"model {fit.fitted.model_name} has no regimes"


def no_profiles(fit: Fit) -> str:
    """Of profiles."""
    if any(evidence.profile is not None for evidence in fit.identifiability.evidence.values()):
        return ""
    return f"there are no profiles: {fit.identifiability.profiles_missing}"


def no_variants(fit: Fit) -> str:
    """Of model variants."""
    found = fit.assumptions
    if found is None or found.missing:
        return "model assumptions were not examined" + (f": {found.missing}" if found is not None else "")
    return "" if found.as_good else "no model variant fits equally well"


# Modules whose figures show rebounds that are computed anew.
REBOUNDS = ("predictions", "measured")


@dataclass(frozen=True)
class Kind:
    """A figure: a line of help, its `caption`, its `section` of the page ("" for the top), and the `module` whose
    functions `NAME_figure` and `NAME_words` draw it and describe it in words; and why a fit is `without` it, "" where
    it has what it shows.
    """

    summary: str
    caption: str
    section: str
    module: str
    without: Callable[[Fit], str] = nothing

    def lacks(self, fit: Fit) -> str:
        """Why a fit has no such figure, "" where it has what it shows; new rebounds need the model."""
        return (fit.fitted.model.without if self.module in REBOUNDS else "") or self.without(fit)

    def function(self, name: str) -> Callable[[Fit], Any]:
        """A function of its module."""
        found: Callable[[Fit], Any] = getattr(import_module(f"fitball.report.figures.{self.module}"), name)
        return found


# In the order of the page.
FIGURES: Mapping[str, Kind] = {
    "curves": Kind(
        "rebound over incidence angle at stated speeds and spins",
        "Model and measurements near each stated speed and spin (within a tenth of that speed; of spin, the surface "
        "speed counts). Grey: all other impacts. Bands: 68 and 95 % credible intervals, "
        "without measurement noise.",
        "",
        "predictions",
    ),
    "corner": Kind(
        "posterior of all pairs of parameters, with priors",
        "Posterior of all pairs of parameters, with the prior on the diagonal and the point estimate.",
        "posterior",
        "evidence",
        no_posterior,
    ),
    "forest": Kind(
        "parameters under model variants that fit equally well",
        "Median and 95 % interval of each quantity under this fit (band) and under each model variant that fits "
        "equally well. The quantities whose medians move most are shown; above each panel the largest move in sds of "
        "this fit. A variant is in colour where the median, or an end of the interval outwards, moves by more than "
        "2 sd.",
        "assumptions",
        "assumptions",
        no_variants,
    ),
    "predictive": Kind(
        "measured against predicted rebounds, with intervals",
        "Measured against predicted rebounds; on the line both are equal. Light bars: 95 % interval of a new "
        "measurement, with noise. Dark bars: 95 % credible interval of the model.",
        "predictions",
        "measured",
    ),
    "force": Kind(
        "force-time records against the posterior prediction",
        "Force records (points: means of samples, with sensor noise). Dark band: 95 % interval of the model's force. "
        "Light band: that of a record, with sensor noise and misfit.",
        "predictions",
        "predictions",
        no_records,
    ),
    "residuals": Kind(
        "standardised residuals against every incident quantity and group",
        "Standardised residuals against every incident quantity, by group, and against normal quantiles.",
        "adequacy",
        "measured",
    ),
    "regimes": Kind(
        "posterior probability of each phase sequence, impact by impact",
        "Posterior probability of each sequence of slip and grip, for each impact.",
        "regimes",
        "predictions",
        no_regimes,
    ),
    "sketch": Kind(
        "the ball of the model, with the symbols of its parameters",
        "The model's ball, with the symbols of its parameters and the signs of the incident and rebound states.",
        "parameters",
        "sketch",
    ),
    "profiles": Kind(
        "profile likelihood of every parameter",
        "Profile likelihood of every parameter: the best fit at each of its values, relative to the best fit of all. "
        "The 68 and 95 % intervals end at -0.5 and -1.92. Bars: 95 % credible interval.",
        "evidence",
        "evidence",
        no_profiles,
    ),
    "trace": Kind(
        "walkers of every ensemble after warm-up",
        "Walkers of every ensemble after warm-up (or chains of weighted draws), and the marginals of each.",
        "diagnosis",
        "evidence",
        no_posterior,
    ),
}


def draw(name: str, fit: Fit) -> Figure:
    """A figure by name. Raises ResultFolderError where the fit does not have what it shows."""
    from fitball.report.figures.canvas import own_style

    kind = FIGURES[name]
    if missing := kind.lacks(fit):
        raise ResultFolderError(f"{name}: {missing}")
    with own_style():
        figure: Figure = kind.function(f"{name}_figure")(fit)
    return figure


def drawable_kinds(fit: Fit) -> list[str]:
    """The figures this fit can show."""
    return [name for name, kind in FIGURES.items() if not kind.lacks(fit)]


def write_figures(fit: Fit, folder: Path) -> dict[str, bytes]:
    """Draw every figure that the fit can show; returns the files written by name. Raises ResultFolderError."""
    # Not loaded for a fit without figures.
    from fitball.report.figures.canvas import save_figure

    images = {}
    # A drawing makes ten thousand objects: searching those of the fit for garbage takes an eighth of the time.
    gc.freeze()
    try:
        for name in drawable_kinds(fit):
            images[name] = save_figure(draw(name, fit), folder / f"{name}.png")
    finally:
        gc.unfreeze()
    return images


def alt_text(name: str, fit: Fit) -> str:
    """A figure that this fit can show, in words and numbers."""
    return str(FIGURES[name].function(f"{name}_words")(fit))
