"""`fitball population FOLDER`: centre and spread of quantities over the tables of a batch."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from fitball.cli.options import add_cores, count

HELP = "what the tables of a batch have in common: mean and spread of a parameter, each table given the others"
EXAMPLE = """examples:
  fitball population
  fitball population fits/batch --of mu,cor_10
  fitball population results/season --of k_theta/k_y --json
  fitball population results/season --of mu --over surface
  fitball population results/season --of mu,cor_10 --joint

From the draws that `fitball batch` kept of each table, whose priors are divided out; nothing is fitted again. Writes
population.csv, population.json and the page of the batch anew. With --joint parameters are also fitted to all tables
together, pooled over them (no ratios), in FOLDER/joint_...; the same line goes on after an interruption. Exit code
1 if the weights of a table are not to be trusted."""


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add what the verb may be asked."""
    parser.add_argument("folder", nargs="?", metavar="FOLDER", help="result folder of a batch (default: fits/batch)")
    parser.add_argument(
        "--of", metavar="A,B,...", default="",
        help="further parameters, or ratios of two such as k_theta/k_y, beside those that at least three tables tell",
    )  # fmt: skip
    parser.add_argument(
        "--over", metavar="LABEL",
        help="tables lie on levels: of a label that all rows of a table share (surface, ball, date), or their folder",
    )  # fmt: skip
    parser.add_argument(
        "--joint", action="store_true",
        help="fit what --of names, or without it what has doubtful weights, to all tables together: a dozen at most",
    )  # fmt: skip
    parser.add_argument("--max-steps", type=count, metavar="N", help="steps of a joint fit at most (default 20000)")
    add_cores(parser)
    parser.add_argument("--json", action="store_true", help="print JSON for other programs")


def run(args: argparse.Namespace) -> int:
    """Weight the draws, write the files, print what was found."""
    from fitball.batch.many import FOLDER, load_batch
    from fitball.inference.effort import MAX_STEPS, Effort
    from fitball.report.batch.population_files import content
    from fitball.report.form.files import json_text

    batch = load_batch(Path(args.folder) if args.folder else FOLDER)
    asked = [name.strip() for name in args.of.split(",") if name.strip()]
    joint = Effort(cores=args.cores, max_steps=args.max_steps or MAX_STEPS) if args.joint else None
    try:
        populated = batch.summarise(asked, args.command, args.over, joint, args.progress)
    except KeyboardInterrupt:
        args.progress.finish()
        print(
            f"Interrupted. A joint fit that had begun is kept in {batch.folder}; the same line goes on.",
            file=sys.stderr,
        )
        return 130
    args.progress.finish()
    sys.stdout.write(json_text(content(populated)) if args.json else batch.report() + "\n")
    return 1 if any(one.population.doubtful for one in populated) else 0
