"""All that `fitball bench` measures, here and now."""

from __future__ import annotations

import os
import platform
import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd
import scipy

from fitball.bench.clock import Action, Pace, by_turns
from fitball.bench.errors import density_costs, work_precision
from fitball.bench.problems import base_values, posed, problems, scenes, spread_draws
from fitball.bench.ratios import ratios
from fitball.models.registry import model
from fitball.models.specs import DEFAULT_MODEL
from fitball.scheduling.engine import engine
from fitball.values import impacts


@dataclass(frozen=True)
class Extent:
    """How much is measured: the pace of short work, and impacts in the largest batch."""

    pace: Pace
    batch: int


FULL = Extent(Pace(7, 2e-3), 100_000)
QUICK = Extent(Pace(3, 1e-3), 20_000)


@dataclass(frozen=True)
class Bench:
    """Tables of what was measured, by name; `machine` in words."""

    frames: Mapping[str, pd.DataFrame]
    machine: str


def measure(extent: Extent, cores: int, report: Callable[[str], None]) -> Bench:
    """Measure everything; in full some minutes."""
    pace = extent.pace
    report("ratios")
    frames = {"ratios": ratios(pace)}
    report("exact answers")
    solved_scenes = scenes(engine(cores))
    report("speed against error")
    frames["precision"] = work_precision(solved_scenes, pace)
    frames["densities"] = pd.concat([density_costs(*named, pace) for named in problems()], ignore_index=True)
    report("batches")
    frames["batches"] = batch_costs(extent.batch, pace)
    return Bench(frames, machine())


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
