"""The verbs that take a fit: `plot`, `predict`, `plan`, `export`, `verify`, `cite`."""

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
    LEVEL,
    PICTURE,
    SCHEDULER,
    SEED,
    Group,
    Verb,
    count,
    either,
    file_place,
    marked,
    one_of,
    option,
    pairs,
    place,
    print_notes,
    print_result,
    switch,
    whole,
)
from fitball.cli.terminal import show
from fitball.errors import ParameterError, suggestion
from fitball.exports.formats import FORMATS as EXPORTS
from fitball.exports.formats import KINDS
from fitball.models.specs import RANKED
from fitball.report.figures.registry import FIGURES

if TYPE_CHECKING:
    pass


KIND_LINES = "\n".join(f"  {name:10}  {text.summary}" for name, text in FIGURES.items())


def run_plot(args: argparse.Namespace) -> int:
    """Draw the figures and print where they are."""
    if args.kind not in (*FIGURES, "all"):
        map_of = f"; for a map of regimes: fitball simulate --map --fit {args.fit}" if "map" in args.kind else ""
        raise ParameterError(f"unknown figure '{args.kind}': {suggestion(args.kind, (*FIGURES, 'all'))}{map_of}")
    from fitball.api import load_fit
    from fitball.api.fit import Plots, lacks_profiles, profiled
    from fitball.report.figures.canvas import save_figure
    from fitball.report.form.folders import PATIENCE, held

    path = Path(args.fit)
    folder = Path(args.out) if args.out else (path if path.is_dir() else path.parent)
    # Read first, so that no folder is made for a missing fit; while figures are drawn, the folder is locked.
    load_fit(path)
    with held(folder, PATIENCE):
        fit = load_fit(path)
        kinds = [args.kind] if args.kind != "all" else list(fit.plot)
        left_out = [name for name in FIGURES if args.kind == "all" and name not in (*kinds, "force")]
        profiles = args.kind == "profiles"
        notes = ["fit.json has no profiles; they are computed now"] if profiles and lacks_profiles(fit) else []
        notes += [f"not drawn, since this fit lacks the data for them: {', '.join(left_out)}"] if left_out else []
        if not args.quiet:
            print_notes(notes)
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
        PICTURE,
        option("--out", "DIR", "folder for the figures (default: that of fit.json)", type=place),
        option("--cores", "N", "number of processes for profiles (default: all)", type=count),
        SCHEDULER,
        switch("--quiet", "print errors and files only"),
    ),
    run_plot,
    f"""kinds:
{KIND_LINES}
  all         every figure that this fit can show

examples:
  fitball plot fits/wang_zero_spin/two-mass profiles
  fitball plot fits/wang_all/grip-slip/fit.json all --format pdf --out figures

A map of contact regimes over angle and spin:
  fitball simulate --map --fit FIT""",
    description="Draw figures of a saved fit. Nothing is fitted or sampled again.",
)  # fmt: skip


