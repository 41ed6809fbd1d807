"""`fitball population FOLDER`: centre and spread of quantities over the tables of a batch."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

HELP = "what the tables of a batch have in common: mean and spread of a parameter, each table given the others"
EXAMPLE = """examples:
  fitball population
  fitball population fits/batch --of mu,cor_10
  fitball population results/season --of k_theta/k_y --json
  fitball population results/season --of mu --over surface

From the draws that `fitball batch` kept of each table, whose priors are divided out; nothing is fitted again. Writes
population.csv, population.json and the page of the batch anew. Exit code 1 if the weights of a table are not to be
trusted: a few tables can be fitted together instead, fitball calibrate TABLES --pool mu=table."""


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
    parser.add_argument("--json", action="store_true", help="print JSON for other programs")


def run(args: argparse.Namespace) -> int:
    """Weight the draws, write the files, print what was found."""
    from fitball.batch.many import FOLDER, load_batch
    from fitball.report.batch.population_files import content
    from fitball.report.form.files import json_text

    batch = load_batch(Path(args.folder) if args.folder else FOLDER)
    asked = [name.strip() for name in args.of.split(",") if name.strip()]
    populated = batch.summarise(asked, args.command, args.over)
    sys.stdout.write(json_text(content(populated)) if args.json else batch.report() + "\n")
    return 1 if any(one.population.doubtful for one in populated) else 0
