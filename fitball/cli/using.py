"""The verbs that take a fit: `plot`, `predict`, `plan`, `export`, `verify`."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from fitball.cli.options import (
    COLUMNS,
    EXACT,
    FIT,
    FLIP,
    FULL,
    PICTURE,
    SCHEDULER,
    SEED,
    Verb,
    count,
    file_place,
    one_of,
    option,
    pairs,
    place,
    print_result,
    switch,
    tell_notes,
    whole,
)
from fitball.cli.terminal import show
from fitball.errors import ParameterError, suggestion
from fitball.exports.formats import FORMATS as EXPORTS
from fitball.exports.formats import KINDS
from fitball.report.figures.registry import FIGURES

if TYPE_CHECKING:
    pass


KIND_LINES = "\n".join(f"  {name:10}  {text.summary}" for name, text in FIGURES.items())


def run_plot(args: argparse.Namespace) -> int:
    """Draw what was asked for and print the places of the files."""
    if args.kind not in (*FIGURES, "all"):
        map_of = f"; a map of regimes: fitball simulate --map --fit {args.fit}" if "map" in args.kind else ""
        raise ParameterError(f"unknown figure '{args.kind}': {suggestion(args.kind, (*FIGURES, 'all'))}{map_of}")
    from fitball.api import load_fit
    from fitball.api.fit import Plots, lacks_profiles, profiled
    from fitball.report.figures.canvas import save_figure
    from fitball.report.form.folders import PATIENCE, held

    path = Path(args.fit)
    folder = Path(args.out) if args.out else (path if path.is_dir() else path.parent)
    # No folder is made for a fit that there is not; one that is drawn in is replaced by nobody meanwhile.
    load_fit(path)
    with held(folder, PATIENCE):
        fit = load_fit(path)
        kinds = [args.kind] if args.kind != "all" else list(fit.plot)
        left_out = [name for name in FIGURES if args.kind == "all" and name not in (*kinds, "force")]
        profiles = args.kind == "profiles"
        notes = ["the file holds no profiles: computing them"] if profiles and lacks_profiles(fit) else []
        notes += [f"left out {', '.join(left_out)}: this fit has not what they show"] if left_out else []
        if not args.quiet:
            tell_notes(notes)
        shown = profiled(fit, args.cores, args.scheduler) if profiles else fit
        for name in kinds:
            place = folder / f"{name}.{args.format}"
            save_figure(Plots(shown)(name), place, args.format)
            print(place)
    return 0


PLOT = Verb(
    "plot", "figures of a fit from its saved files",
    (
        option("fit", "FIT", "a fit.json, or the folder that holds one"),
        option("kind", "KIND", f"{', '.join(FIGURES)} or all"),
        option("--format", "FORMAT", "png (default), svg or pdf", **PICTURE),
        option("--out", "DIR", "folder to write to (default: beside fit.json)", type=place),
        option("--cores", "N", "processes that compute profiles (default: all)", type=count),
        SCHEDULER,
        switch("--quiet", "no notes: only errors and files"),
    ),
    run_plot,
    f"""kinds:
{KIND_LINES}
  all         every one of them that the fit can show

examples:
  fitball plot fits/wang_zero_spin/two-mass profiles
  fitball plot fits/wang_all/grip-slip/fit.json all --format pdf --out figures

