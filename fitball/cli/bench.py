"""`fitball bench`: speed against error, measured here and now."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from fitball.cli.options import add_study, stages

if TYPE_CHECKING:
    from fitball.bench.clock import Pace

DEFAULT_FOLDER = Path("fits") / "bench"


HELP = "speed against error, and where time goes"
DESCRIPTION = """Measure CPU time per impact and per log posterior against error, beside careless and careful
integrators. Writes CSV files, a figure and a summary. Effective draws beside other samplers, many tables and whole
runs are measured by scripts/benchmark of the source tree."""
EXAMPLE = "examples:\n  fitball bench --quick\n  fitball bench --check\n"


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add what the verb may be asked."""
    parser.add_argument("--quick", action="store_true", help="a minute or two instead of ten")
    parser.add_argument(
        "--check", nargs="?", const=DEFAULT_FOLDER / "ratios.csv", type=Path, metavar="FILE",
        help=f"measure ratios only and compare them with kept ones (default: {DEFAULT_FOLDER / 'ratios.csv'}); exit "
        "code 1 when something has become 1.5 times slower",
    )  # fmt: skip
    add_study(parser, DEFAULT_FOLDER)


def run(args: argparse.Namespace) -> int:
    """Measure, write the folder, print the summary; or compare ratios."""
    from fitball.bench.measure import FULL, QUICK, measure
    from fitball.bench.report import summary, write
    from fitball.report.form.folders import held

    extent = QUICK if args.quick else FULL
    if args.check is not None:
        return _check(args, extent.pace)
    folder = Path(args.out) if args.out else DEFAULT_FOLDER
    with held(folder):
        bench = measure(extent, args.cores, stages(args.quiet))
        write(bench, folder)
    if args.json:
        frames = {name: json.loads(frame.to_json(orient="records")) for name, frame in bench.frames.items()}
        print(json.dumps({"machine": bench.machine, **frames}, indent=2))
    else:
        print("\n".join(summary(bench)))
        print(f"Results: {folder}")
    return 0


def _check(args: argparse.Namespace, pace: Pace) -> int:
    """Compare ratios with those kept; 1 when something has become slower."""
    from fitball.bench import ratios
    from fitball.bench.report import verdict

    kept = ratios.read_ratios(args.check)
    compared = ratios.compared(kept, ratios.ratios(pace))
    if (compared["times"] > ratios.TOLERATED).any():
        # What other programs on the machine took is not taken twice.
        compared = ratios.least(compared, ratios.compared(kept, ratios.ratios(pace)))
    lines, good = verdict(compared)
    print(compared.to_json(orient="records", indent=2) if args.json else "\n".join(lines))
    if not good and args.json:
        print("\n".join(lines), file=sys.stderr)
    return 0 if good else 1
