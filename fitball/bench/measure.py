"""Everything that `fitball bench` measures; its files, and whether something has become slower.

A ratio of costs to those of one yardstick in the same run survives another load and, but for what vectors a processor
has, another machine; seconds do not.
"""

from __future__ import annotations

import math
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
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from fitball.bench.clock import Action, Pace, by_turns, fresh_process
from fitball.bench.errors import FASTEST, OURS, density_costs, work_precision
from fitball.bench.integrators import fixed_steps, set_up
from fitball.bench.problems import HARD, base_values, posed, problems, scenes, spread_coordinates, spread_draws
from fitball.errors import ResultFolderError
from fitball.inference.effort import Effort
from fitball.inference.likelihood.posterior import log_posterior
from fitball.inference.point.point_fit import point_fit
from fitball.inference.problem.problem import Problem
from fitball.inference.sampling.ensembles import sample
from fitball.models.registry import model
from fitball.models.specs import DEFAULT_MODEL
from fitball.report.figures.canvas import new_figure, own_style, save_figure
from fitball.report.form.document import markdown_table
from fitball.report.form.files import write_text
from fitball.report.form.palette import SERIES
from fitball.scheduling.engine import engine
from fitball.values import FloatArray, impacts


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
    """Its name, where the system reports it; vectors of eight numbers are faster than of four."""
    try:
        first = Path("/proc/cpuinfo").read_text(encoding="utf-8").split("\n\n")[0]
    except OSError:
        return platform.processor() or platform.machine()
    fields = dict(line.split(":", 1) for line in first.splitlines() if ":" in line)
    known = {key.strip(): value.strip() for key, value in fields.items()}
    vectors = next((name for name in ("avx512f", "avx2") if name in known.get("flags", "").split()), "no avx2")
    return f"{known.get('model name', platform.machine())} ({vectors})"


# Slower by this factor is a fault.
TOLERATED = 1.5
WORK, RATIO = "work", "over the yardstick"
# Seconds of compiled work that fitball does not change: the yardstick of work, and that of starts.
YARDSTICK = "order 8 compiled, 20 steps, events located, 21 impacts"
START = "python -c 'import numpy, scipy.optimize, pandas'"
STEPS = 120
REBOUND = "import fitball; fitball.model('two-mass').rebound({values}, fitball.impacts(14.0, 12.0, 100.0))"


def ratios(pace: Pace) -> pd.DataFrame:
    """Costs over those of the yardsticks, one row a kind of work."""
    spent = by_turns({YARDSTICK: _yardstick(), **_work()}, pace)
    rows = [
        {WORK: name, "yardstick": YARDSTICK, RATIO: seconds / spent[YARDSTICK]}
        for name, seconds in spent.items() if name != YARDSTICK
    ]  # fmt: skip
    starts = {
        START: "import numpy, scipy.optimize, pandas",
        "fitball --help": "import fitball.cli.main",
        "first rebound": REBOUND.format(values=base_values()),
        "imports of calibrate": "import fitball.inference.calibrate",
    }
    rounds = [{name: fresh_process(code).seconds for name, code in starts.items()} for _ in range(pace.rounds)]
    least = {name: min(taken[name] for taken in rounds) for name in starts}
    rows += [
        {WORK: name, "yardstick": START, RATIO: seconds / least[START]}
        for name, seconds in least.items() if name != START
    ]  # fmt: skip
    return pd.DataFrame(rows)


def _yardstick() -> Action:
    ball, given = model(DEFAULT_MODEL).ball, posed("wang_all").impacts
    states = zip(given.v_x1.tolist(), given.v_y1.tolist(), given.omega_1.tolist(), strict=True)
    setups = np.array([set_up(ball, base_values(), *state) for state in states])
    return partial(fixed_steps, setups, 8, 20, located=True)


def _work() -> Mapping[str, Action]:
    chosen, draws = model(DEFAULT_MODEL), spread_draws(200)
    names = tuple(base_values())
    table = posed("wang_all")
    work: dict[str, Action] = {
        "rebounds, 1 draw of 21 impacts": partial(chosen.evaluate, names, draws[:1], table.impacts),
        "rebounds, 200 draws of 21 impacts": partial(chosen.evaluate, names, draws, table.impacts),
        "derivatives, 200 draws of 21 impacts": partial(chosen.jacobian, names, draws, table.impacts, names),
    }
    for problem in (posed("wang_zero_spin"), table, posed("wang_all", 2100)):
        at = spread_coordinates(problem, 40)
        work[f"log posterior, 40 walkers, {len(problem.impacts)} impacts"] = partial(log_posterior, problem, at)
    zero = posed("wang_zero_spin")
    at = spread_coordinates(zero, 4)
    work[f"sampling, {STEPS} steps, 7 impacts"] = partial(_sampled, zero, at)
    work["point fit, 7 impacts"] = lambda: point_fit(zero, np.random.default_rng(1))
    return work


def _sampled(problem: Problem, at: FloatArray) -> object:
    settings = Effort(cores=1, max_steps=STEPS).settings(problem)
    return sample(problem, at, settings, None, False, lambda _progress: None)


def read_ratios(path: Path) -> pd.DataFrame:
    """Ratios of an earlier run. Raises ResultFolderError for a file that has none."""
    try:
        kept = pd.read_csv(path)
        good = {WORK, RATIO} <= set(kept) and len(kept) > 0 and bool((kept[RATIO].astype(float) > 0.0).all())
    except (OSError, UnicodeError, ValueError) as error:
        what = getattr(error, "strerror", None) or error
        raise ResultFolderError(
            f"{path}: read {what}, expected the ratios of an earlier run; run fitball bench first, or give their "
            "file with --check"
        ) from None
    if not good:
        raise ResultFolderError(
            f"{path}: read columns {', '.join(map(str, kept))}, expected '{WORK}' and '{RATIO}' with positive "
            "numbers; run fitball bench first"
        )
    return kept


