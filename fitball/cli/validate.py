"""`scripts/validate`: does the calibration find what was put in? Simulation-based calibration, and its verdict;
with `--trust`, whether what fits say of themselves is true; with `--population`, whether populations over many tables
are found.

Not a verb: it takes a quarter of an hour and checks the program, not a table. It is run as a module.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, TextIO

from fitball.cli.options import add_scheduler, whole
from fitball.cli.visible_stream import own_stream, visible_streams
from fitball.errors import FitballError, ParameterError, suggestion
from fitball.scheduling.engine import engine
from fitball.wording import speaking_to_command_line

if TYPE_CHECKING:
    from fitball.studies.sbc.summary import ModelFinding

DEFAULT_FOLDER = Path("fits") / "validation"
MODELS = "two-mass,grip-slip"
BAR = 24


class Counter:
    """Replicates done and time left on stderr: a bar on a terminal, a line every tenth elsewhere."""

    def __init__(
        self, title: str, total: int, quiet: bool, unit: str = "replicates", stream: TextIO | None = None
    ) -> None:
        self.title, self.total, self.quiet, self.unit = title, total, quiet, unit
        self.stream = own_stream(sys.stderr) if stream is None else stream
        self.first: int | None = None
        self.begun = time.monotonic()
        self.told = -1

    def __call__(self, done: int) -> None:
        """Show that so many are done."""
        if self.quiet:
            return
        if self.first is None:
            self.first, self.begun = done, time.monotonic()
        made = done - self.first
        left = ""
        if made and done < self.total:
            seconds = (time.monotonic() - self.begun) / made * (self.total - done)
            left = f", {seconds / 60:.0f} min left" if seconds >= 90 else f", {seconds:.0f} s left"
        text = f"{self.title}: {done} of {self.total} {self.unit}{left}"
        if self.stream.isatty():
            filled = BAR * done // self.total
            self.stream.write(f"\r[{'#' * filled}{'.' * (BAR - filled)}] {text.ljust(70)}")
            self.stream.write("\n" if done >= self.total else "")
        elif 10 * done // self.total != self.told or done >= self.total:
            self.stream.write(text + "\n")
        self.told = 10 * done // self.total
        self.stream.flush()


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
        help="instead: populations of 20 tables each with known centre and spread: how often do intervals hold them, "
        "and do joint fits of ten tables say the same",
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
    add_scheduler(parser)
    parser.add_argument("--out", metavar="DIR", help=f"where to write (default {DEFAULT_FOLDER})")
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
        with visible_streams(), speaking_to_command_line():
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
    models = _checked(args, 300)
    from fitball.report.figures.save import save_figure
    from fitball.report.form.atomic_write import write_text
    from fitball.report.form.csv import csv_text
    from fitball.studies.sbc.figure import rank_figure
    from fitball.studies.sbc.replicate import BounceExperiment
    from fitball.studies.sbc.run import run_replicates
    from fitball.studies.sbc.summary import summarise, summary_json, summary_rows

    folder = Path(args.out) if args.out else DEFAULT_FOLDER
    workers = engine(args.cores, args.scheduler)
    ranked_by_model = {}
    for model in models:
        experiment = BounceExperiment(args.table, model, args.wrong_sigma)
        counter = Counter(model, args.replicates, args.quiet)
        place = folder / f"ranks_{model}.csv"
        ranked = run_replicates(experiment, args.seed, args.replicates, place, workers, counter)
        ranked_by_model[model] = (experiment.names, ranked)
    findings = summarise(ranked_by_model)
    content = summary_json(findings, args.seed)
    for finding in findings:
        if finding.quantities:
            figure = rank_figure(finding)
            save_figure(figure, folder / f"ranks_{finding.model}.png")
    rows = summary_rows(findings)
    if rows:
        write_text(folder / "summary.csv", csv_text(rows))
    write_text(folder / "summary.json", json.dumps(content, indent=1) + "\n")
    print(json.dumps(content, indent=1) if args.json else render(findings, folder))
    return 0 if content["holds"] else 1


def _trust(args: argparse.Namespace) -> int:
    """Fit simulated tables and count; 1 where what fits say of themselves is not true."""
    _checked(args, 60)
    from fitball.report.form.atomic_write import write_text
    from fitball.report.form.csv import csv_text
    from fitball.studies.trust.findings import findings, findings_json, findings_text, rate_rows
    from fitball.studies.trust.run import run_scenario
    from fitball.studies.trust.scenarios import SCENARIOS

    names = list(SCENARIOS) if args.scenarios is None else [name.strip() for name in args.scenarios.split(",")]
    for name in names:
        if name not in SCENARIOS:
            raise ParameterError(
                f"--scenarios {args.scenarios}: unknown scenario '{name}': {suggestion(name, SCENARIOS)}"
            )
    folder = Path(args.out) if args.out else DEFAULT_FOLDER / "trust"
    workers = engine(args.cores, args.scheduler)
    told = {}
    for name in dict.fromkeys(names):
        counter = Counter(name, args.replicates, args.quiet, "tables")
        told[name] = run_scenario(name, args.seed, args.replicates, folder / f"{name}.csv", workers, counter)
    found = findings(told)
    content = findings_json(found, args.seed)
    write_text(folder / "rates.csv", csv_text(rate_rows(found)))
    write_text(folder / "trust.json", json.dumps(content, indent=1) + "\n")
    write_text(folder / "trust.md", findings_text(found))
    print(json.dumps(content, indent=1) if args.json else findings_text(found) + f"\nResults: {folder}")
    return 0 if content["holds"] else 1


def _plan(args: argparse.Namespace) -> int:
    """Refit tables at planned impacts; 1 where a promise is not kept."""
    _checked(args, 40)
    from fitball.report.form.atomic_write import write_text
    from fitball.report.form.csv import csv_text
    from fitball.studies.plan.cases import CASES
    from fitball.studies.plan.findings import findings_json, findings_text, gain_rows, sd_rows
    from fitball.studies.plan.run import run_case

    names = list(CASES) if args.cases is None else [name.strip() for name in args.cases.split(",")]
    for name in names:
        if name not in CASES:
            raise ParameterError(f"--cases {args.cases}: unknown case '{name}': {suggestion(name, CASES)}")
    folder = Path(args.out) if args.out else DEFAULT_FOLDER / "plan"
    workers = engine(args.cores, args.scheduler)
    found = []
    for name in dict.fromkeys(names):
        counter = Counter(name, args.replicates, args.quiet, "refits")
        found.append(run_case(name, args.seed, args.replicates, folder / f"{name}.csv", workers, counter))
    content = findings_json(found, args.seed)
    write_text(folder / "gains.csv", csv_text(gain_rows(found)))
    write_text(folder / "sds.csv", csv_text(sd_rows(found)))
    write_text(folder / "plan.json", json.dumps(content, indent=1) + "\n")
    write_text(folder / "plan.md", "```text\n" + findings_text(found) + "```\n")
    print(json.dumps(content, indent=1) if args.json else findings_text(found) + f"\nResults: {folder}")
    return 0 if content["holds"] else 1


def _population(args: argparse.Namespace) -> int:
    """Fit tables of known populations, weight their draws, and count; 1 where intervals do not hold."""
    _checked(args, 50)
    from fitball.report.form.atomic_write import write_text
    from fitball.report.form.csv import csv_text
    from fitball.report.form.text_table import columns
    from fitball.studies.population.coverage import run_populations
    from fitball.studies.population.findings import coverages, findings_json, findings_text
    from fitball.studies.population.joint import against_joint_fit

    folder = Path(args.out) if args.out else DEFAULT_FOLDER / "population"
    workers = engine(args.cores, args.scheduler)
    sets = max(1, args.replicates // 10)
    joint = against_joint_fit(args.seed, sets, Counter("joint fits", sets, args.quiet, "sets of ten tables"))
    counter = Counter("populations", args.replicates, args.quiet, "populations")
    rows = run_populations(args.seed, args.replicates, folder / "populations.csv", workers, counter)
    content = findings_json(rows, joint, args.seed)
    write_text(folder / "joint.csv", csv_text(joint))
    found = coverages(rows)
    write_text(folder / "coverage.csv", csv_text(one.row() for one in found))
    write_text(folder / "population.json", json.dumps(content, indent=1) + "\n")
    if args.json:
        print(json.dumps(content, indent=1))
    else:
        print("\n".join([*columns(findings_text(found), 3), "", f"Results: {folder}"]))
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


def render(findings: Sequence[ModelFinding], folder: Path) -> str:
    """The verdict as a person reads it."""
    from fitball.report.form.text_table import columns

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
    return "\n".join([*parts, verdict, f"Results: {folder}"])


if __name__ == "__main__":
    sys.exit(main())
