"""`fitball simulate`: one impact through time, as table, files and figure."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

from fitball.cli.options import count, either, marked, pairs, place, tell_files, tell_notes
from fitball.errors import ParameterError, suggestion
from fitball.models.names import FOLLOWED

if TYPE_CHECKING:
    from fitball.api import Course

FORMATS = ("png", "svg", "pdf")
DEFAULT_FOLDER = Path("fits") / "simulations"
HELP = "one impact through time: velocities, spins, forces, slip and grip"
DESCRIPTION = """Follow one impact through time: compression, velocities, both spins, forces, slip and grip; as a film
too (--animate). Or map the regimes of contact over angle and spin (--map).

Parameters come from a fit (--fit), from a model with round defaults near the fits to Wang's balls (--model, --set),
or from a figure of Jafri's thesis (--example). Courses are exact, from the closed forms of the model.

--html writes a page with sliders instead, which computes the bounce in the browser: one file, no network."""
EXAMPLE = """examples:
  fitball simulate --impact "v=38 mph, theta=18 deg, spin=950 rpm top"
  fitball simulate --impact "v=17, theta=42, spin=100" --fit fits/wang_all/two-mass
  fitball simulate --impact "v_x=12, v_y=10" --model two-mass+torsion=free --set mu=0.6 --set zeta_theta=0.2
  fitball simulate --impact "v=17, theta=42, spin=100" --animate bounce.gif
  fitball simulate --map "v=30" --set mu=0.7
  fitball simulate --map --fit fits/wang_all/two-mass --contours omega_2
  fitball simulate --example fig27
  fitball simulate --example list
  fitball simulate --html --fit fits/wang_all/two-mass --out lecture.html"""


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add what the verb may be asked."""
    parser.add_argument(
        "--impact", metavar="TEXT", help='the impact, e.g. "v=17, theta=18, spin=100" (default: m/s, deg, rad/s)'
    )
    parser.add_argument("--fit", metavar="FIT", help="a result folder of fitball calibrate, or its fit.json")
    parser.add_argument(
        "--model", metavar="NAME", help=f"{either(marked(FOLLOWED))}, with +CLOSURE=OPTION for each one changed"
    )
    parser.add_argument(
        "--set", metavar="NAME=VALUE", action="append", default=[], dest="values",
        help="a parameter of the model in SI units; repeatable",
    )  # fmt: skip
    parser.add_argument(
        "--map", nargs="?", const="", metavar="TEXT",
        help='instead of one impact the regimes of contact over angle and spin, e.g. "v=30, theta=10..80, '
        'spin=-300..300" (default: around the impacts of --fit)',
    )  # fmt: skip
    parser.add_argument(
        "--contours", metavar="NAME", help="of --map: v_x2, v_y2, v_2, theta_2 (default), omega_2 or contact_time"
    )
    parser.add_argument(
        "--html", action="store_true",
        help="a page with sliders instead, of --fit or --model, begun at --impact (--out: a folder or FILE.html)",
    )  # fmt: skip
    parser.add_argument("--example", metavar="NAME", help="fig8 to fig28 of Jafri (2004), or list")
    parser.add_argument(
        "--draws", type=count, default=200, metavar="N", help="posterior draws of --fit (default 200)"
    )
    parser.add_argument(
        "--out",
        type=place,
        metavar="DIR",
        help=f"result folder (default: one named for the impact in {DEFAULT_FOLDER}/)",
    )
    parser.add_argument("--overwrite", action="store_true", help="replace an older result, and FILE.csv")
    parser.add_argument("--format", default="png", metavar="FORMAT", help="of the figure: png (default), svg or pdf")
    parser.add_argument(
        "--animate",
        metavar="FILE",
        help="write a slow-motion film of the bounce: bounce.gif, or bounce.mp4 with ffmpeg",
    )
    parser.add_argument("--csv", metavar="FILE.csv", help="write the courses to this file too")
    parser.add_argument("--json", action="store_true", help="print JSON (SI units)")
    parser.add_argument("--quiet", action="store_true", help="no table and no notes: only errors and files")


