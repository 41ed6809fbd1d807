"""Are posteriors right? Simulation-based calibration (Talts et al. 2018): `sbc.py FOLDER [--tables
300 --only NAME]`.

A truth is drawn from the prior, a table simulated with it and fitted as by `calibrate`. If
posteriors are right, the rank of the truth among draws is uniform, for every parameter and for the
log likelihood (Modrak et al. 2023). The contact time of the scene is the same in every table, as it
is for a user: here it belongs to the prior. There is a test for each design: the smallest p-value
of chi-square over 20 bins, by Bonferroni, at 1 %. Negative control: draws pulled together by 30 %
must fail.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.stats import chisquare
from study import Record, replicates

from fitball.base.values import FloatArray, Impacts
from fitball.data.load import load_data
from fitball.data.read import load_table
from fitball.data.scene import Scene
from fitball.inference.density import cells, log_posterior, scene_density
from fitball.inference.effort import Effort
from fitball.inference.judgement.first_order import first_order
from fitball.inference.problem.build import build_problem
from fitball.inference.problem.problem import Choices, Problem
from fitball.inference.sampling.sample import sample
from fitball.inference.schema import PointFit
from fitball.inference.search.best_fit import best_fit
from fitball.models.types import Status

# Draws of a posterior that are ranked: ranks are 0 to 99.
RANKED = 99
# Bins of ranks, of five each.
BINS = 20
# Level of the test of a design.
LEVEL = 0.01
# Most steps of chains: so few draws can be ranked long before tails have their effective size.
STEPS = 1_000
# Most steps of chains for the design `gaps`, whose steps cost most.
STEPS_OF_GAPS = 160
# Factor by which draws of the control are pulled towards their mean.
PULLED = 0.7
# Draws of the prior of which a truth is accepted.
PRIOR_DRAWS = 64


def of_wang(model: str, rows: int) -> Problem:
    """A problem of this many of Wang's 21 impacts, evenly spread, with his scene."""
    table, scene = load_data(["wang_all.csv"], None, as_read=True)[:2]
    chosen = np.linspace(0, len(table) - 1, rows).round().astype(np.int64)
    return build_problem(table.take(chosen), scene, Choices(model))


def three_surfaces() -> Problem:
    """A problem of 24 impacts on three surfaces, with friction and restitution of each."""
    rng = np.random.default_rng(5)
    speed = rng.uniform(12.0, 25.0, 24)
    angle = np.radians(rng.uniform(15.0, 45.0, 24))
    columns = {
        "v_x1": speed * np.cos(angle),
        "v_y1": speed * np.sin(angle),
        "omega_1": rng.uniform(-150, 150, 24),
    }
    columns |= {
        "v_x2": 0.7 * columns["v_x1"],
        "v_y2": 0.75 * columns["v_y1"],
        "omega_2": columns["v_x1"] / 0.033,
    }
    table = load_table(pd.DataFrame(columns).assign(surface=["clay", "grass", "hard"] * 8))
    choices = Choices("grip-slip", pool={"mu": "surface", "cor_10": "surface"})
    return build_problem(table, Scene(), choices)


def gaps() -> Problem:
    """A problem of every second impact of the bundled table of a camera, with gaps, uncertain
    incidence, correlated errors, and constants of camera and ball.
    """
    table, scene = load_data(["synthetic_gaps.csv"], None, as_read=True)[:2]
    return build_problem(table.take(np.arange(0, len(table), 2)), scene, Choices())


# Problems by name of design, which is that of its records, too.
DESIGNS: Mapping[str, Callable[[], Problem]] = {
    "two-mass": partial(of_wang, "two-mass", 21),
    "grip-slip": partial(of_wang, "grip-slip", 21),
    "levels": three_surfaces,
    "gaps": gaps,
    **{
        f"{model}-{rows}": partial(of_wang, model, rows)
        for model in ("two-mass", "grip-slip")
        for rows in (5, 7)
    },
}


def truth_of(problem: Problem, rng: np.random.Generator) -> FloatArray:
    """Coordinates (1, free) of a truth, from the prior times the density of the scene's contact
    time, at which the model has an answer for all impacts.
    """
    while True:
        q = problem.prior.draw(rng, PRIOR_DRAWS)
        at_draws = cells(problem, q)
        density = scene_density(problem, at_draws.time)
        if problem.contact_time is not None:
            density = density + np.log(problem.contact_time[1]) + 0.5 * np.log(2.0 * np.pi)
        accepted = np.log(rng.uniform(size=PRIOR_DRAWS)) < density
        accepted &= at_draws.possible & np.isfinite(density)
        if accepted.any():
            return q[[int(accepted.argmax())]]


