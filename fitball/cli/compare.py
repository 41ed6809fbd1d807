"""`fitball compare DATA`: the candidates of models on one table, judged by impacts they have not seen."""

from __future__ import annotations

import argparse
from pathlib import Path

from fitball.cli.options import add_reading, add_scheduler, either, place, reading_of, tell_notes, whole
from fitball.errors import ModelError
from fitball.models.names import RANKED

HELP = "compare models on a table of impacts by predictions of impacts left out"
EXAMPLE = f"""examples:
  fitball compare wang_all.csv
  fitball compare my_balls.csv --models brody,grip-slip,two-mass,two-mass+torsion=free
  fitball compare wang_zero_spin.csv --quick --json

A model is {either(RANKED[::-1])}, with +CLOSURE=OPTION for each closure changed (the first two know cor alone):
release (zero_force, zero_displacement), normal (momentum, total, inner), offset (contact, grip), spin (mean, shell),
inertia (tied, table), torsion (matched, free, rigid), cor (line, saturating, mean, measured).

Results go to fits/<table>/compare/ below the current folder unless --out names another. Exit code 1 if a posterior
did not converge."""


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add what the verb may be asked."""
    parser.add_argument("data", metavar="DATA", help="a table (CSV, workbook, Parquet), or the name of a bundled one")
    parser.add_argument("--models", metavar="A,B,...", help="models to compare (default: those that can differ here)")
    parser.add_argument("--config", metavar="FILE.toml", help="scene file (default: the .toml beside DATA)")
    add_reading(parser)
    parser.add_argument(
        "--quick", action="store_true", help="only the main models, and no exact refits of influential impacts"
    )
    parser.add_argument("--seed", type=whole, default=1, metavar="N", help="seed of all random numbers (default 1)")
    parser.add_argument("--max-steps", type=whole, metavar="N", help="steps of each ensemble at most (default 8000)")
    parser.add_argument("--cores", type=whole, metavar="N", help="processes, one model each (default: all)")
    add_scheduler(parser)
    parser.add_argument("--out", type=place, metavar="DIR", help="result folder")
    parser.add_argument("--overwrite", action="store_true", help="replace an older result in the folder")
    parser.add_argument("--json", action="store_true", help="print compare.json")
    parser.add_argument("--quiet", action="store_true", help="no progress, no table: only errors and the folder")


def run(args: argparse.Namespace) -> int:
    """Fit and score every model, write the folder, print the tables; 1 where a posterior did not converge."""
    progress = args.progress
    progress("loading", None)
    from fitball.api.comparing import contest
    from fitball.inference.results.results import RunStatus
    from fitball.report.compare.document import JSON_NAME, render, write_all
    from fitball.report.form.files import json_text
    from fitball.report.form.folders import clear_folder, held

    asked = contest(
        args.data, None if args.models is None else model_names(args.models), quick=args.quick, seed=args.seed,
        max_steps=args.max_steps, cores=args.cores, scheduler=args.scheduler, **reading_of(args),
    )  # fmt: skip
    folder = Path(args.out) if args.out else Path("fits") / asked.table.name / "compare"
    with held(folder):
        clear_folder(folder, JSON_NAME, overwrite=args.overwrite)
        if not args.quiet:
            progress.finish()
            tell_notes(asked.said)
        comparison = asked.compare(lambda stage: progress(stage, None))
        progress("figures and files", None)
        write_all(comparison.result, folder, args.command)
    progress.finish()
    if args.json:
        print(json_text(comparison.json()), end="")
    else:
        print(folder if args.quiet else render(comparison.result, str(folder)))
    if comparison.status is RunStatus.INTERRUPTED:
        return 130
    return 0 if comparison.status is RunStatus.CONVERGED else 1


def model_names(text: str) -> tuple[str, ...]:
    """Names of `--models`, separated by commas. Raises ModelError for an empty one."""
    names = tuple(part.strip() for part in text.split(","))
    if not all(names):
        raise ModelError(f"--models {text}: read an empty name; expected names separated by commas")
    return names
