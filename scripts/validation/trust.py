"""Is what a fit says of itself true? `trust.py FOLDER [--tables 400 --faulty 20 --made 200]`.

Tables that no code of fitball made, of a ball that slides or grips (Walton 1993, Cross 2002): clean
ones of 8, 12 and 24 rows, at most 6 % of which may be objected to, and tables with one fault each,
of which at least 17 in 20 must be. Then tables made by the default model: 95 % intervals of
parameters called identified or given must hold in 92 to 98 % of cases. Negative controls: halved
intervals must not hold, and faults of size zero must not be found.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd
from study import Rate, Record, replicates

import fitball
from fitball.base.values import FloatArray
from fitball.data.read import load_table
from fitball.data.scene import Scene, ValueWithSd
from fitball.inference.calibrate import calibrate
from fitball.inference.effort import Effort
from fitball.inference.judgement.adequacy import adequacy
from fitball.inference.judgement.first_order import first_order
from fitball.inference.problem.build import build_problem
from fitball.inference.problem.levels import ALL
from fitball.inference.problem.problem import Choices
from fitball.inference.search.best_fit import best_fit

MASS = 0.0576
RADIUS = 0.03302
INERTIA_RATIO = 0.56
FRICTION = 0.60
TANGENTIAL = 0.15
OFFSET = 2.0e-3
# Of the velocities [m/s] and of the spin [rad/s].
NOISE = np.array([[0.2], [0.2], [8.0]])
CLEAN_ROWS = (8, 12, 24)
ROWS = 24
MODELS = ("grip-slip", "two-mass")
# Truth of the tables that the default model makes; the ranges are those of measured balls and
# courts.
TRUE: Mapping[str, tuple[float, float]] = {
    "mass_ratio": (0.84, 0.92),
    "k_y": (1.5e4, 3.0e4),
    "k_theta": (8.0, 40.0),
    "mu": (0.45, 0.75),
    "eps_10": (0.001, 0.004),
    "eps_slope": (-2e-4, 2e-4),
    "cor_10": (0.72, 0.8),
    "cor_slope": (-0.016, -0.008),
}
OBJECTIONS = ("describes except", "does not describe")


class Made:
    """A table under construction: incidence (3, rows), friction and restitution (rows,), noise (3,
    rows).
    """

    def __init__(
        self,
        rows: int,
        rng: np.random.Generator,
        speeds: tuple[float, float],
        angles: tuple[float, float],
    ):
        speed = rng.uniform(*speeds, rows)
        angle = np.radians(rng.uniform(*angles, rows))
        self.incident = np.stack(
            [speed * np.cos(angle), speed * np.sin(angle), rng.uniform(-180.0, 180.0, rows)]
        )
        self.friction = np.full(rows, FRICTION)
        self.noise = NOISE * rng.standard_normal((3, rows))
        self.restitution = 0.77 - 0.012 * (self.incident[1] - 10.0)
        self.surface: list[str] | None = None

    def rebound(self) -> FloatArray:
        """Velocities and spin (3, rows) after the impact, without noise."""
        v_x, v_y, spin = self.incident
        inertia = INERTIA_RATIO * MASS * RADIUS**2
        normal = MASS * (1.0 + self.restitution) * v_y
        slip = v_x - RADIUS * spin
        # The impulse after which the point of contact leaves with -TANGENTIAL times its slip.
        grip = (1.0 + TANGENTIAL) * slip + RADIUS * OFFSET * normal / inertia
        grip = grip / (1.0 / MASS + RADIUS**2 / inertia)
        along = np.clip(grip, -self.friction * normal, self.friction * normal)
        return np.stack(
            [
                v_x - along / MASS,
                self.restitution * v_y,
                spin + (RADIUS * along - OFFSET * normal) / inertia,
            ]
        )

    def frame(self) -> pd.DataFrame:
        """As a table."""
        names = ("v_x1", "v_y1", "omega_1", "v_x2", "v_y2", "omega_2")
        found = pd.DataFrame(
            dict(zip(names, [*self.incident, *(self.rebound() + self.noise)], strict=True))
        )
        return found if self.surface is None else found.assign(surface=self.surface)


def bias(made: Made, size: float, _rng: np.random.Generator) -> None:
    """v_x2 1.5 m/s too large in all rows."""
    made.noise[0] += 1.5 * size


def growing(made: Made, size: float, _rng: np.random.Generator) -> None:
    """Noise in proportion to the speed, from 5 to 30 m/s."""
    made.noise *= (np.hypot(made.incident[0], made.incident[1]) / 17.5) ** size


def wild(made: Made, size: float, rng: np.random.Generator) -> None:
    """Three spins off by 80 to 200 rad/s."""
    rows = rng.choice(ROWS, 3, replace=False)
    made.noise[2, rows] += size * rng.uniform(80.0, 200.0, 3) * rng.choice([-1.0, 1.0], 3)


def drift(made: Made, size: float, _rng: np.random.Generator) -> None:
    """Friction from 0.5 to 0.7, and COR from 0.03 below to 0.03 above, along the rows."""
    along = size * np.linspace(-1.0, 1.0, ROWS)
    made.friction += 0.1 * along
    made.restitution += 0.03 * along


def surfaces(made: Made, size: float, rng: np.random.Generator) -> None:
    """Friction 0.5 on hard and 0.75 on clay, which a column names, fitted as one surface."""
    clay = rng.permutation(ROWS) % 2 == 0
    made.friction += np.where(clay, 0.15, -0.10) * size
    made.surface = ["clay" if one else "hard" for one in clay]


Spoil = Callable[[Made, float, np.random.Generator], None]
# Each fault with the speeds [m/s] and the angles [deg] of its impacts.
FAULTS: Mapping[Spoil, tuple[tuple[float, float], tuple[float, float]]] = {
    bias: ((10.0, 25.0), (15.0, 70.0)),
    growing: ((5.0, 30.0), (15.0, 70.0)),
    wild: ((10.0, 25.0), (15.0, 70.0)),
    drift: ((10.0, 25.0), (15.0, 70.0)),
    surfaces: ((10.0, 25.0), (12.0, 45.0)),
}


def answered(frame: pd.DataFrame, model: str, rng: np.random.Generator) -> Record:
    """What a fit of best values says of a table."""
    problem = build_problem(load_table(frame), Scene(), Choices(model, pool={ALL: "none"}))
    point = best_fit(problem, rng)
    found = adequacy(problem, point, first_order(problem, point))
    return {"answer": found.answer, "p": min([one.p for one in found.tests], default=1.0)}


def clean(model: str, number: int) -> Record:
    """Table `number` without a fault."""
    rng = np.random.default_rng([1, number])
    rows = CLEAN_ROWS[number % len(CLEAN_ROWS)]
    made = Made(rows, rng, (10.0, 25.0), (15.0, 70.0))
    return {"rows": rows, **answered(made.frame(), model, rng)}


def faulty(model: str, fault: str, size: float, number: int) -> Record:
    """Table `number` with a fault."""
    spoil = next(one for one in FAULTS if one.__name__ == fault)
    rng = np.random.default_rng([2, number])
    made = Made(ROWS, rng, *FAULTS[spoil])
    spoil(made, size, rng)
    return answered(made.frame(), model, rng)


def told(number: int) -> Record:
    """Of table `number` that the default model made: verdict, 95 % interval, truth of each
    parameter, by name.
    """
    rng = np.random.default_rng([3, number])
    known = load_table("wang_all.csv")
    sd = 5e-4
    model = fitball.model("two-mass")
    states = known.impacts
    while True:
        truth = {name: float(rng.uniform(*ends)) for name, ends in TRUE.items()}
        typical = {spec.name: spec.typical for spec in model.parameters if spec.typical is not None}
        values = typical | truth
        made = model.rebound(values, states)
        if not made.status.any():
            break
    truth |= {"v_x_sd": 0.2, "v_y_sd": 0.2, "spin_sd": 8.0}
    columns = {"v_x1": states.v_x1, "v_y1": states.v_y1, "omega_1": states.omega_1}
    for name, noise in (("v_x2", "v_x_sd"), ("v_y2", "v_y_sd"), ("omega_2", "spin_sd")):
        columns[name] = getattr(made, name) + truth[noise] * rng.standard_normal(len(states))
    # The scene's contact time is a measurement, too.
    time = float(made.contact_time.mean() + sd * rng.standard_normal())
    problem = build_problem(
        load_table(pd.DataFrame(columns)),
        Scene(contact_time=ValueWithSd(time, sd)),
        Choices(),
    )
    fit = calibrate(problem, Effort(number), lambda _stage, _share: None)
    said = {
        name: [one.verdict, one.q025, one.q975, truth[name]]
        for name, one in fit.parameters.items()
        if name in truth
    }
    return {"said": said, "answer": fit.adequacy.answer}


class Verdicts:
    """The rates, each printed beside whether it keeps its limit."""

    def __init__(self) -> None:
        self.held: list[bool] = []

    def add(self, words: str, rate: Rate, holds: bool) -> None:
        """Print a rate, and remember whether its limit holds."""
        self.held.append(holds)
        print(f"{'ok' if holds else 'NOT KEPT':9}{words}: {rate}", flush=True)


def objected(records: list[Record]) -> Rate:
    """How often a fit objected to its table."""
    return Rate(sum(record.get("answer") in OBJECTIONS for record in records), len(records))


def judge_clean(verdicts: Verdicts, model: str, count: int, folder: Path) -> None:
    """At most 6 % of `count` clean tables may be objected to, by number of rows."""
    records = replicates(f"clean-{model}", partial(clean, model), range(count), folder)
    for rows in CLEAN_ROWS:
        rate = objected([record for record in records if record.get("rows") == rows])
        verdicts.add(f"clean, {rows} rows, {model} objects", rate, rate.interval[0] <= 0.06)


def judge_faults(verdicts: Verdicts, model: str, count: int, folder: Path) -> None:
    """Of `count` tables with a fault at least 17 in 20 must be objected to; at most four where the
    fault has size zero.
    """
    for spoil in FAULTS:
        name = spoil.__name__
        case = partial(faulty, model, name, 1.0)
        rate = objected(replicates(f"{name}-{model}", case, range(count), folder))
        verdicts.add(f"{name}, {model} objects", rate, rate.hits >= 0.85 * count)
        control = partial(faulty, model, name, 0.0)
        rate = objected(replicates(f"{name}0-{model}", control, range(count), folder))
        verdicts.add(
            f"control: {name} of size zero, {model} objects",
            rate,
            rate.hits <= 4,
        )


def covered(tables: list[Record], share: float) -> dict[str, list[bool]]:
    """By verdict, whether intervals, shortened about their middle to this share, have the truth."""
    hits: dict[str, list[bool]] = {}
    for table in tables:
        for verdict, low, high, truth in table.values():
            middle = 0.5 * (low + high)
            arm = 0.5 * share * (high - low)
            hits.setdefault(verdict, []).append(abs(truth - middle) <= arm)
    return hits


def judge_intervals(verdicts: Verdicts, count: int, folder: Path) -> None:
    """Intervals of parameters called identified or given must hold in 92 to 98 % of cases, halved
    ones must not.
    """
    records = replicates("told", told, range(count), folder)
    tables = [record["said"] for record in records if "said" in record]
    for words, share, wanted in (("whole", 1.0, True), ("halved, a control", 0.5, False)):
        hits = covered(tables, share)
        relied = [*hits.get("identified", []), *hits.get("given", [])]
        rate = Rate(sum(relied), len(relied))
        within = 0.92 <= rate.hits / max(rate.total, 1) <= 0.98
        verdicts.add(f"identified or given, intervals {words}", rate, within == wanted)
        for verdict, of_verdict in hits.items():
            print(f"         {verdict}: {Rate(sum(of_verdict), len(of_verdict))}")


def main() -> int:
    """Make all tables, print the rates beside their limits; 1 if one is not kept."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    for name, count in (("tables", 400), ("faulty", 20), ("made", 200)):
        parser.add_argument(f"--{name}", type=int, default=count)
    asked = parser.parse_args()
    verdicts = Verdicts()
    for model in MODELS:
        judge_clean(verdicts, model, asked.tables, asked.folder)
        judge_faults(verdicts, model, asked.faulty, asked.folder)
    judge_intervals(verdicts, asked.made, asked.folder)
    return int(not all(verdicts.held))


if __name__ == "__main__":
    sys.exit(main())
