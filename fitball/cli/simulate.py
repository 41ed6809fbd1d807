"""`fitball simulate`: one impact through time, a map of regimes over angle and spin, or a page with sliders."""

from __future__ import annotations

import argparse
import json
import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

from fitball.cli.options import Verb, count, either, marked, option, pairs, place, switch, tell_files, tell_notes
from fitball.errors import ParameterError, suggestion
from fitball.models.names import FOLLOWED

if TYPE_CHECKING:
    from fitball.api import Course
    from fitball.inference.prediction.simulate import Window
    from fitball.inference.results.fitted_model import FittedModel
    from fitball.values import Impacts


FORMATS = ("png", "svg", "pdf")
DEFAULT_FOLDER = Path("fits") / "simulations"


def run_simulate(args: argparse.Namespace) -> int:
    """Solve the impact, write its course, print it."""
    if args.format not in FORMATS:
        raise ParameterError(f"unknown format '{args.format}': {suggestion(args.format, FORMATS)}")
    _check_together(args)
    args.values = pairs("--set", args.values, float, "NAME=VALUE, as in mu=0.6")
    if args.map is not None:
        return run_map(args)
    if args.example == "list":
        from fitball.thesis.example_claims import list_json, list_text

        print(json.dumps(list_json(), indent=2) if args.json else list_text())
        return 0
    if args.html:
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


SIMULATE = Verb(
    "simulate", "one impact through time: velocities, spins, forces, slip and grip",
    (
        option("--impact", "TEXT", 'the impact, e.g. "v=17, theta=18, spin=100" (default: m/s, deg, rad/s)'),
        option("--fit", "FIT", "a result folder of fitball calibrate, or its fit.json"),
        option("--model", "NAME", f"{either(marked(FOLLOWED))}, with +CLOSURE=OPTION for each one changed"),
        option(
            "--set", "NAME=VALUE", "a parameter of the model in SI units; repeatable", action="append", default=[],
            dest="values",
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


MAP_CSV, MAP_JSON, MAP_STEM = "regime_map.csv", "regime_map.json", "regime_map"
# Without a fit: a rally's drive; from grazing to steep, and as much spin as players make.
SPEED, ANGLE, SPIN = 25.0, (math.radians(5.0), math.radians(85.0)), 400.0
CONTOURS = "theta_2"


def run_map(args: argparse.Namespace) -> int:
    """Compute the map, write figure, table and record, and print it in words."""
    from fitball.data.lines import parse_window
    from fitball.files import all_or_none
    from fitball.inference.prediction.simulate import regime_map
    from fitball.report.figures.canvas import save_figure
    from fitball.report.form.files import csv_text, json_text, write_text
    from fitball.report.form.folders import clear_folder, held
    from fitball.report.history.regime_map import contour_names, map_figure, map_json, map_rows, map_text

    contours = CONTOURS if args.contours is None else args.contours
    if contours not in contour_names():
        raise ParameterError(f"unknown quantity '{contours}': {suggestion(contours, contour_names())}")
    asked = parse_window(args.map)
    fitted, title, impacts, source = _from_fit(args) if args.fit is not None else _from_values(args)
    if contours == "contact_time" and not fitted.model.has_time:
        raise ParameterError(f"--contours contact_time: model {fitted.model.name} has none")
    found = regime_map(fitted, _window(asked, impacts))
    name = f"map_{'fit_' if args.fit is not None else ''}{fitted.model.name}_{found.window.speed:.4g}"
    folder = Path(args.out) if args.out else DEFAULT_FOLDER / name
    figure = map_figure(found, title, contours, impacts, source)
    places = [folder / f"{MAP_STEM}.{args.format}", folder / MAP_CSV, folder / MAP_JSON]
    content = json_text({"model": fitted.model.name, "closures": dict(fitted.model.options), **map_json(found)})
    with held(folder), all_or_none():
        clear_folder(folder, MAP_JSON, MAP_CSV, f"{MAP_STEM}.*", overwrite=args.overwrite)
        save_figure(figure, places[0], args.format)
        write_text(places[1], csv_text(map_rows(found)))
        write_text(places[2], content)
    tell_files(args, content, map_text(found, title), places)
    return 0


def _from_fit(args: argparse.Namespace) -> tuple[FittedModel, str, Impacts | None, str]:
    """A fit, and the impacts it was made from."""
    from fitball.api import load_fit

    saved = load_fit(args.fit)
    if saved.at_common and not args.quiet:
        tell_notes([saved.at_common])
    table = saved.source.name
    return saved.fitted, f"{saved.fitted.model.name} fitted to {table}", saved.impacts, table


def _from_values(args: argparse.Namespace) -> tuple[FittedModel, str, Impacts | None, str]:
    """A model at its defaults, some of them set."""
    from fitball.api.predicting import model_at
    from fitball.inference.results.fitted_model import at_values

    model, parameters, notes = model_at(args.model, args.values)
    if not args.quiet:
        tell_notes(notes)
    return at_values(model, parameters), model.name, None, ""


def _window(asked: dict[str, tuple[float, float]], impacts: Impacts | None) -> Window:
    """What the map shows: as asked for, else around the impacts."""
    import numpy as np

    from fitball.inference.prediction.simulate import Window

    speed, angle, spin = SPEED, ANGLE, SPIN
    if impacts is not None:
        speed = float(np.median(impacts.speed))
        angles = impacts.angle
        angle = (min(angle[0], float(0.9 * angles.min())), max(angle[1], min(float(1.1 * angles.max()), math.pi)))
        spin = max(spin, 1.1 * float(np.max(np.abs(impacts.omega_1))))
    return Window(
        asked.get("v_1", (speed, speed))[0], asked.get("theta_1", angle), asked.get("omega_1", (-spin, spin))
    )


def write_page(args: argparse.Namespace) -> int:
    """Write the page of the fit or model that was asked for. Raises ParameterError."""
    from fitball.data.lines import parse_impact
    from fitball.exports.interactive import interactive_page, round_impact
    from fitball.files import is_stream
    from fitball.report.form.files import refuse_existing, write_text

    fitted, intro, origin, name = _page_of_fit(args.fit) if args.fit is not None else _page_of_values(args)
    impact = round_impact(fitted) if args.impact is None else parse_impact(args.impact)
    place = Path(args.out) if args.out else DEFAULT_FOLDER
    if place.suffix != ".html":
        place.mkdir(parents=True, exist_ok=True)
        place /= f"interactive_{name}.html"
    refuse_existing(place, args.overwrite)
    write_text(place, interactive_page(fitted, impact, intro, origin), named=True)
    if not is_stream(place):
        print(place)
    return 0


def _page_of_fit(place: str) -> tuple[FittedModel, str, str, str]:
    """The fitted model, a sentence and a phrase about it, its name."""
    from fitball.api import load_fit
    from fitball.exports.formats import origin_of

    saved = load_fit(place)
    table = saved.source
    intro = f"As fitted to {table.name}, {table.impacts} impacts."
    return saved.fitted, intro, origin_of(saved), f"fit_{saved.fitted.model_name}"


def _page_of_values(args: argparse.Namespace) -> tuple[FittedModel, str, str, str]:
    """The same of a model at its defaults, some of them set."""
    from fitball.exports.interactive import preset
    from fitball.inference.comparison.candidates import parse_name
    from fitball.models.names import DEFAULT_MODEL

    name, closures = parse_name(args.model if args.model is not None else DEFAULT_MODEL)
    given = ", some of them given" if args.values else ""
    intro = f"No fit: round parameters near the fits to the balls of Wang (1989){given}."
    return preset(name, closures, args.values), intro, "no fit, round parameters", name