def run_predict(args: argparse.Namespace) -> int:
    """Predict the impacts and print them, with their agreement with measured rebounds."""
    if bool(args.impact) == (args.data is not None):
        raise ParameterError("predict needs impacts: give either DATA or --impact")
    if (args.flip or args.columns) and args.data is None:
        option = "--flip" if args.flip else "--columns"
        raise ParameterError(f"{option} applies to columns of DATA, not to --impact: leave it out")
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
        seed=args.seed, levels=args.levels,
    )  # fmt: skip
    ids, prediction = found.new.ids, found.prediction
    if args.out is not None:
        write_text(Path(args.out), csv_text(prediction_csv_rows(prediction, ids)), named=True)
    seen = impacts_seen(fit.impacts, found.new.impacts) if found.scores else 0
    title = f"{fit.source.name}: rebounds predicted by the {fit.fitted.model_name} model"
    if args.html is not None:
        page = predict_document(prediction, ids, found.scores, seen, title, ["rebounds"], args.command)
        write_text(Path(args.html), predict_page(page, prediction, ids), named=True)
    if not args.quiet:
        print_notes(found.notes, args.full)
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
        option("data", "DATA", "a table of impacts, or the name of a bundled one", nargs="?"),
        option(
            "--impact", "TEXT",
            'one impact instead of DATA, e.g. "v=17, theta=18, spin=100" (default units: m/s, deg, rad/s; '
            "repeatable)",
            action="append", default=[],
        ),
        LEVEL,
        FLIP,
        COLUMNS,
        switch(*EXACT),
        option("--out", "FILE.csv", "write all numbers to a CSV file", type=file_place),
        option("--html", "FILE.html", "write a page with the figure and the tables", type=file_place),
        switch("--overwrite", "replace files that exist"),
        option("--seed", "N", "seed of the simulated noise (default: 1)", type=whole, default=1),
        FULL,
        switch("--json", "print JSON (SI units, angles in radians)"),
        switch("--quiet", "print errors and files only"),
    ),
    run_predict,
    """examples:
  fitball predict fits/wang_all/two-mass new_balls.csv
  fitball predict fits/wang_all/two-mass --impact "v=38 mph, theta=18 deg, spin=950 rpm top"
  fitball predict fits/wang_all/two-mass --impact "v=38±1 mph, theta=18±0.5 deg"
  fitball predict fits/wang_topspin/two-mass wang_backspin.csv --out predicted.csv
  fitball predict fits/two_surfaces/two-mass new_balls.csv --level surface=clay""",
    description="""Predict rebounds of new impacts from a fit.

There are two kinds of interval: one for the rebound itself, and a wider one for a new measurement of it, which
includes the measurement noise. Both include the sd of the incident state, if it is given (columns such as
v_1_sd, or "v=38±1 mph"), and the contribution of each source is printed. Impacts unlike the fitted ones are marked
as extrapolated. If DATA has rebound columns, they are compared with the prediction.

If parameters of the fit differ between surfaces, balls or places, each row is predicted for its own label, in the
column of DATA that the fit used. --level gives the label of rows that have none, and of --impact. The label new
(--level surface=new, or new in DATA) is one of which nothing was measured: its parameters are drawn from the
population, with wider intervals.""",
)  # fmt: skip


def run_plan(args: argparse.Namespace) -> int:
    """Plan, write the folder, print the plan."""
    args.progress("loading", None)
    from fitball.api import load_fit

    place = Path(args.fit)
    folder = Path(args.out) if args.out else (place.parent if place.is_file() else place) / "plan"
    made = load_fit(place).plan(
        args.target, speed=args.speed, angle=args.angle, spin=args.spin, impacts=args.impacts, repeats=args.repeats,
        sensors=[*(args.sensor or ()), *args.camera] if args.camera else args.sensor, cost=args.cost,
        levels=args.levels, seed=args.seed, progress=args.progress,
    )  # fmt: skip
    args.progress("figure and files", None)
    made.save(folder, overwrite=args.overwrite, command=args.command)
    args.progress.finish()
    print_result(args, made, folder, folder)
    return 0


PLAN = Verb(
    "plan", "choose the impacts and sensors that would determine the parameters best",
    (
        FIT,
        option(
            "--for", "TARGET",
            'quantity to determine: parameters such as k_theta,mu, or "court pace", or impact="v=30 m/s, theta=16 '
            'deg" (default: all parameters of the model)', dest="target",
        ),
        *(
            option(
                f"--{name}", "LOW:HIGH",
                f"{name} that your machine can reach, in {unit} or with a unit, e.g. {example}; also "
                "LOW:HIGH:STEPS or one value (default: the range of the fitted table)",
            )
            for name, unit, example in (
                ("speed", "m/s", "5:20"), ("angle", "deg", "10:80"), ("spin", "rad/s", "-300:300")
            )
        ),
        pairs(
            "--level", "COLUMN=LABEL",
            "plan for this surface, ball or place alone, if parameters of the fit differ between them (default: for "
            "all of them; repeatable)",
            dest="levels",
        ),
        option("--impacts", "N", "number of impacts to choose (default: 5)", type=count, default=5),
        option("--repeats", "N", "how often each impact is measured (default: 1)", type=count, default=1),
        option("--sensor", "NAME=VALUE", "another way of measuring, see below (repeatable)", action="append"),
        option(
            "--camera", "TEXT",
            'a film as a way of measuring, e.g. "fps=240, noise=1mm, view=0.8m, mark=2", in the words of fitball '
            "simulate --help (repeatable: which frame rate is enough?)", action="append",
        ),
        pairs(
            "--cost", "NAME=C",
            "cost of an impact with this sensor, relative to one measured as before; impacts and sensors are then "
            "chosen by gain per cost (repeatable)", convert=float, last=True, number="a number",
            form="NAME=C, such as contact_time=2",
        ),
        SEED,
        option("--out", "DIR", "result folder (default: the folder plan beside fit.json)", type=place),
        switch("--overwrite", "replace an older plan in the folder"),
        FULL,
        switch("--json", "print plan.json (SI units, angles in radians)"),
        switch("--quiet", "print errors and the result folder only"),
    ),
    run_plan,
    """examples:
  fitball plan fits/wang_all/two-mass --speed 5:20 --angle 10:80 --spin -300:300
  fitball plan fits/wang_all/two-mass --for k_theta,mu --impacts 8
  fitball plan fits/wang_all/two-mass --for "court pace" --sensor camera=0.3
  fitball plan fits/wang_all/two-mass --for impact="v=30 m/s, theta=16 deg" --cost camera=3
  fitball plan fits/wang_all/two-mass --for k_y --camera "fps=240, noise=1mm" --camera "fps=1000, noise=1mm"

sensors (several are joined by commas):
  COLUMN=SD      this column of a table, measured with this sd
  camera=SHARE   all columns, with this share of their fitted noise
  gaps=SHARE     gap_time, gap_path and gap_turn, with this share of 0.1 ms, 1 mm and 2.3 deg
  force=SD       a force plate with this noise, at 20,000 samples a second
  drop=HEIGHT    a drop test from this height
  none           none but those of the table

Default sensors are a contact timer, a force plate, a camera with half the noise, one that sees the gaps, and the
ITF's drop test, as far as the model describes them. All are compared with measuring as before. For gaps the height of
the court counts as known within what the scene states, or 3 mm.""",
    description="""Plan the next measurements from the posterior of a fit.

For every incident state within the reach of your machine, the expected information gain of one more impact is
computed in nats. The gain counts for the quantity that you name with --for; all other parameters and the noise remain
as uncertain as after the fit. The best impacts are chosen one after the other. Gains assume that the model is
right.""",
)  # fmt: skip


