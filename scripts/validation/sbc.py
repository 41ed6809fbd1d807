"""Are posteriors right? Simulation-based calibration (Talts et al. 2018): `sbc.py FOLDER [--tables
300 --only NAME]`.

A truth is drawn from the prior, its table simulated and fitted as `calibrate` does it: then the
rank of the truth among draws is uniform, for every parameter and for the log likelihood (Modrak et
al. 2023). The scene's contact time is the same in every table, as it is for a user, so it is a part
of the prior here. One test for each design: the smallest p-value of chi-square over 20 bins, by
Bonferroni, at 1 %. Control: draws pulled together by 30 % must fail.
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
from fitball.data.read import load_data, load_table
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

# Draws of a posterior that are ranked: 20 bins of ranks 0 to 99.
RANKED = 99
BINS = 20
LEVEL = 0.01
# Steps of chains at most: so few draws can be ranked long before tails have their effective size;
# gaps cost the most.
STEPS = 1_000
STEPS_OF_GAPS = 160
PULLED = 0.7


def of_wang(model: str, rows: int) -> Problem:
    """Some of Wang's 21 impacts, evenly spread, and his scene."""
    table, scene = load_data(["wang_all.csv"], None, as_read=True)[:2]
    chosen = np.linspace(0, len(table) - 1, rows).round().astype(np.int64)
    return build_problem(table.take(chosen), scene, Choices(model))


def two_courts() -> Problem:
    """24 impacts on three surfaces, friction and restitution fitted to each."""
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
    return build_problem(
        table,
        Scene(),
        Choices("grip-slip", pool={"mu": "surface", "cor_10": "surface"}),
    )


def gaps() -> Problem:
    """Every second impact of the bundled table of a camera: gaps, uncertain incidence, correlated
    errors, constants of camera and ball.
    """
    table, scene = load_data(["synthetic_gaps.csv"], None, as_read=True)[:2]
    return build_problem(table.take(np.arange(0, len(table), 2)), scene, Choices())


DESIGNS: Mapping[str, Callable[[], Problem]] = {
    "two-mass": partial(of_wang, "two-mass", 21),
    "grip-slip": partial(of_wang, "grip-slip", 21),
    "levels": two_courts,
    "gaps": gaps,
    **{
        f"{model}-{rows}": partial(of_wang, model, rows)
        for model in ("two-mass", "grip-slip")
        for rows in (5, 7)
    },
}


def truth_of(problem: Problem, rng: np.random.Generator) -> FloatArray:
    """Coordinates (1, free) from the prior times the density of the scene's contact time, where all
    has an answer.
    """
    while True:
        q = problem.prior.draw(rng, 64)
        made = cells(problem, q)
        density = scene_density(problem, made.time)
        if problem.contact_time is not None:
            density = density + np.log(problem.contact_time[1]) + 0.5 * np.log(2.0 * np.pi)
        kept = made.possible & np.isfinite(density) & (np.log(rng.uniform(size=64)) < density)
        if kept.any():
            return q[[int(kept.argmax())]]


def simulated(problem: Problem, q: FloatArray, rng: np.random.Generator) -> Problem | None:
    """The problem with measurements made at `q`: true states drawn about the measured ones, errors
    that follow from theirs, scatter. None where the model has no answer at a true state.
    """
    values = problem.values(q)
    rows = problem.rows
    states = rows.states
    shift = np.zeros(rows.y.shape)
    count = len(rows.y)
    if rows.errors is not None:
        moves = np.einsum("ikl,il->ik", rows.errors.axes, rng.standard_normal((count, 3)))
        states = Impacts(
            *(
                getattr(states, name) + moves[:, k]
                for k, name in enumerate(("v_x1", "v_y1", "omega_1"))
            )
        )
        values_of_rest, vectors = np.linalg.eigh(rows.errors.rest)
        own = np.sqrt(np.maximum(values_of_rest, 0.0)) * rng.standard_normal(rows.y.shape)
        shift = np.einsum("ick,ik->ic", vectors, own) - np.einsum(
            "ick,ik->ic",
            rows.errors.follows,
            moves,
        )
    rebound = problem.rebounds(values, states, np.arange(count))
    if np.any(rebound.status != Status.OK):
        return None
    names = [item.column.name for item in problem.observables]
    mean = np.stack([rebound.column(name)[0] for name in names], axis=1)
    scatter = np.stack(
        [problem.forward.column_sd(name, values, rows.sd[:, k])[0] for k, name in enumerate(names)],
        axis=1,
    )
    y = np.where(
        np.isfinite(rows.y),
        mean + shift + scatter * rng.standard_normal(rows.y.shape),
        np.nan,
    )
    return replace(problem, rows=replace(rows, y=y))


