"""The figures of a fit by name, and what is said of each: nothing here draws, so that it loads at once."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

# Dots an inch of figures as PNG files.
DPI = 150


@dataclass(frozen=True)
class FigureText:
    """A figure in words: a line of help, its `caption`, and the section of the page it stands in (an id in
    `html.SECTIONS`).
    """

    summary: str
    caption: str
    section: str


# In the order of the page.
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