def run_export(args: argparse.Namespace) -> int:
    """Write the fit, or the model at given parameters, in this format, or print it."""
    from fitball.api import load_fit
    from fitball.exports.formats import exported_model
    from fitball.files import is_stream

    options = {name: getattr(args, name) for name in KINDS}
    own = [
        flag
        for flag, given in (("--model", args.model), ("--set", args.values), ("--surface", args.surfaces))
        if given
    ]
    if args.fit is None and not own:
        raise ParameterError("export needs a FIT; without one give a model, such as --model two-mass --set mu=0.7")
    if args.fit is not None and own:
        raise ParameterError(f"the fit {args.fit} has its own model and parameters: leave out {' and '.join(own)}")
    if args.fit is None:
        made, path = exported_model(args.model, args.to, args.values, args.surfaces, options), Path()
    else:
        made, path = load_fit(args.fit).exported(args.to, options), Path(args.fit)
    if args.out == "-":
        if not made.texts:
            raise ParameterError(f"--out -: {args.to} is not text; name a file")
        sys.stdout.write(next(iter(made.texts.values())))
    else:
        beside = path if path.is_dir() else path.parent
        for place in made.write(beside if args.out is None else Path(args.out), args.overwrite):
            if not is_stream(place):
                print(place)
    if made.note:
        print_notes([made.note])
    return 0


def _number_or_published(text: str) -> float | str:
    """A number, or `literature:KEY`."""
    return text if text.lower().startswith("literature:") else float(text)


