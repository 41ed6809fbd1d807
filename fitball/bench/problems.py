"""Problems of the bench: impacts that are hard to solve, which tests check to fifty digits; scenes with exact
answers; and tables of different kinds on which densities and samplers are timed.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from hashlib import sha256
from typing import Any

import numpy as np
import pandas as pd

from fitball.data.read import load_table
from fitball.data.scene import load_scene
from fitball.data.table import ImpactTable, Measurement
from fitball.inference.problem.build import Choices, build_problem
from fitball.inference.problem.problem import Problem
from fitball.models.kernels.contact import tied_inertia_split
from fitball.models.model import Model, Oracle
from fitball.models.registry import model
from fitball.models.specs import DEFAULT_MODEL
from fitball.observables import INCIDENT_UNITS, OBSERVABLES, SI_UNITS
from fitball.scheduling.engine import Engine, in_order
from fitball.values import Ball, FloatArray, Impacts, impacts

BASE: Mapping[str, float] = {
    "mass_ratio": 0.88,
    "k_y": 1.93e4,
    "k_theta": 18.0,
    "mu": 0.567,
    "eps_10": 2.4e-3,
    "eps_slope": 0.0,
    "cor_10": 0.77,
    "cor_slope": 0.0,
    "zeta_theta": 0.3,
    "inertia_split": 0.7,
}
FAST = (14.0, 12.0, 100.0)
STEEP = (6.0, 15.0, -50.0)
SHALLOW = (16.0, 5.0, 0.0)


@dataclass(frozen=True)
class HardCase:
    """One impact `(v_x1, v_y1, omega_1)` with parameters changed from `BASE` and closures from `two-mass`."""

    name: str
    impact: tuple[float, float, float] = FAST
    changes: Mapping[str, float] = field(default_factory=dict)
    closures: Mapping[str, str] = field(default_factory=dict)
    cor: float | None = None

    @property
    def model(self) -> Model:
        """The composition."""
        closures: dict[str, Any] = dict(self.closures)
        return model("two-mass", **closures)

    @property
    def parameters(self) -> dict[str, float]:
        """Values of the parameters that the composition has."""
        values = {**BASE, **self.changes}
        return {name: values[name] for name in self.model.parameter_names}

    @property
    def impacts(self) -> Impacts:
        """The impact."""
        return impacts(*self.impact, cor=self.cor)


FREE = {"torsion": "free"}


def hard_cases() -> tuple[HardCase, ...]:
    """The whole catalogue; names are unique."""
    kinds = (
        *(_torsional_damping, _resonance, _stiffness, _restitution, _friction, _start_without_slip, _events),
        *(_many_cycles, _mass_ratio, _extremes),
    )
    cases = tuple(case for kind in kinds for case in kind())
    assert len({case.name for case in cases}) == len(cases)
    return cases


def _torsional_damping() -> Iterator[HardCase]:
    for label, zeta in (
        ("zero", 0.0), ("one thousandth", 1e-3), ("half critical", 0.5), ("critical less 1e-6", 1.0 - 1e-6),
        ("critical less 1e-12", 1.0 - 1e-12), ("critical", 1.0), ("critical and 1e-12", 1.0 + 1e-12),
        ("critical and 1e-6", 1.0 + 1e-6), ("twice critical", 2.0), ("ten times critical", 10.0),
    ):  # fmt: skip
        yield HardCase(f"torsional damping {label}", changes={"zeta_theta": zeta}, closures=FREE)


def _resonance() -> Iterator[HardCase]:
    """The torsional pole on the vertical one while sliding, and at growing distance."""
    ball = Ball()
    split = tied_inertia_split(BASE["mass_ratio"])
    compliance = 1.0 / (split * ball.inertia) + 1.0 / ((1.0 - split) * ball.inertia)
    natural2 = BASE["k_y"] / (BASE["mass_ratio"] * ball.mass)
    # Damping of the vertical motion for this restitution: -ln(e) = 2 b cot(b), zeta = cos(b).
    from scipy.optimize import brentq

    loss = -np.log(BASE["cor_10"] / BASE["mass_ratio"])
    zeta = float(np.cos(brentq(lambda b: 2.0 * b / np.tan(b) - loss, 1e-3, 0.5 * np.pi, xtol=1e-15)))
    for label, factor in (
        ("exactly", 1.0), ("to 1e-14", 1.0 + 1e-14), ("to 1e-10", 1.0 + 1e-10), ("to 1e-6", 1.0 + 1e-6),
        ("to 1e-3", 1.001), ("to a tenth", 1.1), ("to a half", 1.5),
    ):  # fmt: skip
        changes = {"zeta_theta": zeta, "k_theta": natural2 / compliance * factor}
        yield HardCase(f"torsional pole on the vertical one {label}", STEEP, changes, FREE)


def _stiffness() -> Iterator[HardCase]:
    for power in (-2, -1, 0, 1, 2, 3, 4):
        yield HardCase(f"k_theta = 1e{power}", FAST, {"k_theta": 10.0**power}, FREE)
    for power in (2, 3, 4, 5, 6, 7, 8):
        yield HardCase(f"k_theta = 1e{power}, matched", FAST, {"k_theta": 10.0**power})


def _restitution() -> Iterator[HardCase]:
    critical = BASE["mass_ratio"] * float(np.exp(-2.0))
    for label, cor in (
        ("mass_ratio", 0.88), ("mass_ratio less 1e-12", 0.88 * (1.0 - 1e-12)), ("mass_ratio less 1e-6", 0.88 - 1e-6),
        ("0.3", 0.3), ("that of critical damping", critical),
        ("that of critical damping, 1e-9 below", critical - 1e-9),
        ("that of critical damping, 1e-9 above", critical + 1e-9), ("0.05", 0.05), ("0.01", 0.01),
    ):  # fmt: skip
        yield HardCase(f"restitution {label}", FAST, {"cor_10": cor})
    whole = {"normal": "total", "release": "zero_displacement"}
    for label, cor in (("1", 1.0), ("1 less 1e-15", 1.0 - 1e-15), ("0.05", 0.05)):
        yield HardCase(f"restitution {label} of the whole mass", FAST, {"cor_10": cor}, whole)


def _friction() -> Iterator[HardCase]:
    for label, mu in (("0", 0.0), ("1e-12", 1e-12), ("1e-6", 1e-6), ("0.01", 0.01), ("2", 2.0), ("5", 5.0)):
        yield HardCase(f"friction {label}", FAST, {"mu": mu})
    yield HardCase("no speed along the court", (0.0, 12.0, 0.0))
    yield HardCase("no speed along the court, no offset", (0.0, 12.0, 0.0), {"eps_10": 0.0})
    yield HardCase("negative offset", FAST, {"eps_10": -3e-3})
    yield HardCase("large negative offset", STEEP, {"eps_10": -1.5e-2})


def _start_without_slip() -> Iterator[HardCase]:
    radius = Ball().radius
    spin = 300.0
    exact = radius * spin
    for label, v_x in (
        ("exactly", exact), ("one rounding above", float(np.nextafter(exact, 99.0))),
        ("one rounding below", float(np.nextafter(exact, 0.0))), ("1e-12 above", exact * (1.0 + 1e-12)),
        ("1e-12 below", exact * (1.0 - 1e-12)), ("1e-6 above", exact * (1.0 + 1e-6)),
        ("1e-6 below", exact * (1.0 - 1e-6)),
    ):  # fmt: skip
        yield HardCase(f"no slip at landing, {label}", (v_x, 10.0, spin))
    yield HardCase("grip broken at once", (exact, 10.0, spin), {"mu": 0.02, "eps_10": 8e-3})
    yield HardCase("slip reversed by offset alone", (exact + 0.05, 10.0, spin), {"mu": 0.05, "eps_10": -2e-2})
    whole = {"normal": "total"}
    yield HardCase("no slip and no landing impulse", (exact, 10.0, spin), {}, whole)
    yield HardCase("slip of 1e-9 and no landing impulse", (exact * (1.0 + 1e-9), 10.0, spin), {}, whole)


def _events() -> Iterator[HardCase]:
    """Friction at which a sequence of phases just changes: slip that dies at the very end, or touches zero."""
    ringing = {"k_theta": 400.0, "zeta_theta": 0.01}
    for name, impact, changes, closures, low, high in (
        ("slip that ends with the contact", SHALLOW, {}, {}, 0.7, 0.775),
        ("grip that breaks at the end", SHALLOW, {}, {}, 0.775, 0.85),
        ("slip that landing just ends", STEEP, {}, {}, 2.0, 3.5),
        ("soft joint, slip that just reaches zero", SHALLOW, {"k_theta": 4.0, "zeta_theta": 0.02}, FREE, 0.2, 0.7),
        ("ringing joint, grip once or twice", FAST, ringing, FREE, 0.22, 0.24),
        ("ringing joint, slip that touches zero", FAST, ringing, FREE, 0.25, 0.26),
        ("ringing joint, slip that turns or grips", FAST, ringing, FREE, 0.3, 0.305),
        ("offset held back, hold that just sets in", STEEP, {"eps_10": 1.2e-2}, {"offset": "grip"}, 0.1, 0.117),
    ):  # fmt: skip
        edge = _change_of_regime(HardCase(name, impact, changes, closures), low, high)
        for label, factor in (("1e-9 before", 1.0 - 1e-9), ("1e-9 after", 1.0 + 1e-9)):
            yield HardCase(f"{name}, {label}", impact, {**changes, "mu": edge * factor}, closures)


def _change_of_regime(case: HardCase, low: float, high: float) -> float:
    """A friction coefficient between `low` and `high` at which the phases change, by bisection."""
    chosen, values = case.model, case.parameters

    def phases(mu: float) -> int:
        return int(chosen.rebound({**values, "mu": mu}, case.impacts).regime[0])

    first = phases(low)
    assert phases(high) != first
    while low < (middle := 0.5 * (low + high)) < high:
        if phases(middle) == first:
            low = middle
        else:
            high = middle
    return high


def _many_cycles() -> Iterator[HardCase]:
    for label, k_theta, zeta in (("a dozen", 1e3, 1e-3), ("dozens", 1e4, 1e-4), ("hundreds", 1e5, 1e-3)):
        changes = {"k_theta": k_theta, "zeta_theta": zeta, "mu": 0.3}
        yield HardCase(f"{label} torsional periods in one contact", (9.0, 14.0, 0.0), changes, FREE)
    yield HardCase("undamped joint", (9.0, 14.0, 0.0), {"k_theta": 2e3, "zeta_theta": 0.0, "mu": 0.4}, FREE)


def _mass_ratio() -> Iterator[HardCase]:
    for label, ratio in (("at the restitution", 0.77), ("1 less 1e-3", 0.999), ("1 less 1e-6", 1.0 - 1e-6)):
        yield HardCase(f"mass_ratio {label}", FAST, {"mass_ratio": ratio})
    yield HardCase("mass_ratio 1 with a shell of its own inertia", FAST, {"mass_ratio": 1.0}, {"inertia": "table"})
    yield HardCase("mass_ratio 0.3", FAST, {"mass_ratio": 0.3, "cor_10": 0.25})
    for split in (1e-4, 0.9999):
        changes = {"inertia_split": split, "k_theta": 100.0}
        yield HardCase(f"share of inertia {split:g}", FAST, changes, {"inertia": "table"})


def _extremes() -> Iterator[HardCase]:
    for spin in (1e4, -1e4):
        yield HardCase(f"spin {spin:g} rad/s", (14.0, 12.0, spin))
    for label, size in (("1e-6", 1e-6), ("1e6", 1e6)):
        yield HardCase(f"all speeds times {label}", (14.0 * size, 12.0 * size, 100.0 * size))
    yield HardCase("grazing incidence", (50.0, 0.01, 0.0))
    yield HardCase("grip with the offset held back", STEEP, {"eps_10": 1.2e-2, "mu": 0.3}, {"offset": "grip"})
    yield HardCase("k_y = 1e2", FAST, {"k_y": 1e2, "k_theta": 0.5})
    yield HardCase("k_y = 1e7", FAST, {"k_y": 1e7, "k_theta": 2e4})


# The hard set holds joints that take minutes at fifty digits; there the double-precision oracle answers, which agrees
# with fifty digits to 1e-15 wherever both have been run.
HARD = "hard"
# Noise at which densities are timed [m/s, rad/s]: as large as in Wang's tables.
VELOCITY, SPIN = 0.4, 14.0
# Slow impacts that are simulated, and the degrees of freedom of errors with outliers.
SLOW, FREEDOM = 30, 3.0


@dataclass(frozen=True)
class Scene:
    """Impacts of one kind with one parameter set each (rows, parameters), and the exact `v_x2`, `omega_2`."""

    name: str
    names: tuple[str, ...]
    values: FloatArray
    impacts: Impacts
    v_x2: FloatArray
    omega_2: FloatArray

    @property
    def speed(self) -> FloatArray:
        """Incident speed of the ball's surface, at most, (impacts,): what errors are relative to."""
        spin = default_model().ball.radius * np.abs(self.impacts.omega_1)
        return np.asarray(self.impacts.speed + spin)


