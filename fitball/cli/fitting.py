"""The verbs that fit: `calibrate`, `compare`, `batch` and what its tables have in common, `repeat`."""

from __future__ import annotations

import argparse
import shlex
import sys
import time
from collections.abc import Mapping
from itertools import zip_longest
from pathlib import Path
from typing import TYPE_CHECKING

from fitball.cli.options import (
    CORES,
    FORCE,
    FULL,
    MODEL,
    NOISE,
    OVERWRITE,
    OWN,
    READING,
    SAMPLING,
    SCENE,
    SCHEDULER,
    SEED,
    Group,
    Verb,
    either,
    fitting_of,
    option,
    place,
    print_notes,
    print_result,
    switch,
    whole,
)
from fitball.cli.terminal import show, time_left
from fitball.errors import ModelError, ParameterError, ResultFolderError
from fitball.models.specs import RANKED

if TYPE_CHECKING:
    from collections.abc import Callable

    from fitball.batch.many import Going
    from fitball.inference.problem.problem import Problem


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
        raise ParameterError("--resume continues the old run and --overwrite discards it: choose one")
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
            print_notes(_by_weight(problem), args.full)
        if args.resume and not begun.resumes:
            print(f"note: {folder} holds no chain to resume; a new run is started", file=sys.stderr)
        try:
            fit = begun.fit(progress)
            progress("files" if args.no_figures else "figures and files", None)
            write_all(fit, folder, args.command, figures=not args.no_figures)
        except (KeyboardInterrupt, ResultFolderError) as error:
            progress.finish()
            kept = begun.chain is not None and begun.chain.path.exists()
            if isinstance(error, KeyboardInterrupt):
                words = _farewell(folder) if kept else " before sampling; nothing is saved."
                print(f"Interrupted{words}", file=sys.stderr)
                return 130
            raise ResultFolderError(f"{error}\nNot finished{_farewell(folder)}" if kept else str(error)) from None
    progress.finish()
    if args.json:
        print(render_json(fit, folder))
    else:
        show(str(folder) if args.quiet else render(fit, folder))
    return 1 if fit.status is RunStatus.NOT_CONVERGED else 0


def _by_weight(problem: Problem) -> list[object]:
    """Notes before a fit: rows that it leaves out, then one on the fit, one on the table, and so on; what the scene
    leaves open comes last.
    """
    from fitball.data.numbers import IGNORED

    usual, remarks = problem.scene.assumed, problem.table.remarks
    lost = [note for note in remarks if IGNORED in note]
    own = [note for note in problem.notes if note not in usual]
    pairs = zip_longest(own, (note for note in remarks if note not in lost))
    both = [note for pair in pairs for note in pair if note is not None]
    return [*lost, *both, *(note for note in problem.notes if note in usual)]


def default_folder(table: str, model: str, closures: Mapping[str, str]) -> Path:
    """fits/<table>/<model>/, with the closures changed after the model."""
    variant = "".join(f"+{name}={closures[name]}" for name in sorted(closures))
    return Path("fits") / table / (model + variant)


def _farewell(folder: Path) -> str:
    command = [word for word in sys.argv[1:] if word not in ("--resume", "--overwrite")]
    return f". The chain is saved in {folder}; to continue:\n  fitball {shlex.join([*command, '--resume'])}"


