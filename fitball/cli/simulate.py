"""`fitball simulate`: one impact through time, a map of regimes over angle and spin, or a page with sliders."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import TYPE_CHECKING

from fitball.cli.options import Verb, count, either, marked, option, pairs, place, switch, tell_files, tell_notes
from fitball.errors import ParameterError, suggestion
from fitball.models.names import FOLLOWED

if TYPE_CHECKING:
    from fitball.api import Course
    from fitball.api.simulating import Regimes, Subject

FORMATS = ("png", "svg", "pdf")
DEFAULT_FOLDER = Path("fits") / "simulations"


def run_simulate(args: argparse.Namespace) -> int:
    """Solve the impact, write its course, print it; or a map of regimes, or a page."""
    if args.format not in FORMATS:
        raise ParameterError(f"unknown format '{args.format}': {suggestion(args.format, FORMATS)}")
    _check_together(args)
    if args.example == "list":
        from fitball.thesis.example_claims import list_json, list_text

        print(json.dumps(list_json(), indent=2) if args.json else list_text())
        return 0
    if args.html:
        return _write_page(args)
    from fitball.api.simulating import course_of, regimes_of
    from fitball.report.form.files import json_text

    if args.animate is not None:
        from fitball.report.history.film import check_film

        check_film(Path(args.animate))
    result: Course | Regimes
    if args.map is not None:
        result = regimes_of(_subject(args), args.map, args.contours)
    else:
        result = _example(args.example) if args.example else course_of(_subject(args), args.impact, args.draws)
    if not args.quiet:
        tell_notes(result.notes)
    folder = Path(args.out) if args.out else DEFAULT_FOLDER / result.name
    more = {} if args.map is not None else {"csv": args.csv, "film": args.animate}
    places = result.save(folder, overwrite=args.overwrite, form=args.format, **more)
    tell_files(args, json_text(result.json()), result.report(), places)
    return 0


def _subject(args: argparse.Namespace) -> Subject:
    """What bounces."""
    from fitball.api import load_fit
    from fitball.api.simulating import Subject

    return Subject.of(None if args.fit is None else load_fit(args.fit), args.model, args.values)


def _check_together(args: argparse.Namespace) -> None:
    """Raises ParameterError for options that contradict each other or say too little."""
    own = [f"--{name}" for name in ("impact", "fit", "model") if getattr(args, name) is not None]
    own += ["--set"] if args.values else []
    if args.example is not None and own:
        raise ParameterError(f"--example brings its own impact and parameters: leave out {', '.join(own)}")
    idle = [f"--{name}" for name in ("impact", "example", "csv", "animate") if getattr(args, name) is not None]
    if args.map is not None and idle:
        raise ParameterError(f"--map is about many impacts: leave out {', '.join(idle)}")
    if args.map is None and args.contours is not None:
        raise ParameterError("--contours belongs to --map")
    if args.html:
        names = ("example", "map", "animate", "csv")
        mixed = [f"--{name}" for name in names if getattr(args, name) is not None] + ["--json"] * args.json
        if mixed:
            raise ParameterError(f"--html writes a page and nothing else: leave out {', '.join(mixed)}")
    elif args.example is None and args.impact is None and args.map is None:
        raise ParameterError(
            'simulate needs an impact, such as --impact "v=17, theta=18, spin=100", --map, or --example NAME'
        )
    if args.fit is not None and (args.model is not None or args.values):
        raise ParameterError("--fit brings its own model and parameters: leave out --model and --set")


def _example(name: str) -> Course:
    """A figure of the thesis."""
    from fitball.api import Course
    from fitball.thesis.example_claims import example_json, example_text, find_example, findings, run_example

    example = find_example(name)
    solved = run_example(example)
    results = findings(example, solved)
    return Course(
        solved, example.name, f"{example.name}, solved exactly: {example.title}", panels=example.panels,
        heading=example_text(example, results), more={"example": example_json(example, results)},
    )  # fmt: skip


def _write_page(args: argparse.Namespace) -> int:
    """Write the page of the fit or model that was asked for, and print where it lies."""
    from fitball.api.simulating import page_of
    from fitball.data.lines import parse_impact
    from fitball.files import is_stream
    from fitball.report.form.files import refuse_existing, write_text

    subject = _subject(args)
    page = page_of(subject, None if args.impact is None else parse_impact(args.impact))
    place = Path(args.out) if args.out else DEFAULT_FOLDER
    if place.suffix != ".html":
        place.mkdir(parents=True, exist_ok=True)
        place /= f"interactive_{subject.name}.html"
    refuse_existing(place, args.overwrite)
    write_text(place, page, named=True)
    if not is_stream(place):
        print(place)
    return 0


SIMULATE = Verb(
    "simulate", "one impact through time: velocities, spins, forces, slip and grip",
    (
        option("--impact", "TEXT", 'the impact, e.g. "v=17, theta=18, spin=100" (default: m/s, deg, rad/s)'),
        option("--fit", "FIT", "a result folder of fitball calibrate, or its fit.json"),
        option("--model", "NAME", f"{either(marked(FOLLOWED))}, with +CLOSURE=OPTION for each one changed"),
        pairs(
            "--set", "NAME=VALUE", "a parameter of the model in SI units; repeatable", convert=float, dest="values",
            form="NAME=VALUE, as in mu=0.6",
        ),
        option(
            "--map", "TEXT",
            'instead of one impact the regimes of contact over angle and spin, e.g. "v=30, theta=10..80, '
            'spin=-300..300" (default: around the impacts of --fit)', nargs="?", const="",
        ),
        option("--contours", "NAME", "of --map: v_x2, v_y2, v_2, theta_2 (default), omega_2 or contact_time"),
        switch(
            "--html",
            "a page with sliders instead, of --fit or --model, begun at --impact (--out: a folder or FILE.html)",
        ),
        option("--example", "NAME", "fig8 to fig28 of Jafri (2004), or list"),
        option("--draws", "N", "posterior draws of --fit (default 200)", type=count, default=200),
        option("--out", "DIR", f"result folder (default: one named for the impact in {DEFAULT_FOLDER}/)", type=place),
        switch("--overwrite", "replace an older result, and FILE.csv"),
        option("--format", "FORMAT", "of the figure: png (default), svg or pdf", default="png"),
        option("--animate", "FILE", "write a slow-motion film of the bounce: bounce.gif, or bounce.mp4 with ffmpeg"),
        option("--csv", "FILE.csv", "write the courses to this file too"),
        switch("--json", "print JSON (SI units)"),
        switch("--quiet", "no table and no notes: only errors and files"),
    ),
    run_simulate,
    """examples:
  fitball simulate --impact "v=38 mph, theta=18 deg, spin=950 rpm top"
  fitball simulate --impact "v=17, theta=42, spin=100" --fit fits/wang_all/two-mass
  fitball simulate --impact "v_x=12, v_y=10" --model two-mass+torsion=free --set mu=0.6 --set zeta_theta=0.2
  fitball simulate --impact "v=17, theta=42, spin=100" --animate bounce.gif
  fitball simulate --map "v=30" --set mu=0.7
  fitball simulate --map --fit fits/wang_all/two-mass --contours omega_2
  fitball simulate --example fig27
  fitball simulate --example list
  fitball simulate --html --fit fits/wang_all/two-mass --out lecture.html""",
    description="""Follow one impact through time: compression, velocities, both spins, forces, slip and grip; as a
film too (--animate). Or map the regimes of contact over angle and spin (--map).

Parameters come from a fit (--fit), from a model with round defaults near the fits to Wang's balls (--model, --set),
or from a figure of Jafri's thesis (--example). Courses are exact, from the closed forms of the model.

--html writes a page with sliders instead, which computes the bounce in the browser: one file, no network.""",
)  # fmt: skip