def default_model() -> Model:
    """The model whose solvers are compared."""
    return model("two-mass")


def oracle() -> Oracle:
    """Its independent solution."""
    solution = default_model().oracle
    assert solution is not None
    return solution


def scenes(engine: Engine) -> tuple[Scene, ...]:
    """Sliding throughout, slide-grip-slide, grip from the start, Wang's 21, and the hard set of the default model.

    `engine` shares the exact answers, half a second per impact.
    """
    names = default_model().parameter_names
    base = np.array([BASE[name] for name in names])
    hard = [case for case in hard_cases() if not case.closures and "mass_ratio 1" not in case.name]
    kinds = {
        "sliding": impacts([16.0, 17.0, 25.0, 30.0], [4.0, 4.5, 4.0, 6.0], [0.0, -150.0, 0.0, 1e2]),
        "slide-grip-slide": impacts([12.0, 9.0, 14.0, 10.0], [13.0, 15.0, 12.0, 10.0], [0.0, 100.0, 140.0, -100.0]),
        "grip from the start": impacts([5.0, 4.0, 3.0, 6.0], [16.0, 15.0, 12.0, 14.0], [145.0, 120.0, 90.0, 180.0]),
        "Wang's 21": load_table("wang_all.csv").impacts,
        HARD: impacts(*np.array([case.impact for case in hard]).T),
    }
    values = dict.fromkeys(kinds, base) | {
        HARD: np.array([[case.parameters[name] for name in names] for case in hard])
    }
    return tuple(_scene(kind, names, values[kind], given, engine) for kind, given in kinds.items())


