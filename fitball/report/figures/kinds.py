"""Figures by name, of a fit just made or read back, in the format that is asked for."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import matplotlib as mpl
from matplotlib.figure import Figure

from fitball.errors import ResultFolderError
from fitball.inference.results.results import Posterior
from fitball.report.figures.corner import corner_figure
from fitball.report.figures.drawable import Drawable
from fitball.report.figures.force import force_figure
from fitball.report.figures.predictive import predictive_figure, residual_figure, trace_figure
from fitball.report.figures.profiles import profiles_figure
from fitball.report.figures.regimes import regimes_figure
from fitball.report.form.atomic_write import write_whole

DPI = 150
# What would make equal figures unequal files: stamps of time and version.
STAMPS: Mapping[str, dict[str, Any]] = {
    "png": {"Software": None},
    "svg": {"Date": None, "Creator": None},
    "pdf": {"CreationDate": None, "Creator": None, "Producer": None},
}


@dataclass(frozen=True)
class Kind:
    """A figure: whether it needs posterior draws, and how it is drawn."""

    needs_posterior: bool
    draw: Callable[[Drawable, Posterior | None], Figure]


def _corner(fit: Drawable, posterior: Posterior | None) -> Figure:
    return corner_figure(fit, _drawn(posterior))


def _trace(fit: Drawable, posterior: Posterior | None) -> Figure:
    return trace_figure(fit, _drawn(posterior))


def _regimes(fit: Drawable, _posterior: Posterior | None) -> Figure:
    if fit.predictive is None:
        raise ResultFolderError("the probability of regimes needs a posterior; run calibrate without --point-only")
    if not has_regimes(fit):
        raise ResultFolderError("there are no regimes: no motion along the court was measured")
    return regimes_figure(fit, fit.predictive)


def _drawn(posterior: Posterior | None) -> Posterior:
    if posterior is None:
        raise ResultFolderError("this figure needs a posterior; run calibrate without --point-only")
    return posterior


def _profiles(fit: Drawable, posterior: Posterior | None) -> Figure:
    if not has_profiles(fit):
        raise ResultFolderError(f"there are no profiles: {fit.identifiability.profiles_missing}")
    return profiles_figure(fit, posterior)


def _force(fit: Drawable, posterior: Posterior | None) -> Figure:
    if not has_force(fit):
        raise ResultFolderError("there are no force records in this fit")
    return force_figure(fit, posterior)


KINDS: Mapping[str, Kind] = {
    "corner": Kind(True, _corner),
    "trace": Kind(True, _trace),
    "predictive": Kind(False, lambda fit, _posterior: predictive_figure(fit)),
    "residuals": Kind(False, lambda fit, _posterior: residual_figure(fit)),
    "profiles": Kind(False, _profiles),
    "regimes": Kind(True, _regimes),
    "force": Kind(False, _force),
}


def has_profiles(fit: Drawable) -> bool:
    """Whether any parameter has one."""
    return any(evidence.profile is not None for evidence in fit.identifiability.evidence.values())


def has_regimes(fit: Drawable) -> bool:
    """Whether the contact has phases: it has none without motion along the court."""
    return fit.predictive is not None and fit.problem.table.has_tangential


def has_force(fit: Drawable) -> bool:
    """Whether force-time records took part."""
    return fit.problem.force is not None


def drawable_kinds(fit: Drawable, posterior: Posterior | None) -> list[str]:
    """The kinds this fit can show."""
    present = {"profiles": has_profiles(fit), "regimes": has_regimes(fit), "force": has_force(fit)}
    return [
        name
        for name, kind in KINDS.items()
        if (posterior is not None or not kind.needs_posterior) and present.get(name, True)
    ]


def save_figure(figure: Figure, place: Path, form: str, dpi: int = DPI) -> None:
    """Write a figure whole as png, svg or pdf; equal figures become equal files. Raises ResultFolderError."""

    def write(target: Path) -> None:
        with mpl.rc_context({"svg.hashsalt": "fitball"}):
            figure.savefig(target, format=form, dpi=dpi, metadata=STAMPS[form])

    write_whole(place, write)
