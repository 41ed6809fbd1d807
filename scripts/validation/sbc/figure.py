"""Ranks drawn: a histogram a quantity, and the empirical distribution within its simultaneous band."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from scipy.stats import binom

from fitball.inference.problem.parameters import NOISE_SPECS
from fitball.models.registry import parameter_spec
from fitball.report.figures.canvas import new_figure, own_style
from fitball.report.form.palette import MODEL, POOR
from validation.sbc.summary import VALUES, ModelFinding, QuantityFinding
from validation.sbc.uniformity import NullDistribution, bins_for, empirical, null_distribution

CONFIDENCE = 0.95
PAIRS = 2


@own_style()
def rank_figure(finding: ModelFinding) -> Figure:
    """Two quantities a row: histogram with the 95 % range of a bin, empirical minus uniform distribution."""
    items = finding.quantities
    rows = (len(items) + PAIRS - 1) // PAIRS
    figure = new_figure(11.0, 1.3 + 1.75 * rows)
    grid = np.atleast_2d(figure.subplots(rows, 2 * PAIRS, sharex=True))
    cells = grid.reshape(-1, 2)
    null = null_distribution(items[0].ranks.size, VALUES)
    for pair, item in zip(cells, items, strict=False):
        _histogram(pair[0], item)
        _difference(pair[1], item, null)
    for pair in cells[len(items) :]:
        for axis in pair:
            axis.set_visible(False)
    for axis in cells[-PAIRS:].ravel():
        axis.set_xlabel("rank of the truth / 200")
    for pair in cells[len(items) - PAIRS : len(items)]:
        for axis in pair:
            axis.tick_params(labelbottom=True)
            axis.set_xlabel("rank of the truth / 200")
    figure.suptitle(
        f"{finding.model}: {items[0].ranks.size} simulated tables. Left: ranks, 95 % range of each bin;\n"
        "right: empirical minus uniform distribution, simultaneous 95 % band",
        fontsize=11,
    )
    return figure


def _symbol(name: str) -> str:
    spec = parameter_spec(name) or NOISE_SPECS.get(name)
    return spec.label if spec is not None else name.replace("_", " ")


def _histogram(axis: Axes, quantity: QuantityFinding) -> None:
    bins = bins_for(quantity.ranks.size, VALUES)
    counts = np.bincount(quantity.ranks * bins // VALUES, minlength=bins)
    low, high = (float(binom.ppf(level, quantity.ranks.size, 1.0 / bins)) for level in (0.025, 0.975))
    axis.axhspan(low, high, color="0.85", linewidth=0)
    axis.axhline(quantity.ranks.size / bins, color="0.5", linewidth=0.8)
    axis.stairs(counts, np.linspace(0.0, 1.0, bins + 1), fill=True, color=MODEL, alpha=0.7)
    axis.set_ylim(0.0, 1.15 * max(float(counts.max()), high))
    axis.set_ylabel("replicates", fontsize=9)
    axis.set_title(_symbol(quantity.name) + ("" if quantity.holds else ": NOT uniform"), fontsize=10)


def _difference(axis: Axes, quantity: QuantityFinding, null: NullDistribution) -> None:
    place = np.arange(1, VALUES) / VALUES
    low, high = null.band(CONFIDENCE)
    axis.fill_between(place, low - place, high - place, color="0.85", linewidth=0)
    axis.axhline(0.0, color="0.5", linewidth=0.8)
    distribution = empirical(quantity.ranks[None, :], VALUES)[0] / quantity.ranks.size
    axis.plot(place, distribution - place, color=MODEL if quantity.holds else POOR.light, linewidth=1.2)
    axis.set_title(f"{_symbol(quantity.name)}: p = {quantity.ecdf_p:.2g}", fontsize=10)
    axis.set_ylabel("difference", fontsize=9)