def compared(kept: pd.DataFrame, now: pd.DataFrame) -> pd.DataFrame:
    """Ratios now and then, `times` slower, by work. Raises ResultFolderError where the two are of different work."""
    before, after = (frame.set_index(WORK)[RATIO] for frame in (kept, now))
    other = sorted(set(before.index) ^ set(after.index))
    if other:
        raise ResultFolderError(
            f"the saved ratios are of other work than those of this fitball ({'; '.join(other)}): run fitball bench "
            "again"
        )
    frame = pd.DataFrame({"kept": before, "now": after, "times": after / before})
    return frame.rename_axis(WORK).reset_index()


def least(first: pd.DataFrame, second: pd.DataFrame) -> pd.DataFrame:
    """Of two results of `compared` the lesser, work by work."""
    return first.where(first["times"] <= second["times"], second)


FIGURE = "speed_against_error.png"
# Errors below this are drawn at it: zero has no logarithm.
FLOOR = 1e-17
MARKS = "D*dos^vPX"
HEADS = {
    "densities": "Log posterior (errors of the log density against textbook formulas)",
    "batches": "Batches",
    "ratios": "What `--check` compares",
}


def write(bench: Bench, folder: Path) -> None:
    """Write CSV files, the figure and a summary. Raises ResultFolderError."""
    for name, frame in bench.frames.items():
        write_text(folder / f"{name}.csv", frame.to_csv(index=False, float_format="%.4g", lineterminator="\n"))
    save_figure(bench_figure(bench), folder / FIGURE)
    write_text(folder / "summary.md", "\n".join(summary(bench)) + "\n")


def summary(bench: Bench) -> list[str]:
    """The main numbers as Markdown."""
    precision = bench.frames["precision"]
    wang = precision[precision["scene"] == "Wang's 21"].drop(columns=["scene", "median error"])
    fastest = float(wang[wang["solver"] == FASTEST]["microseconds"].iloc[0])
    wang.insert(3, "times slower", wang["microseconds"] / fastest)
    exact = precision[precision["solver"] == "closed form, one by one"]
    largest = ", ".join(f"{row['scene']} {row['largest error']:.1e}" for row in exact.to_dict("records"))
    lines = [
        f"Measured by `fitball bench` on {bench.machine}; times are CPU times, the least of several rounds.", "",
        *markdown(wang), "", f"Largest error of the closed form by scene: {largest}.", "",
    ]  # fmt: skip
    for name, head in HEADS.items():
        lines += [f"{head}:", "", *markdown(bench.frames[name]), ""]
    return lines


def verdict(compared: pd.DataFrame) -> tuple[list[str], bool]:
    """Ratios now and before as Markdown, what has become slower in words, and whether nothing has."""
    slower = compared[compared["times"] > TOLERATED]
    lines = [*markdown(compared), ""]
    lines += [
        f"{row[WORK]}: {row['times']:.2f} times slower than saved ({row['now']:.3g} {RATIO}, was {row['kept']:.3g})"
        for row in slower.to_dict("records")
    ]
    return lines, slower.empty


def markdown(frame: pd.DataFrame) -> list[str]:
    """A table as lines of Markdown."""
    rows = [list(map(_cell, values)) for values in frame.itertuples(index=False)]
    return markdown_table([list(frame.columns), *rows]).splitlines()


def _cell(value: object) -> str:
    if isinstance(value, float):
        return "" if math.isnan(value) else f"{value:.3g}"
    return str(value)


@own_style()
def bench_figure(bench: Bench) -> Figure:
    """Time per impact against largest error, one panel a scene, and time a log posterior, one curve a solver."""
    precision, densities = bench.frames["precision"], bench.frames["densities"]
    names = [name for name in dict.fromkeys(precision["scene"]) if name != HARD]
    figure = new_figure(13.0, 8.2)
    panels = figure.subplots(2, 3).ravel()
    for panel, name in zip(panels, names, strict=False):
        _curves(panel, precision[precision["scene"] == name], "solver", name)
        panel.set_xlabel("largest error / incident surface speed")
        panel.set_ylabel("CPU microseconds an impact")
    _curves(panels[4], densities, "log posterior", "Log posterior of five tables")
    panels[4].set_xlabel("largest error of the log density")
    panels[4].set_ylabel("CPU microseconds a density")
    panels[5].axis("off")
    shared = {"frameon": False, "fontsize": 9, "labelspacing": 0.3}
    panels[5].add_artist(
        panels[5].legend(*panels[0].get_legend_handles_labels(), title="Bounce", loc="upper left", **shared)
    )
    panels[5].legend(*panels[4].get_legend_handles_labels(), title="Log posterior", loc="lower left", **shared)
    figure.suptitle("Speed against error: lower left is better", fontsize=12)
    return figure


def _curves(panel: Axes, rows: pd.DataFrame, by: str, title: str) -> None:
    for k, (name, mine) in enumerate(rows.groupby(by, sort=False)):
        ours = str(name).startswith(("closed form", OURS))
        color, line = SERIES[k % len(SERIES)], "-" if by == "solver" else ""
        panel.loglog(
            mine["largest error"].clip(lower=FLOOR), mine["microseconds"], MARKS[k % len(MARKS)] + line,
            color=color, markersize=8 if ours else 5, linewidth=1, label=str(name),
            markerfacecolor=color if ours else "none",
        )  # fmt: skip
    panel.set_title(title, fontsize=11)
    panel.grid(alpha=0.3)
