"""Ten tables both ways: weighted one by one, and fitted together with the parameter pooled."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np

from fitball.api.calibrating import pose
from fitball.inference.population.draws import TableDraws
from fitball.inference.population.quantity import default_prior, quantity
from fitball.inference.population.reweighting import population
from fitball.inference.problem.problem import Choices
from fitball.inference.sampling.ensembles import Schedule
from validation.population.tables import (
    MODEL,
    QUANTITIES,
    draw_table,
    draw_truth,
    kept_columns,
    posterior_draws,
)

TABLES, ROWS = 10, 20
# The joint fit has one value of every other parameter for all tables, fits by themselves one each: so that both ask
# the same they are known here.
KNOWN: Mapping[str, float] = {
    "e_x": 0.1, "offset": 2e-3, "cor_slope": -0.012, "velocity_sd": 0.5, "spin_sd": 20.0
}  # fmt: skip
JOINT = Schedule(target_ess=1000.0)


def against_joint_fit(
    seed: int, replicates: int, report: Callable[[int], None] = lambda _done: None
) -> list[Mapping[str, object]]:
    """A row for each of so many sets of ten tables and quantity: median and 95 % ends of centre and spread in the
    coordinate, by weights and by the joint fit (`joint_`), and the truth.
    """
    rows = []
    for number in range(replicates):
        rows += _both(seed, number)
        report(number + 1)
    return rows


def _both(seed: int, number: int) -> list[Mapping[str, object]]:
    root = np.random.SeedSequence(seed, spawn_key=(number, TABLES))
    rng = np.random.default_rng(root)
    truth = draw_truth(rng)
    choices = Choices(model=MODEL, fix=KNOWN, velocity_noise="tied")
    tables = [replace(draw_table(truth, ROWS, rng, KNOWN)[0], name=f"t{k}") for k in range(TABLES)]
    kept = [
        kept_columns(posterior_draws(pose(table, choices, as_read=True), own))
        for table, own in zip(tables, root.spawn(TABLES), strict=True)
    ]
    pooled = replace(choices, pool=dict.fromkeys(QUANTITIES, "table"))
    together = posterior_draws(pose(tables, pooled, as_read=True), root, JOINT)
    columns = dict(zip(together.names, together.draws.T, strict=True))
    rows: list[Mapping[str, object]] = []
    for name in QUANTITIES:
        asked = quantity(name)
        priors = {name: default_prior(asked.parts[0])}
        draws = [TableDraws.of(str(k), asked.coordinates(own), asked.log_prior(priors)) for k, own in enumerate(kept)]
        found = population(draws, asked.before(asked.ends(priors)))
        row: dict[str, object] = {"set": number, "quantity": name}
        joint = {"centre": asked.coordinates(columns), "spread": columns[f"{name}_spread"]}
        for what, known, true in (
            ("centre", found.centre, truth.centre[name]), ("spread", found.spread, truth.spread[name])
        ):  # fmt: skip
            row |= {f"{what}_truth": true, what: known.median, f"{what}_low": known.low, f"{what}_high": known.high}
            ends = np.quantile(joint[what], (0.5, 0.025, 0.975)).tolist()
            row |= dict(zip((f"joint_{what}", f"joint_{what}_low", f"joint_{what}_high"), ends, strict=True))
            row[f"{what}_error"] = known.error
        rows.append(row)
    return rows
