"""What the pages quote of fits, comparison and re-derivation of Wang's tables: made again, or as it is kept."""

from __future__ import annotations

import json
import math
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from statistics import stdev
from typing import Any

from fitball.inference.results.results import Verdict, verdict_words
from fitball.version import __version__

ROOT = Path(__file__).resolve().parent.parent
KEPT = ROOT / "fits" / "readme"
NUMBERS = KEPT / "numbers.json"
PICTURE = "curves.png"
LADDER = ("thesis-exact", "two-mass", "grip-slip", "brody")
# Without a contact time it would be held.
FREE_K_Y = "k_y=lognormal(2.0e4, 1.0)"
CALIBRATED = {
    "all": ("wang_all.csv",),
    "zero": ("wang_zero_spin.csv",),
    "drop": ("synthetic_drop.csv",),
    "bare": ("synthetic_drop.csv", "--force-records", "none", "--prior", FREE_K_Y),
    "film": ("synthetic_gaps.csv",),
    "gapless": ("synthetic_gaps.csv", "--ignore", "gap_time,gap_path,gap_turn"),
}
# What is quoted of the size of stiffnesses: the fit and the parameter.
STIFFNESS = {
    "drop": ("drop", "k_y"),
    "bare": ("bare", "k_y"),
    "film": ("film", "k_y"),
    "gapless": ("gapless", "k_y"),
    "film twist": ("film", "k_theta"),
    "gapless twist": ("gapless", "k_theta"),
}


def kept() -> dict[str, Any]:
    """The numbers as they were measured last."""
    numbers: dict[str, Any] = json.loads(NUMBERS.read_text(encoding="utf-8"))
    return numbers


def _fitball(folder: Path, *words: str) -> str:
    """Output of a command, run in `folder`."""
    command = [sys.executable, "-m", "fitball", *words, "--quiet"]
    return subprocess.run(command, cwd=folder, check=True, stdout=subprocess.PIPE, text=True).stdout


def measure() -> None:
    """Fit, compare, re-derive; keep the numbers that the pages quote, and the picture of README.md."""
    KEPT.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        for name, words in CALIBRATED.items():
            _fitball(folder, "calibrate", *words, "--out", name)
        compared = json.loads(_fitball(folder, "compare", "wang_all.csv", "--json", "--out", "compared"))
        derived = json.loads(_fitball(folder, "rederive", "--json", "--out", "derived"))
        fits = {name: json.loads((folder / name / "fit.json").read_text(encoding="utf-8")) for name in CALIBRATED}
        shutil.copyfile(folder / "all" / PICTURE, KEPT / PICTURE)
    found = {
        "version": __version__,
        "parameters": {
            name: _parameter(item) | _over(fits["all"]["assumptions"]["parameters"].get(name))
            for name, item in fits["all"]["parameters"].items()
        },
        "ratio": _parameter(fits["zero"]["derived"]["k_theta/k_y"]),
        "compared": [_score(item) for item in compared["models"] if item["name"] in LADDER],
        "duel": _duel(compared, "two-mass", "grip-slip"),
        "stiffness": {key: _parameter(fits[fit]["parameters"][name]) for key, (fit, name) in STIFFNESS.items()},
        "published": {item["name"]: item["rms"] for item in compared["published"]},
        "rankings": derived["rankings"],
        "thesis": {item["name"]: item["finding"] for item in derived["checks"]} | derived["verdicts"],
    }
    NUMBERS.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")


def _parameter(item: dict[str, Any]) -> dict[str, Any]:
    kept = ("unit", "median", "sd", "q16", "q84")
    return {key: item[key] for key in kept} | {"verdict": verdict_words(Verdict(item["verdict"]), item["given"])}


def _over(span: dict[str, Any] | None) -> dict[str, Any]:
    """Lowest and highest median over model variants that fit equally well; None for a parameter without."""
    return {"over": None if span is None else [span["low"], span["high"]]}


def _score(item: dict[str, Any]) -> dict[str, Any]:
    return {
        "name": item["name"],
        "free": item["free_parameters"],
        "elpd": item["elpd_difference"]["value"],
        "se": item["elpd_difference"]["se"],
        "rms": item["left_out"][0]["rms"],
    }


def _duel(compared: dict[str, Any], first: str, second: str) -> dict[str, float]:
    """Difference in log predictive density over the impacts, with its standard error."""
    by_name = {item["name"]: item["elpd_by_impact"] for item in compared["models"]}
    gaps = [by_name[first][key] - by_name[second][key] for key in by_name[first]]
    return {"value": sum(gaps), "se": math.sqrt(len(gaps)) * stdev(gaps)}
