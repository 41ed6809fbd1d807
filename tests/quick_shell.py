"""Snippets of pages run quickly: `fitball` in this process, few steps, figures drawn but not rendered."""

from __future__ import annotations

import contextlib
import io
import shlex
from pathlib import Path

import matplotlib.figure
from samples import search_briefly
from snippets import posix_shell

import fitball
from fitball.cli.main import main
from fitball.inference.comparison import left_out
from fitball.report.figures import canvas
from fitball.report.history import film

# What is added to a line of each verb; the road is the same, only shorter. Three fits are sampled: that of the table
# which most pages share and of two whose posteriors pages use; pictures that a fit lacks for it are blank.
SHORTER = {
    "calibrate": ("--point-only", "--cores", "1"),
    "compare": ("--models", "brody,grip-slip", "--max-steps", "100", "--cores", "1"),
}
SAMPLED = {"wang_all.csv", "synthetic_court.csv", "two_surfaces.csv"}
NOT_DRAWN = ("corner.png", "trace.png", "profiles.png", "forest.png")
STEPS = 100
# One white pixel.
PNG = bytes.fromhex(
    "89504e470d0a1a0a0000000d4948445200000001000000010802000000907753de0000000c49444154789c63f8ffff3f0005fe02fe0def46b8"
    "0000000049454e44ae426082"
)
SVG = b'<svg xmlns="http://www.w3.org/2000/svg" width="1" height="1"/>'
BLANK = {"png": PNG, "svg": SVG, "pdf": b"%PDF-1.4\n", "gif": b"GIF89a"}


def blank(_figure, target, *, format=None, **_options):
    """In the place of `Figure.savefig`."""
    form = format or Path(target).suffix[1:]
    if hasattr(target, "write"):
        target.write(BLANK[form])
    else:
        Path(target).write_bytes(BLANK[form])


def make_quick(patch) -> None:
    """Let figures stay blank, and searches be short: few starts and steps, no second looks, profiles of short tables
    alone, few folds. Other tests look at all of these.
    """
    calibrate = fitball.calibrate
    search_briefly(patch)
    patch.setattr(matplotlib.figure.Figure, "savefig", blank)
    patch.setattr(canvas, "rendered", lambda _figure, form, _dpi: BLANK[form])
    patch.setattr(fitball, "calibrate", lambda *a, **k: calibrate(*a, **{"max_steps": STEPS, "cores": 1} | k), False)
    patch.setattr(film, "DPI", 8)
    patch.setattr(left_out, "SINGLY", 1)
    patch.setattr(left_out, "FOLDS", 2)


def quick_shell(code: str, folder: Path) -> tuple[int, str]:
    """See `snippets.Shell`: lines of `fitball` alone run here, all others by `sh`."""
    told = ""
    for line in code.replace("\\\n", " ").splitlines():
        words = shlex.split(line, comments=True)
        if not words:
            continue
        if words[0] == "fitball" and not {">", "|", "&&", ";"} & set(words):
            status, printed = _fitball(words[1:], folder)
        else:
            status, printed = posix_shell(line, folder)
        told += printed
        if status:
            return status, told
    return 0, told


def _fitball(words: list[str], folder: Path) -> tuple[int, str]:
    out, err = io.StringIO(), io.StringIO()
    shorter = SHORTER.get(words[0], ()) if words and not {"--help", "--point-only"} & set(words) else ()
    if shorter and words[0] == "calibrate" and SAMPLED & set(words):
        shorter = ("--max-steps", str(STEPS), "--cores", "1")
    with contextlib.chdir(folder), contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        try:
            status = main([*words, *shorter])
        except SystemExit as end:
            status = end.code or 0
    told = out.getvalue() + err.getvalue()
    # Too few steps to converge is what was asked for.
    if shorter and status == 1 and "converge" in told.lower():
        status = 0
    if shorter:
        _fill(folder)
    return status, told if status else out.getvalue()


def _fill(folder: Path) -> None:
    for found in folder.rglob("fit.json"):
        for name in NOT_DRAWN:
            if not (found.parent / name).exists():
                (found.parent / name).write_bytes(PNG)
