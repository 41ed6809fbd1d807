"""Solve the catalogue of hard cases with fifty digits and keep the answers in `tests/data/hard_cases.csv`.

Takes some minutes. Joints too stiff for fifty digits are solved in double precision; the column `digits` says so.
"""

from __future__ import annotations

import csv
import math
import sys
from pathlib import Path

from fitball.bench.problems import HardCase, hard_cases
from fitball.models.kernels.contact import tied_inertia_split
from fitball.models.oracle import oracle_rebound
from fitball.models.types import Status
from fitball.scheduling.engine import engine, in_order

ANSWERS = Path(__file__).resolve().parent.parent / "tests" / "data" / "hard_cases.csv"
HEADS = ("name", "digits", "v_x2", "v_y2", "omega_2", "contact_time", "regime", "status")
# Angle [rad] through which the fastest torsional pole turns or decays in a contact: above it fifty digits take more
# than half a minute an impact.
STIFF = 190.0


def torsional_angle(case: HardCase) -> float:
    """Size of the fastest torsional pole times the contact time."""
    values, ball = case.parameters, case.model.ball
    if case.model.closures.inertia == "tied":
        split = tied_inertia_split(values["mass_ratio"])
    else:
        split = values["inertia_split"]
    natural = math.sqrt(values["k_theta"] * (1.0 / split + 1.0 / (1.0 - split)) / ball.inertia)
    contact = math.pi / math.sqrt(values["k_y"] / ball.mass)
    return 2.0 * max(0.5, values.get("zeta_theta", 1.0)) * natural * contact


def answer(case: HardCase) -> tuple[str, ...]:
    """One row; floats to the last digit."""
    digits = None if torsional_angle(case) > STIFF else 50
    found = oracle_rebound(case.model.closures, case.model.ball, case.parameters, case.impacts, digits)
    numbers = [repr(float(value[0])) for value in (found.v_x2, found.v_y2, found.omega_2, found.contact_time)]
    return (case.name, str(digits or 16), *numbers, str(int(found.regime[0])), Status(int(found.status[0])).name)


def main() -> int:
    """Write the file; returns 0."""
    rows = list(in_order(engine(), answer, list(hard_cases())))
    ANSWERS.parent.mkdir(exist_ok=True)
    with ANSWERS.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(HEADS)
        writer.writerows(rows)
    return 0


if __name__ == "__main__":
    sys.exit(main())
