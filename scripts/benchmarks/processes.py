"""What grows with the rows of a table, and what whole processes take, in time and in memory."""

from __future__ import annotations

import tempfile
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd

from fitball.bench.clock import Pace, by_turns, fresh_process
from fitball.bench.problems import base_values, posed, simulated_frame, spread_coordinates
from fitball.bench.ratios import REBOUND
from fitball.inference.likelihood.posterior import log_posterior
from fitball.values import impacts

ROWS = (7, 21, 210, 2100, 8000)
FITTED = (21, 210, 2100, 8000)
CALIBRATED = (1000, 10_000, 100_000, 1_000_000)
VERB = "from fitball.cli.main import main; assert main({words}) == 0"
POINT_FIT = """
import numpy as np
from fitball.inference.point.point_fit import point_fit
from fitball.bench.problems import posed
problem = posed("wang_all", {rows})
begun = __import__("time").process_time()
point_fit(problem, np.random.default_rng(1))
print(__import__("time").process_time() - begun)
"""
# The truth of tables of many rows.
SIMULATED = {"mu": 0.6, "e_x": 0.1, "offset": 0.0, "cor_10": 0.78, "cor_slope": -0.012}


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


def write_simulated(place: Path, rows: int) -> None:
    """A CSV file of about `rows` impacts of 8 to 35 m/s at 15 to 70 degrees, with back- and topspin, that grip-slip
    made, 0.3 m/s and 10 rad/s of noise added; a rebound that noise turns is left out.
    """
    rng = np.random.default_rng(rows)
    speed, angle = rng.uniform(8.0, 35.0, rows), np.radians(rng.uniform(15.0, 70.0, rows))
    given = impacts(speed * np.cos(angle), speed * np.sin(angle), rng.uniform(-200.0, 300.0, rows))
    frame = simulated_frame("grip-slip", SIMULATED, given, (0.3, 0.3, 10.0), rng)
    frame[frame["v_y2 [m/s]"] > 0.0].to_csv(place, index=False, float_format="%.6g")