def simulated(problem: Problem, q: FloatArray, rng: np.random.Generator) -> Problem | None:
    """The problem with measurements simulated at the coordinates `q` (1, free): true states are
    drawn about the measured ones, rebounds have errors that follow from theirs, and scatter. None
    where the model has no answer at a true state.
    """
    values = problem.values(q)
    rows = problem.rows
    states = rows.states
    shift = np.zeros(rows.y.shape)
    count = len(rows.y)
    if rows.errors is not None:
        moves = np.einsum("ikl,il->ik", rows.errors.axes, rng.standard_normal((count, 3)))
        states = Impacts(
            states.v_x1 + moves[:, 0],
            states.v_y1 + moves[:, 1],
            states.omega_1 + moves[:, 2],
        )
        values_of_rest, vectors = np.linalg.eigh(rows.errors.rest)
        independent = np.sqrt(np.maximum(values_of_rest, 0.0)) * rng.standard_normal(rows.y.shape)
        shift = np.einsum("ick,ik->ic", vectors, independent)
        shift = shift - np.einsum("ick,ik->ic", rows.errors.follows, moves)
    rebound = problem.rebounds(values, states, np.arange(count))
    if np.any(rebound.status != Status.OK):
        return None
    names = [observable.column.name for observable in problem.observables]
    mean = np.stack([rebound.column(name)[0] for name in names], axis=1)
    sds = []
    for k, name in enumerate(names):
        sds.append(problem.forward.column_sd(name, values, rows.sd[:, k])[0])
    measured = mean + shift + np.stack(sds, axis=1) * rng.standard_normal(rows.y.shape)
    y = np.where(np.isfinite(rows.y), measured, np.nan)
    return replace(problem, rows=replace(rows, y=y))


def ranks_of_table(design: str, number: int) -> Record:
    """Ranks of the truth of table `number` by name of quantity, among draws as they are, and among
    draws pulled together.
    """
    rng = np.random.default_rng([hash_of(design), number])
    designed = DESIGNS[design]()
    problem = None
    while problem is None:
        q = truth_of(designed, rng)
        problem = simulated(designed, q, rng)
    point = best_fit(problem, rng)
    begin = []
    for optimum, density in zip(point.optima, point.log_posterior, strict=True):
        at_optimum = PointFit((optimum,), (density,), point.log_likelihood, point.rms)
        begin.append(first_order(problem, at_optimum).proposal)
    effort = Effort(number, max_steps=STEPS_OF_GAPS if design == "gaps" else STEPS)
    posterior, diagnostics = sample(problem, begin, effort, lambda _stage, _share: None)
    values = posterior.values.reshape(-1, len(problem.free))
    draws = problem.prior.coordinate(values)
    mean = draws.mean(axis=0)
    ranked = draws[np.linspace(0, len(draws) - 1, RANKED).round().astype(np.int64)]
    pulled = mean + PULLED * (ranked - mean)
    ranks = ranks_by_name(problem, ranked, q)
    ranks["log likelihood"] = int((likelihood(problem, ranked) < likelihood(problem, q)).sum())
    return {
        "converged": diagnostics.converged,
        "ranks": ranks,
        "pulled": ranks_by_name(problem, pulled, q),
    }


def ranks_by_name(problem: Problem, draws: FloatArray, q: FloatArray) -> dict[str, int]:
    """By parameter the number of `draws` (draws, free) below the truth `q` (1, free)."""
    return dict(zip(problem.free, (draws < q).sum(axis=0).tolist(), strict=True))


def likelihood(problem: Problem, q: FloatArray) -> FloatArray:
    """Log likelihood (draws,) at coordinates (draws, free)."""
    return log_posterior(problem, q) - problem.prior.log_density(q)


def hash_of(design: str) -> int:
    """A number for a design: with the same random numbers its tables would not be independent of
    those of others.
    """
    return sum(256**k * byte for k, byte in enumerate(design.encode()[:8]))


def smallest_p(records: list[Record], key: str) -> tuple[float, str]:
    """Smallest p-value of uniform ranks over quantities, by Bonferroni, and the quantity; `key` is
    that of the ranks in records.
    """
    names = list(records[0][key])
    p = []
    for name in names:
        ranks = np.array([record[key][name] for record in records])
        p.append(chisquare(np.bincount(ranks * BINS // (RANKED + 1), minlength=BINS)).pvalue)
    return min(1.0, min(p) * len(p)), names[int(np.argmin(p))]


def main() -> int:
    """Fit the tables and print p-values; 1 if ranks of a design are not uniform, if those of its
    control are, or if a table has no fit.
    """
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--tables", type=int, default=300)
    parser.add_argument("--only", nargs="+", default=list(DESIGNS), choices=DESIGNS)
    arguments = parser.parse_args()
    bad = 0
    for design in arguments.only:
        numbers = range(arguments.tables)
        table = partial(ranks_of_table, design)
        records = replicates(f"sbc-{design}", table, numbers, arguments.folder)
        fitted = [record for record in records if "failed" not in record]
        p, name = smallest_p(fitted, "ranks")
        control, worst = smallest_p(fitted, "pulled")
        bad += not p >= LEVEL or not control < LEVEL or len(fitted) < len(records)
        slow = sum(not record["converged"] for record in fitted)
        print(
            f"{design}: {len(fitted)} of {len(records)} tables, {slow} not converged; uniform p = "
            f"{p:.3f} ({name}); control p = {control:.1e} ({worst})",
            flush=True,
        )
    return int(bad > 0)


if __name__ == "__main__":
    sys.exit(main())
