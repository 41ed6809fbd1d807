"""`scripts/validate`: does the calibration find what was put in? Simulation-based calibration, and its verdict;
with `--trust`, whether what fits say of themselves is true; with `--population`, whether populations over many tables
are found; with `--few`, whether intervals from few levels hold and stay narrow; with `--gaps`, whether the gaps
between two flights determine the stiffnesses; with `--tracks`, whether positions on film give impacts and errors.

Not a verb: it takes a quarter of an hour and checks the program, not a table. It is run as a module.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Iterable, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING

from fitball.cli.options import SCHEDULER, place, whole
from fitball.cli.terminal import ProgressLine, time_left, visible_streams
from fitball.errors import FitballError, ParameterError, suggestion
from fitball.scheduling.engine import Engine, engine
from fitball.wording import speaking_to_command_line

if TYPE_CHECKING:
    from validation.harness import Row, Study, Verdict

DEFAULT_FOLDER = Path("fits") / "validation"
MODELS = "two-mass,grip-slip"


class Counter:
    """Shows on a progress line how many of a `total` are done, and the time left."""

    def __init__(self, line: ProgressLine, title: str, total: int, unit: str = "replicates") -> None:
        self.line, self.title, self.total, self.unit = line, title, total, unit
        self.first: int | None = None

    def __call__(self, done: int) -> None:
        """Show that so many are done."""
        if self.first is None:
            self.first, self.begun = done, self.line.clock()
        left = time_left(self.line.clock() - self.begun, done - self.first, self.total - done)
        words = f"{self.title}: {done} of {self.total} {self.unit}{left}"
        self.line.count(self.title, words, due=done >= self.total)


def make_parser() -> argparse.ArgumentParser:
    """The command line."""
    parser = argparse.ArgumentParser(
        prog="scripts/validate",
        description="Draw parameters from the prior, simulate tables at Wang's incident conditions, fit them, and "
        "test whether the truth ranks uniformly among posterior draws (Talts et al. 2018). "
        "Exit code 1 if it does not. An interrupted run continues where it stopped.",
        epilog="examples:\n  scripts/validate\n  scripts/validate --models grip-slip --replicates 60 --out check\n"
        "  scripts/validate --models grip-slip --replicates 60 --wrong-sigma 0.5 --out wrong    (must fail)\n"
        "  scripts/validate --trust --scenarios wang,negated --replicates 20\n"
        "  scripts/validate --population --replicates 5",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument(
        "--trust",
        action="store_true",
        help="instead: fit tables that the model made and tables that it did not, and count how often the fit "
        "describes them, and how often what it calls identified holds the truth",
    )
    parser.add_argument(
        "--plan",
        action="store_true",
        help="instead: simulate tables at impacts that fitball plan recommends, refit, and compare with its promises",
    )
    parser.add_argument("--cases", metavar="A,B", help="of --plan: which plans (default: all)")
    parser.add_argument(
        "--population",
        action="store_true",
        help="instead: populations of 20 tables each with known centre and spread, and of 3 levels of 4 tables: how "
        "often do intervals hold them, and do joint fits of ten tables say the same",
    )
    parser.add_argument(
        "--few",
        action="store_true",
        help="instead: labs with two to six balls or places, and tables of two surfaces: how often do intervals hold "
        "the truth, and how wide are they",
    )
    parser.add_argument(
        "--gaps",
        action="store_true",
        help="instead: films with gaps between the flights, whose errors belong together: how often do intervals "
        "hold the truth, and do fits of wrong films miss it by as much as predicted",
    )
    parser.add_argument(
        "--tracks",
        action="store_true",
        help="instead: positions of balls on film: how often do intervals of impacts, and of parameters fitted to "
        "them, hold the truth",
    )
    parser.add_argument("--scenarios", metavar="A,B", help="of --trust: kinds of tables (default: all)")
    parser.add_argument(
        "--replicates",
        type=whole,
        metavar="N",
        help="tables a model (default 300), a kind of them (default 60) or a plan (default 40); populations (50); "
        "labs, and tables of two surfaces (400); films (400); films of tracks (1120)",
    )
    parser.add_argument("--models", default=MODELS, metavar="A,B", help=f"models (default {MODELS})")
    parser.add_argument("--table", default="wang_all.csv", metavar="DATA", help="whose incident conditions to use")
    parser.add_argument("--seed", type=whole, default=1, metavar="N", help="seed of all random numbers (default 1)")
    parser.add_argument("--cores", type=whole, metavar="N", help="processes (default: all cores)")
    parser.add_argument(SCHEDULER.flag, help=SCHEDULER.help, **SCHEDULER.more)
    parser.add_argument("--out", type=place, metavar="DIR", help=f"where to write (default {DEFAULT_FOLDER})")
    parser.add_argument(
        "--wrong-sigma",
        type=float,
        metavar="F",
        help="assume F times the true noise in the fit: a control that must fail",
    )
    parser.add_argument("--json", action="store_true", help="print the verdict as JSON")
    parser.add_argument("--quiet", action="store_true", help="no progress")
    return parser


def main(argv: Sequence[str] | None = None) -> int:
    """Draw, fit and rank, or count; 1 where something does not hold."""
    args = make_parser().parse_args(argv)
    try:
        with visible_streams(), speaking_to_command_line(), ExitStack() as args.stack:
            args.line = ProgressLine(args.quiet)
            if args.population:
                return _population(args)
            if args.few:
                return _few(args)
            if args.gaps:
                return _gaps(args)
            if args.tracks:
                return _tracks(args)
            return _plan(args) if args.plan else _trust(args) if args.trust else _ranks(args)
    except FitballError as error:
        print(f"fitball: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("\nfitball: interrupted; what was done is kept: the same command goes on", file=sys.stderr)
        return 130


def _ranks(args: argparse.Namespace) -> int:
    """Rank truths among draws; 1 where they do not rank uniformly."""
    models = _checked(args, 300)
    from validation.ranks import Bounces, judge

    folder, workers = _place_and_workers(args, "")
    made = {}
    for model in models:
        study = Bounces(args.table, model, args.wrong_sigma).study
        made[model] = [row for rows in _made(args, study, folder, workers) for row in rows]
    return _end(args, folder / "summary.json", judge(made, args.seed))


def _trust(args: argparse.Namespace) -> int:
    """Fit simulated tables and count; 1 where what fits say of themselves is not true."""
    _checked(args, 60)
    from fitball.report.form.files import write_text
    from validation.scenarios import SCENARIOS
    from validation.trust import judge, study

    folder, workers = _place_and_workers(args, "trust")
    told = {}
    for name in _named("scenarios", args.scenarios, SCENARIOS):
        told[name] = [row for rows in _made(args, study(name), folder, workers) for row in rows]
    found = judge(told, args.seed)
    write_text(folder / "trust.md", found.text)
    return _end(args, folder / "trust.json", found)


def _plan(args: argparse.Namespace) -> int:
    """Refit tables at planned impacts; 1 where a promise is not kept."""
    _checked(args, 40)
    from fitball.report.form.files import write_text
    from validation import plans

    folder, workers = _place_and_workers(args, "plan")
    found = []
    for name in _named("cases", args.cases, plans.CASES):
        ready = plans.prepared(name, args.seed)
        made = _made(args, plans.study(ready, args.seed), folder, workers)
        found.append(plans.finding(ready, [row for rows in made for row in rows]))
    verdict = plans.judge(found, args.seed)
    write_text(folder / "plan.md", f"```text\n{verdict.text}```\n")
    return _end(args, folder / "plan.json", verdict)


def _population(args: argparse.Namespace) -> int:
    """Fit tables of known populations, weight their draws, and count; 1 where intervals do not hold."""
    _checked(args, 50)
    from validation.populations import judge, studies

    folder, workers = _place_and_workers(args, "population")
    counts = (args.replicates, -(-4 * args.replicates // 5), max(1, args.replicates // 10))
    both = zip(studies(), counts, strict=True)
    made = {study.name: _made(args, study, folder, workers, count) for study, count in both}
    return _end(args, folder / "population.json", judge(made, args.seed))


def _few(args: argparse.Namespace) -> int:
    """Measure few balls, places and surfaces, and count; 1 where intervals do not hold."""
    _checked(args, 400)
    from fitball.report.form.files import write_text
    from validation.few_levels import judge, studies

    folder, workers = _place_and_workers(args, "few")
    made = {study.name: _made(args, study, folder, workers) for study in studies()}
    found = judge(made, args.seed)
    write_text(folder / "few.md", f"```text\n{found.text}```\n")
    return _end(args, folder / "few.json", found)


def _gaps(args: argparse.Namespace) -> int:
    """Film impacts with gaps, fit, and count; 1 where intervals do not hold, or where a control does."""
    _checked(args, 400)
    from fitball.report.form.files import write_text
    from validation.gaps import judge, study

    folder, workers = _place_and_workers(args, "gaps")
    found = judge(_made(args, study(), folder, workers), args.seed)
    write_text(folder / "gaps.md", f"```text\n{found.text}```\n")
    return _end(args, folder / "gaps.json", found)


def _tracks(args: argparse.Namespace) -> int:
    """Film impacts, track and fit them, and count; 1 where intervals do not hold, or where a control does."""
    _checked(args, 1120)
    from fitball.report.form.files import write_text
    from validation.tracks import judge, study

    folder, workers = _place_and_workers(args, "tracks")
    found = judge(_made(args, study(), folder, workers), args.seed)
    write_text(folder / "tracks.md", f"```text\n{found.text}```\n")
    return _end(args, folder / "tracks.json", found)


def _made(
    args: argparse.Namespace, study: Study, folder: Path, workers: Engine, count: int | None = None
) -> list[list[Row]]:
    """The records of the replicates of a study, with a progress line."""
    from validation.harness import run

    count = args.replicates if count is None else count
    counter = Counter(args.line, study.title, count, study.unit)
    return run(study, args.seed, count, folder, workers, counter)


def _place_and_workers(args: argparse.Namespace, study: str) -> tuple[Path, Engine]:
    """Where to write, held until the end, and who computes."""
    from fitball.report.form.folders import held

    folder, workers = Path(args.out) if args.out else DEFAULT_FOLDER / study, engine(args.cores, args.scheduler)
    args.stack.enter_context(held(folder))
    return folder, workers


def _named(option: str, text: str | None, known: Iterable[str]) -> list[str]:
    """Those of the `known` names that an option lists, without it all. Raises ParameterError for others."""
    names = list(known) if text is None else [name.strip() for name in text.split(",")]
    for name in names:
        if name not in known:
            raise ParameterError(f"--{option} {text}: unknown {option[:-1]} '{name}': {suggestion(name, known)}")
    return list(dict.fromkeys(names))


def _end(args: argparse.Namespace, record: Path, found: Verdict) -> int:
    """Write tables and figures beside the `record`, print what it holds or the text; 0 where all holds."""
    from fitball.report.figures.canvas import save_figure
    from fitball.report.form.files import csv_text, write_text

    for name, rows in found.tables.items():
        if rows:
            write_text(record.with_name(f"{name}.csv"), csv_text(rows))
    for name, figure in found.figures.items():
        save_figure(figure, record.with_name(f"{name}.png"))
    whole = json.dumps(found.content, indent=1)
    write_text(record, whole + "\n")
    args.line.finish()
    print(whole if args.json else f"{found.text}\nResults: {record.parent}")
    return 0 if found.content["holds"] else 1


def _checked(args: argparse.Namespace, replicates: int) -> tuple[str, ...]:
    """The models; `replicates` is the default number of replicates. Raises ParameterError for numbers that cannot
    work.
    """
    args.replicates = replicates if args.replicates is None else args.replicates
    for name, least in (("replicates", 1), ("seed", 0)):
        if getattr(args, name) < least:
            raise ParameterError(f"{name} = {getattr(args, name)}: expected at least {least}")
    if args.wrong_sigma is not None and not 0.0 < args.wrong_sigma < float("inf"):
        raise ParameterError(f"wrong_sigma = {args.wrong_sigma}: expected a positive number")
    models = tuple(dict.fromkeys(name.strip() for name in args.models.split(",") if name.strip()))
    if not models:
        raise ParameterError("models: expected at least one name")
    return models


if __name__ == "__main__":
    sys.exit(main())
