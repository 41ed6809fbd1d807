"""The verbs that need no table. `simulate` computes one impact through time, a map of regimes or a page with sliders.
`rederive` and `bench` examine the thesis and fitball itself.
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from fitball.cli.options import (
    FIT,
    FULL,
    LEVEL,
    PICTURE,
    SEED,
    Group,
    Verb,
    count,
    either,
    marked,
    option,
    pairs,
    place,
    print_files,
    print_notes,
    stages,
    study,
    switch,
)
from fitball.cli.terminal import show
from fitball.errors import ParameterError
from fitball.models.specs import FOLLOWED

if TYPE_CHECKING:
    from fitball.api import Course
    from fitball.api.simulating import Regimes, Subject
    from fitball.bench.clock import Pace

DEFAULT_FOLDER = Path("fits") / "simulations"
# Impacts of simulated tracks: as many as Wang measured.
TRACKED = 21


def run_simulate(args: argparse.Namespace) -> int:
    """Write and print one impact through time, or a map of regimes, or a page."""
    _check_together(args)
    if args.example == "list":
        from fitball.thesis.examples import list_json, list_text

        print(json.dumps(list_json(), indent=2) if args.json else list_text())
        return 0
    if args.html:
        return _write_page(args)
    if args.tracks is not None:
        return _write_tracks(args)
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
        print_notes(result.notes)
    folder = Path(args.out) if args.out else DEFAULT_FOLDER / result.name
    more = {} if args.map is not None else {"csv": args.csv, "film": args.animate}
    places = result.save(folder, overwrite=args.overwrite, form=args.format, **more)
    print_files(args, json_text(result.json()), result.report(), places)
    return 0


def _subject(args: argparse.Namespace) -> Subject:
    """The fit or model to simulate."""
    from fitball.api import load_fit
    from fitball.api.simulating import Subject

    return Subject.from_fit(None if args.fit is None else load_fit(args.fit), args.model, args.values, args.levels)


def _check_together(args: argparse.Namespace) -> None:
    """Raises ParameterError for options that contradict each other, or if one is missing."""
    own = [f"--{name}" for name in ("impact", "fit", "model") if getattr(args, name) is not None]
    own += ["--set"] * bool(args.values) + ["--level"] * bool(args.levels)
    if args.example is not None and own:
        raise ParameterError(f"--example has its own impact and parameters: leave out {', '.join(own)}")
    idle = [f"--{name}" for name in ("impact", "example", "csv", "animate") if getattr(args, name) is not None]
    if args.map is not None and idle:
        raise ParameterError(f"--map covers many impacts: leave out {', '.join(idle)}")
    if args.tracks is not None:
        others = ("impact", "example", "map", "csv", "animate", "contours")
        mixed = [f"--{name}" for name in others if getattr(args, name) is not None] + ["--html"] * args.html
        if mixed:
            raise ParameterError(f"--tracks draws its own impacts: leave out {', '.join(mixed)}")
    elif args.camera is not None or args.impacts is not None:
        raise ParameterError(f"--{'impacts' if args.camera is None else 'camera'} needs --tracks")
    if args.map is None and args.contours is not None:
        raise ParameterError("--contours needs --map")
    if args.html:
        names = ("example", "map", "animate", "csv")
        mixed = [f"--{name}" for name in names if getattr(args, name) is not None] + ["--json"] * args.json
        if mixed:
            raise ParameterError(f"--html writes a page only: leave out {', '.join(mixed)}")
    elif all(given is None for given in (args.example, args.impact, args.map, args.tracks)):
        raise ParameterError(
            'simulate needs an impact, such as --impact "v=17, theta=18, spin=100", --map, --tracks or --example NAME'
        )
    if args.fit is not None and (args.model is not None or args.values):
        raise ParameterError("--fit has its own model and parameters: leave out --model and --set")


def _example(name: str) -> Course:
    """A figure of the thesis."""
    from fitball.api import Course
    from fitball.thesis.examples import example_json, example_text, find_example, findings, run_example

    example = find_example(name)
    solved = run_example(example)
    results = findings(example, solved)
    return Course(
        solved, example.name, f"{example.name}, solved exactly: {example.title}", panels=example.panels,
        heading=example_text(example, results), more={"example": example_json(example, results)},
    )  # fmt: skip


def _write_tracks(args: argparse.Namespace) -> int:
    """Write tracks with their truth, and print the errors that such a film leaves."""
    from fitball.api.filmed import filmed_impacts
    from fitball.report.form.files import json_text

    made = filmed_impacts(_subject(args), args.tracks, args.camera or "", args.impacts or TRACKED, args.seed)
    if not args.quiet:
        print_notes(made.notes)
    folder = Path(args.out) if args.out else DEFAULT_FOLDER / made.name
    places = made.save(folder, overwrite=args.overwrite)
    print_files(args, json_text(made.json()), made.report(), places)
    return 0


def _write_page(args: argparse.Namespace) -> int:
    """Write the page of the fit or model, and print where it is."""
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
    "simulate", "compute one impact through time, a map of regimes, or a page with sliders",
    (
        Group("what to compute (one of)", (
            option(
                "--impact", "TEXT", 'one impact, e.g. "v=17, theta=18, spin=100" (default units: m/s, deg, rad/s)'
            ),
            option(
                "--map", "TEXT",
                'a map of contact regimes over angle and spin, e.g. "v=30, theta=10..80, spin=-300..300" (default: '
                "the range of the impacts of --fit)", nargs="?", const="",
            ),
            option(
                "--tracks", "TEXT",
                "tracks of several impacts as a camera shows them, with their truth, for impacts drawn from e.g. "
                '"v=15..25, theta=16..60, spin=-300..400" (these are the defaults)', nargs="?", const="",
            ),
            switch("--html", "a page with sliders that computes bounces in the browser, starting at --impact"),
            option("--example", "NAME", "a figure of Jafri (2004), fig8 to fig28, or list"),
        )),
        Group("model and parameters", (
            option("--fit", "FIT", FIT.help),
            LEVEL,
            option("--model", "NAME", f"{either(marked(FOLLOWED))}; assumptions as +NAME=OPTION"),
            pairs(
                "--set", "NAME=VALUE", "a parameter of the model in SI units (repeatable)", convert=float,
                dest="values", form="NAME=VALUE, as in mu=0.6",
            ),
            option("--draws", "N", "posterior draws of --fit for bands (default: 200)", type=count, default=200),
        )),
        Group("camera of --tracks", (
            option(
                "--camera", "TEXT",
                'e.g. "fps=1000, noise=1mm, view=0.8m, mark=2", see below (default: fps=1000, noise=1mm)',
            ),
            option("--impacts", "N", f"number of impacts (default: {TRACKED})", type=count),
            SEED,
        )),
        Group("output", (
            option(
                "--contours", "NAME",
                "output drawn as contours in --map: v_x2, v_y2, v_2, theta_2, omega_2, contact_time, gap_time, "
                "gap_path or gap_turn (default: theta_2)",
            ),
            option(
                "--out", "DIR",
                f"result folder (default: one in {DEFAULT_FOLDER}, named after the impact); FILE.html for --html",
                type=place,
            ),
            switch("--overwrite", "replace an older result, and FILE.csv"),
            PICTURE,
            option("--animate", "FILE", "also write a slow-motion film: bounce.gif, or bounce.mp4 with ffmpeg"),
            option("--csv", "FILE.csv", "also write the time series to this file"),
            FULL,
            switch("--json", "print JSON (SI units)"),
            switch("--quiet", "print errors and files only"),
        )),
    ),
    run_simulate,
    """examples:
  fitball simulate --impact "v=38 mph, theta=18 deg, spin=950 rpm top"
  fitball simulate --impact "v=17, theta=42" --fit fits/wang_all/two-mass
  fitball simulate --impact "v=17, theta=42" --fit fits/two_surfaces/two-mass --level surface=clay
  fitball simulate --impact "v=17, theta=42" --model two-mass+torsion=free --set mu=0.6
  fitball simulate --impact "v=17, theta=42, spin=100" --animate bounce.gif
  fitball simulate --map "v=30" --set mu=0.7
  fitball simulate --map --fit fits/wang_all/two-mass --contours omega_2
  fitball simulate --html --fit fits/wang_all/two-mass --out lecture.html
  fitball simulate --tracks --camera "fps=240, noise=1mm, mark=2" --impacts 40
  fitball simulate --example fig27

