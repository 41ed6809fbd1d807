"""The verbs that fit: `calibrate`, `compare`, `batch` and what its tables have in common, `repeat`."""

from __future__ import annotations

import argparse
import shlex
import sys
import time
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from fitball.cli.options import (
    CONFIG,
    CORES,
    FITTING,
    FULL,
    READING,
    SCHEDULER,
    SEED,
    Verb,
    either,
    fitting_of,
    option,
    place,
    print_result,
    switch,
    tell_notes,
    whole,
)
from fitball.cli.terminal import show, time_left
from fitball.errors import ModelError, ParameterError, ResultFolderError
from fitball.models.specs import RANKED

if TYPE_CHECKING:
    from collections.abc import Callable

    from fitball.batch.many import Going


def run_calibrate(args: argparse.Namespace) -> int:
    """Fit, write the result folder, print the summary; 1 where the posterior did not converge."""
    progress = args.progress
    progress("loading", None)
    from fitball.api import begin, pose
    from fitball.api.reading import choices_of, effort_of, reading_of
    from fitball.inference.results.results import RunStatus
    from fitball.report.fit.document import render
    from fitball.report.fit.folder import render_json, write_all
    from fitball.report.form.folders import held

    if args.resume and args.overwrite:
        raise ParameterError("--resume goes on with the old result and --overwrite discards it: choose one")
    asked = fitting_of(args)
    choices = choices_of(args.model, asked)
    problem = pose(args.data, choices, args.force, **reading_of(asked))
    folder = Path(args.out) if args.out else default_folder(problem.table.name, problem.model.name, choices.closures)
    effort = effort_of(asked, args.cores)
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
    if args.json:
        print(render_json(fit, folder))
    else:
        show(str(folder) if args.quiet else render(fit, folder))
    return 1 if fit.status is RunStatus.NOT_CONVERGED else 0


def default_folder(table: str, model: str, closures: Mapping[str, str]) -> Path:
    """fits/<table>/<model>/, the changed closures named behind the model."""
    variant = "".join(f"+{name}={closures[name]}" for name in sorted(closures))
    return Path("fits") / table / (model + variant)


def _farewell(folder: Path) -> str:
    command = [word for word in sys.argv[1:] if word not in ("--resume", "--overwrite")]
    return f". The chain is kept in {folder}; to go on:\n  fitball {shlex.join([*command, '--resume'])}"


CALIBRATE = Verb(
    "calibrate", "fit a model to a table of impacts: parameters, uncertainty, verdicts, figures, exported files",
    (
        option("data", "DATA", "a table (CSV, workbook, Parquet), or the name of a bundled one", nargs="+"),
        *FITTING,
        option(
            "--force", "FILE",
            "force-time records: columns id, t, F (default: <table>_force.csv beside DATA); none: without",
        ),
        option("--out", "DIR", "result folder", type=place),
        switch("--no-figures", "draw none: neither files nor on the page"),
        switch("--resume", "go on with an interrupted or unconverged run"),
        switch("--overwrite", "replace an older result in the folder"),
        FULL,
        switch("--json", "print the summary as JSON"),
        switch("--quiet", "no progress, no table: only errors and files"),
    ),
    run_calibrate,
    """examples:
  fitball calibrate wang_zero_spin.csv
  fitball calibrate my_balls.csv --model grip-slip --out results/my_balls
  fitball calibrate wang_all.csv --fix eps_slope=0 --prior "mu=normal(0.6, 0.1)" --seed 7

Results go to fits/<table>/<model>/ below the current folder unless --out names another.""",
)  # fmt: skip


