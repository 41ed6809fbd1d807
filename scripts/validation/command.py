"""`scripts/validate`: does the calibration find what was put in? Simulation-based calibration, and its verdict;
with `--trust`, whether what fits say of themselves is true; with `--population`, whether populations over many tables
are found.

Not a verb: it takes a quarter of an hour and checks the program, not a table. It is run as a module.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Iterable, Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Any

from fitball.cli.options import SCHEDULER, place, whole
from fitball.cli.terminal import ProgressLine, time_left, visible_streams
from fitball.errors import FitballError, ParameterError, suggestion
from fitball.scheduling.engine import Engine, engine
from fitball.wording import speaking_to_command_line

if TYPE_CHECKING:
    from validation.sbc.summary import ModelFinding

DEFAULT_FOLDER = Path("fits") / "validation"
MODELS = "two-mass,grip-slip"


class Counter:
    """Tells on a progress line how many of a `total` are done, and the time left, from those done since the first
    look.
    """

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
        description="Draw parameters from what is known before a table, simulate tables at Wang's incident "
        "conditions, fit them, and test whether the truth ranks uniformly among posterior draws (Talts et al. 2018). "
        "Exit code 1 if it does not. An interrupted run goes on where it stopped.",
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
    parser.add_argument("--scenarios", metavar="A,B", help="of --trust: kinds of tables (default: all)")
    parser.add_argument(
        "--replicates",
        type=whole,
        metavar="N",
        help="tables a model (default 300), a kind of them (default 60) or a plan (default 40); populations (50)",
    )
    parser.add_argument("--models", default=MODELS, metavar="A,B", help=f"models (default {MODELS})")
    parser.add_argument("--table", default="wang_all.csv", metavar="DATA", help="whose incident conditions to use")
    parser.add_argument("--seed", type=whole, default=1, metavar="N", help="seed of all random numbers (default 1)")
    parser.add_argument("--cores", type=whole, metavar="N", help="processes (default: all cores)")
    parser.add_argument(SCHEDULER.flag, help=SCHEDULER.help, **SCHEDULER.more)
    parser.add_argument("--out", type=place, metavar="DIR", help=f"where to write (default {DEFAULT_FOLDER})")
    parser.add_argument(
        "--wrong-sigma", type=float, metavar="F", help="tell the fit F times the true noise: a control that must fail"
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
            return _plan(args) if args.plan else _trust(args) if args.trust else _run(args)
    except FitballError as error:
        print(f"fitball: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("\nfitball: interrupted; what was done is kept: the same command goes on", file=sys.stderr)
        return 130


def _run(args: argparse.Namespace) -> int:
    """Rank truths among draws; 1 where they do not rank uniformly."""
    models = _checked(args, 300)
    from fitball.report.figures.canvas import save_figure
    from validation.sbc.figure import rank_figure
    from validation.sbc.replicate import BounceExperiment
    from validation.sbc.run import run_replicates
    from validation.sbc.summary import summarise, summary_json, summary_rows

    folder, workers = _place_and_workers(args, "")
    ranked_by_model = {}
    for model in models:
        experiment = BounceExperiment(args.table, model, args.wrong_sigma)
        place, counter = folder / f"ranks_{model}.csv", Counter(args.line, model, args.replicates)
        ranked = run_replicates(experiment, args.seed, args.replicates, place, workers, counter)
        ranked_by_model[model] = (experiment.names, ranked)
    findings = summarise(ranked_by_model)
    for finding in findings:
        if finding.quantities:
            save_figure(rank_figure(finding), folder / f"ranks_{finding.model}.png")
    rows = summary_rows(findings)
    tables = {"summary": rows} if rows else {}
    return _end(args, folder / "summary.json", summary_json(findings, args.seed), tables, render(findings))


def _trust(args: argparse.Namespace) -> int:
    """Fit simulated tables and count; 1 where what fits say of themselves is not true."""
    _checked(args, 60)
    from fitball.report.form.files import write_text
    from validation.trust.findings import findings, findings_json, findings_text, rate_rows
    from validation.trust.run import run_scenario
    from validation.trust.scenarios import SCENARIOS

    folder, workers = _place_and_workers(args, "trust")
    told = {}
    for name in _named("scenarios", args.scenarios, SCENARIOS):
        counter = Counter(args.line, name, args.replicates, "tables")
        told[name] = run_scenario(name, args.seed, args.replicates, folder / f"{name}.csv", workers, counter)
    found = findings(told)
    text = findings_text(found)
    write_text(folder / "trust.md", text)
    return _end(args, folder / "trust.json", findings_json(found, args.seed), {"rates": rate_rows(found)}, text)


def _plan(args: argparse.Namespace) -> int:
    """Refit tables at planned impacts; 1 where a promise is not kept."""
    _checked(args, 40)
    from fitball.report.form.files import write_text
    from validation.plan.cases import CASES
    from validation.plan.findings import findings_json, findings_text, gain_rows, sd_rows
    from validation.plan.run import run_case

    folder, workers = _place_and_workers(args, "plan")
    found = []
    for name in _named("cases", args.cases, CASES):
        counter = Counter(args.line, name, args.replicates, "refits")
        found.append(run_case(name, args.seed, args.replicates, folder / f"{name}.csv", workers, counter))
    text = findings_text(found)
    write_text(folder / "plan.md", f"```text\n{text}```\n")
    tables = {"gains": gain_rows(found), "sds": sd_rows(found)}
    return _end(args, folder / "plan.json", findings_json(found, args.seed), tables, text)


def _population(args: argparse.Namespace) -> int:
    """Fit tables of known populations, weight their draws, and count; 1 where intervals do not hold."""
    _checked(args, 50)
    from fitball.report.form.document import columns
    from validation.population.coverage import run_populations
    from validation.population.findings import (
        Coverage,
        coverages,
        findings_json,
        findings_text,
        level_coverages,
    )
    from validation.population.joint import against_joint_fit
    from validation.population.levels import run_levels

    folder, workers = _place_and_workers(args, "population")
    sets = max(1, args.replicates // 10)
    joint = against_joint_fit(args.seed, sets, Counter(args.line, "joint fits", sets, "sets of ten tables"))
    counter = Counter(args.line, "populations", args.replicates, "populations")
    rows = run_populations(args.seed, args.replicates, folder / "populations.csv", workers, counter)
    few = -(-4 * args.replicates // 5)
    counter = Counter(args.line, "levels", few, "populations on levels")
    levels = run_levels(args.seed, few, folder / "levels.csv", workers, counter)
    found = [*coverages(rows), *level_coverages(levels)]
    text = "\n".join(columns(findings_text(found), 3)) + "\n"
    tables = {"joint": joint, "coverage": map(Coverage.row, found)}
    return _end(args, folder / "population.json", findings_json(rows, joint, levels, args.seed), tables, text)


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


def _end(
    args: argparse.Namespace,
    record: Path,
    content: Mapping[str, object],
    tables: Mapping[str, Iterable[Mapping[str, Any]]],
    text: str,
) -> int:
    """Write the `tables` beside the `record`, print its content or the `text`; 0 where all holds."""
    from fitball.report.form.files import csv_text, write_text

    for name, rows in tables.items():
        write_text(record.with_name(f"{name}.csv"), csv_text(rows))
    whole = json.dumps(content, indent=1)
    write_text(record, whole + "\n")
    args.line.finish()
    print(whole if args.json else f"{text}\nResults: {record.parent}")
    return 0 if content["holds"] else 1


def _checked(args: argparse.Namespace, replicates: int) -> tuple[str, ...]:
    """The models; so many `replicates` unless told otherwise. Raises ParameterError for numbers that cannot work."""
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


def render(findings: Sequence[ModelFinding]) -> str:
    """The verdict as a person reads it."""
    from fitball.report.form.document import columns

    parts = []
    for finding in findings:
        head = (
            f"{finding.model}: {finding.replicates} replicates, {finding.unconverged} not converged, "
            f"{finding.failed} without a fit"
        )
        rows = [["quantity", "p chi-square", "p ecdf", "adjusted p", "in 50 %", "in 80 %", "in 95 %", ""]]
        for quantity in finding.quantities:
            shares = [f"{100 * c.observed:.0f} [{100 * c.low:.0f}, {100 * c.high:.0f}]" for c in quantity.coverages]
            adjusted = min(quantity.chi_square_adjusted, quantity.ecdf_adjusted)
            words = [f"{quantity.chi_square_p:.2g}", f"{quantity.ecdf_p:.2g}", f"{adjusted:.2g}"]
            rows.append([quantity.name, *words, *shares, "holds" if quantity.holds else "FAILS"])
        parts += [head, "", *columns(rows), ""]
        parts += [f"FAILS: {text}" for text in finding.complaints]
    good = not any(finding.complaints for finding in findings)
    verdict = "The truth ranks uniformly: intervals mean what they say." if good else "Validation FAILED."
    return "\n".join([*parts, verdict])


if __name__ == "__main__":
    sys.exit(main())
