"""What grows: batches, rows; and what whole processes take, in time and in memory."""

from __future__ import annotations

import tempfile
from functools import partial
from pathlib import Path

import pandas as pd

from fitball.inference.likelihood.posterior import log_posterior
from fitball.models.names import DEFAULT_MODEL
from fitball.models.registry import model
from fitball.studies.bench.clock import Action, Pace, by_turns, fresh_process
from fitball.studies.bench.tables import base_values, posed, spread_coordinates, spread_draws, write_simulated
from fitball.values import impacts

ROWS = (7, 21, 210, 2100, 8000)
FITTED = (21, 210, 2100, 8000)
CALIBRATED = (1000, 10_000, 100_000, 1_000_000)
VERB = "from fitball.cli.main import main; assert main({words}) == 0"
POINT_FIT = """
import numpy as np
from fitball.inference.point.point_fit import point_fit
from fitball.studies.bench.tables import posed
problem = posed("wang_all", {rows})
begun = __import__("time").process_time()
point_fit(problem, np.random.default_rng(1))
print(__import__("time").process_time() - begun)
"""
REBOUND = "import fitball; fitball.model('two-mass').rebound({values}, fitball.impacts(14.0, 12.0, 100.0))"


def batch_costs(many: int, pace: Pace) -> pd.DataFrame:
    """CPU microseconds per impact: a public call, one draw of 21 impacts, and about `many` impacts in one call."""
    chosen, wang, base = model(DEFAULT_MODEL), posed("wang_all").impacts, base_values()
    names, draws = tuple(base), spread_draws(many // len(wang))
    one = impacts(wang.v_x1[0], wang.v_y1[0], wang.omega_1[0])
    total = len(draws) * len(wang)
    calls: dict[str, tuple[int, Action]] = {
        "public call, 1 impact": (1, partial(chosen.rebound, base, one)),
        "public call, 21 impacts": (len(wang), partial(chosen.rebound, base, wang)),
        "batch, 1 draw of 21": (len(wang), partial(chosen.evaluate, names, draws[:1], wang)),
        f"batch of {total}": (total, partial(chosen.evaluate, names, draws, wang)),
        f"batch of {total}, with derivatives": (total, partial(chosen.jacobian, names, draws, wang, names)),
    }
    spent = by_turns({name: action for name, (_, action) in calls.items()}, pace)
    return pd.DataFrame(
        [{"call": name, "microseconds an impact": 1e6 * spent[name] / count} for name, (count, _) in calls.items()]
    )


def growth_costs(most: int, pace: Pace) -> pd.DataFrame:
    """With rows of the table, `most` at most: CPU time of 40 log posteriors in one call, and of a point fit in a
    process of its own with the most memory that took.
    """
    rows = []
    for count in (count for count in ROWS if count <= most):
        problem = posed("wang_all", count)
        at = spread_coordinates(problem, 40)
        spent = by_turns({"density": partial(log_posterior, problem, at)}, pace)["density"] / len(at)
        row: dict[str, object] = {"rows": count, "milliseconds a log posterior": 1e3 * spent,
                                  "microseconds an impact": 1e6 * spent / count}  # fmt: skip
        if count in FITTED:
            told = fresh_process(POINT_FIT.format(rows=count))
            row |= {"point fit [s]": float(told.printed[-1]), "most memory [MB]": told.megabytes}
        rows.append(row)
    return pd.DataFrame(rows)


def whole_costs(most: int) -> pd.DataFrame:
    """With rows of a simulated table, `most` at most: CPU time and most memory of `fitball calibrate` from the CSV
    file to the result folder, and the sizes of what is read of that.
    """
    rows = []
    for count in (count for count in CALIBRATED if count <= most):
        with tempfile.TemporaryDirectory() as name:
            place, folder = Path(name) / "table.csv", Path(name) / "fit"
            write_simulated(place, count)
            words = ["calibrate", str(place), "--model", "grip-slip", "--cores", "1", "--quiet", "--out", str(folder)]
            told = fresh_process(VERB.format(words=words))
            sizes = {f"{item} [kB]": (folder / item).stat().st_size / 1e3 for item in ("report.html", "fit.json")}
        rows.append({"rows": count, "calibrate [s]": told.seconds, "microseconds a row": 1e6 * told.seconds / count,
                     "most memory [MB]": told.megabytes, **sizes})  # fmt: skip
    return pd.DataFrame(rows)


def process_costs(full: bool) -> pd.DataFrame:
    """CPU seconds and most memory of fresh processes, one core; in `full` with an empty compile cache too."""
    rebound = REBOUND.format(values=base_values())
    with tempfile.TemporaryDirectory() as place:
        asked: list[tuple[str, str, dict[str, str]]] = [
            ("python", "pass", {}),
            ("fitball --version", "import fitball.cli.main", {}),
            ("numpy, scipy.optimize, pandas", "import numpy, scipy.optimize, pandas", {}),
            ("first rebound", rebound, {}),
        ]
        if full:
            asked.append(("first rebound, empty compile cache", rebound, {"NUMBA_CACHE_DIR": f"{place}/cache"}))
        for table in ("wang_zero_spin", "wang_all"):
            words = ["calibrate", f"{table}.csv", "--cores", "1", "--quiet", "--out", f"{place}/{table}"]
            asked.append((f"fitball calibrate {table}", VERB.format(words=words), {}))
        told = {label: fresh_process(code, **environment) for label, code, environment in asked}
    return pd.DataFrame(
        [
            {"process": label, "CPU seconds": one.seconds, "most memory [MB]": one.megabytes}
            for label, one in told.items()
        ]
    )
