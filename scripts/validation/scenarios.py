"""Kinds of simulated tables, with their incident conditions and scenes. Some come from the fitted model, with a truth
from the prior draws. Others come from one truth and contain one thing that the model does not describe.

Tables of other code are of a ball that slides or grips, after Walton (1993) and Cross (2002), with one fault each, as
a CSV file. They use no model of fitball, so that an error of fitball is not repeated.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from fitball.api.calibrating import pose
from fitball.data.read import load_table
from fitball.data.scene import NO_SPIN_SD, NO_VELOCITY_SD, Scene, load_scene
from fitball.data.table import ImpactTable, Measurement
from fitball.inference.problem.build import Choices, build_problem
from fitball.inference.problem.problem import Problem
from fitball.models.registry import model
from fitball.models.specs import DEFAULT_MODEL
from fitball.models.types import Rebound
from fitball.values import FloatArray, Impacts
from validation.harness import drawn_truth, simulated_columns

ROWS = 24
MASS, RADIUS, INERTIA_RATIO = 0.0576, 0.03302, 0.56
FRICTION, TANGENTIAL, OFFSET = 0.60, 0.15, 2.0e-3
# Noise of the velocities [m/s] and of the spin [rad/s].
NOISE = np.array([[0.2], [0.2], [8.0]])
COLUMNS = ("v_x1 [m/s]", "v_y1 [m/s]", "omega_1 [rad/s]", "v_x2 [m/s]", "v_y2 [m/s]", "omega_2 [rad/s]")


@dataclass
class Made:
    """A table under construction: incidence (3, rows), friction and restitution (rows,), noise (3, rows) that
    includes faults of the measurements, the surface of each row, and the number of copies of the table.
    """

    incident: FloatArray
    friction: FloatArray
    restitution: FloatArray
    noise: FloatArray
    surface: list[str] = field(default_factory=list)
    copies: int = 1


# Puts a fault into a table: its size, as a share of the usual one.
Spoil = Callable[[Made, float, np.random.Generator], None]


def foreign_rebound(incident: FloatArray, friction: FloatArray, restitution: FloatArray) -> FloatArray:
    """Velocity along and away from the court [m/s] and spin [rad/s] (3, rows) after impacts (3, rows)."""
    v_x, v_y, spin = incident
    inertia = INERTIA_RATIO * MASS * RADIUS**2
    normal = MASS * (1.0 + restitution) * v_y
    slip = v_x - RADIUS * spin
    # Impulse along the court after which the point of contact leaves with -TANGENTIAL times its slip.
    grip = ((1.0 + TANGENTIAL) * slip + RADIUS * OFFSET * normal / inertia) / (1.0 / MASS + RADIUS**2 / inertia)
    along = np.minimum(np.maximum(grip, -friction * normal), friction * normal)
    return np.stack([v_x - along / MASS, restitution * v_y, spin + (RADIUS * along - OFFSET * normal) / inertia])


def _no_fault(_made: Made, _size: float, _rng: np.random.Generator) -> None:
    """Leave all as it is."""


def _bias(made: Made, size: float, _rng: np.random.Generator) -> None:
    made.noise[0] += 1.5 * size


def _growing(made: Made, size: float, _rng: np.random.Generator) -> None:
    made.noise *= (np.hypot(made.incident[0], made.incident[1]) / 17.5) ** size


def _wild(made: Made, size: float, rng: np.random.Generator) -> None:
    rows = rng.choice(ROWS, 3, replace=False)
    made.noise[2, rows] += size * rng.uniform(80.0, 200.0, 3) * rng.choice([-1.0, 1.0], 3)


def _drift(made: Made, size: float, _rng: np.random.Generator) -> None:
    along = size * np.linspace(-1.0, 1.0, ROWS)
    made.friction += 0.1 * along
    made.restitution += 0.03 * along


def _surfaces(made: Made, size: float, rng: np.random.Generator) -> None:
    clay = rng.permutation(ROWS) % 2 == 0
    made.friction += np.where(clay, 0.15, -0.10) * size
    made.surface = ["clay" if one else "hard" for one in clay]


def _copies(made: Made, _size: float, _rng: np.random.Generator) -> None:
    half = ROWS // 2
    made.incident, made.noise = made.incident[:, :half], made.noise[:, :half]
    made.friction, made.restitution = made.friction[:half], made.restitution[:half]
    made.copies = 5


@dataclass(frozen=True)
class Fault:
    """A fault in `words`, its effect (`spoil`), the incident speeds [m/s] and angles [deg], the sizes that are tried
    as shares of the usual one, and whether other assumptions are examined too.
    """

    words: str
    spoil: Spoil
    speeds: tuple[float, float] = (10.0, 25.0)
    angles: tuple[float, float] = (15.0, 70.0)
    sizes: tuple[float, ...] = (1.0, 0.5)
    looked: bool = False


FAULTS: Mapping[str, Fault] = {
    "clean": Fault("nothing is wrong", _no_fault, sizes=(1.0,), looked=True),
    "bias": Fault("v_x2 1.5 m/s too large in all rows", _bias),
    "growing": Fault("noise in proportion to the speed, 5 to 30 m/s", _growing, speeds=(5.0, 30.0)),
    "wild": Fault("three spins off by 80 to 200 rad/s", _wild, looked=True),
    "drift": Fault("mu 0.5 to 0.7 and COR 0.03 below to above along the rows", _drift),
    "surfaces": Fault("mu 0.5 on hard and 0.75 on clay, which a column names", _surfaces, angles=(12.0, 45.0)),
    "copies": Fault("12 impacts, each in the table five times", _copies, sizes=(1.0,)),
}


def foreign_text(name: str, size: float, rng: np.random.Generator) -> str:
    """A table with the fault `name` of a `size`, as CSV."""
    fault = FAULTS[name]
    speed, angle = rng.uniform(*fault.speeds, ROWS), np.radians(rng.uniform(*fault.angles, ROWS))
    incident = np.stack([speed * np.cos(angle), speed * np.sin(angle), rng.uniform(-180.0, 180.0, ROWS)])
    restitution = 0.77 - 0.012 * (incident[1] - 10.0)
    made = Made(incident, np.full(ROWS, FRICTION), restitution, NOISE * rng.standard_normal((3, ROWS)))
    fault.spoil(made, size, rng)
    after = foreign_rebound(made.incident, made.friction, made.restitution) + made.noise
    lines = [",".join(map(repr, row)) for row in np.concatenate([made.incident, after]).T.tolist()]
    head = ",".join([*COLUMNS, *(["surface"] if made.surface else [])])
    if made.surface:
        lines = [f"{line},{surface}" for line, surface in zip(lines, made.surface, strict=True)]
    return "\n".join([head, *(lines * made.copies)]) + "\n"


def foreign_problem(name: str, size: float, fitted: str, rng: np.random.Generator) -> Problem:
    """The same as `calibrate` poses it for the model `fitted`. Raises FitballError where it refuses the table."""
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder) / f"{name}.csv"
        place.write_text(foreign_text(name, size, rng), encoding="utf-8")
        return pose(place, Choices(model=fitted))


WANG = "wang_all.csv"
# A court's contact time as a scene may know it [s].
CONTACT_TIME = (5.0e-3, 0.5e-3)
GROUPS = 4


@dataclass(frozen=True)
class Design:
    """What is known of a table before it is measured: rows, incidence and scene. `columns` are measured."""

    words: str
    scene: Scene
    make: Callable[[int], Impacts]
    rows: int
    columns: tuple[str, ...] = ("v_x2", "v_y2", "omega_2")

    def table(self, times: int = 1) -> ImpactTable:
        """The design as a table of zeros; so many `times` as long, further rows between those that there are."""
        impacts = self.make(self.rows * times)
        count = len(impacts)
        drop = not np.any(impacts.v_x1)
        return replace(
            load_table(WANG),
            name="simulated",
            source="simulated",
            impacts=impacts,
            incident_columns=("v_y1",) if drop else ("v_x1", "v_y1", "omega_1"),
            ids=tuple(str(k + 1) for k in range(count)),
            measurements=tuple(Measurement(name, np.zeros(count)) for name in self.columns),
            redundant=(),
            labels={} if drop else {"group": tuple("ABCD"[GROUPS * k // count] for k in range(count))},
            notices=(),
        )


def _evenly(low: float, high: float, count: int, step: float) -> FloatArray:
    """Numbers that fill a range evenly however many there are (Weyl 1916)."""
    return np.asarray(low + (high - low) * ((0.5 + step * np.arange(count)) % 1.0))


# Steps of sequences that fill a square or a cube evenly: roots of two and three, and the golden section.
STEPS = (0.6180339887498949, 0.41421356237309515, 0.7320508075688772)


def spread(angle: tuple[float, float], speed: tuple[float, float], spin: float) -> Callable[[int], Impacts]:
    """Impacts over ranges of angle [deg] and speed [m/s], with spins [rad/s] of either sign up to `spin`."""

    def make(count: int) -> Impacts:
        theta = np.radians(_evenly(*angle, count, STEPS[0]))
        fast = _evenly(*speed, count, STEPS[1])
        return Impacts(fast * np.cos(theta), fast * np.sin(theta), _evenly(-spin, spin, count, STEPS[2]))

    return make


def _wang(count: int) -> Impacts:
    impacts = load_table(WANG).impacts
    return impacts.take(np.arange(count) % len(impacts))


def _drop(count: int) -> Impacts:
    return Impacts(np.zeros(count), _evenly(3.0, 12.0, count, STEPS[0]), np.zeros(count))


# True noises are drawn from priors, which are wider than what a scene means that states a noise.
_SILENT = (NO_VELOCITY_SD, NO_SPIN_SD)
_TIMED = Scene(contact_time=CONTACT_TIME, assumed=_SILENT)
_WANG_SCENE = replace(load_scene(WANG), assumed=_SILENT)
DESIGNS: Mapping[str, Design] = {
    "wang": Design("Wang's 21 impacts, his scene", _WANG_SCENE, _wang, 21),
    "untimed": Design(
        "Wang's 21 impacts, contact time not known", replace(_WANG_SCENE, contact_time=None), _wang, 21
    ),
    "grip": Design(
        "21 steep impacts, at which most balls grip", _TIMED, spread((55.0, 75.0), (12.0, 18.0), 100.0), 21
    ),
    "slide": Design("21 shallow impacts, at which balls slide", _TIMED, spread((11.0, 17.0), (25.0, 40.0), 50.0), 21),
    "one-angle": Design("21 impacts at one angle", _TIMED, spread((35.0, 35.0), (12.0, 25.0), 100.0), 21),
    "drop": Design("a drop test of 15 heights", Scene(assumed=_SILENT), _drop, 15, ("v_y2",)),
    "broad": Design(
        "40 impacts, steep and shallow, of every spin", _TIMED, spread((20.0, 65.0), (14.0, 25.0), 300.0), 40
    ),
}
# A ball and court like Wang's, and noises of the expected size [m/s, rad/s].
TRUTH: Mapping[str, float] = {
    "mass_ratio": 0.87, "k_y": 2.0e4, "k_theta": 15.0, "mu": 0.55, "eps_10": 2.5e-3, "eps_slope": 0.0,
    "cor_10": 0.775, "cor_slope": -0.0145, "v_x_sd": 0.25, "v_y_sd": 0.25, "velocity_sd": 0.25, "spin_sd": 10.0,
}  # fmt: skip
# Brody's ball grips or slides throughout; it has friction and restitution in common with others.
SHARED = ("mu", "cor_10", "cor_slope")
VELOCITY, SPIN = 0.25, 10.0
Columns = dict[str, FloatArray]
# From the speed and the vertical speed of an impact to other values of some parameters.
Change = Callable[[float, float], Mapping[str, float]]


@dataclass(frozen=True)
class Scenario:
    """A kind of table: its `design`, whether it comes from the fitted model (`by_model`), and `words` about the rest.

    `spoil` changes simulated impacts and rebound columns. `maker` computes rebounds without noise, if the fitted
    `model` does not. `truths` are the parameters with a known truth (None: all).

    A table of which only the answer counts has a `fault` of a `size` (see `foreign`), and comes from no model.
    """

    name: str
    design: Design
    words: str
    by_model: bool
    fixed: bool = True
    maker: Callable[[Impacts], Rebound] | None = None
    spoil: Callable[[Impacts, Columns, np.random.Generator], tuple[Impacts, Columns]] | None = None
    truths: tuple[str, ...] | None = None
    model: str = DEFAULT_MODEL
    fault: str | None = None
    size: float = 1.0

    @property
    def problem(self) -> Problem:
        """The problem that is fitted, its measurements not yet made."""
        return self.posed(self.design.table())

    def posed(self, table: ImpactTable) -> Problem:
        """The problem of a table of this design."""
        return build_problem(table, self.design.scene, Choices(model=self.model))

    def truth(self, rng: np.random.Generator) -> FloatArray:
        """True values (free,): the one truth, or a draw from the prior draws.

        Raises FitError if there is no draw.
        """
        known = self.problem
        if self.fixed:
            return np.array([TRUTH[name] for name in known.free_names])
        return drawn_truth(known, rng, f"scenario {self.name}")

    def simulated(self, values: FloatArray, rng: np.random.Generator, times: int = 1) -> Problem:
        """The problem of a table made from true values (free,), so many `times` as long as the design's."""
        empty = self.posed(self.design.table(times))
        own = dict(zip(self.problem.free_names, values, strict=True))
        row = np.array([[own[name] for name in empty.free_names]])
        rebound = None if self.maker is None else self.maker(empty.impacts)
        made = simulated_columns(empty, row, rng, rebound)
        impacts = empty.impacts
        if self.spoil is not None:
            impacts, made = self.spoil(impacts, made, rng)
        measured = tuple(Measurement(name, column) for name, column in made.items())
        return self.posed(replace(empty.table, impacts=impacts, measurements=measured))

    def knows(self, name: str) -> bool:
        """Whether there is a truth of this parameter."""
        return self.truths is None or name in self.truths


