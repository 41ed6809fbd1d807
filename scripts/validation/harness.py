"""Common parts of all studies: a growing file of replicates, rates with their intervals, simulated tables, and
posteriors by a short chain.

A study makes the records of one replicate from a seed and a number. Its file has one line of JSON for each replicate,
in order, after a line with all settings. An interrupted run continues. The same seed gives the same bytes for any
number of processes and interruptions.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from scipy.stats import beta

from fitball.errors import FitError, ResultFolderError
from fitball.files import refusal
from fitball.inference.identifiability.information import prior_draws
from fitball.inference.point.point_fit import STARTS, maximum_posterior, starting_points
from fitball.inference.prediction.posterior_predictive import measurements, with_noise
from fitball.inference.problem.problem import Problem
from fitball.inference.results.results import PointFit
from fitball.inference.sampling.ensembles import ENSEMBLES, Sampled, Schedule, Settings, default_walkers, sample
from fitball.models.types import Rebound
from fitball.report.form.files import write_text
from fitball.scheduling.engine import Engine, in_order
from fitball.values import FloatArray
from fitball.version import __version__

Row = dict[str, Any]
# Receives the number of finished replicates.
Report = Callable[[int], None]
LEVEL = 0.95
# Ends of a 95 % interval from so many effective draws are right within a tenth of its width.
SCHEDULE = Schedule(warm_up=160, first_check=320, target_ess=400.0, target_r_hat=1.05)
# Some tables put the core's mass near the whole ball's, where mixing is slow: what is not done here did not converge.
MAX_STEPS = 2000
# What every replicate with a chain depends on.
CHAIN: Mapping[str, object] = {"ensembles": ENSEMBLES, "max_steps": MAX_STEPS, **asdict(SCHEDULE)}


@dataclass(frozen=True)
class Study:
    """`make` (seed, number) -> records of one replicate, which depend on these and the `settings` alone. `name` is
    the name of the file, `title` and `unit` are those of the progress line.
    """

    name: str
    make: Callable[[int, int], list[Row]]
    settings: Mapping[str, object]
    title: str = ""
    unit: str = "replicates"


@dataclass(frozen=True)
class Verdict:
    """What a study found: everything for machines (`holds` among it), tables and figures by name, text for people."""

    content: Mapping[str, object]
    tables: Mapping[str, Iterable[Mapping[str, object]]]
    text: str
    figures: Mapping[str, Figure] = field(default_factory=dict)


def run(
    study: Study, seed: int, count: int, folder: Path, engine: Engine, report: Report = lambda _n: None
) -> list[list[Row]]:
    """The records of replicates 0 to `count` - 1: those in the study's file, and the others, which are computed and
    appended. Raises ResultFolderError for a file that is damaged, or of another run.
    """
    place = folder / f"{study.name}.jsonl"
    head = json.dumps({"version": __version__, "seed": seed, **study.settings}, sort_keys=True)
    done = len(_opened(place, head))
    report(min(done, count))
    todo = range(done, count)
    for number, rows in zip(todo, in_order(engine, partial(study.make, seed), todo), strict=True):
        line = json.dumps(rows)
        try:
            with place.open("a", encoding="utf-8", newline="") as file:
                file.write(f"{line}\n")
        except OSError as error:
            raise ResultFolderError(refusal(place, error, len(line))) from None
        report(number + 1)
    return [_read(place, k, line) for k, line in enumerate(_opened(place, head)[:count])]


def _opened(place: Path, head: str) -> list[str]:
    """The lines below the head of a file, made where there is none; what was cut off while written is taken off."""
    try:
        place.parent.mkdir(parents=True, exist_ok=True)
        if not place.exists():
            write_text(place, f"{head}\n")
        text = place.read_bytes().decode("utf-8")
        whole = text[: text.rfind("\n") + 1]
        if not whole.startswith(f"{head}\n"):
            raise ResultFolderError(
                f"{place}: holds replicates of another run (seed, model, priors, table or version differ); remove "
                "it, or name another folder"
            )
        if whole != text:
            write_text(place, whole)
    except (OSError, UnicodeDecodeError) as error:
        raise ResultFolderError(f"{place}: cannot be read or written: {error}") from None
    return whole.split("\n")[1:-1]


def _read(place: Path, number: int, line: str) -> list[Row]:
    try:
        rows = json.loads(line)
    except ValueError:
        rows = None
    if not isinstance(rows, list) or not all(isinstance(row, dict) for row in rows):
        raise ResultFolderError(
            f"{place}: line {number + 2} is damaged; remove it and all that follow, and run again"
        )
    return rows


@dataclass(frozen=True)
class Rate:
    """`count` of `total`, with the ends of a 95 % interval (Clopper and Pearson 1934); empty without any."""

    count: int
    total: int

    @property
    def value(self) -> float | None:
        """The share."""
        return self.count / self.total if self.total else None

    @property
    def low(self) -> float:
        """The least rate that would give as many."""
        return float(beta.ppf(0.5 - LEVEL / 2, self.count, self.total - self.count + 1)) if self.count else 0.0

    @property
    def high(self) -> float:
        """The largest rate that would give as few."""
        return (
            float(beta.ppf(0.5 + LEVEL / 2, self.count + 1, self.total - self.count))
            if self.count < self.total
            else 1.0
        )

    def agrees(self, low: float, high: float) -> bool:
        """Whether the rate may lie from `low` to `high`."""
        return not self.total or (self.low <= high and self.high >= low)

    def __str__(self) -> str:
        if self.value is None:
            return "-"
        return f"{100 * self.value:.0f} % [{100 * self.low:.0f}, {100 * self.high:.0f}]"


def rate(values: Iterable[object]) -> Rate:
    """The share of true values; None is not counted."""
    known = [bool(one) for one in values if one is not None]
    return Rate(sum(known), len(known))


def drawn_truth(known: Problem, rng: np.random.Generator, who: str) -> FloatArray:
    """One draw (free,) from the prior draws. Raises FitError, with the name `who`, if there is none."""
    drawn = prior_draws(known, rng, wanted=1, batch=400)
    if not len(drawn):
        raise FitError(f"{who}: no draw of the priors agrees with what the scene knows")
    truth: FloatArray = drawn[0]
    return truth


def simulated_columns(
    known: Problem, row: FloatArray, rng: np.random.Generator, rebound: Rebound | None = None
) -> dict[str, FloatArray]:
    """Simulated measurements (impacts,) by column for true values (1, free), with the noise and gaps of the table.
    `rebound` replaces the model.
    """
    rebound, columns = known.rebound(row) if rebound is None else rebound, known.all_values(row)
    if known.errors is not None:
        # Errors of a row that belong together, those of its incident state to first order.
        drawn = measurements(known, columns, rebound, rng)
        return {item.name: np.where(np.isnan(item.observed), np.nan, data[0]) for item, _, _, data in drawn}
    return {
        observable.name: observable.spread_out(
            with_noise(known.noise, observable, columns, rebound, rng)[2][0], len(known.impacts), np.nan
        )
        for observable in known.observables
    }


def maximum(problem: Problem, seed: np.random.SeedSequence) -> PointFit:
    """The maximum of the posterior by the road of `calibrate`."""
    return maximum_posterior(problem, starting_points(problem, np.random.default_rng(seed), STARTS))


def short_chain(problem: Problem, point: PointFit, seed: int, schedule: Schedule = SCHEDULE) -> Sampled:
    """Ensembles begun at the optima of a point fit, on one thread."""
    optima = problem.free_rows(point.optima)
    settings = Settings(default_walkers(problem.dimension), ENSEMBLES, MAX_STEPS, 1, seed, schedule)
    return sample(problem, problem.to_coordinates(optima), settings, None, False, lambda _progress: None)


def drawn_values(problem: Problem, sampled: Sampled) -> FloatArray:
    """The draws (ensembles, steps, walkers, free) of a chain in SI, without its warm-up."""
    shape = sampled.kept.shape
    values: FloatArray = problem.to_values(sampled.kept.reshape(-1, shape[-1])).reshape(shape)
    return values


def standard_error(values: Sequence[float] | FloatArray) -> FloatArray:
    """Of the mean over the first axis."""
    return np.asarray(np.std(values, axis=0, ddof=1) / np.sqrt(len(values)))
