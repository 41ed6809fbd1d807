"""Figures of a fit, a row each: what draws it, which fits have data for it, its caption, and where
the page has it.
"""

from collections.abc import Callable, Mapping
from typing import Literal, NamedTuple, TypeAlias

from fitball.base.values import Figure
from fitball.inference.fitted import Fitted
from fitball.report.figures import parameters, predictions
from fitball.report.figures.chosen import Chosen

# The part of the page, by the title of its section.
Place: TypeAlias = Literal[
    "summary",
    "All parameters",
    "Model assumptions",
    "Measured and predicted",
    "Residuals",
    "Sampling and least squares",
]


class FitFigure(NamedTuple):
    """A figure that `draw` makes of a fit for which `has_data` is true. The `caption` is a text, or
    a function of the fit where it depends on that. The page has the figure at its `place`; a figure
    that is not `usual` is drawn only where all figures are wanted. It `takes` fields of `Chosen`.
    """

    draw: Callable[[Fitted, Chosen], Figure]
    has_data: Callable[[Fitted], bool]
    caption: str | Callable[[Fitted], str]
    place: Place
    usual: bool = True
    takes: tuple[str, ...] = ()

    def caption_of(self, fit: Fitted) -> str:
        """The caption below the figure of a fit."""
        return self.caption if isinstance(self.caption, str) else self.caption(fit)


def _has_curves(fit: Fitted) -> bool:
    return len(fit.curves) > 0


def _is_sampled(fit: Fitted) -> bool:
    return fit.posterior is not None


def _has_pairs(fit: Fitted) -> bool:
    return fit.posterior is not None and len(parameters.corner_names(fit)) > 0


def _has_profiles(fit: Fitted) -> bool:
    return len(fit.profiles) > 0


def _has_variants(fit: Fitted) -> bool:
    return len(parameters.forest_variants(fit)) > 0


def _has_observations(fit: Fitted) -> bool:
    return bool(fit.predictions["observed"].notna().any())


def _has_regimes(fit: Fitted) -> bool:
    return bool((fit.predictions["regime"] != "").any())


def _has_residuals(fit: Fitted) -> bool:
    return bool(fit.predictions["z"].notna().any())


# In the order of the page.
FIGURES: Mapping[str, FitFigure] = {
    "curves": FitFigure(
        predictions.draw_curves,
        _has_curves,
        predictions.curves_caption,
        "summary",
        takes=("columns", "groups"),
    ),
    "corner": FitFigure(
        parameters.draw_corner,
        _has_pairs,
        "Posterior in pairs of parameters, the first nine if there are more. Ticks: 95 % "
        "intervals. Orange: priors.",
        "All parameters",
        takes=("parameters",),
    ),
    "profiles": FitFigure(
        parameters.draw_profiles,
        _has_profiles,
        "Log likelihood below its maximum, all other parameters fitted again, and 95 % intervals.",
        "All parameters",
        usual=False,
        takes=("parameters",),
    ),
    "forest": FitFigure(
        parameters.draw_forest,
        _has_variants,
        "The values that move most, by median or an end of the interval. Band: 95 % interval of "
        "this fit.",
        "Model assumptions",
        takes=("parameters",),
    ),
    "predictive": FitFigure(
        predictions.draw_predictive,
        _has_observations,
        "Measured against predicted. Bars: 95 % of new measurements.",
        "Measured and predicted",
        takes=("columns",),
    ),
    "regimes": FitFigure(
        predictions.draw_regimes,
        _has_regimes,
        "Which sequence of slip and grip each impact has, and how probable it is; at most 40 "
        "impacts.",
        "Measured and predicted",
        usual=False,
    ),
    "regime_map": FitFigure(
        predictions.draw_regime_map,
        _has_regimes,
        "Slip and grip over angle and spin by the best fit, with lines of equal rebound angle.",
        "Measured and predicted",
        usual=False,
    ),
    "residuals": FitFigure(
        predictions.draw_residuals,
        _has_residuals,
        "Residuals in sds of the noise. Grey: ± 2 sd.",
        "Residuals",
        takes=("columns",),
    ),
    "trace": FitFigure(
        parameters.draw_trace,
        _is_sampled,
        "Some walkers of each ensemble after warm-up, a colour an ensemble; first weighted draws, "
        "if there are any. Grey: the median of all.",
        "Sampling and least squares",
        usual=False,
        takes=("parameters",),
    ),
}


def drawable(fit: Fitted) -> tuple[str, ...]:
    """Names of the figures that a fit has data for."""
    return tuple(name for name, figure in FIGURES.items() if figure.has_data(fit))
