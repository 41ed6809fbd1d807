"""Simulation-based calibration of the calibration (Talts et al. 2018; Modrak et al. 2023).

A truth is drawn from the prior, a table is simulated from it, and the table is fitted. If the fits are right, the
rank of the truth among posterior draws is uniform.

The prior is the posterior's own reference density: priors, truncated to parameters that the model can evaluate at
every impact, times the scene's mean contact time. The contact time is the same in every replicate, as it is for a
user. So it belongs to the prior here and is not simulated.

The log likelihood is ranked beside the parameters. Without a quantity that depends on the data, a sampler that
returned the prior would pass (Modrak et al. 2023).

The simultaneous band for uniform ranks is that of Sailynoja, Burkner and Vehtari (2022, Statistics and Computing
32:32). It consists of pointwise binomial intervals. Their level is adjusted, by seeded simulation, so that a uniform
sample leaves the band anywhere with the stated probability.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray
from scipy.stats import binom, chi2

from fitball.data.read import load_table
from fitball.data.scene import load_scene
from fitball.data.table import Measurement
from fitball.errors import FitError
from fitball.inference.likelihood.posterior import log_likelihood
from fitball.inference.problem.build import Choices, build_problem
from fitball.inference.problem.parameters import NOISE_SPECS
from fitball.inference.problem.problem import Problem
from fitball.inference.sampling.ensembles import Sampled
from fitball.models.registry import parameter_spec
from fitball.report.figures.canvas import new_figure, own_style
from fitball.report.form.document import columns
from fitball.report.form.palette import MODEL, POOR
from fitball.values import FloatArray
from validation.harness import (
    CHAIN,
    LEVEL,
    Rate,
    Row,
    Study,
    Verdict,
    drawn_truth,
    maximum,
    short_chain,
    simulated_columns,
)

IntArray = NDArray[np.int64]

SIMULATIONS = 20_000
SIMULATION_SEED = 2022
# Least expected count of a bin for the chi-square distribution to hold (Cochran 1954).
LEAST_EXPECTED = 5


@dataclass(frozen=True)
class NullDistribution:
    """What uniform ranks of `count` replicates among `values` values do.

    `pointwise` (values - 1, count + 1): two-sided probability of `c` ranks at or below each value but the last.
    `smallest` (simulations,): the smallest such probability over all values, for uniform samples, sorted.
    """

    count: int
    values: int
    pointwise: FloatArray
    smallest: FloatArray

    def statistic(self, ranks: IntArray) -> float:
        """Smallest pointwise probability of ranks (count,)."""
        return float(_smallest(self.pointwise, ranks[None, :], self.values)[0])

    def p_value(self, ranks: IntArray) -> float:
        """Share of uniform samples whose statistic is as small; never below that of one in all simulations."""
        below = np.searchsorted(self.smallest, self.statistic(ranks), side="right")
        return float((below + 1) / (self.smallest.size + 1))

    def band(self, confidence: float) -> tuple[FloatArray, FloatArray]:
        """Least and greatest empirical distribution at each value but the last that uniform ranks keep to."""
        level = float(np.quantile(self.smallest, 1.0 - confidence, method="lower"))
        inside = self.pointwise >= level
        low = np.argmax(inside, axis=1)
        high = self.count - np.argmax(inside[:, ::-1], axis=1)
        return low / self.count, high / self.count


def null_distribution(count: int, values: int) -> NullDistribution:
    """Simulate it; the same numbers every time."""
    probability = np.arange(1, values)[:, None] / values
    held = np.arange(count + 1)
    at_most = binom.cdf(held, count, probability)
    at_least = binom.sf(held - 1, count, probability)
    pointwise = np.minimum(1.0, 2.0 * np.minimum(at_most, at_least))
    rng = np.random.default_rng(SIMULATION_SEED)
    parts = [_smallest(pointwise, rng.integers(values, size=(SIMULATIONS // 20, count)), values) for _ in range(20)]
    return NullDistribution(count, values, pointwise, np.sort(np.concatenate(parts)))


def empirical(ranks: IntArray, values: int) -> IntArray:
    """Number of ranks (samples, count) at or below each value but the last, (samples, values - 1)."""
    samples = ranks.shape[0]
    cells = ranks + values * np.arange(samples)[:, None]
    counts = np.bincount(cells.ravel(), minlength=samples * values).reshape(samples, values)
    cumulative: IntArray = np.cumsum(counts, axis=1, dtype=np.int64)[:, :-1]
    return cumulative


def _smallest(pointwise: FloatArray, ranks: IntArray, values: int) -> FloatArray:
    held = empirical(ranks, values)
    smallest: FloatArray = pointwise[np.arange(values - 1), held].min(axis=1)
    return smallest


def bins_for(count: int, values: int) -> int:
    """Most equal bins of at least LEAST_EXPECTED expected ranks, at most 20."""
    return max(bins for bins in range(1, 21) if values % bins == 0 and (bins <= 2 or count >= LEAST_EXPECTED * bins))


def chi_square(ranks: IntArray, values: int) -> tuple[float, float]:
    """Pearson's statistic of binned ranks and its probability for uniform ones."""
    bins = bins_for(ranks.size, values)
    counts = np.bincount(ranks * bins // values, minlength=bins)
    expected = ranks.size / bins
    statistic = float(np.sum((counts - expected) ** 2) / expected)
    return statistic, float(chi2.sf(statistic, bins - 1))


def coverage(ranks: IntArray, values: int, nominal: float) -> Rate:
    """How often the central interval of probability `nominal` held the truth, by ranks.

    `values` times `nominal` must be whole and leave as many values below as above. Raises ValueError.
    """
    outside = round(values * (1.0 - nominal))
    if outside % 2 or abs(values * (1.0 - nominal) - outside) > 1e-9 * values:
        raise ValueError(f"no central interval of {nominal} among {values} values")
    edge = outside // 2
    return Rate(int(np.count_nonzero((ranks >= edge) & (ranks < values - edge))), ranks.size)


def holm(p_values: Sequence[float]) -> list[float]:
    """Adjusted probabilities of a family of tests (Holm 1979), in the order given."""
    order = np.argsort(p_values, kind="stable")
    adjusted = [1.0] * len(p_values)
    largest = 0.0
    for position, k in enumerate(order):
        largest = max(largest, min(1.0, (len(p_values) - position) * p_values[int(k)]))
        adjusted[int(k)] = largest
    return adjusted


# Posterior draws among which a truth is ranked: 200 values have central intervals of exactly 50, 80 and 95 %.
RANKED = 199
VALUES = RANKED + 1
COVERAGES = (0.5, 0.8, 0.95)
LOG_LIKELIHOOD = "log_likelihood"
# Probability that correct fits fail: of any test on any quantity of any model, by Holm's adjustment.
FAMILY_ERROR = 0.01
# Share of replicates without a trustworthy chain above which the ranks prove nothing.
MOST_UNCONVERGED = 0.05
# Below this even grossly wrong intervals may pass.
FEWEST = 20
# Quantities in a row of the figure.
PAIRS = 2


def ranks_among(truth: FloatArray, draws: FloatArray) -> list[int]:
    """Rank of each truth (quantities,) among its draws (draws, quantities)."""
    return [int(below) for below in np.count_nonzero(draws < truth, axis=0)]


@cache
def _problem(table: str, model: str) -> Problem:
    return build_problem(load_table(table), load_scene(table), Choices(model=model))


@dataclass(frozen=True)
class Bounces:
    """Fits of `model` to rebounds simulated at the incident conditions of `table`.

    With `wrong_sigma` the fit assumes that many times the true noise: a control that must fail.
    """

    table: str
    model: str
    wrong_sigma: float | None = None

    @property
    def problem(self) -> Problem:
        """The problem whose table is replaced by simulated ones."""
        return _problem(self.table, self.model)

    @property
    def names(self) -> tuple[str, ...]:
        """Free parameters of the fit, and the log likelihood."""
        free = self.problem.free_names
        kept = free if self.wrong_sigma is None else tuple(name for name in free if name not in NOISE_SPECS)
        return (*kept, LOG_LIKELIHOOD)

    @property
    def study(self) -> Study:
        """Its replicates."""
        settings = {
            "table": self.problem.table.digest, "model": self.model, "wrong_sigma": self.wrong_sigma,
            "ranked": RANKED, "contact_time": self.problem.contact_time, **CHAIN,
            "parameters": [[item.name, item.prior.text, item.fixed] for item in self.problem.parameters],
        }  # fmt: skip
        return Study(f"ranks_{self.model}", self.replicate, settings, self.model)

    def replicate(self, seed: int, number: int) -> list[Row]:
        """One record: the rank of each truth among RANKED draws, and how the sampler ended; no ranks, and why, where
        there was no fit.
        """
        roots = np.random.SeedSequence(seed, spawn_key=(number,)).spawn(4)
        values = self.truth(np.random.default_rng(roots[0]))
        problem = self.simulated(values, np.random.default_rng(roots[1]))
        try:
            # The real road to a posterior: starts, maxima, ensembles.
            sampled = short_chain(problem, maximum(problem, roots[2]), int(roots[3].generate_state(1)[0]))
        except FitError as error:
            return [{"ranks": {}, "converged": False, "failed": str(error)}]
        found, rng = sampled.convergence, np.random.default_rng(roots[3])
        ending = {"steps": sampled.steps, "ess": found.min_ess, "r_hat": found.max_r_hat, "failed": ""}
        return [{"ranks": self._ranks(values, problem, sampled, rng), "converged": sampled.converged, **ending}]

    def truth(self, rng: np.random.Generator) -> FloatArray:
        """One draw (free,) from the prior draws. Raises FitError if there is none."""
        return drawn_truth(self.problem, rng, f"model {self.model}")

    def simulated(self, values: FloatArray, rng: np.random.Generator) -> Problem:
        """The problem of a table simulated from true values (free,), with the gaps of the one there is."""
        known, count, row = self.problem, len(self.problem.impacts), values[None, :]
        made, columns = simulated_columns(known, row, rng), known.all_values(row)
        measured = tuple(
            Measurement(observable.name, made[observable.name], observable.everywhere(count).sd)
            for observable in known.observables
        )
        fix = {}
        if self.wrong_sigma is not None:
            fix = {name: self.wrong_sigma * float(columns[name][0]) for name in columns if name in NOISE_SPECS}
        table = replace(known.table, measurements=measured, redundant=())
        return build_problem(table, known.scene, Choices(model=self.model, fix=fix))

    def _ranks(
        self, values: FloatArray, problem: Problem, sampled: Sampled, rng: np.random.Generator
    ) -> dict[str, int]:
        kept = sampled.kept.reshape(-1, problem.dimension)
        draws = problem.to_values(kept[rng.choice(len(kept), RANKED, replace=False)])
        named = dict(zip(self.problem.free_names, values, strict=True))
        truth = np.array([[named[name] for name in problem.free_names]])
        together = np.concatenate([truth, draws])
        score = log_likelihood(problem, together, problem.rebound(together))
        quantities = np.column_stack([together, score])
        return dict(zip(self.names, ranks_among(quantities[0], quantities[1:]), strict=True))


@dataclass(frozen=True)
class Quantity:
    """Ranks of one quantity: chi-square with its probability for correct fits, the probability of the empirical
    distribution, and the smaller of both, adjusted for all tests of the run.
    """

    model: str
    name: str
    ranks: IntArray
    chi_square: float
    chi_square_p: float
    ecdf_p: float
    adjusted: float

    @property
    def coverages(self) -> Mapping[float, Rate]:
        """How often central intervals of some probabilities held the truth."""
        return {nominal: coverage(self.ranks, VALUES, nominal) for nominal in COVERAGES}

    @property
    def holds(self) -> bool:
        """Whether the ranks look uniform."""
        return self.adjusted >= FAMILY_ERROR

    def row(self) -> dict[str, object]:
        """As a row of the summary."""
        row: dict[str, object] = {
            "model": self.model, "quantity": self.name, "replicates": self.ranks.size,
            "chi_square": round(self.chi_square, 3), "chi_square_p": float(f"{self.chi_square_p:.4g}"),
            "ecdf_p": float(f"{self.ecdf_p:.4g}"), "adjusted_p": float(f"{self.adjusted:.4g}"),
        }  # fmt: skip
        for nominal, part in self.coverages.items():
            numbers = {"": part.value or 0.0, "_low": part.low, "_high": part.high}
            row |= {f"within_{100 * nominal:.0f}{end}": round(number, 4) for end, number in numbers.items()}
        return row | {"holds": "yes" if self.holds else "no"}


def quantities(records: Mapping[str, Sequence[Row]]) -> list[Quantity]:
    """The ranks of the replicates of each model, quantity by quantity.

    Replicates that did not converge are ranked too: leaving them out would hide their errors.
    """
    raw = []
    for model, rows in records.items():
        fitted = [row["ranks"] for row in rows if not row["failed"]]
        for name in fitted[0] if fitted else ():
            ranks = np.array([item[name] for item in fitted], dtype=np.int64)
            raw.append((model, name, ranks, *chi_square(ranks, VALUES)))
    nulls = {count: null_distribution(count, VALUES) for count in {item[2].size for item in raw}}
    ecdf = [nulls[item[2].size].p_value(item[2]) for item in raw]
    adjusted = holm([item[4] for item in raw] + ecdf)
    return [Quantity(*item, ecdf[k], min(adjusted[k], adjusted[len(raw) + k])) for k, item in enumerate(raw)]


def complaints(rows: Sequence[Row], found: Sequence[Quantity]) -> list[str]:
    """What speaks against the fits of a model, in words; empty when nothing does."""
    failed = sum(bool(row["failed"]) for row in rows)
    unconverged = sum(not row["converged"] and not row["failed"] for row in rows)
    faults = []
    if len(rows) < FEWEST:
        faults.append(f"{len(rows)} replicates prove nothing: at least {FEWEST} are needed")
    if unconverged + failed > MOST_UNCONVERGED * len(rows):
        faults.append(f"{unconverged} of {len(rows)} replicates did not converge and {failed} had no fit")
    return faults + [
        f"{one.name}: ranks are not uniform (adjusted p = {one.adjusted:.2g})" for one in found if not one.holds
    ]


def judge(records: Mapping[str, Sequence[Row]], seed: int) -> Verdict:
    """Do the truths of all models rank uniformly?"""
    found, models, figures, parts = quantities(records), {}, {}, []
    for model, rows in records.items():
        mine = [one for one in found if one.model == model]
        told: Row = {
            "replicates": len(rows), "failed": sum(bool(row["failed"]) for row in rows),
            "unconverged": sum(not row["converged"] and not row["failed"] for row in rows),
            "complaints": complaints(rows, mine),
        }  # fmt: skip
        models[model] = told
        if mine:
            figures[f"ranks_{model}"] = rank_figure(model, mine)
        table = [["quantity", "p chi-square", "p ecdf", "adjusted p", "in 50 %", "in 80 %", "in 95 %", ""]]
        for one in mine:
            words = [f"{p:.2g}" for p in (one.chi_square_p, one.ecdf_p, one.adjusted)]
            shares = [str(part).replace(" % ", " ") for part in one.coverages.values()]
            table.append([one.name, *words, *shares, "holds" if one.holds else "FAILS"])
        head = f"{told['replicates']} replicates, {told['unconverged']} not converged, {told['failed']} without a fit"
        parts += [f"{model}: {head}", "", *columns(table), "", *(f"FAILS: {one}" for one in told["complaints"])]
    good = not any(told["complaints"] for told in models.values())
    parts.append(
        "The truth ranks uniformly: the intervals have their stated coverage." if good else "Validation FAILED."
    )
    content = {"holds": good, "seed": seed, "family_error": FAMILY_ERROR, "ranked_draws": RANKED, "models": models}
    return Verdict(content, {"summary": [one.row() for one in found]}, "\n".join(parts), figures)


@own_style()
def rank_figure(model: str, items: Sequence[Quantity]) -> Figure:
    """Two quantities a row: histogram with the 95 % range of a bin, empirical minus uniform distribution."""
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
        f"{model}: {items[0].ranks.size} simulated tables. Left: ranks, 95 % range of each bin;\n"
        "right: empirical minus uniform distribution, simultaneous 95 % band",
        fontsize=11,
    )
    return figure


