"""Run in an interpreter of its own: a registry with one more column, the ratio of the velocities of
a rebound, which has no dimension. Prints what reading, fitting and planning make of it, as JSON.
"""

import json
import sys
from collections.abc import Callable

import numpy as np

from fitball.base import columns
from fitball.base.columns import Column
from fitball.base.priors import ParameterSpec

SPEC = ParameterSpec("ratio_sd", "", 1e-4, 1.0, "lognormal(0.05, 0.7)", "noise of ratio_2", "s")
RATIO = Column(
    "ratio_2",
    "",
    "rebound ratio",
    "r",
    (-100.0, 100.0),
    tangential=True,
    noise=SPEC,
    formula=lambda v_x2, v_y2: v_x2 / v_y2,
)
# Before other modules take the names of the columns from it.
columns.COLUMNS = {**columns.COLUMNS, RATIO.name: RATIO}
columns.REBOUND = (*columns.REBOUND, RATIO.name)

import fitball  # noqa: E402
from fitball.data.table import join_tables  # noqa: E402


def frame(*names: str, **more: object) -> dict[str, object]:
    """Impacts of one friction and one restitution, with these rebound columns and `more`."""
    rng = np.random.default_rng(4)
    v_x1 = rng.uniform(25.0, 30.0, 16)
    v_y1 = rng.uniform(5.0, 7.0, 16)
    v_y2 = 0.75 * v_y1 + 0.05 * rng.standard_normal(16)
    v_x2 = v_x1 - 0.4 * (v_y1 + v_y2) + 0.05 * rng.standard_normal(16)
    every = {"v_x2": v_x2, "v_y2": v_y2, "v_2": np.hypot(v_x2, v_y2), "ratio_2": v_x2 / v_y2}
    every["theta_2"] = np.degrees(np.arctan2(v_y2, v_x2))
    return {"v_x1": v_x1, "v_y1": v_y1, **{name: every[name] for name in names}, **more}


def code_of(call: Callable[[], object]) -> list[str]:
    """The codes of the faults, or of the error, with which a call ends."""
    try:
        call()
    except fitball.FitballError as error:
        return [fault.code for fault in getattr(error, "faults", ())] or [error.code]
    return []


def main() -> None:
    """All cases at once, since an interpreter takes long to begin."""
    both = frame("v_x2", "v_y2", "ratio_2")
    polar = fitball.load_table(frame("v_2", "ratio_2"))
    cartesian = fitball.load_table({**both, "ratio_2_sd": 0.01 + 0.0 * both["v_x1"]})
    ratio = both["ratio_2"]
    fit, full = (
        fitball.calibrate(frame(*names), model="grip-slip", point_only=True, progress=False)
        for names in (("v_2", "ratio_2"), ("v_x2", "v_y2"))
    )
    again = fitball.load_table(polar.to_frame())
    answers = {
        "beside components": [*cartesian.values],
        "notes": [note.code for note in cartesian.notices],
        "beside speed": [*polar.values],
        "beside polar": [*fitball.load_table(frame("v_2", "theta_2", "ratio_2")).values],
        "beside one of each": [*fitball.load_table(frame("v_x2", "v_2", "ratio_2")).values],
        "contradiction": code_of(lambda: fitball.load_table({**both, "ratio_2": 3.0 * ratio})),
        "joined": code_of(lambda: join_tables([polar, cartesian])),
        "sensor": code_of(lambda: full.plan(sensor={"ratio_2": "0.01"})),
        "same": bool(np.array_equal(again.values["ratio_2"], polar.values["ratio_2"])),
        "length": code_of(lambda: fitball.load_table(frame("v_2", **{"ratio_2 [m]": ratio}))),
        "noise": fit.parameters["ratio_sd"].point,
        "page": "ratio_2" in fit.report(),
        "parameters": [observable.column.name for observable in fit.problem.observables],
    }
    for unit, factor in (("%", 100.0), ("-", 1.0), ("1", 1.0)):
        table = fitball.load_table(frame("v_2", **{f"ratio_2 [{unit}]": factor * ratio}))
        answers[unit] = float(np.max(np.abs(table.values["ratio_2"] - ratio)))
    json.dump(answers, sys.stdout)


if __name__ == "__main__":
    main()