def _by(
    name: str, change: Callable[[float, float], Mapping[str, float]] | None = None
) -> Callable[[Impacts], Rebound]:
    """Rebounds of a model at the one truth, or at what it changes to from impact to impact."""
    chosen = model(name)

    def make(impacts: Impacts) -> Rebound:
        def rebound(given: Impacts, values: Mapping[str, float]) -> Rebound:
            row = np.array([[values[name] for name in chosen.parameter_names]])
            return chosen.evaluate(chosen.parameter_names, row, given)

        if change is None:
            return rebound(impacts, TRUTH)
        speeds = np.hypot(impacts.v_x1, impacts.v_y1)
        states = enumerate(zip(speeds.tolist(), impacts.v_y1.tolist(), strict=True))
        each = [rebound(impacts.take(np.array([k])), {**TRUTH, **change(*state)}) for k, state in states]
        return Rebound.joined(each, axis=1)

    return make


def _negated(impacts: Impacts, made: Columns, _rng: np.random.Generator) -> tuple[Impacts, Columns]:
    return replace(impacts, omega_1=-impacts.omega_1), {**made, "omega_2": -made["omega_2"]}


def _outliers(impacts: Impacts, made: Columns, rng: np.random.Generator) -> tuple[Impacts, Columns]:
    for name, size in (("v_x2", VELOCITY), ("v_y2", VELOCITY), ("omega_2", SPIN)):
        far = rng.random(len(impacts)) < 0.1
        made[name] = made[name] + 5.0 * size * far * rng.standard_normal(len(impacts))
    return impacts, made