def _scene(name: str, names: tuple[str, ...], values: FloatArray, given: Impacts, engine: Engine) -> Scene:
    rows = np.broadcast_to(values, (len(given), len(names))).copy()
    bounces = [(dict(zip(names, row.tolist(), strict=True)), given.take(np.array([k]))) for k, row in enumerate(rows)]
    v_x2, omega_2 = np.array(list(in_order(engine, partial(_exact, None if name == HARD else 50), bounces))).T
    # Two events closer than rounding leave double precision without an answer, and the bench without a rival.
    kept = np.flatnonzero(np.isfinite(v_x2))
    return Scene(name, names, rows[kept], given.take(kept), v_x2[kept], omega_2[kept])


def _exact(digits: int | None, bounce: tuple[Mapping[str, float], Impacts]) -> tuple[float, float]:
    exact = oracle().rebound(*bounce, digits=digits)
    return float(exact.v_x2[0]), float(exact.omega_2[0])


def problems() -> Iterator[tuple[str, Problem]]:
    """Five problems by the name of their table: measured, simulated, slow, ungrouped, with outliers, incomplete."""
    for name in ("wang_zero_spin", "wang_all", "synthetic_court"):
        yield name, posed(name)
    yield "slow, without groups", build_problem(load_table(_slow()), load_scene(None), Choices())
    scene = load_scene("synthetic_court.csv")
    yield "student-t, cells missing", build_problem(load_table(_gappy()), scene, Choices(noise="student-t"))


