"""`fitball rederive`: Chapter V and Appendices C and D of the thesis, regenerated and judged."""

from __future__ import annotations

import argparse
import json
from pathlib import Path

from fitball.cli.options import add_study, stages, whole

DEFAULT_FOLDER = Path("fits") / "chapter_five"


HELP = "Chapter V and Appendices C and D of Jafri (2004) from their tables"
DESCRIPTION = """Recompute the printed tables of Jafri (2004), judge its three best cases against Wang's measurements,
and write a page. Exit code 1 if a comparison with print no longer gives the counts and numbers that it gave when a
person last looked."""
EXAMPLE = "example:\n  fitball rederive\n  fitball rederive --out judged --json\n"


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add what the verb may be asked."""
    parser.add_argument("--seed", type=whole, default=1, help="seed of fits and resampling (default: 1)")
    add_study(parser, DEFAULT_FOLDER)


def run(args: argparse.Namespace) -> int:
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
    folder = Path(args.out) if args.out else DEFAULT_FOLDER
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
