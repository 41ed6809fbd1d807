"""`fitball calibrate DATA`: validate, balance, fit, sample, diagnose, draw, report, export."""

from __future__ import annotations

import argparse
import shlex
import sys
from collections.abc import Mapping
from pathlib import Path

from fitball.cli.fitting import add_fitting, choices_of, make_effort
from fitball.cli.options import place, reading_of, tell_notes
from fitball.errors import ParameterError, ResultFolderError

HELP = "fit a model to a table of impacts: parameters, uncertainty, verdicts, figures, exported files"
EXAMPLE = """examples:
  fitball calibrate wang_zero_spin.csv
  fitball calibrate my_balls.csv --model grip-slip --out results/my_balls
  fitball calibrate wang_all.csv --fix eps_slope=0 --prior "mu=normal(0.6, 0.1)" --seed 7

Results go to fits/<table>/<model>/ below the current folder unless --out names another."""


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add what the verb may be asked."""
    parser.add_argument(
        "data", nargs="+", metavar="DATA", help="a table (CSV, workbook, Parquet), or the name of a bundled one"
    )
    add_fitting(parser)
    parser.add_argument(
        "--force", metavar="FILE",
        help="force-time records: columns id, t, F (default: <table>_force.csv beside DATA); none: without",
    )  # fmt: skip
    parser.add_argument("--out", type=place, metavar="DIR", help="result folder")
    parser.add_argument("--no-figures", action="store_true", help="draw none: neither files nor on the page")
    parser.add_argument("--resume", action="store_true", help="go on with an interrupted or unconverged run")
    parser.add_argument("--overwrite", action="store_true", help="replace an older result in the folder")
    parser.add_argument("--json", action="store_true", help="print the summary as JSON")
    parser.add_argument("--quiet", action="store_true", help="no progress, no table: only errors and files")


def run(args: argparse.Namespace) -> int:
    """Fit, write the result folder, print the summary; 1 where the posterior did not converge."""
    progress = args.progress
    progress("loading", None)
    from fitball.api import begin, pose
    from fitball.inference.results.results import RunStatus
    from fitball.report.fit.document import render
    from fitball.report.fit.folder import render_json, write_all
    from fitball.report.form.folders import held

    if args.resume and args.overwrite:
        raise ParameterError("--resume goes on with the old result and --overwrite discards it: choose one")
    choices = choices_of(args)
    problem = pose(args.data, choices, args.force, **reading_of(args))
    folder = Path(args.out) if args.out else default_folder(problem.table.name, problem.model.name, choices.closures)
    effort = make_effort(args, args.cores)
    effort.settings(problem)
    with held(folder):
        begun = begin(problem, effort, folder, overwrite=args.overwrite, resume=args.resume)
        if not args.quiet:
            progress.finish()
            tell_notes([*problem.table.remarks, *problem.notes])
        if args.resume and not begun.resumes:
            print(f"note: {folder} holds no chain to resume: starting anew", file=sys.stderr)
        try:
            fit = begun.fit(progress)
            progress("files" if args.no_figures else "figures and files", None)
            write_all(fit, folder, args.command, figures=not args.no_figures)
        except (KeyboardInterrupt, ResultFolderError) as error:
            progress.finish()
            kept = begun.chain is not None and begun.chain.path.exists()
            if isinstance(error, KeyboardInterrupt):
                words = _farewell(folder) if kept else " before sampling: nothing to keep."
                print(f"Interrupted{words}", file=sys.stderr)
                return 130
            raise ResultFolderError(f"{error}\nNot finished{_farewell(folder)}" if kept else str(error)) from None
    progress.finish()
    print(render_json(fit, folder) if args.json else folder if args.quiet else render(fit, folder))
    return 1 if fit.status is RunStatus.NOT_CONVERGED else 0


def default_folder(table: str, model: str, closures: Mapping[str, str]) -> Path:
    """fits/<table>/<model>/, the changed closures named behind the model."""
    variant = "".join(f"+{name}={closures[name]}" for name in sorted(closures))
    return Path("fits") / table / (model + variant)


def _farewell(folder: Path) -> str:
    command = [word for word in sys.argv[1:] if word not in ("--resume", "--overwrite")]
    return f". The chain is kept in {folder}; to go on:\n  fitball {shlex.join([*command, '--resume'])}"
