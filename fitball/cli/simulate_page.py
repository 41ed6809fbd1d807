"""`fitball simulate --html`: the page with sliders."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from fitball.inference.results.fitted_model import FittedModel


def write_page(args: argparse.Namespace) -> int:
    """Write the page of the fit or model that was asked for. Raises ParameterError."""
    from fitball.cli.simulate import DEFAULT_FOLDER
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
