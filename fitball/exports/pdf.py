"""The report of a fit as PDF: its page, printed by a browser that is installed."""

from __future__ import annotations

import os
import shutil
import subprocess
from pathlib import Path
from tempfile import TemporaryDirectory

from fitball.errors import EnvironmentSettingError, ResultFolderError
from fitball.inference.results.results import Fit
from fitball.report.figures.registry import write_figures
from fitball.report.fit.document import page

VARIABLE = "FITBALL_BROWSER"
# Names on the path, and where systems without such a path install them; all print alike.
BROWSERS = (
    "chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome", "msedge", "microsoft-edge",
    "/Applications/Google Chrome.app/Contents/MacOS/Google Chrome",
    r"C:\Program Files\Google\Chrome\Application\chrome.exe",
    r"C:\Program Files (x86)\Microsoft\Edge\Application\msedge.exe",
)  # fmt: skip
FLAGS = ("--headless", "--disable-gpu", "--disable-extensions", "--no-first-run", "--no-pdf-header-footer")
# More time than the page of a large fit takes on a slow machine [s].
PATIENCE = 120.0


def browser() -> str:
    """The browser that FITBALL_BROWSER names, or the first that is installed. Raises EnvironmentSettingError."""
    named = os.environ.get(VARIABLE, "")
    for name in (named,) if named else BROWSERS:
        if found := shutil.which(name):
            return found
    if named:
        raise EnvironmentSettingError(f"{VARIABLE}={named}: no such program; name Chromium, Chrome or Edge")
    raise EnvironmentSettingError(
        "a PDF needs Chromium, Chrome or Edge, and none was found: install one, or name it in the environment "
        f"variable {VARIABLE}; or open report.html in any browser and print it"
    )


def report_pdf(saved: Fit) -> bytes:
    """The page beside `fit.json`, or a new one where there is none, as PDF. Raises EnvironmentSettingError without
    a browser, ResultFolderError where the browser prints nothing.
    """
    program = browser()
    with TemporaryDirectory() as folder:
        here = Path(folder)
        place = here / "report.html" if saved.place is None else saved.place.with_name("report.html")
        if not place.exists():
            place = here / "report.html"
            place.write_text(page(saved, write_figures(saved, here)), encoding="utf-8")
        out = here / "report.pdf"
        # The page is fitball's own, without scripts; Chromium has no sandbox for root.
        root = ["--no-sandbox"] * (hasattr(os, "geteuid") and os.geteuid() == 0)
        command = [program, *FLAGS, *root, f"--user-data-dir={here / 'profile'}", f"--print-to-pdf={out}"]
        try:
            done = subprocess.run(
                [*command, place.resolve().as_uri()], capture_output=True, text=True, timeout=PATIENCE, check=False
            )
        except (OSError, subprocess.TimeoutExpired) as error:
            raise ResultFolderError(f"{program}: {error}; open report.html in any browser and print it") from None
        if not out.exists():
            words = (done.stderr.strip().splitlines() or [f"exit code {done.returncode}"])[-1]
            raise ResultFolderError(
                f"{program} printed nothing: {words}; open report.html in any browser and print it"
            )
        return out.read_bytes()
