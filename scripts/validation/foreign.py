"""Tables that no code of fitball made: a ball that slides or grips, after Walton (1993) and Cross (2002), with one
fault each, as a CSV file such as a user has.

No model of fitball is called: the equations stand in full, so that an error of fitball's is not made twice.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from fitball.api.calibrating import pose
from fitball.inference.problem.build import Choices
from fitball.inference.problem.problem import Problem
from fitball.values import FloatArray

ROWS = 24
MASS, RADIUS, INERTIA_RATIO = 0.0576, 0.03302, 0.56
FRICTION, TANGENTIAL, OFFSET = 0.60, 0.15, 2.0e-3
# Noise of the velocities [m/s] and of the spin [rad/s].
NOISE = np.array([[0.2], [0.2], [8.0]])
COLUMNS = ("v_x1 [m/s]", "v_y1 [m/s]", "omega_1 [rad/s]", "v_x2 [m/s]", "v_y2 [m/s]", "omega_2 [rad/s]")


@dataclass
class Made:
    """A table in the making: incidence (3, rows), friction and restitution (rows,), and noise (3, rows), to which
    what is wrong with the measurements is added; the surface of each row; and how often the table stands there.
    """

    incident: FloatArray
    friction: FloatArray
    restitution: FloatArray
    noise: FloatArray
    surface: list[str] = field(default_factory=list)
    copies: int = 1


# Puts a fault into a table: its size, as a share of the usual one.
Spoil = Callable[[Made, float, np.random.Generator], None]


def rebound(incident: FloatArray, friction: FloatArray, restitution: FloatArray) -> FloatArray:
    """Velocity along and away from the court [m/s] and spin [rad/s] (3, rows) after impacts (3, rows)."""
    v_x, v_y, spin = incident
    inertia = INERTIA_RATIO * MASS * RADIUS**2
    normal = MASS * (1.0 + restitution) * v_y
    slip = v_x - RADIUS * spin
    # Impulse along the court after which the point of contact leaves with -TANGENTIAL times its slip.
    grip = ((1.0 + TANGENTIAL) * slip + RADIUS * OFFSET * normal / inertia) / (1.0 / MASS + RADIUS**2 / inertia)
    along = np.minimum(np.maximum(grip, -friction * normal), friction * normal)
    return np.stack([v_x - along / MASS, restitution * v_y, spin + (RADIUS * along - OFFSET * normal) / inertia])


def _none(_made: Made, _size: float, _rng: np.random.Generator) -> None:
    """Leave all as it is."""


def _bias(made: Made, size: float, _rng: np.random.Generator) -> None:
    made.noise[0] += 1.5 * size


def _growing(made: Made, size: float, _rng: np.random.Generator) -> None:
    made.noise *= (np.hypot(made.incident[0], made.incident[1]) / 17.5) ** size


def _outliers(made: Made, size: float, rng: np.random.Generator) -> None:
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
    """A fault in `words`, what it does (`spoil`), the incident speeds [m/s] and angles [deg], the sizes that are
    tried, as shares of the usual one, and whether other assumptions are looked at too.
    """

    words: str
    spoil: Spoil
    speeds: tuple[float, float] = (10.0, 25.0)
    angles: tuple[float, float] = (15.0, 70.0)
    sizes: tuple[float, ...] = (1.0, 0.5)
    looked: bool = False


FAULTS: Mapping[str, Fault] = {
    "clean": Fault("nothing is wrong", _none, sizes=(1.0,), looked=True),
    "bias": Fault("v_x2 1.5 m/s too large in all rows", _bias),
    "growing": Fault("noise in proportion to the speed, 5 to 30 m/s", _growing, speeds=(5.0, 30.0)),
    "wild": Fault("three spins off by 80 to 200 rad/s", _outliers, looked=True),
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
    after = rebound(made.incident, made.friction, made.restitution) + made.noise
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
