"""Time and memory as functions of the number of rows, of whole processes, and of each table when `calibrate_many`
fits many.
"""

from __future__ import annotations

import os
import tempfile
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple, Protocol

import numpy as np
import pandas as pd

from fitball.bench.clock import Pace, by_turns, fresh_process
from fitball.bench.measure import REBOUND
from fitball.bench.problems import base_values, posed, simulated_frame, spread_coordinates
from fitball.inference.likelihood.posterior import log_posterior
from fitball.models.specs import DEFAULT_MODEL
from fitball.values import impacts

LENGTHS = (7, 21, 210, 2100, 8000)
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
    """For tables of up to `most` rows: CPU time of 40 log posteriors in one call. CPU time and maximum memory of a
    point fit in its own process.
    """
    rows = []
    for count in (count for count in LENGTHS if count <= most):
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
    """For simulated tables of up to `most` rows: CPU time and maximum memory of `fitball calibrate` from the CSV file
    to the result folder, and the sizes of its main files.
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
    """A CSV file of about `rows` impacts of 8 to 35 m/s at 15 to 70 degrees, with backspin and topspin. Rebounds are
    those of grip-slip with noise of 0.3 m/s and 10 rad/s; unphysical ones are left out.
    """
    rng = np.random.default_rng(rows)
    speed, angle = rng.uniform(8.0, 35.0, rows), np.radians(rng.uniform(15.0, 70.0, rows))
    given = impacts(speed * np.cos(angle), speed * np.sin(angle), rng.uniform(-200.0, 300.0, rows))
    frame = simulated_frame("grip-slip", SIMULATED, given, {"v_x2": 0.3, "v_y2": 0.3, "omega_2": 10.0}, rng)
    frame[frame["v_y2 [m/s]"] > 0.0].to_csv(place, index=False, float_format="%.6g")


ROWS = 20
# Tables after which is looked.
LOOKED = (10, 50, 100, 200, 500, 1000)
COLUMNS = ("cores", "rows", "tables", "wall [s]", "CPU seconds a table", "parent [MB]", "worker [MB]")
# How much balls and courts differ, as shares of the values of the catalogue of hard cases.
DIFFERENT = {"mu": 0.1, "k_theta": 0.1, "k_y": 0.05, "cor_10": 0.03}
# Noise of the speeds [m/s] and of the spin [rad/s].
NOISE = {"v_x2": 0.2, "v_y2": 0.2, "omega_2": 6.0}
# Started afresh: memory and threads of the bench itself are not those of a batch.
BATCH = """
import fitball
from benchmarks.processes import Watch
watch = Watch({cores})
fitball.calibrate_many({tables!r}, out={out!r}, cores={cores}, progress=watch)
"""


class Family(NamedTuple):
    """CPU seconds of this process and those it started, and the most memory of it and of any of them [MB]."""

    seconds: float
    parent: float
    worker: float


class Going(Protocol):
    """Progress of a batch: tables that are `done`, of a `total`."""

    done: int
    total: int


class Watch:
    """Prints a line at each of `LOOKED` and at the end of a batch on `cores` cores: tables, wall time, CPU seconds a
    table since the line before, memory of parent and worker. Start-up counts with the first tables.
    """

    def __init__(self, cores: int, family: Callable[[], Family] | None = None) -> None:
        self.cores, self.family = cores, family or running
        self.begun = time.monotonic()
        self.tables, self.seconds = 0, 0.0

    def __call__(self, going: Going) -> None:
        """Called after every table."""
        if going.done not in (*LOOKED, going.total):
            return
        now = self.family()
        each = (now.seconds - self.seconds) / (going.done - self.tables)
        self.tables, self.seconds = going.done, now.seconds
        wall = time.monotonic() - self.begun
        print(self.cores, ROWS, going.done, wall, each, now.parent, now.worker, flush=True)


def running() -> Family:
    """CPU time and memory of this process and its children (Linux); elsewhere CPU time of this process alone."""
    own = time.process_time()
    try:
        places = [place for place in Path("/proc").iterdir() if place.name.isdigit()]
    except OSError:
        return Family(own, np.nan, np.nan)
    seconds, most = own, np.nan
    for place in places:
        try:
            # The name of a process, in parentheses, may hold spaces.
            fields = (place / "stat").read_text(encoding="utf-8").rpartition(")")[2].split()
            if int(fields[1]) == os.getpid():
                seconds += (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")
                most = np.fmax(most, _megabytes(place))
        except (OSError, IndexError):
            continue  # It ended meanwhile.
    return Family(seconds, _megabytes(Path("/proc/self")), float(most))


def _megabytes(place: Path) -> float:
    return float((place / "status").read_text(encoding="utf-8").split("VmHWM:")[1].split()[0]) / 1024


def many_costs(tables: int, cores: int) -> pd.DataFrame:
    """A row (`COLUMNS`) for each line of a batch of simulated tables with 20 rows: wall time so far, CPU seconds a
    table since the line before, maximum memory of the parent and of any worker.
    """
    with TemporaryDirectory() as place:
        folder = Path(place) / "tables"
        write_tables(folder, tables)
        code = BATCH.format(tables=str(folder), out=str(Path(place) / "fits"), cores=cores)
        path = str(Path(__file__).parent.parent)
        told = fresh_process(code, OPENBLAS_NUM_THREADS="1", PYTHONPATH=path).printed
    frame = pd.DataFrame(np.array(told, dtype=np.float64).reshape(-1, len(COLUMNS)), columns=COLUMNS)
    return frame.astype(dict.fromkeys(COLUMNS[:3], int))


def write_tables(folder: Path, count: int) -> None:
    """Simulated tables `0001.csv` and on, each of a ball and a court of its own."""
    folder.mkdir()
    for number in range(1, count + 1):
        rng = np.random.default_rng([15, number])
        speed, angle = rng.uniform(12.0, 30.0, ROWS), np.radians(rng.uniform(14.0, 40.0, ROWS))
        given = impacts(speed * np.cos(angle), speed * np.sin(angle), rng.uniform(-300.0, 300.0, ROWS))
        own = {
            name: value * (1.0 + DIFFERENT.get(name, 0.0) * rng.standard_normal())
            for name, value in base_values().items()
        }
        frame = simulated_frame(DEFAULT_MODEL, own, given, NOISE, rng)
        frame.to_csv(folder / f"{number:04}.csv", index=False, float_format="%.6g")