camera of --tracks (names not given have defaults):
  fps=N          frames per second (1000)
  noise=LENGTH   standard deviation of each coordinate of a centre (1mm)
  view=LENGTH    width of the view, centred on the landing (0.8m); height=LENGTH above the court (0.5m)
  mark=N         the mark looks the same after 1/N turn: 1 a dot, 2 a stripe, none (1); angle=ANGLE its noise (2deg)
  outliers, lost, repeated=SHARE   of all frames (0.02, 0.05, 0)
  slow=FACTOR    standard deviation of errors that last over frames, over noise (0)
  radius=LENGTH  adds a column radius with this noise; jitter=TIME of time stamps
  scale=FACTOR, clock=FACTOR, tilt=ANGLE, court=LENGTH   errors of the session, as in [camera] of a scene""",
    description="""Compute the bounce of a fitted or chosen model: compression, velocities, spins, forces, slip and
grip.

Parameters come from a fit (--fit), from a figure of the thesis (--example), or from a model (--model, --set). The
defaults of a model are round numbers near the fits to Wang's balls. Time series are exact, from closed forms.""",
)  # fmt: skip


CHAPTER = Path("fits") / "chapter_five"


def run_rederive(args: argparse.Namespace) -> int:
    """Compute the tables again, write the page, print the checks; 1 where a count has changed."""
    from fitball.errors import check_whole
    from fitball.inference.effort import Effort
    from fitball.report.form.document import on_terminal
    from fitball.report.form.folders import held
    from fitball.thesis.chapter_five import derive
    from fitball.thesis.judgement import side_by_side
    from fitball.thesis.page import rederive_document, write

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
        show(on_terminal(rederive_document(chapter, folder)))
    return 0 if chapter.holds else 1


