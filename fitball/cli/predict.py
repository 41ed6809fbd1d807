"""`fitball predict FIT DATA`: rebounds of new impacts from a fit, with intervals."""

from __future__ import annotations

import argparse
from pathlib import Path

from fitball.cli.options import add_columns, add_flip, file_place, tell_notes, whole
from fitball.errors import ParameterError

HELP = "predict rebounds of new impacts from a fit, with intervals"
DESCRIPTION = """Predict rebounds of new impacts from a fit.

Two kinds of interval: of the rebound itself, which the uncertain parameters leave open, and of a new
measurement of it, which the noise widens. Where the sd of the incident state is stated (columns v_1_sd,
theta_1_sd, omega_1_sd, ..., or "v=38±1 mph") both contain it, and what each source adds is told. An impact
unlike those the fit was made from is flagged. Rebound columns, where DATA has any, are compared with the
prediction."""
EXAMPLE = """examples:
  fitball predict fits/wang_all/two-mass new_balls.csv
  fitball predict fits/wang_all/two-mass --impact "v=38 mph, theta=18 deg, spin=950 rpm top"
  fitball predict fits/wang_all/two-mass --impact "v=38±1 mph, theta=18±0.5 deg, spin=950±50 rpm top"
  fitball predict fits/wang_topspin/two-mass wang_backspin.csv --out predicted.csv"""


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add what the verb may be asked."""
    parser.add_argument("fit", metavar="FIT", help="a result folder of fitball calibrate, or its fit.json")
    parser.add_argument("data", metavar="DATA", nargs="?", help="impacts: a table, or the name of a bundled one")
    parser.add_argument(
        "--impact", metavar="TEXT", action="append", default=[],
        help='one impact instead of DATA, e.g. "v=17, theta=18, spin=100" (default: m/s, deg, rad/s); repeatable',
    )  # fmt: skip
    add_flip(parser)
    add_columns(parser)
    parser.add_argument(
        "--exact-incidence", action="store_true", help="take the incident state as exact even where its sd is stated"
    )
    parser.add_argument("--out", type=file_place, metavar="FILE.csv", help="write every number to a CSV file")
    parser.add_argument("--overwrite", action="store_true", help="replace that file if it exists")
    parser.add_argument("--seed", type=whole, default=1, metavar="N", help="seed of the simulated noise (default 1)")
    parser.add_argument("--json", action="store_true", help="print JSON (SI units, angles in radians)")
    parser.add_argument("--quiet", action="store_true", help="no table and no notes: only errors and files")


def run(args: argparse.Namespace) -> int:
    """Predict the impacts, print them and what data say of them."""
    if bool(args.impact) == (args.data is not None):
        raise ParameterError("predict needs impacts: either DATA or --impact, one of them")
    if (args.flip or args.columns) and args.data is None:
        option = "--flip" if args.flip else "--columns"
        raise ParameterError(f"{option} is about columns of DATA: write an --impact as it is meant")
    from fitball.api import load_fit
    from fitball.api.predicting import foretell
    from fitball.files import is_stream
    from fitball.inference.prediction.holdout_scores import impacts_seen
    from fitball.report.form.document import on_terminal
    from fitball.report.form.files import csv_text, json_text, refuse_existing, write_text
    from fitball.report.predict import predict_document, prediction_csv_rows, prediction_json

    if args.out is not None:
        refuse_existing(Path(args.out), args.overwrite)
    fit = load_fit(args.fit)
    data = args.impact if args.data is None else args.data
    found = foretell(
        fit, fit.predicting, data, flip=args.flip, columns=args.columns, exact_incidence=args.exact_incidence,
        seed=args.seed,
    )  # fmt: skip
    ids, prediction = found.new.ids, found.prediction
    if args.out is not None:
        write_text(Path(args.out), csv_text(prediction_csv_rows(prediction, ids)), named=True)
    if not args.quiet:
        tell_notes(found.notes)
    if args.json:
        print(json_text(prediction_json(prediction, ids, found.scores, found.notes)), end="")
    elif not args.quiet:
        seen = impacts_seen(fit.impacts, found.new.impacts) if found.scores else 0
        print(on_terminal(predict_document(prediction, ids, found.scores, seen)))
    if args.out is not None and not args.json and not is_stream(Path(args.out)):
        print(args.out)
    return 0