EXPORT_LINES = "\n".join(f"  {name:11}  {form.help}" for name, form in EXPORTS.items())
EXPORT = Verb(
    "export", "write a fit as source code, a table, or settings of a game engine",
    (
        option("fit", "FIT", FIT.help, nargs="?"),
        option("--to", "FORMAT", f"one of {', '.join(EXPORTS)}", required=True, type=one_of("format", EXPORTS)),
        option("--out", "FILE", "file, or - for stdout (default: a file beside fit.json, or here)", type=place),
        switch("--overwrite", "replace files that exist"),
        LEVEL,
        Group("a bounce without a table (instead of FIT)", (
            option("--model", "NAME", f"{either(marked(RANKED))}; assumptions as +NAME=OPTION"),
            pairs(
                "--set", "NAME=VALUE",
                "a parameter in SI units, or a published one, e.g. cor_10=literature:court (repeatable; the others "
                "have default values)",
                dest="values", convert=_number_or_published, number="a number in SI units, or literature:KEY",
                form="NAME=VALUE, as in mu=0.6",
            ),
            pairs(
                "--surface", "NAME=...",
                "a surface with published parameters, e.g. clay=literature:clay, or with yours, e.g. "
                '"hard=mu=0.6, cor_10=0.75"; list: fitball datasets priors (repeatable)',
                dest="surfaces", form="NAME=literature:KEY, such as clay=literature:clay",
            ),
        )),
        Group("options of single formats", (
            option("--prefix", "TEXT", "c, javascript, csharp: beginning of all names (default of c: fitball_)"),
            switch("--json", "engine, lookup: write JSON only"),
            switch("--inputs-only", "golden: omit the expected rebounds"),
            option("--range", "TEXT", "lookup: grid of impacts (default: the calibrated range)"),
            option("--at", "TEXT", "engine: operating point (default: middle of the calibrated range)"),
            option("--engine-inertia", "X", "engine: I/(M R^2) of its sphere (default: 0.4, solid)", type=float),
        )),
    ),
    run_export,
    f"""formats:
{EXPORT_LINES}

examples:
  fitball export fits/wang_all/two-mass --to c --out bounce.h
  fitball export fits/wang_all/two-mass --to latex --out -
  fitball export fits/my_drops/two-mass --to certificate
  fitball export fits/wang_all/two-mass --to lookup --range "v=10..40:16, theta=10..60:16"
  fitball export fits/wang_all/two-mass --to engine --at "v=30 m/s, theta=16 deg"
  fitball export fits/wang_all/two-mass --to engine --json --out -
  fitball export --model two-mass --set mu=0.7 --set cor_10=0.76 --to c
  fitball export --surface clay=literature:clay --surface grass=literature:grass --to javascript

To check a port, use fitball verify.""",
    description="""Write a fit in another format. Nothing is fitted or sampled again.

If parameters differ between surfaces or balls, a port takes these as arguments; tables and engine settings have one
part for each. --level chooses one. Without FIT the bounce is that of a model at parameters that you set or that are
published: nothing is fitted.""",
)  # fmt: skip


def run_verify(args: argparse.Namespace) -> int:
    """Compare the port and print deviations; 0 where it agrees, else 1."""
    from fitball.api.verifying import DEFAULT_TOLERANCE, verify

    tolerance = DEFAULT_TOLERANCE if args.tolerance is None else args.tolerance
    found = verify(args.port, args.fit, tolerance, args.levels)
    print_result(args, found, found.outcome)
    return found.exit_code


VERIFY = Verb(
    "verify", "check a port of a fitted model on test impacts",
    (
        option("port", "PORT.csv", "rebounds that the port computed for the golden impacts"),
        option("--fit", "FIT", "result folder or fit.json (default: the folder of PORT.csv)"),
        option("--tolerance", "X", "largest relative difference (default: 1e-9)", type=float),
        LEVEL,
        switch("--json", "print JSON (SI units, angles in radians)"),
        switch("--quiet", "print the outcome only"),
    ),
    run_verify,
    """PORT.csv has one row for each golden impact, and any of the columns v_x2, v_y2, omega_2, contact_time,
gap_time, gap_path, gap_turn, v_2, theta_2, regime. Units are written as in impact tables; without a unit they are
m/s, rad/s, s, m and deg. Rows are matched by a column id, or else by their order.

The tolerance is relative. Differences of speeds are divided by the incident speed, of spins by the incident speed
over the radius, of times by their own value, and of gap_path and gap_turn by what the incident speed goes in
gap_time. Two double-precision programs agree to 1e-12; 1e-9 allows for ten printed digits.

examples:
  fitball export fits/wang_all/two-mass --to golden --inputs-only --out impacts.csv
  fitball verify port.csv --fit fits/wang_all/two-mass
  fitball verify port.csv --fit fits/wang_all/two-mass --tolerance 1e-5

Exit code 0 if every impact passes, 1 if one fails.""",
    description="Compare the rebounds that another program computes with those of a fit, on its golden impacts.",
)  # fmt: skip


def run_cite(args: argparse.Namespace) -> int:
    """Print the works."""
    from fitball.api import cite

    print(cite(args.fit, args.to), end="")
    return 0


CITE = Verb(
    "cite", "references for a paper: fitball, and what a fit rests on",
    (
        option("fit", "FIT", FIT.help, nargs="?"),
        option("--to", "FORM", "bibtex or text (default: bibtex)", default="bibtex"),
    ),
    run_cite,
    """examples:
  fitball cite
  fitball cite fits/wang_all/two-mass > fit.bib
  fitball cite fits/my_balls/two-mass --to text""",
    description="""Print the works to cite. Without FIT this is fitball itself. With FIT it is also the source of the
data, of the model, and of the methods that the fit used. Data of your own are cited by source.citation of their
scene.""",
)  # fmt: skip
