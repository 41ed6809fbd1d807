"""Are values right where fitball's models are not? `foreign.py FOLDER [--tables 40 --only KIND]`.

Tables of balls that others have described (`foreign_balls.py`), and of a second code of the
two-mass ball, are calibrated as by a user. Counted are: values that are identified, or given
without naming what their ball breaks, further than 3.5 posterior sds from the truth (none may be);
how often 95 % intervals of values so called hold (93 to 98 %); how often those of new measurements
inside the calibrated range do (90 to 98 %, of no kind below 85 %). Values that name what is broken
are counted by themselves, without a limit: their intervals hold if that is right. Negative control:
intervals of half the width must hold too rarely.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd
from foreign_balls import (
    INERTIA_RATIO,
    MASS,
    RADIUS,
    Motion,
    elastic_sphere,
    falling_friction,
    grip_slip,
    hunt_crossley,
    power_law,
    restitution_at,
    two_masses,
)
from study import Rate, Record, replicates

from fitball.base.priors import parse_prior
from fitball.data.load import load_data
from fitball.data.read import load_table
from fitball.data.scene import BallSection, Scene
from fitball.inference.calibrate import calibrate
from fitball.inference.effort import Effort
from fitball.inference.fitted import Fitted
from fitball.inference.problem.build import build_problem
from fitball.inference.problem.problem import Choices
from fitball.uses.predict import predict

# Verdicts of values that may be relied on.
RELIED_ON = ("identified", "given")
# Posterior sds from the truth that no such value may exceed.
MOST_SDS = 3.5
# Shares of 95 % intervals of values that must hold, and of new measurements.
OF_VALUES = (0.93, 0.98)
OF_MEASUREMENTS = (0.90, 0.98)
# Share of new measurements of any kind that must be in their intervals.
OF_EACH_KIND = 0.85
# Rows of tables, and sds of velocities [m/s] and spins [rad/s], in turn.
ROWS = (15, 20, 30, 45, 60)
NOISES = ((0.1, 4.0), (0.3, 10.0), (0.4, 15.0))
# New impacts of a table.
NEW = 200
# Speeds [m/s], angles [deg] and spins [rad/s] of impacts.
SPEEDS = (10.0, 35.0)
ANGLES = (12.0, 75.0)
SPINS = (-300.0, 300.0)
# What foreign balls break, by the beginning of the names of values that this concerns: beginnings
# of what such a value `rests on`. No other law of restitution is the saturating one, no other ball
# twists as a shell about a core does, and none loses a part of its speed to a shell at once: with
# `normal=momentum` restitution of slow balls ends at the mass ratio, here at one.
LAW = {"cor": ("cor", "normal", "model")}
STRUCTURE = {**LAW, "mu": ("torsion", "spin", "model")}


class Kind(NamedTuple):
    """A kind of ball: what simulates it, ranges of its parameters, the assumptions of fitball that
    it breaks, and which of its parameters are parameters of fitball, too.
    """

    simulate: Callable[..., Motion]
    ranges: Mapping[str, tuple[float, float]]
    broken: Mapping[str, tuple[str, ...]]
    shared: tuple[str, ...] = ("mu",)


LINE = {"cor_10": (0.70, 0.80), "cor_slope": (-0.015, -0.006)}
# The stiffness k of k d^1.5 [N/m^1.5] that holds a tennis ball to some 5 ms, and losses [s/m].
SOFT = {"stiffness": (3e5, 6e5), "loss": (0.015, 0.03)}
KINDS: Mapping[str, Kind] = {
    "grip-slip": Kind(
        grip_slip,
        {"mu": (0.45, 0.75), "tangential": (0.05, 0.3), "offset": (0.0, 3e-3), **LINE},
        STRUCTURE,
    ),
    "power-law": Kind(
        power_law,
        {"mu": (0.45, 0.75), "tangential": (0.0, 0.3), "cor_10": (0.7, 0.8), "power": (0.05, 0.2)},
        STRUCTURE,
    ),
    "fourth-root": Kind(
        power_law,
        {
            "mu": (0.45, 0.75),
            "tangential": (0.0, 0.2),
            "cor_10": (0.6, 0.75),
            "power": (0.25, 0.25),
        },
        STRUCTURE,
    ),
    "falling-friction": Kind(
        falling_friction,
        {"mu_slow": (0.65, 0.8), "mu_fast": (0.45, 0.6), "speed": (3.0, 8.0), **LINE},
        LAW,
        (),
    ),
    "hunt-crossley": Kind(
        hunt_crossley,
        {"mu": (0.45, 0.75), "ratio": (0.5, 0.9), "damping": (0.1, 0.4), **SOFT},
        STRUCTURE,
    ),
    "elastic-sphere": Kind(
        elastic_sphere,
        {"mu": (0.4, 0.7), "poisson": (0.3, 0.5), **SOFT},
        STRUCTURE,
    ),
    "two-surfaces": Kind(
        grip_slip,
        {"mu": (0.45, 0.75), "tangential": (0.05, 0.3), "offset": (0.0, 3e-3), **LINE},
        STRUCTURE,
    ),
    "two-mass": Kind(
        two_masses,
        {
            "mass_ratio": (0.84, 0.92),
            "k_y": (1.5e4, 3.0e4),
            "k_theta": (15.0, 40.0),
            "mu": (0.45, 0.75),
            "eps_10": (0.001, 0.004),
            "eps_slope": (-2e-4, 2e-4),
            "cor_10": (0.72, 0.80),
            "cor_slope": (-0.016, -0.008),
        },
        {},
        ("mass_ratio", "k_y", "k_theta", "mu", "eps_10", "eps_slope", "cor_10", "cor_slope"),
    ),
}
# Friction of the second of two surfaces over that of the first.
SECOND_FRICTION = 1.35


class Simulated(NamedTuple):
    """A table as a `frame`, `new` impacts of the same balls, true values by name of parameter."""

    frame: pd.DataFrame
    new: pd.DataFrame
    truth: dict[str, float]


def simulated(name: str, number: int) -> Simulated:
    """Table `number` of a kind of ball."""
    kind = KINDS[name]
    rng = np.random.default_rng([10, *name.encode(), number])
    values = {key: float(rng.uniform(*ends)) for key, ends in kind.ranges.items()}
    rows = ROWS[number % len(ROWS)]
    noise = NOISES[number % len(NOISES)]
    surfaces = {"": values}
    if name == "two-surfaces":
        second = values | {"mu": SECOND_FRICTION * values["mu"]}
        surfaces = {"hard": values, "clay": second}
    tables = {count: _table(kind, surfaces, count, noise, rng) for count in (rows, NEW)}
    return Simulated(tables[rows], tables[NEW], _truth(kind, surfaces))


def _table(
    kind: Kind,
    surfaces: Mapping[str, Mapping[str, float]],
    count: int,
    noise: tuple[float, float],
    rng: np.random.Generator,
) -> pd.DataFrame:
    """A table of `count` impacts on surfaces in turn, with measurement errors of these sds [m/s,
    rad/s].
    """
    frames = []
    for surface, values in surfaces.items():
        share = -(-count // len(surfaces))
        speed = rng.uniform(*SPEEDS, share)
        angle = np.radians(rng.uniform(*ANGLES, share))
        spin = rng.uniform(*SPINS, share)
        incident = Motion(speed * np.cos(angle), speed * np.sin(angle), spin)
        after = kind.simulate(incident, **values)
        errors = rng.standard_normal((3, share))
        columns = {
            "v_x1": incident.v_x,
            "v_y1": incident.v_y,
            "omega_1": incident.spin,
            "v_x2": after.v_x + noise[0] * errors[0],
            "v_y2": after.v_y + noise[0] * errors[1],
            "omega_2": after.spin + noise[1] * errors[2],
        }
        label = {"surface": surface} if surface else {}
        frames.append(pd.DataFrame(columns).assign(**label))
    return pd.concat(frames, ignore_index=True)


def _truth(kind: Kind, surfaces: Mapping[str, Mapping[str, float]]) -> dict[str, float]:
    """True values of what fitball names: shared parameters, restitution at 10 m/s and its slope."""
    truth = dict[str, float]()
    for surface, values in surfaces.items():
        ball = partial(kind.simulate, **values)
        of_surface = {name: values[name] for name in kind.shared}
        of_surface["cor_10"] = restitution_at(ball, 10.0)
        rise = restitution_at(ball, 10.5) - restitution_at(ball, 9.5)
        truth["cor_slope"] = values.get("cor_slope", rise)
        for name, value in of_surface.items():
            truth[name] = value
            truth[f"{name}[{surface}]"] = value
    return truth


def judged(name: str, number: int) -> Record:
    """What a fit says of table `number` of a kind: of values with a truth the verdict, what breaks
    it, the distance from the truth in posterior sds, and whether intervals hold; of new
    measurements inside the calibrated range whether theirs do.
    """
    table = simulated(name, number)
    scene = Scene(ball=BallSection(MASS, RADIUS, INERTIA_RATIO))
    problem = build_problem(*load_data([table.frame], scene, True)[:2], Choices())
    fit = calibrate(problem, Effort(number), lambda _stage, _share: None)
    predicted = predict(fit, load_table(table.new, scene=scene), {}).frames["predictions"]
    inside = predicted[predicted["observed"].notna() & ~predicted["outside"].astype(bool)]
    middle = 0.5 * (inside["new_q025"] + inside["new_q975"])
    arms = 0.5 * (inside["new_q975"] - inside["new_q025"])
    off = ((inside["observed"] - middle).abs() / arms).to_numpy()
    return {
        "kind": name,
        "answer": fit.adequacy.answer,
        "rows": len(table.frame),
        "values": [*_judged_values(fit, table.truth, KINDS[name].broken)],
        "new": int(off.size),
        "held": int((off <= 1.0).sum()),
        "held halved": int((off <= 0.5).sum()),
    }


def _judged_values(
    fit: Fitted,
    truth: Mapping[str, float],
    broken: Mapping[str, tuple[str, ...]],
) -> list[Record]:
    """Of each parameter with a truth its verdict, whether it rests on what is broken, how many sds
    it is from the truth on its own scale, and how far in half widths of its 95 % interval.
    """
    judged_values = []
    for name, estimate in fit.parameters.items():
        if name not in truth or not estimate.sd > 0.0:
            continue
        log = parse_prior(fit.quantity(name).spec).log
        draws = fit.draws.values[name]
        places, true = (np.log(draws), np.log(truth[name])) if log else (draws, truth[name])
        middle = 0.5 * (estimate.q025 + estimate.q975)
        arm = 0.5 * (estimate.q975 - estimate.q025)
        excuses = [named for start, named in broken.items() if name.startswith(start)]
        judged_values.append(
            {
                "name": name,
                "verdict": estimate.verdict,
                "excused": any(
                    rests.startswith(named) for rests in estimate.given for named in excuses
                ),
                "given": estimate.given,
                "sds": float(abs(np.median(places) - true) / places.std()),
                "arms": float(abs(truth[name] - middle) / arm),
            }
        )
    return judged_values


def held(label: str, rate: Rate, limits: tuple[float, float], must_hold: bool = True) -> bool:
    """Print a rate; whether it is within limits as it must be."""
    share = rate.hits / max(rate.total, 1)
    right = (limits[0] <= share <= limits[1]) == must_hold
    print(f"{'ok' if right else 'NOT KEPT':9}{label}: {rate}", flush=True)
    return right


def report(records: list[Record]) -> bool:
    """Print what was counted; whether all limits are kept."""
    values = [
        {"kind": record["kind"], "number": record["number"], **value}
        for record in records
        for value in record["values"]
        if value["verdict"] in RELIED_ON
    ]
    plain = [value for value in values if not _is_excused(value)]
    excused = [value for value in values if _is_excused(value)]
    far = [value for value in plain if value["sds"] > MOST_SDS]
    for value in far:
        words = f"{value['kind']} {value['number']}: {value['name']}, {value['verdict']}"
        print(f"NOT KEPT {words}, is {value['sds']:.1f} sds from the truth")
    good = [not far]
    for label, reach, must_hold in (("values", 1.0, True), ("values, halved", 0.5, False)):
        hits = sum(value["arms"] <= reach for value in plain)
        good.append(held(label, Rate(hits, len(plain)), OF_VALUES, must_hold))
    hits = sum(value["arms"] <= 1.0 for value in excused)
    print(f"         values that name what is broken: {Rate(hits, len(excused))}")
    new = sum(record["new"] for record in records)
    for label, key, must_hold in (
        ("new measurements", "held", True),
        ("new measurements, halved", "held halved", False),
    ):
        hits = sum(record[key] for record in records)
        good.append(held(label, Rate(hits, new), OF_MEASUREMENTS, must_hold))
    for kind in dict.fromkeys(record["kind"] for record in records):
        of_kind = [record for record in records if record["kind"] == kind]
        rate = Rate(sum(record["held"] for record in of_kind), sum(r["new"] for r in of_kind))
        good.append(held(f"new measurements of {kind}", rate, (OF_EACH_KIND, 1.0)))
    return all(good)


def _is_excused(value: Record) -> bool:
    """Whether a value names the assumption that is broken."""
    return value["verdict"] == "given" and bool(value["excused"])


def main() -> int:
    """Calibrate the tables and print what was counted; 1 if a limit is not kept."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--tables", type=int, default=40)
    parser.add_argument("--only", nargs="+", default=list(KINDS), choices=KINDS)
    arguments = parser.parse_args()
    each = -(-arguments.tables // len(arguments.only))
    records = list[Record]()
    failed = 0
    for kind in arguments.only:
        every = replicates(f"foreign-{kind}", partial(judged, kind), range(each), arguments.folder)
        fitted = [record for record in every if "failed" not in record]
        failed += len(every) - len(fitted)
        records += fitted
    print(f"{len(records)} tables, {failed} failed")
    return int(failed > 0 or not report(records))


if __name__ == "__main__":
    sys.exit(main())