def posed(name: str, rows: int | None = None) -> Problem:
    """The problem of a bundled table with its scene, `enlarged` to so many rows."""
    table = load_table(f"{name}.csv")
    return build_problem(table if rows is None else enlarged(table, rows), load_scene(f"{name}.csv"), Choices())


def simulated_frame(
    name: str, values: Mapping[str, float], given: Impacts, sds: Mapping[str, float], rng: np.random.Generator
) -> pd.DataFrame:
    """The table that a model makes at incident states: columns of `OBSERVABLES` with normal noise of these `sds`."""
    made = model(name).rebound(values, given)
    columns = {column: getattr(given, column) for column in INCIDENT_UNITS}
    for column, sd in sds.items():
        columns[column] = OBSERVABLES[column].predict(made) + sd * rng.standard_normal(len(given))
    return pd.DataFrame({f"{column} [{SI_UNITS[column]}]": numbers for column, numbers in columns.items()})


def _slow() -> pd.DataFrame:
    """Impacts as of a ball thrown by hand, spins of both signs."""
    rng = np.random.default_rng(14)
    given = impacts(rng.uniform(1.0, 7.0, SLOW), rng.uniform(2.0, 6.0, SLOW), rng.uniform(-150.0, 150.0, SLOW))
    return simulated_frame(DEFAULT_MODEL, base_values(), given, {"v_x2": 0.1, "v_y2": 0.1, "omega_2": 4.0}, rng)


