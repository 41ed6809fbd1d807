"""`fitball bench`: speed against error, measured here and now."""

from __future__ import annotations

import argparse
import json
from pathlib import Path

from fitball.cli.options import add_study, add_verb, stages

DEFAULT_FOLDER = Path("fits") / "bench"


def add_parser(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the verb `bench`."""
    parser = add_verb(
        subparsers,
        "bench",
        run,
        help="speed against error, and where time goes",
        description="Measure time per impact against error for the closed form and for what one would write without "
        "it, cold starts, the stages of a calibration, and growth with rows and draws. Writes CSV files, a figure "
        "and a summary.",
        epilog="example:\n  fitball bench --quick\n",
    )
    parser.add_argument("--quick", action="store_true", help="a minute instead of some")
    add_study(parser, DEFAULT_FOLDER)


def run(args: argparse.Namespace) -> int:
    """Measure, write the folder, print the summary."""
    from fitball.studies.bench.measure import FULL, QUICK, measure
    from fitball.studies.bench.page import summary, write

    report = stages(args.quiet)
    folder = Path(args.out) if args.out else DEFAULT_FOLDER
    found = measure(QUICK if args.quick else FULL, args.cores, report)
    write(found, folder)
    if args.json:
        frames = {
            name: json.loads(getattr(found, name).to_json(orient="records"))
            for name in ("precision", "batches", "growth", "start_up", "stages")
        }
        print(json.dumps({"machine": found.machine, **frames}, indent=2))
    else:
        print("\n".join(summary(found)))
        print(f"Results: {folder}")
    return 0
