"""`fitball simulate --map`: regimes of contact over angle and spin."""

from __future__ import annotations

import argparse
import math
from pathlib import Path
from typing import TYPE_CHECKING

from fitball.cli.options import tell_files, tell_notes
from fitball.errors import ParameterError, suggestion

if TYPE_CHECKING:
    from fitball.inference.prediction.regime_map import Window
    from fitball.inference.results.fitted_model import FittedModel
    from fitball.values import Impacts

DEFAULT_FOLDER = Path("fits") / "simulations"
CSV_NAME, JSON_NAME, FIGURE_STEM = "regime_map.csv", "regime_map.json", "regime_map"
# Without a fit: a rally's drive; from grazing to steep, and as much spin as players make.
SPEED, ANGLE, SPIN = 25.0, (math.radians(5.0), math.radians(85.0)), 400.0
CONTOURS = "theta_2"


def run_map(args: argparse.Namespace) -> int:
    """Compute the map, write figure, table and record, and print it in words."""
    from fitball.data.lines import parse_window
    from fitball.files import all_or_none
    from fitball.inference.prediction.regime_map import regime_map
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
    places = [folder / f"{FIGURE_STEM}.{args.format}", folder / CSV_NAME, folder / JSON_NAME]
    content = json_text({"model": fitted.model.name, "closures": dict(fitted.model.options), **map_json(found)})
    with held(folder), all_or_none():
        clear_folder(folder, JSON_NAME, CSV_NAME, f"{FIGURE_STEM}.*", overwrite=args.overwrite)
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
    from fitball.api.simulating import model_at
    from fitball.inference.results.fitted_model import at_values

    model, parameters, notes = model_at(args.model, args.values)
    if not args.quiet:
        tell_notes(notes)
    return at_values(model, parameters), model.name, None, ""


def _window(asked: dict[str, tuple[float, float]], impacts: Impacts | None) -> Window:
    """What the map shows: as asked for, else around the impacts."""
    import numpy as np

    from fitball.inference.prediction.regime_map import Window

    speed, angle, spin = SPEED, ANGLE, SPIN
    if impacts is not None:
        speed = float(np.median(impacts.speed))
        angles = impacts.angle
        angle = (min(angle[0], float(0.9 * angles.min())), max(angle[1], min(float(1.1 * angles.max()), math.pi)))
        spin = max(spin, 1.1 * float(np.max(np.abs(impacts.omega_1))))
    return Window(
        asked.get("v_1", (speed, speed))[0], asked.get("theta_1", angle), asked.get("omega_1", (-spin, spin))
    )
