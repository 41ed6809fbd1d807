"""Are the verdicts of a fit true? `trust.py FOLDER [--tables 400 --faulty 20 --made 200]`.

Tables without any code of fitball, of a ball that slides or grips (Walton 1993, Cross 2002). A fit
may object to at most 6 % of clean ones, of 8, 12 and 24 rows. It must object to at least 17 in 20
with a fault. Then tables simulated by the default model: 95 % intervals of parameters called
identified or given must hold in 92 to 98 % of cases. Negative controls: halved intervals must not
hold, and faults of size zero must not be found.
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
from fitball.data.scene import BallSection, Scene, ValueWithSd
from fitball.inference.calibrate import calibrate
from fitball.inference.effort import Effort
from fitball.inference.judgement.adequacy import adequacy
from fitball.inference.judgement.first_order import first_order
from fitball.inference.problem.build import build_problem
from fitball.inference.problem.levels import ALL
from fitball.inference.problem.problem import Choices
from fitball.inference.search.best_fit import best_fit

# A tennis ball: mass [kg], radius [m], moment of inertia over m r^2.
MASS = 0.0576
RADIUS = 0.03302
INERTIA_RATIO = 0.56
# What a scene states of it.
BALL = BallSection(inertia_ratio=INERTIA_RATIO)
# Friction coefficient of the court.
FRICTION = 0.60
# Tangential restitution of a ball that grips.
TANGENTIAL = 0.15
# Offset of the normal force ahead of the centre [m].
OFFSET = 2.0e-3
# Sds of velocities [m/s] and of the spin [rad/s].
NOISE = np.array([[0.2], [0.2], [8.0]])
# Rows of clean tables, the last as many as of faulty ones.
CLEAN_ROWS = (8, 12, 24)
# Rows of tables with a fault.
FAULTY_ROWS = 24
MODELS = ("grip-slip", "two-mass")
# Least and most speed [m/s] and angle of incidence [deg] of impacts.
SPEEDS = (10.0, 25.0)
ANGLES = (15.0, 70.0)
# Sd of the contact time that a scene states [s].
CONTACT_TIME_SD = 5e-4
# Sds of the scatter of tables that the default model makes: those of NOISE.
SCATTER = {"v_x_sd": 0.2, "v_y_sd": 0.2, "spin_sd": 8.0}
# Ranges of parameters of tables that the default model makes: those of measured balls and courts.
TRUE_RANGES: Mapping[str, tuple[float, float]] = {
    "mass_ratio": (0.84, 0.92),
    "k_y": (1.5e4, 3.0e4),
    "k_theta": (8.0, 40.0),
    "mu": (0.45, 0.75),
    "eps_10": (0.001, 0.004),
    "eps_slope": (-2e-4, 2e-4),
    "cor_10": (0.72, 0.8),
    "cor_slope": (-0.016, -0.008),
}
# Largest share of clean tables to which a fit may object; its tests have 5 % by design.
MOST_FALSE_ALARMS = 0.06
# Least share of faulty tables to which a fit must object: 17 in 20.
LEAST_FOUND = 0.85
# Most of 20 tables with a fault of size zero to which a fit may object.
MOST_FOUND_IN_CONTROL = 4
# Shares of 95 % intervals that must hold, least and most.
COVERAGE = (0.92, 0.98)
# Answers of a fit that object to its table.
OBJECTIONS = ("describes except", "does not describe")


class SimulatedTable:
    """A table under construction, which faults change: incidence and noise (3, rows), friction and
    restitution (rows,).
    """

    def __init__(
        self,
        rows: int,
        rng: np.random.Generator,
        speeds: tuple[float, float] = SPEEDS,
        angles: tuple[float, float] = ANGLES,
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
        """Velocities [m/s] and spin [rad/s] (3, rows) after the impact, without noise."""
        v_x, v_y, spin = self.incident
        inertia = INERTIA_RATIO * MASS * RADIUS**2
        normal = MASS * (1.0 + self.restitution) * v_y
        slip = v_x - RADIUS * spin
        # The impulse after which the point of contact leaves with -TANGENTIAL times its slip.
        change = (1.0 + TANGENTIAL) * slip + RADIUS * OFFSET * normal / inertia
        grip = change / (1.0 / MASS + RADIUS**2 / inertia)
        most = self.friction * normal
        along = np.clip(grip, -most, most)
        v_x2 = v_x - along / MASS
        omega_2 = spin + (RADIUS * along - OFFSET * normal) / inertia
        return np.stack([v_x2, self.restitution * v_y, omega_2])

    def frame(self) -> pd.DataFrame:
        """The impacts as a frame that fitball reads."""
        names = ("v_x1", "v_y1", "omega_1", "v_x2", "v_y2", "omega_2")
        columns = [*self.incident, *(self.rebound() + self.noise)]
        frame = pd.DataFrame(dict(zip(names, columns, strict=True)))
        return frame if self.surface is None else frame.assign(surface=self.surface)


def bias(table: SimulatedTable, size: float, _rng: np.random.Generator) -> None:
    """Make v_x2 1.5 m/s too large in all rows."""
    table.noise[0] += 1.5 * size


def growing(table: SimulatedTable, size: float, _rng: np.random.Generator) -> None:
    """Make noise proportional to the speed, of impacts from 5 to 30 m/s."""
    table.noise *= (np.hypot(table.incident[0], table.incident[1]) / 17.5) ** size


def wild(table: SimulatedTable, size: float, rng: np.random.Generator) -> None:
    """Move three spins by 80 to 200 rad/s."""
    rows = rng.choice(FAULTY_ROWS, 3, replace=False)
    table.noise[2, rows] += size * rng.uniform(80.0, 200.0, 3) * rng.choice([-1.0, 1.0], 3)


def drift(table: SimulatedTable, size: float, _rng: np.random.Generator) -> None:
    """Let friction rise from 0.5 to 0.7, and COR by 0.06, along the rows."""
    along = size * np.linspace(-1.0, 1.0, FAULTY_ROWS)
    table.friction += 0.1 * along
    table.restitution += 0.03 * along


def surfaces(table: SimulatedTable, size: float, rng: np.random.Generator) -> None:
    """Make friction 0.5 on hard and 0.75 on clay, which are fitted as one surface."""
    clay = rng.permutation(FAULTY_ROWS) % 2 == 0
    table.friction += np.where(clay, 0.15, -0.10) * size
    table.surface = ["clay" if is_clay else "hard" for is_clay in clay]


# What puts a fault of a size, 1 or 0, into a table.
Spoil = Callable[[SimulatedTable, float, np.random.Generator], None]
# Each fault with the speeds [m/s] and the angles [deg] of its impacts.
FAULTS: Mapping[Spoil, tuple[tuple[float, float], tuple[float, float]]] = {
    bias: (SPEEDS, ANGLES),
    growing: ((5.0, 30.0), ANGLES),
    wild: (SPEEDS, ANGLES),
    drift: (SPEEDS, ANGLES),
    surfaces: (SPEEDS, (12.0, 45.0)),
}


def answer_of(frame: pd.DataFrame, model: str, rng: np.random.Generator) -> Record:
    """The answer of the residual tests of a fit to a table, and their least p-value."""
    problem = build_problem(load_table(frame), Scene(ball=BALL), Choices(model, pool={ALL: "none"}))
    point = best_fit(problem, rng)
    judgement = adequacy(problem, point, first_order(problem, point))
    least_p = min([test.p for test in judgement.tests], default=1.0)
    return {"answer": judgement.answer, "p": least_p}


def clean(model: str, number: int) -> Record:
    """The answer of a fit to clean table `number`."""
    rng = np.random.default_rng([1, number])
    rows = CLEAN_ROWS[number % len(CLEAN_ROWS)]
    table = SimulatedTable(rows, rng)
    return {"rows": rows, **answer_of(table.frame(), model, rng)}


def faulty(model: str, fault: str, size: float, number: int) -> Record:
    """The answer of a fit to table `number` with a fault of this name and size."""
    spoil = next(function for function in FAULTS if function.__name__ == fault)
    rng = np.random.default_rng([2, number])
    table = SimulatedTable(FAULTY_ROWS, rng, *FAULTS[spoil])
    spoil(table, size, rng)
    return answer_of(table.frame(), model, rng)


def intervals(number: int) -> Record:
    """Of a fit to simulated table `number` of the default model by name of parameter the verdict,
    the ends of the 95 % interval and the truth.
    """
    rng = np.random.default_rng([3, number])
    states = load_table("wang_all.csv").impacts
    model = fitball.model("two-mass")
    while True:
        truth = {name: float(rng.uniform(*ends)) for name, ends in TRUE_RANGES.items()}
        typical = {spec.name: spec.typical for spec in model.parameters if spec.typical is not None}
        values = typical | truth
        rebound = model.rebound(values, states)
        if not rebound.status.any():
            break
    truth |= SCATTER
    columns = {"v_x1": states.v_x1, "v_y1": states.v_y1, "omega_1": states.omega_1}
    for name, noise in (("v_x2", "v_x_sd"), ("v_y2", "v_y_sd"), ("omega_2", "spin_sd")):
        scatter = truth[noise] * rng.standard_normal(len(states))
        columns[name] = getattr(rebound, name) + scatter
    # The contact time of the scene is a measurement, too.
    time = float(rebound.contact_time.mean() + CONTACT_TIME_SD * rng.standard_normal())
    scene = Scene(ball=BALL, contact_time=ValueWithSd(time, CONTACT_TIME_SD))
    problem = build_problem(load_table(pd.DataFrame(columns)), scene, Choices())
    fit = calibrate(problem, Effort(number), lambda _stage, _share: None)
    parameters = {
        name: [estimate.verdict, estimate.q025, estimate.q975, truth[name]]
        for name, estimate in fit.parameters.items()
        if name in truth
    }
    return {"parameters": parameters, "answer": fit.adequacy.answer}


class Verdicts:
    """Prints rates, each with whether it keeps its limit, and collects the latter as `held`."""

    def __init__(self) -> None:
        self.held: list[bool] = []

    def add(self, words: str, rate: Rate, holds: bool) -> None:
        """Print a rate, and remember whether its limit holds."""
        self.held.append(holds)
        print(f"{'ok' if holds else 'NOT KEPT':9}{words}: {rate}", flush=True)


def objections(records: list[Record]) -> Rate:
    """The rate of tables to which a fit objected."""
    return Rate(sum(record.get("answer") in OBJECTIONS for record in records), len(records))


def judge_clean(verdicts: Verdicts, model: str, count: int, folder: Path) -> None:
    """Judge the rates of objections to `count` clean tables, by number of rows."""
    records = replicates(f"clean-{model}", partial(clean, model), range(count), folder)
    for rows in CLEAN_ROWS:
        rate = objections([record for record in records if record.get("rows") == rows])
        verdicts.add(
            f"clean, {rows} rows, {model} objects", rate, rate.interval[0] <= MOST_FALSE_ALARMS
        )


def judge_faults(verdicts: Verdicts, model: str, count: int, folder: Path) -> None:
    """Judge the rates of objections to `count` tables with each fault, and with that of size
    zero.
    """
    for spoil in FAULTS:
        name = spoil.__name__
        case = partial(faulty, model, name, 1.0)
        rate = objections(replicates(f"{name}-{model}", case, range(count), folder))
        verdicts.add(f"{name}, {model} objects", rate, rate.hits >= LEAST_FOUND * count)
        control = partial(faulty, model, name, 0.0)
        rate = objections(replicates(f"{name}0-{model}", control, range(count), folder))
        verdicts.add(
            f"control: {name} of size zero, {model} objects",
            rate,
            rate.hits <= MOST_FOUND_IN_CONTROL,
        )


def covered(tables: list[Record], share: float) -> dict[str, list[bool]]:
    """By verdict, whether each interval contains the truth, shortened about its middle to this
    share.
    """
    hits: dict[str, list[bool]] = {}
    for table in tables:
        for verdict, low, high, truth in table.values():
            middle = 0.5 * (low + high)
            arm = 0.5 * share * (high - low)
            hits.setdefault(verdict, []).append(abs(truth - middle) <= arm)
    return hits


def judge_intervals(verdicts: Verdicts, count: int, folder: Path) -> None:
    """Judge how often intervals of parameters called identified or given contain the truth, and
    halved ones.
    """
    records = replicates("intervals", intervals, range(count), folder)
    tables = [record["parameters"] for record in records if "parameters" in record]
    for words, share, must_hold in (("whole", 1.0, True), ("halved, a control", 0.5, False)):
        hits = covered(tables, share)
        relied = [*hits.get("identified", []), *hits.get("given", [])]
        rate = Rate(sum(relied), len(relied))
        holds = COVERAGE[0] <= rate.hits / max(rate.total, 1) <= COVERAGE[1]
        verdicts.add(f"identified or given, intervals {words}", rate, holds == must_hold)
        for verdict, of_verdict in hits.items():
            print(f"         {verdict}: {Rate(sum(of_verdict), len(of_verdict))}")


def main() -> int:
    """Fit all tables and print the rates with their limits; 1 if a limit is not kept."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    for name, count in (("tables", 400), ("faulty", 20), ("made", 200)):
        parser.add_argument(f"--{name}", type=int, default=count)
    arguments = parser.parse_args()
    verdicts = Verdicts()
    for model in MODELS:
        judge_clean(verdicts, model, arguments.tables, arguments.folder)
        judge_faults(verdicts, model, arguments.faulty, arguments.folder)
    judge_intervals(verdicts, arguments.made, arguments.folder)
    return int(not all(verdicts.held))


if __name__ == "__main__":
    sys.exit(main())
