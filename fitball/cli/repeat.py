"""`fitball repeat FIT`: make a run again and say whether the result is the same."""

from __future__ import annotations

import argparse
import sys
import tempfile
from contextlib import nullcontext
from pathlib import Path

from fitball.cli.options import add_cores, place, tell_notes

HELP = "run a fit again and say whether the result is the same"
DESCRIPTION = """Run a fit again from its run.toml and compare.

The answer is one of three: bit-equal; equal within tolerance (numbers of the posterior differ by no more than their
Monte Carlo errors, the point estimate by no more than its search leaves open); different, with what and by how much.
Exit code 1 when different. The result compared with is never touched."""
EXAMPLE = """examples:
  fitball repeat fits/wang_zero_spin/two-mass
  fitball repeat fits/my_balls/grip-slip --data moved/my_balls.csv
  fitball repeat fits/my_balls/grip-slip/run-seed-2.toml --out fits/my_balls/again"""


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add what the verb may be asked."""
    parser.add_argument(
        "fit", metavar="FIT",
        help="a result folder of fitball calibrate, its fit.json or run.toml, or a copy of run.toml beside it",
    )  # fmt: skip
    parser.add_argument(
        "--data", metavar="FILE", action="append", default=[], help="where the table is now; repeat for several"
    )
    parser.add_argument("--force", metavar="FILE", help="where its force records are now")
    parser.add_argument("--out", type=place, metavar="DIR", help="keep the new result in this folder")
    add_cores(parser)
    parser.add_argument("--json", action="store_true", help="print every comparison as JSON")
    parser.add_argument("--quiet", action="store_true", help="no progress and no table: only the outcome and errors")


def run(args: argparse.Namespace) -> int:
    """Run the fit again and print what differs; 0 where nothing does, 1 where the results contradict each other."""
    progress = args.progress
    progress("loading", None)
    from dataclasses import replace

    from fitball.api import begin
    from fitball.errors import ResultFolderError
    from fitball.repeat.compare import Outcome, compared
    from fitball.repeat.kept import check_rows, read_kept, write_numbers
    from fitball.repeat.text import render, repetition_json
    from fitball.report.fit.folder import older_result, write_all
    from fitball.report.form.files import json_text
    from fitball.report.form.folders import held
    from fitball.report.saved.run_file import find_records, find_tables, read_run, record_problem
    from fitball.report.saved.structure import OlderFileError

    record = read_run(Path(args.fit))
    try:
        original = read_kept(record.folder)
    except OlderFileError:
        # It cannot be compared with, and is the reason for many to make it again.
        if args.out is None:
            raise
        original = None
    problem = record_problem(record, find_tables(record, args.data), find_records(record, args.force))
    if original is not None:
        check_rows(problem, original)
    if args.out is not None and (older := older_result(Path(args.out))):
        raise ResultFolderError(
            f"{args.out}: holds {' and '.join(older)} of an older run, which is never replaced here; name another "
            "folder with --out"
        )
    effort = replace(record.effort, cores=args.cores)
    place = nullcontext(args.out) if args.out is not None else tempfile.TemporaryDirectory(prefix="fitball-repeat-")
    try:
        with place as name, held(Path(name)):
            folder = Path(name)
            fit = begin(problem, effort, folder).fit(progress)
            progress("comparison", None)
            (write_numbers if args.out is None else write_all)(fit, folder)
            repetition = None if original is None else compared(problem, original, read_kept(folder))
    except KeyboardInterrupt:
        progress.finish()
        print("Interrupted: nothing was compared.", file=sys.stderr)
        return 130
    progress.finish()
    if original is None or repetition is None:
        tell_notes(["an older fitball made this fit: nothing was compared"])
        print(args.out)
        return 0
    if not args.quiet:
        tell_notes(repetition.notes)
    if args.json:
        print(json_text(repetition_json(repetition, original.content)), end="")
    elif args.quiet:
        print(repetition.outcome)
    else:
        print(render(repetition, original))
        if args.out is not None:
            print(args.out)
    return 1 if repetition.outcome is Outcome.DIFFERENT else 0
