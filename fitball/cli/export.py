"""`fitball export FIT --to FORMAT`: a fitted parameter set in another form."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from fitball.cli.options import place, tell_notes
from fitball.errors import ParameterError, suggestion
from fitball.exports import FORMAT_NAMES, OWNERS

HELP = "a fitted parameter set in another form: C, Python, JavaScript, C#, tables, engines"
DESCRIPTION = "Write a fit in another form. Nothing is fitted or sampled again."
EXAMPLE = """formats:
  python     a module that needs only math: rebound(v_x1, v_y1, omega_1), with a self-test
  c          a C99 header with the same, self-test under FITBALL_SELF_TEST
  javascript the same for a page or Node (.js) and as an ES module (.mjs)
  csharp     the same for Unity, Godot and .NET
  golden     the impacts a port is checked with, and their rebounds; --inputs-only leaves these out
  lookup     rebounds on a grid, and how wrong interpolation between its points is
  engine     restitution and friction for Unity, Godot, Bullet and MuJoCo, and what they lose; as a page and as JSON
  json       the parameter set for other programs, with a schema; summary.csv of the result folder has it as CSV
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


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add what the verb may be asked."""
    parser.add_argument("fit", metavar="FIT", help="a result folder of fitball calibrate, or its fit.json")
    parser.add_argument("--to", metavar="FORMAT", required=True, help=", ".join(FORMAT_NAMES))
    parser.add_argument(
        "--out", type=place, metavar="FILE", help="file, or - for stdout (default: a name beside fit.json)"
    )
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
    from fitball.api import load_fit
    from fitball.files import is_stream

    fit = load_fit(args.fit)
    made = fit.exported(args.to, {name: getattr(args, name) for name in OWNERS})
    if args.out == "-":
        if made.tree is not None:
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
