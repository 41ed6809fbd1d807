"""Many small tables through `calibrate_many`: does the time of a table, and the memory, stay what it was?"""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple, Protocol

import numpy as np
import pandas as pd

from fitball.bench.clock import fresh_process
from fitball.bench.problems import base_values, simulated_frame
from fitball.models.specs import DEFAULT_MODEL
from fitball.values import impacts

ROWS = 20
# Tables after which is looked.
LOOKED = (10, 50, 100, 200, 500, 1000)
COLUMNS = ("cores", "rows", "tables", "wall [s]", "CPU seconds a table", "parent [MB]", "worker [MB]")
# How much balls and courts differ, as shares of the values of the catalogue of hard cases.
DIFFERENT = {"mu": 0.1, "k_theta": 0.1, "k_y": 0.05, "cor_10": 0.03}
# Noise of the speeds [m/s] and of the spin [rad/s].
NOISE = (0.2, 0.2, 6.0)
# Started afresh: memory and threads of the bench itself are not those of a batch.
BATCH = """
import fitball
from benchmarks.many_tables import Watch
watch = Watch({cores})
fitball.calibrate_many({tables!r}, out={out!r}, cores={cores}, progress=watch)
"""


class Family(NamedTuple):
    """CPU seconds of this process and those it started, and the most memory of it and of any of them [MB]."""

    seconds: float
    parent: float
    worker: float


class Going(Protocol):
    """How far a batch is: tables that are `done`, `of` all."""

    done: int
    of: int


class Watch:
    """Prints, as a batch on so many `cores` goes on, one line at each of `LOOKED` and at its end: tables, wall time,
    CPU seconds a table since the line before, memory of parent and worker. Start-up counts with the first tables.
    """

    def __init__(self, cores: int, family: Callable[[], Family] | None = None) -> None:
        self.cores, self.family = cores, family or running
        self.begun = time.monotonic()
        self.tables, self.seconds = 0, 0.0

    def __call__(self, going: Going) -> None:
        """Called after every table."""
        if going.done not in (*LOOKED, going.of):
            return
        now = self.family()
        each = (now.seconds - self.seconds) / (going.done - self.tables)
        self.tables, self.seconds = going.done, now.seconds
        wall = time.monotonic() - self.begun
        print(self.cores, ROWS, going.done, wall, each, now.parent, now.worker, flush=True)


def running() -> Family:
    """Of this process and its children, as Linux tells; elsewhere CPU of this process alone, and no memory."""
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
    """A row (`COLUMNS`) at each look at a batch of so many simulated tables of 20 rows: wall time so far, CPU seconds
    a table since the look before, and the most memory of the process that asks, and of any other that works.
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
