"""The verb that takes films: `track`, from positions of a ball to a table of impacts."""

from __future__ import annotations

import argparse
from pathlib import Path

from fitball.cli.options import FULL, OVERWRITE, Group, Verb, option, pairs, place, print_notes, print_result, switch
from fitball.errors import ParameterError

FOLDER = Path("tracks")


def default_folder(files: list[str]) -> Path:
    """tracks/<first file>/."""
    return FOLDER / Path(files[0]).stem


def run_track(args: argparse.Namespace) -> int:
    """Find impacts, write the folder, print the result; with `--calibrate` go on to a fit."""
    args.progress("reading positions", None)
    from fitball.api.tracking import track
    from fitball.report.form.folders import refuse_older
    from fitball.report.tracks.folder import TABLE

    if args.calibrate and args.json:
        raise ParameterError("--calibrate prints a fit and --json the impacts: leave one of them out")
    folder = Path(args.out) if args.out else default_folder(args.files)
    refuse_older(folder, TABLE, overwrite=args.overwrite)
    found = track(
        args.files, fps=args.fps, scene=args.config, scale=args.scale, ball_diameter=args.ball_diameter,
        court=args.court, y_down=args.y_down or None, up=args.up, unit=args.unit, fold=args.fold,
        clockwise=args.clockwise, columns=args.columns, as_read=args.as_read,
    )  # fmt: skip
    args.progress("figures and files", None)
    found.save(folder, overwrite=args.overwrite, figures=not args.no_figures, command=args.command)
    args.progress.finish()
    if not args.quiet and not args.json:
        print_notes(found.tracks.notes, args.full)
    if not args.calibrate:
        print_result(args, found, folder / TABLE, folder)
        return 0
    return _calibrate(args, folder)


def _calibrate(args: argparse.Namespace, folder: Path) -> int:
    """Run `fitball calibrate` on the table that was written."""
    from fitball.cli.main import make_parser

    words = ["calibrate", str(folder / "impacts.csv"), "--out", str(folder / "fit")]
    words += [f"--{name}" for name in ("quiet", "full", "overwrite") if getattr(args, name)]
    words += ["--no-figures"] * args.no_figures + ["--point-only"] * args.point_only
    asked = make_parser().parse_args(words)
    asked.progress, asked.command = args.progress, args.command
    return int(asked.run(asked))


TRACK = Verb(
    "track", "find impacts in positions of a ball on film: a table with errors, ready for calibrate",
    (
        option("files", "FILES", "positions of a ball in frames (CSV, workbook, HDF5)", nargs="+"),
        Group("film", (
            option(
                "--scene", "FILE.toml",
                "what is known about ball and camera (default: the .toml file beside the first of FILES)",
                dest="config",
            ),
            option("--fps", "N", "frames per second of the camera, if a file counts frames", type=float),
            option("--scale", "SIZE", "size of a pixel, e.g. 0.8mm/px"),
            option(
                "--ball-diameter", "LENGTH",
                "diameter of the ball, e.g. 66mm: scale of pixels by the column radius", dest="ball_diameter",
            ),
            option(
                "--court", "Y",
                "height of the court in coordinates of the file, e.g. 0mm or 812px (default: found from contacts)",
            ),
            switch("--y-down", "y grows downwards, as rows of a picture (default: found from the motion)"),
            option("--up", "AXIS", "which of three axes points up: x, y, z or -z (default: found from the motion)"),
            option("--unit", "UNIT", "unit of positions where a file states none: m, mm or px"),
            option(
                "--fold", "N",
                "the mark looks the same after 1/N turn (1: a dot, 2: a stripe), where a file does not say",
                type=int,
            ),
            switch("--clockwise", "angles of marks grow clockwise in the picture (default: counterclockwise)"),
            pairs(
                "--columns", "OURS=THEIRS,...", 'names of the columns in these files, e.g. "x=Ball X, y=Ball Y"',
                several=True, form="OURS=THEIRS once for each column, separated by commas",
            ),
            switch("--as-read", "accept scale, clock and angles even if gravity or bounces contradict them"),
        )),
        Group("output", (
            option("--out", "DIR", f"result folder (default: {FOLDER}/<file>)", type=place),
            switch("--calibrate", "go on with fitball calibrate, into the folder fit in DIR"),
            switch("--point-only", "with --calibrate: best-fit values only"),
            switch("--no-figures", "draw no pictures"),
            OVERWRITE,
            FULL,
            switch("--json", "print impacts, session and notes as JSON (SI units)"),
            switch("--quiet", "print errors and the table only"),
        )),
    ),
    run_track,
    """examples:
  fitball track clip.csv --fps 1000
  fitball track tracker_export.txt --fps 240 --ball-diameter 66mm --court 812px
  fitball track session/*.csv --scene session.toml --out results/session
  fitball track clip.csv --fps 1000 --calibrate

files:
  long table  columns id, t [s] or frame, x [m], y [m]; also angle [deg], angle_fold, radius, quality, session
  exports     of Tracker, Kinovea, DLTdv and DeepLabCut, as they are

The folder holds impacts.csv (states before and after with standard errors, and time, path and turn between the
flights), impacts_covariance.csv, impacts.toml (what the session shares: scale, clock, tilt, height of the court),
tracks.csv (every frame), spins.csv (all spins that the marks allow) and tracks.html. Then:
  fitball calibrate DIR/impacts.csv""",
    description="""Find impacts in positions of a ball on film, and their errors.

The flights before and after an impact are fitted with gravity, drag and Magnus force. Frames of the contact are left
out, and outliers are recognised. Spins come from marks on the ball. If frames allow several spins and none has more
than 99.9 % probability, the spins stay empty in impacts.csv. Exit code 2 if no track has an impact.""",
)  # fmt: skip