def _symbol(name: str) -> str:
    spec = parameter_spec(name) or NOISE_SPECS.get(name)
    return spec.label if spec is not None else name.replace("_", " ")


def _histogram(axis: Axes, quantity: Quantity) -> None:
    bins = bins_for(quantity.ranks.size, VALUES)
    counts = np.bincount(quantity.ranks * bins // VALUES, minlength=bins)
    low, high = (float(binom.ppf(level, quantity.ranks.size, 1.0 / bins)) for level in (0.025, 0.975))
    axis.axhspan(low, high, color="0.85", linewidth=0)
    axis.axhline(quantity.ranks.size / bins, color="0.5", linewidth=0.8)
    axis.stairs(counts, np.linspace(0.0, 1.0, bins + 1), fill=True, color=MODEL, alpha=0.7)
    axis.set_ylim(0.0, 1.15 * max(float(counts.max()), high))
    axis.set_ylabel("replicates", fontsize=9)
    axis.set_title(_symbol(quantity.name) + ("" if quantity.holds else ": NOT uniform"), fontsize=10)


def _difference(axis: Axes, quantity: Quantity, null: NullDistribution) -> None:
    place = np.arange(1, VALUES) / VALUES
    low, high = null.band(LEVEL)
    axis.fill_between(place, low - place, high - place, color="0.85", linewidth=0)
    axis.axhline(0.0, color="0.5", linewidth=0.8)
    distribution = empirical(quantity.ranks[None, :], VALUES)[0] / quantity.ranks.size
    axis.plot(place, distribution - place, color=MODEL if quantity.holds else POOR.light, linewidth=1.2)
    axis.set_title(f"{_symbol(quantity.name)}: p = {quantity.ecdf_p:.2g}", fontsize=10)
    axis.set_ylabel("difference", fontsize=9)
