"""All that `fitball bench` measures, here and now."""

from __future__ import annotations

import os
import platform
import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
import scipy

from fitball.scheduling.engine import engine
from fitball.studies.bench.clock import Pace
from fitball.studies.bench.costs import batch_costs, growth_costs, process_costs, whole_costs
from fitball.studies.bench.densities import density_costs
from fitball.studies.bench.many_tables import many_costs
from fitball.studies.bench.precision import work_precision
from fitball.studies.bench.ratios import ratios
from fitball.studies.bench.sampling import missing, sampling_costs
from fitball.studies.bench.scenes import scenes
from fitball.studies.bench.tables import problems


@dataclass(frozen=True)
class Extent:
    """How much is measured: the pace of short work, CPU seconds of each rival sampler on each table, impacts in the
    largest batch, rows of the largest table whose density is timed and of that which is calibrated, and batches of
    tables with the cores that each has.
    """

    pace: Pace
    sampling: float
    batch: int
    rows: int
    calibrated: int
    many: tuple[tuple[int, int], ...]


FULL = Extent(Pace(7, 2e-3), 15.0, 100_000, 8000, 1_000_000, ((200, 1), (1000, 2)))
QUICK = Extent(Pace(3, 1e-3), 2.0, 20_000, 2100, 10_000, ((10, 1),))


@dataclass(frozen=True)
class Bench:
    """Tables of what was measured, by name; `machine` in words, and rival samplers that are `missing`."""

    frames: Mapping[str, pd.DataFrame]
    machine: str
    missing: tuple[str, ...]


def measure(extent: Extent, cores: int, report: Callable[[str], None]) -> Bench:
    """Measure everything; in full an hour or so, most of it for many tables and for rival samplers."""
    pace = extent.pace
    report("ratios")
    frames = {"ratios": ratios(pace)}
    report("exact answers")
    solved_scenes = scenes(engine(cores))
    report("speed against error")
    frames["precision"] = work_precision(solved_scenes, pace)
    frames["densities"] = pd.concat([density_costs(*named, pace) for named in problems()], ignore_index=True)
    report("batches, rows, processes")
    frames["batches"] = batch_costs(extent.batch, pace)
    frames["growth"] = growth_costs(extent.rows, pace)
    report("whole calibrations")
    frames["whole"] = whole_costs(extent.calibrated)
    frames["processes"] = process_costs(extent is FULL)
    report("many tables")
    frames["tables"] = pd.concat([many_costs(count, on) for count, on in extent.many], ignore_index=True)
    frames["samplers"] = sampling_costs(extent.sampling, frames["densities"], report)
    return Bench(frames, machine(), tuple(missing()))


def machine() -> str:
    """Processor and versions."""
    return (
        f"{os.cpu_count()} logical cores of {_processor()}, Python {sys.version.split()[0]}, numpy {np.__version__}, "
        f"scipy {scipy.__version__}"
    )


def _processor() -> str:
    """Its name, where the system tells; vectors of eight numbers are faster than of four."""
    try:
        first = Path("/proc/cpuinfo").read_text(encoding="utf-8").split("\n\n")[0]
    except OSError:
        return platform.processor() or platform.machine()
    told = dict(line.split(":", 1) for line in first.splitlines() if ":" in line)
    known = {key.strip(): value.strip() for key, value in told.items()}
    vectors = next((name for name in ("avx512f", "avx2") if name in known.get("flags", "").split()), "no avx2")
    return f"{known.get('model name', platform.machine())} ({vectors})"
