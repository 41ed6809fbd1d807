"""`scripts/benchmark`: effective draws beside other samplers, many tables, whole processes with rows.

CSV files, which the pages of the documentation quote, go beside those of `fitball bench`.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Mapping
from pathlib import Path

import pandas as pd

from benchmarks import processes, samplers
from fitball.bench.clock import Pace
from fitball.bench.errors import density_costs
from fitball.bench.measure import markdown
from fitball.bench.problems import problems
from fitball.report.figures.canvas import save_figure
from fitball.report.form.files import write_text
from fitball.report.form.folders import held

DEFAULT_FOLDER = Path("fits") / "bench"
Frames = Mapping[str, pd.DataFrame]
FULL, QUICK = Pace(7, 2e-3), Pace(3, 1e-3)


def _samplers(quick: bool, folder: Path) -> Frames:
    pace, seconds = (QUICK, 2.0) if quick else (FULL, 15.0)
    densities = pd.concat([density_costs(*named, pace) for named in problems()], ignore_index=True)
    frame = samplers.sampling_costs(seconds, densities, lambda stage: print(stage, file=sys.stderr))
    save_figure(samplers.figure(frame), folder / "samplers.png")
    if names := samplers.missing():
        wanted = " ".join(names)
        print(f"Not measured, not installed: pip install {wanted} (or fitball[bench]).", file=sys.stderr)
    return {"samplers": frame}


def _tables(quick: bool, _folder: Path) -> Frames:
    batches = ((10, 1),) if quick else ((200, 1), (1000, 2))
    found = [processes.many_costs(count, cores) for count, cores in batches]
    return {"tables": pd.concat(found, ignore_index=True)}


def _processes(quick: bool, _folder: Path) -> Frames:
    return {
        "growth": processes.growth_costs(2100 if quick else 8000, QUICK if quick else FULL),
        "whole": processes.whole_costs(10_000 if quick else 1_000_000),
        "processes": processes.process_costs(not quick),
    }


BENCHMARKS: Mapping[str, Callable[[bool, Path], Frames]] = {
    "samplers": _samplers, "tables": _tables, "processes": _processes,
}  # fmt: skip


def main(argv: list[str] | None = None) -> int:
    """Measure what is named, or all, and write its tables."""
    parser = argparse.ArgumentParser(prog="scripts/benchmark", description=__doc__)
    parser.add_argument("name", nargs="*", metavar="NAME", help=f"{', '.join(BENCHMARKS)} (default: all, an hour)")
    parser.add_argument("--quick", action="store_true", help="some minutes instead of an hour")
    parser.add_argument("--out", type=Path, default=DEFAULT_FOLDER, metavar="DIR", help="where to write")
    args = parser.parse_args(argv)
    if unknown := set(args.name) - set(BENCHMARKS):
        parser.error(f"unknown: {', '.join(sorted(unknown))}; known: {', '.join(BENCHMARKS)}")
    with held(args.out):
        for name in args.name or BENCHMARKS:
            for title, frame in BENCHMARKS[name](args.quick, args.out).items():
                text = frame.to_csv(index=False, float_format="%.4g", lineterminator="\n")
                write_text(args.out / f"{title}.csv", text)
                print("\n".join([f"{title}:", "", *markdown(frame), ""]))
    return 0


if __name__ == "__main__":
    sys.exit(main())