Nothing is fitted or sampled again. A map of regimes over angle and spin:
  fitball simulate --map --fit FIT""",
    description="Draw figures of a fit from fit.json and the draws beside it.",
)  # fmt: skip


def run_predict(args: argparse.Namespace) -> int:
    """Predict the impacts, print them and what data say of them."""
    if bool(args.impact) == (args.data is not None):
        raise ParameterError("predict needs impacts: either DATA or --impact, one of them")
    if (args.flip or args.columns) and args.data is None:
        option = "--flip" if args.flip else "--columns"
        raise ParameterError(f"{option} is about columns of DATA: write an --impact as it is meant")
    from fitball.api import load_fit
    from fitball.api.predicting import foretell
    from fitball.files import is_stream
    from fitball.inference.prediction.new_impacts import impacts_seen
    from fitball.report.form.document import on_terminal
    from fitball.report.form.files import csv_text, json_text, refuse_existing, write_text
    from fitball.report.predict.document import predict_document, predict_page
    from fitball.report.predict.rows import prediction_csv_rows, prediction_json

    files = [Path(name) for name in (args.out, args.html) if name is not None]
    for file in files:
        refuse_existing(file, args.overwrite)
    fit = load_fit(args.fit)
    data = args.impact if args.data is None else args.data
    found = foretell(
        fit, fit.predicting, data, flip=args.flip, columns=args.columns, exact_incidence=args.exact_incidence,
        seed=args.seed,
    )  # fmt: skip
    ids, prediction = found.new.ids, found.prediction
    if args.out is not None:
        write_text(Path(args.out), csv_text(prediction_csv_rows(prediction, ids)), named=True)
    seen = impacts_seen(fit.impacts, found.new.impacts) if found.scores else 0
    title = f"Rebounds predicted by {fit.fitted.model_name}, fitted to {fit.source.name}"
    if args.html is not None:
        page = predict_document(prediction, ids, found.scores, seen, title, ["rebounds"], args.command)
        write_text(Path(args.html), predict_page(page, prediction, ids), named=True)
    if not args.quiet:
        tell_notes(found.notes)
    if args.json:
        print(json_text(prediction_json(prediction, ids, found.scores, found.notes)), end="")
    elif not args.quiet:
        show(on_terminal(predict_document(prediction, ids, found.scores, seen, title)))
    for file in files:
        if not args.json and not is_stream(file):
            print(file)
    return 0


PREDICT = Verb(
    "predict", "predict rebounds of new impacts from a fit, with intervals",
    (
        FIT,
        option("data", "DATA", "impacts: a table, or the name of a bundled one", nargs="?"),
        option(
            "--impact", "TEXT",
            'one impact instead of DATA, e.g. "v=17, theta=18, spin=100" (default: m/s, deg, rad/s); repeatable',
            action="append", default=[],
        ),
        FLIP,
        COLUMNS,
        switch(*EXACT),
        option("--out", "FILE.csv", "write every number to a CSV file", type=file_place),
        option("--html", "FILE.html", "write a page with the figure and the tables", type=file_place),
        switch("--overwrite", "replace files that exist"),
        option("--seed", "N", "seed of the simulated noise (default 1)", type=whole, default=1),
        FULL,
        switch("--json", "print JSON (SI units, angles in radians)"),
        switch("--quiet", "no table and no notes: only errors and files"),
    ),
    run_predict,
    """examples:
  fitball predict fits/wang_all/two-mass new_balls.csv
  fitball predict fits/wang_all/two-mass --impact "v=38 mph, theta=18 deg, spin=950 rpm top"
  fitball predict fits/wang_all/two-mass --impact "v=38±1 mph, theta=18±0.5 deg, spin=950±50 rpm top"
  fitball predict fits/wang_topspin/two-mass wang_backspin.csv --out predicted.csv""",
    description="""Predict rebounds of new impacts from a fit.

