"""`fitball predict FIT DATA`: rebounds of new impacts from a fit, with intervals."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from fitball.cli.options import add_columns, add_flip, add_verb, tell_notes, whole
from fitball.errors import ParameterError

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from fitball.data.table import ImpactTable
    from fitball.report.saved.fit_file import TablePart
    from fitball.values import Ball, FloatArray, Impacts

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

DRAWN = "the incident state is uncertain: it is drawn anew for each draw of the parameters"
IGNORED = "the stated uncertainty of the incident state is not used"
NO_LINE = (
    "a line of restitution ends somewhere; calibrate with --closure cor=saturating for one that holds at every speed"
)
POINT_ONLY = "a point fit has no posterior: values at the point estimate, without intervals"


def add_parser(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the verb to the command line."""
    parser = add_verb(subparsers, "predict", run, help=HELP, description=DESCRIPTION, epilog=EXAMPLE)
    parser.add_argument("fit", metavar="FIT", help="a result folder of fitball calibrate, or its fit.json")
    parser.add_argument("data", metavar="DATA", nargs="?", help="impacts: a table, or the name of a bundled one")
    parser.add_argument(
        "--impact",
        metavar="TEXT",
        action="append",
        default=[],
        help='one impact instead of DATA, e.g. "v=17, theta=18, spin=100" (default: m/s, deg, rad/s); repeatable',
    )
    add_flip(parser)
    add_columns(parser)
    parser.add_argument(
        "--exact-incidence", action="store_true", help="take the incident state as exact even where its sd is stated"
    )
    parser.add_argument("--out", metavar="FILE.csv", help="write every number to a CSV file")
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
    if args.seed < 0:
        raise ParameterError(f"seed = {args.seed}: expected a number not below 0")
    import numpy as np

    from fitball.api import load_fit
    from fitball.inference.prediction.holdout_scores import impacts_seen, scores
    from fitball.inference.prediction.new_impacts import observed_observables
    from fitball.inference.prediction.over_assumptions import with_assumptions
    from fitball.inference.results.results import RunStatus, Verdict
    from fitball.observables import OBSERVABLES
    from fitball.report.form.atomic_write import refuse_existing, write_text
    from fitball.report.form.csv import csv_text
    from fitball.report.form.json_text import json_text
    from fitball.report.predict.rows import prediction_csv_rows, prediction_json
    from fitball.report.predict.text import render_prediction, render_scores

    if args.out is not None:
        refuse_existing(Path(args.out), args.overwrite)
    saved = load_fit(args.fit)
    impacts, ids, table, covariance = _impacts(args.data, args.flip, args.columns, args.impact, saved.fitted.ball)
    stated, point_only = covariance is not None, saved.status is RunStatus.POINT_ONLY
    if args.exact_incidence:
        covariance = None
    observables, unused = observed_observables(saved.fitted, table) if table is not None else ((), ())
    prediction = saved.predict_interval(impacts, observables, seed=args.seed, incident_covariance=covariance)
    prediction = with_assumptions(prediction, saved.fitted, saved.file.assumptions)
    judged = scores(prediction)
    notes = [*(() if table is None else (*table.remarks, *_other_flips(saved.file.table, table))), *unused]
    if point_only:
        notes.append(POINT_ONLY)
    if stated:
        notes.append(IGNORED if point_only or args.exact_incidence else DRAWN)
    if saved.status is RunStatus.NOT_CONVERGED:
        notes.append("the sampler of this fit did not converge: intervals may change")
    unknown = [output.name for output in prediction.outputs if output.rebound is not None and output.measured is None]
    # A contact time is seldom measured: nobody misses its noise.
    silent = [name for name in unknown if not OBSERVABLES[name].timed]
    if silent:
        notes.append(f"the fit knows no noise of {', '.join(silent)}: no interval of a new measurement")
    stiffness = saved.parameters.get("k_y")
    if stiffness is not None and stiffness.verdict is Verdict.FIXED:
        notes.append("k_y was held at its value in this fit: contact times rest on that value alone")
    # Another law of restitution would have an answer.
    if saved.fitted.model.options.get("cor") == "line" and np.any(prediction.unsolved > 0.0):
        notes.append(NO_LINE)
    if args.out is not None:
        write_text(Path(args.out), csv_text(prediction_csv_rows(prediction, ids)))
    if not args.quiet:
        tell_notes(notes)
    if args.json:
        print(json_text(prediction_json(prediction, ids, judged, notes)), end="")
    elif not args.quiet:
        print(render_prediction(prediction, ids))
        if judged:
            print("\n" + render_scores(judged, impacts_seen(saved.impacts, impacts), len(ids)))
    if args.out is not None and not args.json:
        print(args.out)
    return 0


def _other_flips(fitted: TablePart, table: ImpactTable) -> tuple[str, ...]:
    """What to say where the fit counted columns the other way round and these impacts do not, or the reverse."""
    flips = [", ".join(sorted({name.rpartition(":")[2] for name in item.flipped})) for item in (fitted, table)]
    if flips[0] == flips[1]:
        return ()
    made, here = (names or "no column" for names in flips)
    return (f"the fit was made with {made} flipped, these impacts are read with {here} flipped (--flip)",)


def _impacts(
    data: str | None, flip: Sequence[str], columns: Mapping[str, str], texts: Sequence[str], ball: Ball
) -> tuple[Impacts, tuple[str, ...], ImpactTable | None, FloatArray | None]:
    """Impacts, their names, the table they come from, and the covariance of their incident states."""
    import numpy as np

    from fitball.data.impact_text import parse_uncertain_impact
    from fitball.data.read import load_table
    from fitball.data.scene import Scene, load_scene
    from fitball.values import Impacts

    if data is not None:
        # The table's own scene says how its columns are called, the fit what ball it is.
        scene = Scene(ball=ball, columns=load_scene(data, as_read=True).columns)
        table = load_table(data, rebound=False, scene=scene, flip=flip, columns=columns)
        return table.impacts, table.ids, table, table.incident_covariance
    parsed = [parse_uncertain_impact(text) for text in texts]
    joined = [np.concatenate([getattr(item, name) for item, _ in parsed]) for name in ("v_x1", "v_y1", "omega_1")]
    covariance = None
    if any(item is not None for _, item in parsed):
        covariance = np.concatenate([np.zeros((1, 3, 3)) if item is None else item for _, item in parsed])
    return Impacts(*joined), tuple(f"impact {k}" for k in range(1, len(parsed) + 1)), None, covariance
