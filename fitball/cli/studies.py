"""The verbs that examine fitball itself: `rederive` and `bench`."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from fitball.cli.options import Option, Verb, option, stages, study, switch, whole

if TYPE_CHECKING:
    from fitball.bench.clock import Pace


CHAPTER = Path("fits") / "chapter_five"


def run_rederive(args: argparse.Namespace) -> int:
    """Compute the tables again, write the page, print what holds; 1 where a count has changed."""
    from fitball.errors import check_whole
    from fitball.inference.effort import Effort
    from fitball.report.form.document import columns
    from fitball.report.form.folders import held
    from fitball.thesis.chapter_five import derive
    from fitball.thesis.page import write
    from fitball.thesis.ranking import in_brief, side_by_side

    check_whole(seed=args.seed)
    report = stages(args.quiet)
    folder = Path(args.out) if args.out else CHAPTER
    with held(folder):
        chapter = derive(Effort(seed=args.seed, cores=args.cores), report)
        report("figures and page")
        write(chapter, folder)
    if args.json:
        content = {
            "holds": chapter.holds,
            "summary": chapter.summary,
            "checks": [
                {"name": check.name, "holds": check.holds, "finding": check.finding} for check in chapter.checks
            ],
            "verdicts": dict(chapter.verdicts),
            "rankings": side_by_side(chapter.rankings).to_dict("records"),
            "folder": str(folder),
        }
        print(json.dumps(content, indent=2, ensure_ascii=False))
    else:
        for check in chapter.checks:
            print(f"[{'as pinned' if check.holds else 'CHANGED'}] {check.name}: {check.finding}")
        for name, verdict in chapter.verdicts.items():
            print(f"{name}: {verdict}")
        brief = in_brief(chapter.rankings)
        print("Score of each set (share of resamples in which it is first):")
        print("\n".join(columns([list(brief.columns), *brief.to_numpy().tolist()])))
        print(chapter.summary)
        print(f"Results: {folder / 'report.html'}")
    return 0 if chapter.holds else 1


REDERIVE = Verb(
    "rederive", "Chapter V and Appendices C and D of Jafri (2004) from their tables",
    (
        Option("--seed", "seed of fits and resampling (default: 1)", {"type": whole, "default": 1}),
        *study(CHAPTER),
    ),
    run_rederive,
    "example:\n  fitball rederive\n  fitball rederive --out judged --json\n",
    description="""Recompute the printed tables of Jafri (2004), judge its three best cases against Wang's
measurements, and write a page. Exit code 1 if a comparison with print no longer gives the counts and
numbers that it gave when a person last looked.""",
)  # fmt: skip


BENCH_FOLDER = Path("fits") / "bench"


def run_bench(args: argparse.Namespace) -> int:
    """Measure, write the folder, print the summary; or compare ratios."""
    from fitball.bench.measure import FULL, QUICK, measure, summary, write
    from fitball.report.form.folders import held

    extent = QUICK if args.quick else FULL
    if args.check is not None:
        return _check(args, extent.pace)
    folder = Path(args.out) if args.out else BENCH_FOLDER
    with held(folder):
        bench = measure(extent, args.cores, stages(args.quiet))
        write(bench, folder)
    if args.json:
        frames = {name: json.loads(frame.to_json(orient="records")) for name, frame in bench.frames.items()}
        print(json.dumps({"machine": bench.machine, **frames}, indent=2))
    else:
        print("\n".join(summary(bench)))
        print(f"Results: {folder}")
    return 0


def _check(args: argparse.Namespace, pace: Pace) -> int:
    """Compare ratios with those kept; 1 when something has become slower."""
    from fitball.bench import measure

    kept = measure.read_ratios(args.check)
    compared = measure.compared(kept, measure.ratios(pace))
    if (compared["times"] > measure.TOLERATED).any():
        # What other programs on the machine took is not taken twice.
        compared = measure.least(compared, measure.compared(kept, measure.ratios(pace)))
    lines, good = measure.verdict(compared)
    print(compared.to_json(orient="records", indent=2) if args.json else "\n".join(lines))
    if not good and args.json:
        print("\n".join(lines), file=sys.stderr)
    return 0 if good else 1


BENCH = Verb(
    "bench", "speed against error, and where time goes",
    (
        switch("--quick", "a minute or two instead of ten"),
        option(
            "--check", "FILE",
            f"measure ratios only and compare them with kept ones (default: {BENCH_FOLDER / 'ratios.csv'}); exit "
            "code 1 when something has become 1.5 times slower", nargs="?", const=BENCH_FOLDER / "ratios.csv",
            type=Path,
        ),
        *study(BENCH_FOLDER),
    ),
    run_bench,
    "examples:\n  fitball bench --quick\n  fitball bench --check\n",
    description="""Measure CPU time per impact and per log posterior against error, beside careless and careful
integrators. Writes CSV files, a figure and a summary. Effective draws beside other samplers, many tables and whole
runs are measured by scripts/benchmark of the source tree.""",
)  # fmt: skip
