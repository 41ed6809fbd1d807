"""The figure of profile likelihoods: one panel per parameter, with the levels that end its intervals."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from fitball.inference.identifiability.profile import DROP_68, DROP_95
from fitball.inference.results.evidence import Profile
from fitball.inference.results.results import Fit
from fitball.report.figures.canvas import (
    Margins,
    drawn_handles,
    filled,
    fit_heading,
    legend_below,
    log_scale,
    verbatim,
)
from fitball.report.figures.quantities import ParameterAxis, parameter, parameter_axis
from fitball.report.form.numbers import handy, profile_interval
from fitball.report.form.palette import GUIDE, MEASURED, MODEL
from fitball.values import FloatArray
from fitball.wording import short

# Lowest log likelihood shown, a little below the 95 % level at -1.92.
LOWEST = -2.6
CURVE_POINTS = 201


@dataclass(frozen=True)
class ProfilePanel:
    """One parameter in a handy unit: log likelihood below its maximum at the points of the profile and along a
    `curve` (2, points) through them, the curve without the scene's contact time (empty where it is the same), the
    part of the axis shown, and the posterior's 95 % interval.
    """

    name: str
    axis: ParameterAxis
    values: FloatArray
    log_likelihood: FloatArray
    curve: FloatArray
    curve_alone: FloatArray
    span: tuple[float, float]
    posterior: tuple[float, float] | None


def profile_panels(fit: Fit) -> tuple[ProfilePanel, ...]:
    """A panel for each parameter that has a profile, in the order of the fit."""
    known = fit.identifiability.evidence.items()
    return tuple(_panel(fit, name, item.profile, item.alone) for name, item in known if item.profile is not None)


def _panel(fit: Fit, name: str, profile: Profile, alone: Profile | None) -> ProfilePanel:
    item = parameter(fit, name)
    axis = parameter_axis(item.spec)
    values, posterior, within = profile.values * axis.factor, fit.posterior, None
    ends = [float(values[0]), float(values[-1])]
    if posterior is not None:
        low, high = np.quantile(posterior.draws[:, posterior.names.index(name)], (0.025, 0.975)) * axis.factor
        within = (float(low), float(high))
        ends += within
    return ProfilePanel(
        name=name,
        axis=axis,
        values=values,
        log_likelihood=-profile.drop,
        curve=_curve(profile, item.prior.log, axis.factor),
        curve_alone=np.empty((2, 0)) if alone is None else _curve(alone, item.prior.log, axis.factor),
        span=axis.margins(min(ends), max(ends)),
        posterior=within,
    )


def _curve(profile: Profile, logarithmic: bool, factor: float) -> FloatArray:
    """A smooth curve (2, points) through a profile: linear in the root of the drop, as its intervals are."""
    along = np.log(profile.values) if logarithmic else profile.values
    dense = np.union1d(np.linspace(along[0], along[-1], CURVE_POINTS), along)
    root = np.interp(dense, along, np.sqrt(profile.drop))
    return np.stack([(np.exp(dense) if logarithmic else dense) * factor, -(root**2)])


COLUMNS = 4
# Height of the posterior's interval, in log likelihood.
BAR = -2.35
LEVELS = (0.0, -DROP_68, -1.0, -DROP_95)
LEVEL_WORDS = ("0", f"-{DROP_68:g} (68 %)", "-1", f"-{DROP_95:.2f} (95 %)")
CELL = (2.3, 1.75)


def figure(fit: Fit) -> Figure:
    """All profiles; with a posterior its 95 % intervals below them."""
    shown = profile_panels(fit)
    figure, grid = filled(len(shown), COLUMNS, CELL, Margins(left=1.15, down=0.75, bottom=1.05, top=0.75))
    axes = grid.ravel()
    scene = fit.problem.contact_time is not None
    words = "profile of the measurements and the scene's contact time" if scene else "profile of the measurements"
    for axis, panel in zip(axes, shown, strict=False):
        _draw(axis, panel, words)
    for row in grid:
        row[0].set_yticks(LEVELS, LEVEL_WORDS, fontsize=8)
        for axis in row[1:]:
            axis.set_yticks([])
    figure.supylabel("log likelihood below its maximum", fontsize=10, x=0.1 / figure.get_figwidth(), ha="left")
    legend_below(figure, drawn_handles(*axes), {1: 1, 2: 2, 3: 2}.get(len(shown), 3))
    fit_heading(figure, fit, "profile likelihoods", narrow=len(shown) == 1)
    return figure


def _draw(axis: Axes, panel: ProfilePanel, words: str) -> None:
    for level in (DROP_68, DROP_95):
        axis.axhline(-level, color=GUIDE, linewidth=0.8, linestyle=":")
    axis.plot(*panel.curve, "-", color=MEASURED, linewidth=1.3, label=words)
    axis.plot(panel.values, panel.log_likelihood, "o", color=MEASURED, markersize=2.5)
    if panel.curve_alone.size:
        axis.plot(*panel.curve_alone, "--", color=GUIDE, linewidth=1.3, label="without the scene's contact time")
    if panel.posterior is not None:
        ends = (BAR, BAR)
        axis.plot(panel.posterior, ends, color=MODEL, linewidth=4, solid_capstyle="butt", label="posterior, 95 %")
    if panel.axis.logarithmic:
        log_scale(axis, *panel.span)
    else:
        axis.set_xlim(*panel.span)
        axis.locator_params(axis="x", nbins=4)
    axis.set_ylim(LOWEST, 0.15)
    axis.set_title(verbatim(short(panel.name, 34)), fontsize=9, pad=3)
    axis.set_xlabel(panel.axis.label, labelpad=2)


def missing(fit: Fit) -> str:
    """Why a fit has no such figure, "" where it has."""
    return "" if has_profiles(fit) else f"there are no profiles: {fit.identifiability.profiles_missing}"


def has_profiles(fit: Fit) -> bool:
    """Whether any parameter has one."""
    return any(evidence.profile is not None for evidence in fit.identifiability.evidence.values())


def words(fit: Fit) -> str:
    """The figure in words and numbers, for who does not see it."""
    parts = []
    for name, item in fit.identifiability.evidence.items():
        scale = handy(name, fit.parameters[name].unit)
        parts += [f"{name} {profile_interval(item.profile, scale)} {scale.unit}".rstrip()] if item.profile else []
    return "Profile likelihoods with their 95 % intervals: " + "; ".join(parts) + "."
