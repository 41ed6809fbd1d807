"""`fitball plot FIT KIND`: figures of a fit from its saved files."""

from __future__ import annotations

import argparse
from pathlib import Path

from fitball.cli.options import add_scheduler, count, place, tell_notes
from fitball.errors import ParameterError, suggestion
from fitball.report.figures.registry import FIGURES

KIND_LINES = "\n".join(f"  {name:10}  {text.summary}" for name, text in FIGURES.items())
FORMATS = ("png", "svg", "pdf")
HELP = "figures of a fit from its saved files"
DESCRIPTION = "Draw figures of a fit from fit.json and the draws beside it."
EXAMPLE = f"""kinds:
{KIND_LINES}
  all         every one of them that the fit can show

examples:
  fitball plot fits/wang_zero_spin/two-mass profiles
  fitball plot fits/wang_all/grip-slip/fit.json all --format pdf --out figures

Nothing is fitted or sampled again. A map of regimes over angle and spin:
  fitball simulate --map --fit FIT"""


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add what the verb may be asked."""
    parser.add_argument("fit", metavar="FIT", help="a fit.json, or the folder that holds one")
    parser.add_argument("kind", metavar="KIND", help=f"{', '.join(FIGURES)} or all")
    parser.add_argument("--format", default="png", metavar="FORMAT", help="png (default), svg or pdf")
    parser.add_argument("--out", type=place, metavar="DIR", help="folder to write to (default: beside fit.json)")
    parser.add_argument("--cores", type=count, metavar="N", help="processes that compute profiles (default: all)")
    add_scheduler(parser)
    parser.add_argument("--quiet", action="store_true", help="no notes: only errors and files")


def run(args: argparse.Namespace) -> int:
    """Draw what was asked for and print the places of the files."""
    if args.kind not in (*FIGURES, "all"):
        map_of = f"; a map of regimes: fitball simulate --map --fit {args.fit}" if "map" in args.kind else ""
        raise ParameterError(f"unknown figure '{args.kind}': {suggestion(args.kind, (*FIGURES, 'all'))}{map_of}")
    if args.format not in FORMATS:
        raise ParameterError(f"unknown format '{args.format}': {suggestion(args.format, FORMATS)}")
    from fitball.api import load_fit
    from fitball.report.form.folders import PATIENCE, held

    path = Path(args.fit)
    folder = Path(args.out) if args.out else (path if path.is_dir() else path.parent)
    # No folder is made for a fit that there is not.
    load_fit(path)
    with held(folder, PATIENCE):
        _draw(args, path, folder)
    return 0


def _draw(args: argparse.Namespace, path: Path, folder: Path) -> None:
    """Draw into the folder; a fit in it is replaced by nobody meanwhile."""
    from fitball.api import load_fit
    from fitball.api.plotting import Plots, lacks_profiles, profiled
    from fitball.report.figures.canvas import save_figure

    fit = load_fit(path)
    if args.kind == "profiles" and not args.quiet and lacks_profiles(fit):
        tell_notes(["the file holds no profiles: computing them"])
    shown = profiled(fit, args.cores, args.scheduler) if args.kind == "profiles" else fit
    kinds = [args.kind] if args.kind != "all" else list(fit.plot)
    left_out = [name for name in FIGURES if args.kind == "all" and name not in (*kinds, "force")]
    if left_out and not args.quiet:
        tell_notes([f"left out {', '.join(left_out)}: this fit has not what they show"])
    for name in kinds:
        place = folder / f"{name}.{args.format}"
        save_figure(Plots(shown)(name), place, args.format)
        print(place)