def ranked(design: str, number: int) -> Record:
    """Ranks of the truth of table `number`, by name, among draws as they are and pulled
    together.
    """
    rng = np.random.default_rng([hash_of(design), number])
    problem = DESIGNS[design]()
    made = None
    while made is None:
        q = truth_of(problem, rng)
        made = simulated(problem, q, rng)
    point = best_fit(made, rng)
    begin = [
        first_order(made, PointFit((own,), (density,), point.log_likelihood, point.rms)).proposal
        for own, density in zip(point.optima, point.log_posterior, strict=True)
    ]
    effort = Effort(number, max_steps=STEPS_OF_GAPS if design == "gaps" else STEPS)
    posterior, diagnostics = sample(made, begin, effort, lambda _stage, _share: None)
    flat = made.prior.coordinate(posterior.values.reshape(-1, len(made.free)))
    chosen = flat[np.linspace(0, len(flat) - 1, RANKED).round().astype(np.int64)]
    found: Record = {"converged": diagnostics.converged}
    for name, draws in (
        ("ranks", chosen),
        ("pulled", flat.mean(axis=0) + PULLED * (chosen - flat.mean(axis=0))),
    ):
        below = dict(zip(made.free, (draws < q).sum(axis=0).tolist(), strict=True))
        if name == "ranks":
            score = [log_posterior(made, x) - made.prior.log_density(x) for x in (draws, q)]
            below["log likelihood"] = int((score[0] < score[1]).sum())
        found[name] = below
    return found


def hash_of(design: str) -> int:
    """A number of a design's own: the same random numbers in two would be no independent tables."""
    return sum(256**k * byte for k, byte in enumerate(design.encode()[:8]))


def smallest(found: list[Record], which: str) -> tuple[float, str]:
    """Smallest p-value of uniform ranks over quantities, by Bonferroni, and the quantity."""
    names = list(found[0][which])
    p = []
    for name in names:
        ranks = np.array([one[which][name] for one in found])
        p.append(chisquare(np.bincount(ranks * BINS // (RANKED + 1), minlength=BINS)).pvalue)
    return min(1.0, min(p) * len(p)), names[int(np.argmin(p))]


def main() -> int:
    """Fit the tables, print p-values; 1 if a design is not uniform, or its control is."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--tables", type=int, default=300)
    parser.add_argument("--only", nargs="+", default=list(DESIGNS), choices=DESIGNS)
    asked = parser.parse_args()
    bad = 0
    for design in asked.only:
        every = replicates(
            f"sbc-{design}",
            partial(ranked, design),
            range(asked.tables),
            asked.folder,
        )
        found = [one for one in every if "failed" not in one]
        p, name = smallest(found, "ranks")
        control, worst = smallest(found, "pulled")
        bad += not p >= LEVEL or not control < LEVEL or len(found) < len(every)
        slow = sum(not one["converged"] for one in found)
        print(
            f"{design}: {len(found)} of {len(every)} tables, {slow} not converged; uniform p = "
            f"{p:.3f} ({name}); "
            f"control p = {control:.1e} ({worst})",
            flush=True,
        )
    return int(bad > 0)


if __name__ == "__main__":
    sys.exit(main())