def _gappy() -> pd.DataFrame:
    """The simulated court with outliers added, every third spin and every fifth speed unread."""
    rng = np.random.default_rng(15)
    frame = load_table("synthetic_court.csv").to_frame()
    for name, size, every in (("v_x2", 0.2, 5), ("v_y2", 0.2, 7), ("omega_2", 6.0, 3)):
        column = next(head for head in frame if str(head).startswith(name))
        frame[column] += size * rng.standard_t(FREEDOM, len(frame))
        frame.loc[frame.index[every - 1 :: every], column] = np.nan
    return frame


def enlarged(table: ImpactTable, rows: int) -> ImpactTable:
    """A table of `rows` impacts that repeats another with small changes to the incident speeds."""
    rng = np.random.default_rng(rows)
    take = np.arange(rows) % len(table)
    stretch = 1.0 + 0.02 * rng.standard_normal(rows)
    given = table.impacts
    return replace(
        table,
        impacts=Impacts(given.v_x1[take] * stretch, given.v_y1[take] * stretch, given.omega_1[take]),
        measurements=tuple(Measurement(item.name, item.values[take]) for item in table.measurements),
        redundant=(),
        ids=tuple(str(k + 1) for k in range(rows)),
        labels={},
        incident_covariance=None,
        digest=sha256(f"{table.digest} times {rows}".encode()).hexdigest(),
    )


def base_values() -> dict[str, float]:
    """Parameters of the default model as in the catalogue of hard cases."""
    return {name: BASE[name] for name in model(DEFAULT_MODEL).parameter_names}


def spread_draws(count: int, seed: int = 1) -> FloatArray:
    """Parameter draws (count, parameters) of the default model, as wide as a posterior of Wang's 21 impacts."""
    base = base_values()
    widths = {"mass_ratio": 0.015, "k_y": 3e3, "k_theta": 3.0, "mu": 0.02, "eps_10": 3e-4, "eps_slope": 6e-5,
              "cor_10": 0.01, "cor_slope": 0.002}  # fmt: skip
    noise = np.random.default_rng(seed).standard_normal((count, len(base)))
    draws: FloatArray = np.array(list(base.values())) + noise * np.array([widths[name] for name in base])
    return draws


def spread_coordinates(problem: Problem, count: int) -> FloatArray:
    """Coordinates (count, free) of `spread_draws` with noise as large as in Wang's tables."""
    columns = dict(zip(base_values(), spread_draws(count).T, strict=True))
    sizes = {"spin_sd": SPIN, "degrees_of_freedom": 5.0}
    free = [columns.get(name, np.full(count, sizes.get(name, VELOCITY))) for name in problem.free_names]
    return problem.to_coordinates(np.stack(free, axis=1))
