"""Figures by name, of a fit just made or read back, in the format that is asked for."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from matplotlib.figure import Figure

from fitball.errors import ResultFolderError
from fitball.inference.results.results import Fit
from fitball.report.figures.corner import corner_figure
from fitball.report.figures.curves import curves_figure
from fitball.report.figures.force import force_figure
from fitball.report.figures.predictive import predictive_figure
from fitball.report.figures.profiles import profiles_figure
from fitball.report.figures.regimes import regimes_figure
from fitball.report.figures.residuals import residuals_figure
from fitball.report.figures.sketch import sketch_figure
from fitball.report.figures.style import own_style
from fitball.report.figures.trace import trace_figure
from fitball.wording import option


def has_profiles(fit: Fit) -> bool:
    """Whether any parameter has one."""
    return any(evidence.profile is not None for evidence in fit.identifiability.evidence.values())


def _no_posterior(fit: Fit) -> str:
    return "" if fit.posterior is not None else f"it needs a posterior; run calibrate without {option('point_only')}"


def _no_regimes(fit: Fit) -> str:
    if fit.predictive is None:
        return f"the probability of regimes needs a posterior; run calibrate without {option('point_only')}"
    return "" if fit.problem.table.has_tangential else "no motion along the court was measured: there are no regimes"


def _no_profiles(fit: Fit) -> str:
    return "" if has_profiles(fit) else f"there are no profiles: {fit.identifiability.profiles_missing}"


def _no_force(fit: Fit) -> str:
    return "" if fit.problem.force is not None else "there are no force records in this fit"


@dataclass(frozen=True)
class Kind:
    """How a figure is drawn, and why a fit cannot show it ("" where it can)."""

    draw: Callable[[Fit], Figure]
    missing: Callable[[Fit], str] = lambda _fit: ""


# The figures of `names.FIGURES`.
KINDS: Mapping[str, Kind] = {
    "sketch": Kind(sketch_figure),
    "predictive": Kind(predictive_figure),
    "curves": Kind(curves_figure),
    "residuals": Kind(residuals_figure),
    "force": Kind(force_figure, _no_force),
    "regimes": Kind(regimes_figure, _no_regimes),
    "profiles": Kind(profiles_figure, _no_profiles),
    "corner": Kind(corner_figure, _no_posterior),
    "trace": Kind(trace_figure, _no_posterior),
}


@own_style()
def draw(name: str, fit: Fit) -> Figure:
    """A figure by name. Raises ResultFolderError where the fit has not what it shows."""
    missing = KINDS[name].missing(fit)
    if missing:
        raise ResultFolderError(f"{name}: {missing}")
    return KINDS[name].draw(fit)


def drawable_kinds(fit: Fit) -> list[str]:
    """The figures this fit can show."""
    return [name for name, kind in KINDS.items() if not kind.missing(fit)]
