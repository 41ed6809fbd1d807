"""What each figure of a fit shows, in words and numbers, for readers who do not see it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping

import numpy as np

from fitball.inference.results.results import TARGET_R_HAT, Fit
from fitball.report.figures.curves import curve_columns
from fitball.report.figures.force import force_panels
from fitball.report.figures.predictive import agreements
from fitball.report.figures.residuals import incident_quantities, residual_data
from fitball.report.form.display_units import handy, output_scale
from fitball.report.form.parameters import parameter_row, profile_interval

# Correlations named, the strongest first.
NAMED = 3
# A sequence less probable than this may be another one.
SURE = 0.95


def alt_text(name: str, fit: Fit) -> str:
    """The text for a figure that this fit can show."""
    return WORDS[name](fit)


def _sketch(fit: Fit) -> str:
    specs = fit.problem.model.specs
    what = "a core within a shell, joined by springs and dampers" if "mass_ratio" in specs else "one body"
    meanings = "; ".join(f"{name}: {spec.meaning}" for name, spec in specs.items())
    return f"Sketch of the ball on the court: {what}. Topspin and speeds towards the right are positive. {meanings}."


def _predictive(fit: Fit) -> str:
    parts = [
        f"{item.name}: {np.count_nonzero(item.inside)} of {item.inside.size} measurements within the 95 % range of a "
        f"new one, root mean square difference {item.rms:.2g} {output_scale(item.name).unit}"
        for item in agreements(fit)
    ]
    what = "posterior median" if fit.predictive is not None else "point estimate"
    return f"Measured rebounds against the {what}. " + "; ".join(parts) + "."


def _curves(fit: Fit) -> str:
    along = "incidence angle" if fit.problem.table.has_tangential else "vertical speed"
    parts = []
    for column in curve_columns(fit):
        ends = [
            f"{name} from {band[len(band) // 2, 0]:.3g} to {band[len(band) // 2, -1]:.3g} {output_scale(name).unit}"
            for name, band in column.bands.items()
        ]
        where = f"at {column.title}" if column.title else "over all"
        parts.append(f"{where}, near {column.rows.size} impact{'s' * (column.rows.size != 1)}, {', '.join(ends)}")
    return f"Predicted rebounds along {along}: " + "; ".join(parts) + "."


def _force(fit: Fit) -> str:
    parts = []
    for panel in force_panels(fit):
        inside = np.sum((panel.means >= panel.expected[0]) & (panel.means <= panel.expected[1]))
        parts.append(
            f"{panel.title}: measured up to {panel.means.max():.0f} N, "
            f"the model up to {panel.course[1].max():.0f} N, "
            f"{inside} of {panel.means.size} means within the 95 % range of a record"
        )
    return "Force records beside the model's force. " + "; ".join(parts) + "."


def _residuals(fit: Fit) -> str:
    parts = []
    for item in residual_data(fit):
        worst = int(np.argmax(np.abs(item.values)))
        beyond = int(np.sum(np.abs(item.values) > 2.0))
        parts.append(
            f"{item.name}: {beyond} of {item.values.size} beyond 2 sd, the largest {item.values[worst]:+.1f} sd at "
            f"impact {fit.problem.table.ids[item.rows[worst]]}"
        )
    against = ", ".join(incident_quantities(fit)) or "normal quantiles"
    return f"Standardised residuals, measured minus predicted, against {against}. " + "; ".join(parts) + "."


def _profiles(fit: Fit) -> str:
    parts = []
    for name, item in fit.identifiability.evidence.items():
        scale = handy(name, fit.parameters[name].unit)
        parts += [f"{name} {profile_interval(item.profile, scale)} {scale.unit}".rstrip()] if item.profile else []
    return "Profile likelihoods with their 95 % intervals: " + "; ".join(parts) + "."


def _corner(fit: Fit) -> str:
    names, matrix = fit.problem.free_names, fit.correlation
    medians = "; ".join(
        f"{row.name} {row.median} {row.interval_95} {row.unit}".rstrip()
        for row in map(parameter_row, fit.estimates)
        if row.name in names
    )
    text = f"Posterior of {len(names)} parameters, median and 95 % interval: {medians}."
    if matrix is None or len(names) < 2:
        return text
    above = [(abs(matrix[i, j]), i, j) for i in range(len(names)) for j in range(i)]
    strongest = sorted(above, reverse=True)[:NAMED]
    pairs = ", ".join(f"{names[j]} with {names[i]} {matrix[i, j]:+.2f}" for _size_of, i, j in strongest)
    return f"{text} Strongest correlations: {pairs}."


def _trace(fit: Fit) -> str:
    diagnostics = fit.diagnostics
    if diagnostics is None:
        return ""
    worst = max(diagnostics.r_hat, key=lambda name: diagnostics.r_hat[name])
    chains = diagnostics.ensembles
    who = f"Walkers of {chains} ensembles" if diagnostics.pareto_k is None else f"{chains} chains of weighed draws"
    many = " are not yet enough" if diagnostics.max_r_hat < TARGET_R_HAT else " do not yet agree"
    state = " agree" if diagnostics.converged else many
    return (
        f"{who} over steps {diagnostics.warm_up} to {diagnostics.steps}: they{state}; "
        f"the largest R-hat is {diagnostics.max_r_hat:.3f}, of {worst}, "
        f"the smallest effective sample size {min(diagnostics.min_ess_bulk, diagnostics.min_ess_tail):.0f}."
    )


def _regimes(fit: Fit) -> str:
    if fit.predictive is None:
        return ""
    first = [next(iter(shares.items())) for shares in fit.predictive.regimes]
    counts = Counter(name for name, _share in first).most_common()
    doubtful = sum(share < SURE for _name, share in first)
    parts = ", ".join(f"{name} at {count}" for name, count in counts)
    sure = "all of them certain" if doubtful == 0 else f"{doubtful} of them below {100.0 * SURE:.0f} % probability"
    return f"Most probable sequence of slip and grip of {len(first)} impacts: {parts}; {sure}."


# Of every figure in `names.FIGURES`.
WORDS: Mapping[str, Callable[[Fit], str]] = {
    "corner": _corner,
    "trace": _trace,
    "sketch": _sketch,
    "predictive": _predictive,
    "curves": _curves,
    "residuals": _residuals,
    "profiles": _profiles,
    "regimes": _regimes,
    "force": _force,
}
