"""What the figure of profiles shows, computed before anything is drawn."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fitball.inference.results.evidence import Profile
from fitball.report.figures.drawable import Drawable, parameter
from fitball.report.figures.parameter_axis import ParameterAxis, parameter_axis
from fitball.values import FloatArray

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


def profile_panels(fit: Drawable) -> tuple[ProfilePanel, ...]:
    """A panel for each parameter that has a profile, in the order of the fit."""
    panels = []
    for name, evidence in fit.identifiability.evidence.items():
        if evidence.profile is not None:
            panels.append(_panel(fit, name, evidence.profile, evidence.alone))
    return tuple(panels)


def _panel(fit: Drawable, name: str, profile: Profile, alone: Profile | None) -> ProfilePanel:
    item = parameter(fit, name)
    axis = parameter_axis(item.spec)
    within = None
    ends = [float(profile.values[0]), float(profile.values[-1])]
    posterior = fit.posterior
    if posterior is not None:
        low, high = np.quantile(posterior.draws[:, posterior.names.index(name)], (0.025, 0.975)) * axis.factor
        within = (float(low), float(high))
    low, high = (end * axis.factor for end in ends)
    if within is not None:
        low, high = min(low, within[0]), max(high, within[1])
    return ProfilePanel(
        name=name,
        axis=axis,
        values=profile.values * axis.factor,
        log_likelihood=-profile.drop,
        curve=_curve(profile, item.prior.log, axis.factor),
        curve_alone=np.empty((2, 0)) if alone is None else _curve(alone, item.prior.log, axis.factor),
        span=axis.margins(low, high),
        posterior=within,
    )


def _curve(profile: Profile, logarithmic: bool, factor: float) -> FloatArray:
    """A smooth curve (2, points) through a profile: linear in the root of the drop, as its intervals are."""
    along = np.log(profile.values) if logarithmic else profile.values
    dense = np.union1d(np.linspace(along[0], along[-1], CURVE_POINTS), along)
    root = np.interp(dense, along, np.sqrt(profile.drop))
    return np.stack([(np.exp(dense) if logarithmic else dense) * factor, -(root**2)])
