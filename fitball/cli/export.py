"""`fitball export FIT --to FORMAT`: a fitted parameter set in another form."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from fitball.cli.options import add_verb, tell_notes
from fitball.errors import ParameterError, suggestion

if TYPE_CHECKING:
    from fitball.report.saved.saved_fit import SavedFit

FORMAT_NAMES = (
    "python", "c", "javascript", "csharp", "gdscript", "golden", "lookup", "engine", "json", "toml", "csv", "latex",
    "markdown", "netcdf", "certificate",
)  # fmt: skip
# Options that some formats alone have.
OWNERS = {
    "prefix": ("c", "javascript", "csharp"), "inputs_only": ("golden",), "range": ("lookup",), "at": ("engine",),
    "engine_inertia": ("engine",), "json": ("engine", "lookup"),
}  # fmt: skip
EXAMPLE = """formats:
  python     a module that needs only math: rebound(v_x1, v_y1, omega_1), with a self-test
  c          a C99 header with the same, self-test under FITBALL_SELF_TEST
  javascript the same for a page or Node (.js) and as an ES module (.mjs)
  csharp     the same for Unity, Godot and .NET
  gdscript   the same for Godot, 3 and 4
  golden     the impacts a port is checked with, and their rebounds; --inputs-only leaves these out
  lookup     rebounds on a grid, and how wrong interpolation between its points is
  engine     restitution and friction for Unity, Godot, Bullet and MuJoCo, and what they lose; as a page and as JSON
  json, toml the parameter set for other programs (json has a schema)
  csv        parameters in SI and in the thesis's units
  latex      a table for booktabs, rounded by the rule of the Particle Data Group
  markdown   the same table
  certificate one page of HTML to print and sign: result, interval, adequacy, table and its SHA-256
  netcdf     draws and data for ArviZ

examples:
  fitball export fits/wang_all/two-mass --to c --out bounce.h
  fitball export fits/wang_all/two-mass --to latex --out -
  fitball export fits/my_drops/two-mass --to certificate
  fitball export fits/wang_all/two-mass --to lookup --range "v=10..40 m/s:16, theta=10..60 deg:16, spin=-300..300:9"
  fitball export fits/wang_all/two-mass --to engine --at "v=30 m/s, theta=16 deg, spin=0 rpm"
  fitball export fits/wang_all/two-mass --to engine --json --out -

Check a port with fitball verify."""


def add_parser(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the verb to the command line."""
    parser = add_verb(
        subparsers,
        "export",
        run,
        help="a fitted parameter set in another form: C, Python, JavaScript, C#, GDScript, tables, engines",
        description="Write a fit in another form. Nothing is fitted or sampled again.",
        epilog=EXAMPLE,
    )
    parser.add_argument("fit", metavar="FIT", help="a result folder of fitball calibrate, or its fit.json")
    parser.add_argument("--to", metavar="FORMAT", required=True, help=", ".join(FORMAT_NAMES))
    parser.add_argument("--out", metavar="FILE", help="file, or - for stdout (default: a name beside fit.json)")
    parser.add_argument("--overwrite", action="store_true", help="replace files that exist")
    parser.add_argument(
        "--prefix", metavar="TEXT", help="c: beginning of every name (fitball_); javascript, csharp: of the port's"
    )
    parser.add_argument("--json", action="store_true", help="engine, lookup: the JSON alone")
    parser.add_argument("--inputs-only", action="store_true", help="golden: without the expected rebounds")
    parser.add_argument("--range", metavar="TEXT", help="lookup: the grid (default: the calibrated range)")
    parser.add_argument(
        "--at", metavar="TEXT", help="engine: operating point (default: middle of the calibrated range)"
    )
    parser.add_argument(
        "--engine-inertia", type=float, metavar="X", help="engine: I/(M R^2) of its sphere (0.4: solid)"
    )


def run(args: argparse.Namespace) -> int:
    """Write the fit in the form asked for, or print it."""
    if args.to not in FORMAT_NAMES:
        raise ParameterError(f"unknown format '{args.to}': {suggestion(args.to, FORMAT_NAMES)}")
    _refuse_idle(args)
    from fitball.export.formats import TEXT_FORMATS, Options
    from fitball.report.saved.saved_fit import read_fit

    saved = read_fit(Path(args.fit))
    if args.to == "netcdf":
        return _netcdf(args, saved)
    chosen = TEXT_FORMATS[args.to]
    given = {name: getattr(args, name) for name in OWNERS if name != "json" and getattr(args, name) is not None}
    texts = chosen.make(saved, Options(**given))
    note = chosen.note(texts)
    if args.json:
        texts = {".json": texts[".json"]}
    if args.out == "-":
        sys.stdout.write(next(iter(texts.values())))
        return 0
    places = _places(args, saved.place.parent, chosen.stem, texts)
    _write(places, texts, args.overwrite)
    if note:
        tell_notes([note])
    return 0


def _refuse_idle(args: argparse.Namespace) -> None:
    """Raise ParameterError for an option that the format does not have."""
    for name, owners in OWNERS.items():
        if getattr(args, name) not in (None, False) and args.to not in owners:
            listed = " and ".join(filter(None, (", ".join(owners[:-1]), owners[-1])))
            raise ParameterError(f"--{name.replace('_', '-')} belongs to --to {listed}, not to --to {args.to}")


def _places(args: argparse.Namespace, folder: Path, stem: str, texts: Mapping[str, str]) -> dict[str, Path]:
    """Where each text goes, by its ending; with several, the endings follow the stem of what was named."""
    if args.out is None:
        return {ending: folder / f"{stem}{ending}" for ending in texts}
    named = Path(args.out)
    if named.is_dir():
        return {ending: named / f"{stem}{ending}" for ending in texts}
    if len(texts) == 1:
        return dict.fromkeys(texts, named)
    return {ending: named.with_suffix(ending) for ending in texts}


def _write(places: Mapping[str, Path], texts: Mapping[str, str], overwrite: bool) -> None:
    from fitball.report.form.atomic_write import refuse_existing, write_text

    for place in places.values():
        refuse_existing(place, overwrite)
    for ending, place in places.items():
        write_text(place, texts[ending])
        print(place)


def _netcdf(args: argparse.Namespace, saved: SavedFit) -> int:
    from fitball.export.arviz_file import write_arviz
    from fitball.report.form.atomic_write import refuse_existing

    if args.out == "-":
        raise ParameterError("--out -: netCDF is no text; name a file")
    (place,) = _places(args, saved.place.parent, "arviz", {".nc": ""}).values()
    refuse_existing(place, args.overwrite)
    note = write_arviz(saved, place)
    if note:
        tell_notes([note])
    print(place)
    return 0