Two kinds of interval: of the rebound itself, which the uncertain parameters leave open, and of a new
measurement of it, which the noise widens. Where the sd of the incident state is stated (columns v_1_sd,
theta_1_sd, omega_1_sd, ..., or "v=38±1 mph") both contain it, and what each source adds is told. An impact
unlike those the fit was made from is flagged. Rebound columns, where DATA has any, are compared with the
prediction.""",
)  # fmt: skip


def run_plan(args: argparse.Namespace) -> int:
    """Plan, write the folder, print what to do."""
    args.progress("loading", None)
    from fitball.api import load_fit

    place = Path(args.fit)
    folder = Path(args.out) if args.out else (place.parent if place.is_file() else place) / "plan"
    made = load_fit(place).plan(
        args.target, speed=args.speed, angle=args.angle, spin=args.spin, impacts=args.impacts, repeats=args.repeats,
        sensors=args.sensor, cost=args.cost, seed=args.seed, progress=args.progress,
    )  # fmt: skip
    args.progress("figure and files", None)
    made.save(folder, overwrite=args.overwrite, command=args.command)
    args.progress.finish()
    print_result(args, made, folder, folder)
    return 0


PLAN = Verb(
    "plan", "what to measure next: the impacts and sensors that would tell most",
    (
        FIT,
        option(
            "--for", "TARGET",
            'what is to be known: parameters (k_theta,mu), "court pace", or impact="v=30 m/s, theta=16 deg" '
            "(default: all parameters of the model)", dest="target",
        ),
        *(
            option(
                f"--{name}", "LOW:HIGH",
                f"what the machine can do, in {unit} or with a unit, e.g. {example} (LOW:HIGH:STEPS, or one value; "
                "default: the range of the fitted table)",
            )
            for name, unit, example in (
                ("speed", "m/s", "5:20"), ("angle", "deg", "10:80"), ("spin", "rad/s", "-300:300")
            )
        ),
        option("--impacts", "N", "impacts to choose (default 5)", type=count, default=5),
        option("--repeats", "N", "times each is made (default 1)", type=count, default=1),
        option("--sensor", "NAME=VALUE", "another way of measuring, see below; repeatable", action="append"),
        pairs(
            "--cost", "NAME=C",
            "what an impact read by that sensor costs, one measured as before being 1: the batch is then chosen "
            "among all sensors by gain for cost; repeatable", convert=float, last=True, number="a number",
            form="NAME=C, such as contact_time=2",
        ),
        SEED,
        option("--out", "DIR", "result folder (default: plan, beside fit.json)", type=place),
        switch("--overwrite", "replace an older plan in the folder"),
        FULL,
        switch("--json", "print plan.json (SI units, angles in radians)"),
        switch("--quiet", "no progress, no tables: only errors and the folder"),
    ),
    run_plan,
    """examples:
  fitball plan fits/wang_all/two-mass --speed 5:20 --angle 10:80 --spin -300:300
  fitball plan fits/wang_all/two-mass --for k_theta,mu --impacts 8
  fitball plan fits/wang_all/two-mass --for "court pace" --sensor contact_time=0.1ms --sensor camera=0.3
  fitball plan fits/wang_all/two-mass --for impact="v=30 m/s, theta=16 deg" --cost camera=3 --cost contact_time=2

A sensor is COLUMN=SD (a column of a table, read with that sd beside or instead of the fitted ones), camera=SHARE
(all columns with that share of their fitted noise), force=SD (a force plate of that noise, 20,000 samples a second),
drop=HEIGHT (a drop test from there), several of them joined by commas, or none. Without --sensor a contact timer, a
force plate, a camera twice as good and the ITF's drop test are looked at, as far as the model knows of them.
Results go to the folder plan beside fit.json unless --out names another.""",
    description="""What to measure next, from the posterior of a fit.