def run(args: argparse.Namespace) -> int:
    """Solve the impact, write its course, print it."""
    if args.format not in FORMATS:
        raise ParameterError(f"unknown format '{args.format}': {suggestion(args.format, FORMATS)}")
    _check_together(args)
    args.values = pairs("--set", args.values, float, "NAME=VALUE, as in mu=0.6")
    if args.map is not None:
        from fitball.cli.simulate_map import run_map

        return run_map(args)
    if args.example == "list":
        from fitball.thesis.example_claims import list_json, list_text

        print(json.dumps(list_json(), indent=2) if args.json else list_text())
        return 0
    if args.html:
        from fitball.cli.simulate_page import write_page

        return write_page(args)
    from fitball.report.form.files import refuse_existing
    from fitball.report.form.folders import clear_folder, held
    from fitball.report.history.document import CSV_NAME, FIGURE_STEM, JSON_NAME

    if args.animate is not None:
        from fitball.report.history.film import check_film

        check_film(Path(args.animate))
    course, extra, text, name = _example(args) if args.example else _one(args)
    folder = Path(args.out) if args.out else DEFAULT_FOLDER / name
    if args.animate is not None and len(course.simulations) > 1:
        raise ParameterError(f"--animate shows one bounce; example {name} has {len(course.simulations)}")
    for written in (args.csv, args.animate):
        if written is not None:
            refuse_existing(Path(written), args.overwrite)
    with held(folder):
        clear_folder(folder, JSON_NAME, CSV_NAME, f"{FIGURE_STEM}.*", overwrite=args.overwrite)
        _write(args, folder, course, extra, text)
    return 0


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


def _one(args: argparse.Namespace) -> tuple[Course, dict[str, Any], str, str]:
    """The impact that was asked for: its course, what its file says besides, its text, and a name for its folder."""
    from fitball.api import simulate
    from fitball.data.lines import parse_impact

    impact = parse_impact(args.impact)
    course = simulate(impact, fit=args.fit, model=args.model, values=args.values, draws=args.draws)
    if not args.quiet:
        tell_notes(course.notes)
    v_x, v_y, omega = (float(item[0]) for item in (impact.v_x1, impact.v_y1, impact.omega_1))
    name = f"{course.source}_{v_x:.4g}_{v_y:.4g}_{omega:.4g}"
    return course, {"notes": list(course.notes)}, course.report(), name


def _example(args: argparse.Namespace) -> tuple[Course, dict[str, Any], str, str]:
    """A figure of the thesis, as `_one`."""
    from fitball.api import Course
    from fitball.thesis.example_claims import example_json, example_text, find_example, findings, run_example

    example = find_example(args.example)
    solved = run_example(example)
    results = findings(example, solved)
    title = f"{example.name}, solved exactly: {example.title}"
    course = Course(solved, example.name, title, panels=example.panels)
    text = example_text(example, results) + "\n\n" + course.report()
    return course, {"example": example_json(example, results)}, text, example.name


def _write(args: argparse.Namespace, folder: Path, course: Course, extra: dict[str, Any], text: str) -> None:
    """Figure and files, then what was asked for on stdout."""
    from fitball.report.form.files import csv_text, json_text, write_text
    from fitball.report.history.document import history_rows, simulation_json, write_all

    content = {**extra, "simulations": [simulation_json(simulation) for simulation in course.simulations]}
    table = csv_text(history_rows(course.simulations))
    places = write_all(folder, content, table, course.plot(), args.format)
    if args.csv is not None:
        write_text(Path(args.csv), table, named=True)
        places = (*places, Path(args.csv))
    if args.animate is not None:
        from fitball.report.history.film import write_film

        write_film(course.simulations[0], course.title, Path(args.animate))
        places = (*places, Path(args.animate))
    tell_files(args, json_text(content), text, places)