def _biased(impacts: Impacts, made: Columns, _rng: np.random.Generator) -> tuple[Impacts, Columns]:
    count = len(impacts)
    second = (np.arange(count) >= count // 4) & (np.arange(count) < count // 2)
    return impacts, {**made, "v_x2": made["v_x2"] + 0.6 * second}


def _scenarios() -> tuple[Scenario, ...]:
    broad = DESIGNS["broad"]
    drawn = [
        Scenario(name, DESIGNS[name], DESIGNS[name].words, by_model=True, fixed=False)
        for name in ("wang", "grip", "slide", "one-angle", "drop", "untimed")
    ]
    return (
        *drawn,
        Scenario("control", broad, broad.words, by_model=True),
        Scenario("brody", broad, "made by the model brody", by_model=False, maker=_by("brody"), truths=SHARED),
        Scenario(
            "too-simple", broad, "from the default model, fitted by brody", by_model=False, maker=_by(DEFAULT_MODEL),
            truths=SHARED, model="brody",
        ),
        Scenario("negated", broad, "both spins of the other sign", by_model=False, spoil=_negated),
        Scenario("outliers", broad, "a tenth of all measurements off by 5 sds", by_model=False, spoil=_outliers),
        Scenario("biased", broad, "v_x2 of a quarter of the rows 0.6 m/s too large", by_model=False, spoil=_biased),
        Scenario(
            "friction", broad, "mu falls from 0.7 at 14 m/s to 0.4 at 25 m/s", by_model=False,
            maker=_by(DEFAULT_MODEL, lambda speed, _up: {"mu": 0.55 - 0.3 / 11.0 * (speed - 19.5)}),
            truths=("mass_ratio", "k_y", "k_theta", "eps_10", "eps_slope", "cor_10", "cor_slope", "v_x_sd", "v_y_sd",
                    "spin_sd"),
        ),
        Scenario(
            "restitution", broad, "the COR bends: 0.0015 (v_y1 - 13)^2 less far from 13 m/s", by_model=False,
            maker=_by(DEFAULT_MODEL, lambda _speed, up: {"cor_10": TRUTH["cor_10"] - 0.0015 * (up - 13.0) ** 2}),
            truths=("mass_ratio", "k_y", "k_theta", "mu", "eps_10", "eps_slope", "v_x_sd", "v_y_sd", "spin_sd"),
        ),
    )  # fmt: skip


def _foreign() -> Iterator[Scenario]:
    """Tables that no code of fitball made, fitted with the model of their equations and with the default."""
    scene = load_scene(None)
    for name, fault in FAULTS.items():
        design = Design(fault.words, scene, spread(fault.angles, fault.speeds, 180.0), ROWS)
        for size in fault.sizes:
            for fitted in ("grip-slip", DEFAULT_MODEL):
                share = "" if size >= 1.0 else f", {100 * size:.0f} % of that"
                label = f"{name}{'' if size >= 1.0 else f'-{100 * size:.0f}'}-{fitted}"
                words = f"{fault.words}{share}, fitted by {fitted}"
                yield Scenario(label, design, words, by_model=False, model=fitted, fault=name, size=size)


SCENARIOS: Mapping[str, Scenario] = {scenario.name: scenario for scenario in (*_scenarios(), *_foreign())}