def run_compare(args: argparse.Namespace) -> int:
    """Fit and score every model, write the folder, print the tables; 1 where a posterior did not converge."""
    progress = args.progress
    progress("loading", None)
    from fitball.api.calibrating import contest
    from fitball.api.reading import reading_of
    from fitball.report.compare.document import JSON_NAME, write_all
    from fitball.report.form.folders import clear_folder, held

    asked = contest(
        args.data, None if args.models is None else model_names(args.models), quick=args.quick, seed=args.seed,
        max_steps=args.max_steps, cores=args.cores, scheduler=args.scheduler, **reading_of(fitting_of(args)),
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
    print_result(args, comparison, folder, folder)
    return comparison.exit_code


def model_names(text: str) -> tuple[str, ...]:
    """Names of `--models`, separated by commas. Raises ModelError for an empty one."""
    names = tuple(part.strip() for part in text.split(","))
    if not all(names):
        raise ModelError(f"--models {text}: read an empty name; expected names separated by commas")
    return names


COMPARE = Verb(
    "compare", "compare models on a table of impacts by predictions of impacts left out",
    (
        option("data", "DATA", "a table (CSV, workbook, Parquet), or the name of a bundled one"),
        option("--models", "A,B,...", "models to compare (default: those that can differ here)"),
        CONFIG,
        *READING,
        switch("--quick", "only the main models, and no exact refits of influential impacts"),
        SEED,
        option("--max-steps", "N", "steps of each ensemble at most (default 8000)", type=whole),
        option("--cores", "N", "processes, one model each (default: all)", type=whole),
        SCHEDULER,
        option("--out", "DIR", "result folder", type=place),
        switch("--overwrite", "replace an older result in the folder"),
        FULL,
        switch("--json", "print compare.json"),
        switch("--quiet", "no progress, no table: only errors and the folder"),
    ),
    run_compare,
    f"""examples:
  fitball compare wang_all.csv
  fitball compare my_balls.csv --models brody,grip-slip,two-mass,two-mass+torsion=free
  fitball compare wang_zero_spin.csv --quick --json

A model is {either(RANKED[::-1])}, with +CLOSURE=OPTION for each closure changed (the first two know cor alone):
release (zero_force, zero_displacement), normal (momentum, total, inner), offset (contact, grip), spin (mean, shell),
inertia (tied, table), torsion (matched, free, rigid), cor (line, saturating, mean, measured).

Results go to fits/<table>/compare/ below the current folder unless --out names another. Exit code 1 if a posterior
did not converge.""",
)  # fmt: skip


def run_batch(args: argparse.Namespace) -> int:
    """Fit what is not fitted yet, write the files of all, print what was found."""
    args.progress("loading", None)
    from fitball.batch.many import FOLDER, batch_of, plan_of
    from fitball.inference.results.results import RunStatus
    from fitball.report.batch.rows import FAILED

    folder = Path(args.out) if args.out else FOLDER
    plan = plan_of(folder, args.model, args.all_files, args.overwrite, **fitting_of(args))
    try:
        batch = batch_of(args.data, plan, args.cores, args.scheduler, telling(args), args.command)
    except KeyboardInterrupt:
        args.progress.finish()
        print(f"Interrupted. Finished tables are kept in {folder}; the same line goes on.", file=sys.stderr)
        return 130
    args.progress.finish()
    show(str(folder) if args.quiet else batch.report())
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


BATCH = Verb(
    "batch", "fit many tables, each by itself: one table and one page of all, resumable",
    (
        option("data", "DATA", "tables, folders of tables, or patterns in quotes ('courts/*.csv')", nargs="+"),
        *FITTING,
        switch("--all-files", "all files of calibrate for each table, not fit.json alone"),
        switch("--overwrite", "replace results of other data or settings"),
        SCHEDULER,
        option("--out", "DIR", "result folder (default: fits/batch)", type=place),
        FULL,
        switch("--quiet", "no progress, no table: only errors and the folder"),
    ),
    run_batch,
    """examples:
  fitball batch 'courts/*.csv'
  fitball batch 'season/**/*.xlsx' --model grip-slip --out results/season
  fitball batch courts --scheduler tcp://head:8786

Results go to fits/batch/ unless --out names another folder: batch.csv with a row a table, batch.html, and a folder a
table with fit.json (--all-files: all that calibrate writes). The same line goes on after an interruption. Exit code
1 if a table failed or a posterior did not converge.""",
)  # fmt: skip


def run_population(args: argparse.Namespace) -> int:
    """Weight the draws, write the files, print what was found."""
    from fitball.batch.many import FOLDER, load_batch
    from fitball.report.batch.populations import content
    from fitball.report.form.files import json_text

    batch = load_batch(Path(args.folder) if args.folder else FOLDER)
    asked = [name.strip() for name in args.of.split(",") if name.strip()]
    populated = batch.summarise(asked, args.command, args.over)
    if args.json:
        print(json_text(content(populated)), end="")
    else:
        show(batch.report())
    return 1 if any(one.population.doubtful for one in populated) else 0


POPULATION = Verb(
    "population",
    "what the tables of a batch have in common: mean and spread of a parameter, each table given the others",
    (
        option("folder", "FOLDER", "result folder of a batch (default: fits/batch)", nargs="?"),
        option(
            "--of", "A,B,...",
            "further parameters, or ratios of two such as k_theta/k_y, beside those that at least three tables tell",
            default="",
        ),
        option(
            "--over", "LABEL",
            "tables lie on levels: of a label that all rows of a table share (surface, ball, date), or their folder",
        ),
        FULL,
        switch("--json", "print JSON for other programs"),
    ),
    run_population,
    """examples:
  fitball population
  fitball population fits/batch --of mu,cor_10
  fitball population results/season --of k_theta/k_y --json
  fitball population results/season --of mu --over surface

From the draws that `fitball batch` kept of each table, whose priors are divided out; nothing is fitted again. Writes
population.csv, population.json and the page of the batch anew. Exit code 1 if the weights of a table are not to be
trusted: a few tables can be fitted together instead, fitball calibrate TABLES --pool mu=table.""",
)  # fmt: skip


def run_repeat(args: argparse.Namespace) -> int:
    """Run the fit again and print what differs; 0 where nothing does, 1 where the results contradict each other."""
    args.progress("loading", None)
    from fitball.repeat import repeat

    out = None if args.out is None else Path(args.out)
    try:
        found = repeat(Path(args.fit), args.data, args.force, out, args.cores, args.progress)
    except KeyboardInterrupt:
        args.progress.finish()
        print("Interrupted: nothing was compared.", file=sys.stderr)
        return 130
    args.progress.finish()
    if found is None:
        tell_notes(["an older fitball made this fit: nothing was compared"])
        print(args.out)
        return 0
    if not args.quiet:
        tell_notes(found.repetition.notes)
    print_result(args, found, found.repetition.outcome)
    return found.exit_code


REPEAT = Verb(
    "repeat", "run a fit again and say whether the result is the same",
    (
        option(
            "fit", "FIT",
            "a result folder of fitball calibrate, its fit.json or run.toml, or a copy of run.toml beside it",
        ),
        option("--data", "FILE", "where the table is now; repeat for several", action="append", default=[]),
        option("--force", "FILE", "where its force records are now"),
        option("--out", "DIR", "keep the new result in this folder", type=place),
        CORES,
        switch("--json", "print every comparison as JSON"),
        switch("--quiet", "no progress and no table: only the outcome and errors"),
    ),
    run_repeat,
    """examples:
  fitball repeat fits/wang_zero_spin/two-mass
  fitball repeat fits/my_balls/grip-slip --data moved/my_balls.csv
  fitball repeat fits/my_balls/grip-slip/run-seed-2.toml --out fits/my_balls/again""",
    description="""Run a fit again from its run.toml and compare.

The answer is one of three: bit-equal; equal within tolerance (numbers of the posterior differ by no more than their
Monte Carlo errors, the point estimate by no more than its search leaves open); different, with what and by how much.
Exit code 1 when different. The result compared with is never touched.""",
)  # fmt: skip