Every incident state that your machine can make is looked at: how much one more impact there is expected to tell
(in nats) of what you want to know, noise and all other parameters as uncertain as the fit left them. The best
impacts are chosen one after the other, and other ways of measuring are set beside measuring as before.""",
)  # fmt: skip


def run_export(args: argparse.Namespace) -> int:
    """Write the fit in the form asked for, or print it."""
    from fitball.api import load_fit
    from fitball.files import is_stream

    fit = load_fit(args.fit)
    made = fit.exported(args.to, {name: getattr(args, name) for name in KINDS})
    if args.out == "-":
        if not made.texts:
            raise ParameterError("--out -: netCDF is no text; name a file")
        sys.stdout.write(next(iter(made.texts.values())))
    else:
        path = Path(args.fit)
        beside = path if path.is_dir() else path.parent
        for place in made.write(beside if args.out is None else Path(args.out), args.overwrite):
            if not is_stream(place):
                print(place)
    if made.note:
        tell_notes([made.note])
    return 0


EXPORT_LINES = "\n".join(f"  {name:10} {form.help}" for name, form in EXPORTS.items())
EXPORT = Verb(
    "export", "a fitted parameter set in another form: C, Python, JavaScript, C#, tables, engines",
    (
        FIT,
        option("--to", "FORMAT", ", ".join(EXPORTS), required=True, type=one_of("format", EXPORTS)),
        option("--out", "FILE", "file, or - for stdout (default: a name beside fit.json)", type=place),
        switch("--overwrite", "replace files that exist"),
        option("--prefix", "TEXT", "c: beginning of every name (fitball_); javascript, csharp: of the port's"),
        switch("--json", "engine, lookup: the JSON alone"),
        switch("--inputs-only", "golden: without the expected rebounds"),
        option("--range", "TEXT", "lookup: the grid (default: the calibrated range)"),
        option("--at", "TEXT", "engine: operating point (default: middle of the calibrated range)"),
        option("--engine-inertia", "X", "engine: I/(M R^2) of its sphere (0.4: solid)", type=float),
    ),
    run_export,
    f"""formats:
{EXPORT_LINES}

examples:
  fitball export fits/wang_all/two-mass --to c --out bounce.h
  fitball export fits/wang_all/two-mass --to latex --out -
  fitball export fits/my_drops/two-mass --to certificate
  fitball export fits/wang_all/two-mass --to lookup --range "v=10..40 m/s:16, theta=10..60 deg:16, spin=-300..300:9"
  fitball export fits/wang_all/two-mass --to engine --at "v=30 m/s, theta=16 deg, spin=0 rpm"
  fitball export fits/wang_all/two-mass --to engine --json --out -

Check a port with fitball verify.""",
    description="Write a fit in another form. Nothing is fitted or sampled again.",
)  # fmt: skip


def run_verify(args: argparse.Namespace) -> int:
    """Compare the port and print where it deviates; 0 where it agrees, else 1."""
    from fitball.api.verifying import DEFAULT_TOLERANCE, verify

    found = verify(args.port, args.fit, DEFAULT_TOLERANCE if args.tolerance is None else args.tolerance)
    print_result(args, found, found.outcome)
    return found.exit_code


VERIFY = Verb(
    "verify", "check a port of a fitted model against its golden impacts",
    (
        option("port", "PORT.csv", "outputs of the port for the golden impacts"),
        option("--fit", "FIT", "result folder or fit.json (default: beside PORT.csv)"),
        option("--tolerance", "X", "largest relative difference (1e-9)", type=float),
        switch("--json", "print JSON (SI units, angles in radians)"),
        switch("--quiet", "print the result alone"),
    ),
    run_verify,
    """PORT.csv holds what the port answers to the golden impacts: columns by name, with units as in impact
tables (v_x2, v_y2, omega_2, contact_time, v_2, theta_2; without a unit m/s, rad/s, s, deg), any of them, and a
column id, or the order of the golden impacts. A column regime, if there is one, is compared too.

The tolerance is relative: speeds to the incident speed, spins times the radius likewise, contact times to themselves.
Two double-precision programs agree to 1e-12; 1e-9 leaves room for ten printed digits.

examples:
  fitball export fits/wang_all/two-mass --to golden --inputs-only --out impacts.csv
  fitball verify port.csv --fit fits/wang_all/two-mass
  fitball verify port.csv --fit fits/wang_all/two-mass --tolerance 1e-5     a port in single precision

Exit code 0 if every impact passes, 1 if one fails.""",
    description="Compare the outputs of another program with the golden impacts of a fit.",
)  # fmt: skip
