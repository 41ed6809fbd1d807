"""Figures of a fit: curves, corner, forest, residuals, predictive, profiles, trace, regimes,
regime_map.
"""

from collections.abc import Callable, Mapping

from fitball.base.values import Figure
from fitball.inference.fitted import Fitted
from fitball.report.figures import parameters, predictions

# What draws each, in the order of the page.
FIGURES: Mapping[str, Callable[[Fitted], Figure]] = {
    "curves": predictions.curves,
    "corner": parameters.corner,
    "profiles": parameters.profiles,
    "forest": parameters.forest,
    "predictive": predictions.predictive,
    "regimes": predictions.regimes,
    "regime_map": predictions.regime_map,
    "residuals": predictions.residuals,
    "trace": parameters.trace,
}


def drawable(fit: Fitted) -> tuple[str, ...]:
    """Names of those that a fit has data for."""
    frame = fit.predictions
    sliding = bool((frame["regime"] != "").any())
    known = {
        "curves": len(fit.curves) > 0,
        "corner": fit.posterior is not None and len(parameters.cornered(fit)) > 0,
        "profiles": len(fit.profiles) > 0,
        "forest": len(parameters.varied(fit)) > 0,
        "predictive": bool(frame["observed"].notna().any()),
        "regimes": sliding,
        "regime_map": sliding,
        "residuals": bool(frame["z"].notna().any()),
        "trace": fit.posterior is not None,
    }
    return tuple(name for name in FIGURES if known[name])
