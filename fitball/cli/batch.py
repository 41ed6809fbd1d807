"""`fitball batch 'courts/*.csv'`: every table fitted by itself, one table and one page of all."""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING

from fitball.cli.fitting import add_fitting, choices_of, make_effort
from fitball.cli.options import add_scheduler, place
from fitball.cli.progress import time_left

if TYPE_CHECKING:
    from collections.abc import Callable

    from fitball.batch.run import Going

HELP = "fit many tables, each by itself: one table and one page of all, resumable"
EXAMPLE = """examples:
  fitball batch 'courts/*.csv'
  fitball batch 'season/**/*.xlsx' --model grip-slip --out results/season
  fitball batch courts --scheduler tcp://head:8786

Results go to fits/batch/ unless --out names another folder: batch.csv with a row a table, batch.html, and a folder a
table with fit.json (--full: all that calibrate writes). The same line goes on after an interruption. Exit code 1 if
a table failed or a posterior did not converge."""


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add what the verb may be asked."""
    parser.add_argument(
        "data", nargs="+", metavar="DATA", help="tables, folders of tables, or patterns in quotes ('courts/*.csv')"
    )
    add_fitting(parser)
    parser.add_argument(
        "--full", action="store_true", help="all files of calibrate for each table, not fit.json alone"
    )
    parser.add_argument("--overwrite", action="store_true", help="replace results of other data or settings")
    add_scheduler(parser)
    parser.add_argument("--out", type=place, metavar="DIR", help="result folder (default: fits/batch)")
    parser.add_argument("--quiet", action="store_true", help="no progress, no table: only errors and the folder")


def run(args: argparse.Namespace) -> int:
    """Fit what is not fitted yet, write the files of all, print what was found."""
    args.progress("loading", None)
    from fitball.batch.many import FOLDER, batch_of
    from fitball.batch.plan import Plan
    from fitball.inference.results.results import RunStatus
    from fitball.report.batch.rows import FAILED

    folder = Path(args.out) if args.out else FOLDER
    plan = Plan(
        folder, choices_of(args), make_effort(args, 1), args.config, tuple(args.flip), args.columns, {}, args.as_read,
        args.full, args.overwrite,
    )  # fmt: skip
    try:
        batch = batch_of(args.data, plan, args.cores, args.scheduler, telling(args), args.command)
    except KeyboardInterrupt:
        args.progress.finish()
        print(f"Interrupted. Finished tables are kept in {folder}; the same line goes on.", file=sys.stderr)
        return 130
    args.progress.finish()
    print(folder if args.quiet else batch.report())
    unsure = any(row["status"] == RunStatus.NOT_CONVERGED for row in batch.rows)
    return 1 if unsure or any(row["outcome"] == FAILED for row in batch.rows) else 0


def telling(args: argparse.Namespace) -> Callable[[Going], None]:
    """Progress with the time left, from tables that were fitted in this run."""
    begun = time.monotonic()

    def tell(going: Going) -> None:
        words = f"{going.done:,} of {going.of:,} tables"
        words += f", {going.failed:,} failed" if going.failed else ""
        words += time_left(time.monotonic() - begun, going.done - going.kept, going.of - going.done)
        args.progress.count("tables", words)

    return tell
