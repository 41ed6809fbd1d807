"""`fitball calibrate DATA`: validate, balance, fit, sample, diagnose, draw, report, export."""

from __future__ import annotations

import argparse
import shlex
import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

from fitball.cli.options import add_cores, add_reading, add_structure, add_verb, count, tell_notes, whole
from fitball.errors import ParameterError

if TYPE_CHECKING:
    from fitball.inference.effort import Effort

T = TypeVar("T")

HELP = "fit a model to a table of impacts: parameters, uncertainty, verdicts, figures, exported files"
EXAMPLE = """examples:
  fitball calibrate wang_zero_spin.csv
  fitball calibrate my_balls.csv --model grip-slip --out results/my_balls
  fitball calibrate wang_all.csv --fix eps_slope=0 --prior "mu=normal(0.6, 0.1)" --seed 7

Results go to fits/<table>/<model>/ below the current folder unless --out names another."""


def add_parser(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the verb to the command line."""
    parser = add_verb(subparsers, "calibrate", run, help=HELP, epilog=EXAMPLE)
    parser.add_argument(
        "data", nargs="+", metavar="DATA", help="a table (CSV, workbook, Parquet), or the name of a bundled one"
    )
    parser.add_argument("--model", metavar="NAME", help="{ranked}")
    parser.add_argument(
        "--closure", metavar="NAME=OPTION", action="append", default=[], help="replace a closure, e.g. normal=total"
    )
    parser.add_argument("--config", metavar="FILE.toml", help="scene file (default: the .toml beside DATA)")
    parser.add_argument(
        "--fix", metavar="NAME=VALUE", action="append", default=[], help="hold a parameter (SI units)"
    )
    parser.add_argument(
        "--prior",
        metavar="NAME=DIST(...)",
        action="append",
        default=[],
        help='e.g. "mu=normal(0.6, 0.1)", or one from the literature: mu=literature:clay (fitball datasets priors)',
    )
    parser.add_argument(
        "--force",
        metavar="FILE",
        help="force-time records: columns id, t, F (default: <table>_force.csv beside DATA); none: without",
    )
    add_structure(parser)
    add_reading(parser)
    parser.add_argument("--point-only", action="store_true", help="no posterior: the best values only")
    parser.add_argument("--seed", type=whole, default=1, metavar="N", help="seed of all random numbers (default 1)")
    parser.add_argument("--out", metavar="DIR", help="result folder")
    parser.add_argument("--no-figures", action="store_true", help="draw none: neither files nor on the page")
    parser.add_argument("--resume", action="store_true", help="go on with an interrupted or unconverged run")
    parser.add_argument("--overwrite", action="store_true", help="replace an older result in the folder")
    parser.add_argument("--max-steps", type=count, metavar="N", help="steps of each ensemble at most (default 20000)")
    parser.add_argument(
        "--walkers", type=count, metavar="N", help="walkers of each ensemble (default 4 per parameter)"
    )
    add_cores(parser)
    parser.add_argument("--json", action="store_true", help="print the summary as JSON")
    parser.add_argument("--quiet", action="store_true", help="no progress, no table: only errors and files")


def pairs(option: str, given: Sequence[str], convert: Callable[[str], T]) -> dict[str, T]:
    """Read repeated NAME=VALUE options. Raises ParameterError for a missing `=`, a bad value, a name said twice."""
    values: dict[str, T] = {}
    for text in given:
        name, equals, value = text.partition("=")
        name = name.strip()
        if not equals or not name or not value.strip():
            raise ParameterError(f"{option} {text}: expected NAME=VALUE")
        if name in values:
            raise ParameterError(f"{option}: {name} is given twice")
        try:
            values[name] = convert(value.strip())
        except ValueError:
            raise ParameterError(f"{option} {text}: read '{value.strip()}', expected a number") from None
    return values


def run(args: argparse.Namespace) -> int:
    """Fit, write the result folder, print the summary; 1 where the posterior did not converge."""
    progress = args.progress
    progress("loading", None)
    from fitball.api import begin, pose
    from fitball.inference.problem.build import Choices
    from fitball.inference.results.results import RunStatus
    from fitball.inference.sampling.ensembles import SamplingInterrupted
    from fitball.report.fit.folder import write_all
    from fitball.report.fit.terminal import render, render_json

    if args.resume and args.overwrite:
        raise ParameterError("--resume goes on with the old result and --overwrite discards it: choose one")
    choices = Choices(
        model=args.model,
        closures=pairs("--closure", args.closure, str),
        priors=pairs("--prior", args.prior, str),
        fix=pairs("--fix", args.fix, float),
        noise=args.noise,
        pool=pairs("--pool", args.pool, str),
        offsets=args.offsets,
        incident_errors=not args.exact_incidence,
        velocity_noise=args.velocity_noise,
    )
    problem = pose(
        args.data, choices, config=args.config, force=args.force, flip=args.flip, columns=args.columns,
        as_read=args.as_read,
    )  # fmt: skip
    folder = Path(args.out) if args.out else default_folder(problem.table.name, problem.model.name, choices.closures)
    begun = begin(problem, make_effort(args), folder, overwrite=args.overwrite, resume=args.resume)
    if not args.quiet:
        progress.finish()
        tell_notes([*problem.table.remarks, *problem.notes])
    if args.resume and not begun.resumes:
        print(f"note: {folder} holds no chain to resume: starting anew", file=sys.stderr)
    try:
        fit = begun.fit(progress).result
        progress("files" if args.no_figures else "figures and files", None)
        write_all(fit, folder, args.command, figures=not args.no_figures)
    except (KeyboardInterrupt, SamplingInterrupted):
        progress.finish()
        kept = begun.chain is not None and begun.chain.path.exists()
        print(_farewell(folder, kept), file=sys.stderr)
        return 130
    progress.finish()
    if args.json:
        print(render_json(fit, folder))
    elif not args.quiet:
        print(render(fit, folder))
    else:
        print(folder)
    return 1 if fit.status is RunStatus.NOT_CONVERGED else 0


def make_effort(args: argparse.Namespace) -> Effort:
    """The effort the options ask for."""
    from fitball.inference.effort import MAX_STEPS, Effort

    return Effort(
        seed=args.seed,
        point_only=args.point_only,
        walkers=args.walkers,
        max_steps=MAX_STEPS if args.max_steps is None else args.max_steps,
        cores=args.cores,
    )


def default_folder(table: str, model: str, closures: Mapping[str, str]) -> Path:
    """fits/<table>/<model>/, the changed closures named behind the model."""
    variant = "".join(f"+{name}={closures[name]}" for name in sorted(closures))
    return Path("fits") / table / (model + variant)


def _farewell(folder: Path, kept: bool) -> str:
    if not kept:
        return "Interrupted before sampling: nothing to keep."
    command = [word for word in sys.argv[1:] if word not in ("--resume", "--overwrite")]
    return f"Interrupted. The chain is kept in {folder}; to go on:\n  fitball {shlex.join([*command, '--resume'])}"