REDERIVE = Verb(
    "rederive", "recompute Chapter V and Appendices C and D of Jafri (2004)",
    (
        SEED,
        *study(CHAPTER),
        FULL,
    ),
    run_rederive,
    "examples:\n  fitball rederive\n  fitball rederive --out judged --json\n",
    description="""Recompute the printed tables of Jafri (2004), compare its three best cases with Wang's
measurements, and write a page. Exit code 1 if a comparison with the printed tables gives other counts than
those last reviewed.""",
)  # fmt: skip


BENCH_FOLDER = Path("fits") / "bench"


def run_bench(args: argparse.Namespace) -> int:
    """Measure, write the folder, print the summary; or compare ratios."""
    from fitball.bench import measure
    from fitball.report.form.folders import held

    extent = measure.QUICK if args.quick else measure.FULL
    if args.check is not None:
        return _check_ratios(args, extent.pace)
    folder = Path(args.out) if args.out else BENCH_FOLDER
    with held(folder):
        bench = measure.measure(extent, args.cores, stages(args.quiet))
        measure.write(bench, folder)
    if args.json:
        frames = {name: json.loads(frame.to_json(orient="records")) for name, frame in bench.frames.items()}
        print(json.dumps({"machine": bench.machine, **frames}, indent=2))
    else:
        print("\n".join(measure.summary(bench)))
        print(f"Results: {folder}")
    return 0


def _check_ratios(args: argparse.Namespace, pace: Pace) -> int:
    """Compare ratios with those kept; 1 when something has become slower."""
    from fitball.bench import measure

    kept = measure.read_ratios(args.check)
    compared = measure.compared(kept, measure.ratios(pace))
    if (compared["times"] > measure.TOLERATED).any():
        # Slowed by other programs, perhaps: the smaller of two measurements counts.
        compared = measure.least(compared, measure.compared(kept, measure.ratios(pace)))
    lines, good = measure.verdict(compared)
    print(compared.to_json(orient="records", indent=2) if args.json else "\n".join(lines))
    if not good and args.json:
        print("\n".join(lines), file=sys.stderr)
    return 0 if good else 1


BENCH = Verb(
    "bench", "measure the speed and accuracy of fitball on this machine",
    (
        switch("--quick", "take one or two minutes instead of ten"),
        option(
            "--check", "FILE",
            "measure ratios of times only and compare them with saved ones; exit code 1 if one is 1.5 times slower "
            f"(default: {BENCH_FOLDER / 'ratios.csv'})", nargs="?", const=BENCH_FOLDER / "ratios.csv",
            type=Path,
        ),
        *study(BENCH_FOLDER),
    ),
    run_bench,
    "examples:\n  fitball bench --quick\n  fitball bench --check\n",
    description="""Measure CPU time and error of one impact and of one log posterior, and compare them with other
integrators.

The result folder holds CSV files, a figure and a summary. Other samplers, many tables and whole runs are measured by
scripts/benchmark in the source tree.""",
)  # fmt: skip