TABLE = option("data", "DATA", "a table (CSV, workbook, Parquet), or the name of a bundled one")
CALIBRATE = Verb(
    "calibrate", "fit a model to measured impacts: parameters, uncertainty, verdicts, report",
    (
        option("data", "DATA", TABLE.help, nargs="+"),
        Group("table", (SCENE, FORCE, *READING)),
        MODEL,
        NOISE,
        SAMPLING,
        Group("output", (
            option("--out", "DIR", "result folder (default: fits/<table>/<model>)", type=place),
            switch("--no-figures", "draw no figures, neither as files nor in the report"),
            switch("--resume", "continue an interrupted or unconverged run"),
            OVERWRITE,
            FULL,
            switch("--json", "print the summary as JSON"),
            switch("--quiet", "print errors and the result folder only"),
        )),
    ),
    run_calibrate,
    """examples:
  fitball calibrate wang_zero_spin.csv
  fitball calibrate my_balls.csv --model grip-slip --out results/my_balls
  fitball calibrate wang_all.csv --fix eps_slope=0 --prior "mu=normal(0.6, 0.1)"

Several tables are fitted together, with shared parameters. Models and their assumptions: fitball compare --help.""",
    description="""Fit a model to a table of impacts.

The result folder holds report.html, figures, parameters, draws of the posterior, and run.toml to repeat the fit. Exit
code 1 if the posterior did not converge.""",
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
            print_notes(asked.notes, args.full)
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
        raise ModelError(f"--models {text}: one name is empty; expected names separated by commas")
    return names


COMPARE = Verb(
    "compare", "compare models by how well they predict impacts that were left out",
    (
        TABLE,
        option("--models", "A,B,...", "models to compare, or FILE:NAME (default: all that can differ on this table)"),
        switch("--quick", "compare the main models only, without exact refits of influential impacts"),
        Group("table", (SCENE, *READING)),
        Group("sampling", (
            SEED,
            option("--max-steps", "N", "maximum number of steps of each ensemble (default: 8000)", type=whole),
            option("--cores", "N", "number of processes, one model each (default: all)", type=whole),
            SCHEDULER,
        )),
        Group("output", (
            option("--out", "DIR", "result folder (default: fits/<table>/compare)", type=place),
            OVERWRITE,
            FULL,
            switch("--json", "print compare.json"),
            switch("--quiet", "print errors and the result folder only"),
        )),
    ),
    run_compare,
    f"""examples:
  fitball compare wang_all.csv
  fitball compare my_balls.csv --models brody,grip-slip,two-mass
  fitball compare my_balls.csv --models two-mass,two-mass+torsion=free
  fitball compare wang_zero_spin.csv --quick --json

models:
  {either(RANKED[::-1])}

model assumptions, written as MODEL+NAME=OPTION (brody and grip-slip have cor only):
  release   zero_force, zero_displacement
  normal    momentum, total, inner
  offset    contact, grip
  spin      mean, shell
  inertia   tied, table
  torsion   matched, free, rigid
  cor       line, saturating, mean, measured

Exit code 1 if a posterior did not converge.""",
)  # fmt: skip


def run_batch(args: argparse.Namespace) -> int:
    """Fit all tables that are not fitted yet, write the files of all, print the result."""
    args.progress("loading", None)
    from fitball.batch.many import FOLDER, batch_of, plan_of
    from fitball.inference.results.results import RunStatus
    from fitball.report.batch.rows import FAILED

    folder = Path(args.out) if args.out else FOLDER
    plan = plan_of(folder, args.model, args.all_files, args.overwrite, **fitting_of(args))
    try:
        batch = batch_of(args.data, plan, args.cores, args.scheduler, counting(args), args.command)
    except KeyboardInterrupt:
        args.progress.finish()
        print(f"Interrupted. Finished tables are saved in {folder}; the same command continues.", file=sys.stderr)
        return 130
    args.progress.finish()
    show(str(folder) if args.quiet else batch.report())
    unsure = any(row["status"] == RunStatus.NOT_CONVERGED for row in batch.rows)
    return 1 if unsure or any(row["outcome"] == FAILED for row in batch.rows) else 0


def counting(args: argparse.Namespace) -> Callable[[Going], None]:
    """Progress with the time left, from tables that were fitted in this run."""
    begun = time.monotonic()

    def count(going: Going) -> None:
        words = f"{going.done:,} of {going.total:,} tables"
        words += f", {going.failed:,} failed" if going.failed else ""
        words += time_left(time.monotonic() - begun, going.done - going.kept, going.total - going.done)
        args.progress.count("tables", words)

    return count


BATCH = Verb(
    "batch", "fit many tables separately: one page and one CSV file for all, resumable",
    (
        option("data", "DATA", "tables, folders of tables, or patterns in quotes ('courts/*.csv')", nargs="+"),
        Group("tables", (SCENE, *READING)),
        MODEL,
        NOISE,
        Group("sampling", (*SAMPLING.options, SCHEDULER)),
        Group("output", (
            option("--out", "DIR", "result folder (default: fits/batch)", type=place),
            switch("--all-files", "write all files of calibrate for each table, not fit.json alone"),
            switch("--overwrite", "replace results of other data or settings"),
            FULL,
            switch("--quiet", "print errors and the result folder only"),
        )),
    ),
    run_batch,
    """examples:
  fitball batch 'courts/*.csv'
  fitball batch 'season/**/*.xlsx' --model grip-slip --out results/season
  fitball batch courts --scheduler tcp://head:8786""",
    description="""Fit many tables, each on its own.

The result folder holds batch.html, batch.csv with one row for each table, and a folder with fit.json for each table.
After an interruption, the same command continues. Exit code 1 if a table failed or a posterior did not converge.""",
)  # fmt: skip


def run_population(args: argparse.Namespace) -> int:
    """Weight the draws, write the files, print the result."""
    from fitball.batch.many import FOLDER, load_batch
    from fitball.report.batch.populations import content
    from fitball.report.form.files import json_text

    batch = load_batch(Path(args.folder) if args.folder else FOLDER)
    asked = [name.strip() for name in args.parameters.split(",") if name.strip()]
    populated = batch.summarise(asked, args.command, args.over)
    if args.json:
        print(json_text(content(tuple(populated.values()))), end="")
    else:
        show(populated.report())
    return 1 if populated.doubtful else 0


POPULATION = Verb(
    "population", "mean and spread of parameters over the tables of a batch",
    (
        option("folder", "FOLDER", "result folder of a batch (default: fits/batch)", nargs="?"),
        option(
            "--parameters", "A,B,...",
            "parameters to show, or ratios of two such as k_theta/k_y (default: those that at least three tables "
            "determine)", old="--of", default="",
        ),
        option(
            "--over", "LABEL",
            "group tables by a label that all rows of a table share (surface, ball, date), or by their folder",
        ),
        FULL,
        switch("--json", "print JSON for other programs"),
    ),
    run_population,
    """examples:
  fitball population
  fitball population fits/batch --parameters mu,cor_10
  fitball population results/season --parameters k_theta/k_y --json
  fitball population results/season --parameters mu --over surface""",
    description="""Estimate the mean and spread of parameters over the tables of a batch, and each table's value
given all others.

The draws that fitball batch saved are reweighted, with the priors divided out; nothing is fitted again. The verb
writes population.csv and population.json, and the page of the batch anew. Exit code 1 if importance weights of a
table are unreliable. A few tables can be fitted together instead: fitball calibrate TABLES --pool mu=table.""",
)  # fmt: skip


def run_repeat(args: argparse.Namespace) -> int:
    """Run the fit again and print the differences; 0 where there are none, 1 where the results disagree."""
    args.progress("loading", None)
    from fitball.api import load_fit
    from fitball.repeat import repeat

    out = None if args.out is None else Path(args.out)
    if args.model is not None:
        load_fit(args.fit, args.model)
    try:
        found = repeat(Path(args.fit), args.data, args.force, args.covariance, out, args.cores, args.progress)
    except KeyboardInterrupt:
        args.progress.finish()
        print("Interrupted: nothing was compared.", file=sys.stderr)
        return 130
    args.progress.finish()
    if found is None:
        print_notes(["this fit was made by an older version of fitball; nothing was compared"])
        print(args.out)
        return 0
    if not args.quiet:
        print_notes(found.repetition.notes)
    print_result(args, found, found.repetition.outcome)
    return found.exit_code


REPEAT = Verb(
    "repeat", "run a fit again and check that the result is the same",
    (
        option("fit", "FIT", "a result folder of fitball calibrate, its fit.json, or a run.toml"),
        OWN,
        option(
            "--data", "FILE", "where the table is now (repeatable, for several tables)", action="append", default=[]
        ),
        option("--force-records", "FILE", "where the force records are now", old=FORCE.old, dest="force"),
        option(
            "--covariance", "FILE", "where the covariances are now (repeatable, for several tables)", action="append",
            default=[],
        ),
        CORES,
        option("--out", "DIR", "save the new result in this folder (default: not saved)", type=place),
        switch("--json", "print every comparison as JSON"),
        switch("--quiet", "print errors and the outcome only"),
    ),
    run_repeat,
    """examples:
  fitball repeat fits/wang_zero_spin/two-mass
  fitball repeat fits/my_balls/grip-slip --data moved/my_balls.csv
  fitball repeat fits/my_balls/grip-slip/run-seed-2.toml --out fits/my_balls/again""",
    description="""Run a fit again from its run.toml and compare the results.

There are three outcomes. Bit-equal: all numbers are the same. Equal within tolerance: posteriors differ by less
than their Monte Carlo errors, and best-fit values by less than the accuracy of the search. Different: the numbers
that differ are listed, and the exit code is 1. The old result is never changed.""",
)  # fmt: skip
