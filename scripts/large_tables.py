"""Measure what tables of many rows cost: `scripts/large_tables.py ROWS [calibrate options]`.

The table is simulated with the model grip-slip, 0.3 m/s and 10 rad/s of noise. Prints peak memory, wall time, bytes
of text, and of files: those of `fit.json` and of the page should not grow with rows.
"""

from __future__ import annotations

import json
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

import fitball

TRUTH = {"mu": 0.6, "e_x": 0.1, "offset": 0.0, "cor_10": 0.78, "cor_slope": -0.012}
NOISE = (0.3, 0.3, 10.0)
HEAD = "v_x1,v_y1,omega_1,v_x2,v_y2,omega_2"


def write_table(place: Path, rows: int) -> None:
    """Impacts of 8 to 35 m/s at 15 to 70 degrees, with back- and topspin; a rebound that noise turns is left out."""
    rng = np.random.default_rng(rows)
    speed, angle = rng.uniform(8.0, 35.0, rows), np.radians(rng.uniform(15.0, 70.0, rows))
    given = fitball.impacts(speed * np.cos(angle), speed * np.sin(angle), rng.uniform(-200.0, 300.0, rows))
    made = fitball.model("grip-slip").rebound(TRUTH, given)
    seen = [
        column + sd * rng.standard_normal(rows)
        for column, sd in zip((made.v_x2, made.v_y2, made.omega_2), NOISE, strict=True)
    ]
    numbers = np.stack([given.v_x1, given.v_y1, given.omega_1, *seen], axis=1)
    np.savetxt(place, numbers[numbers[:, 4] > 0.0], delimiter=",", header=HEAD, comments="", fmt="%.6g")


def main(rows: int, options: list[str]) -> int:
    """Simulate, calibrate in a process of its own, and print what it took."""
    with tempfile.TemporaryDirectory() as name:
        place = Path(name)
        write_table(place / "table.csv", rows)
        table, folder = str(place / "table.csv"), place / "fit"
        command = [sys.executable, "-m", "fitball", "calibrate", table, "--out", str(folder)]
        begun = time.perf_counter()
        done = subprocess.run([*command, "--model", "grip-slip", *options], capture_output=True, text=True)
        seconds = time.perf_counter() - begun
        found: dict[str, object] = {
            "rows": rows,
            "exit code": done.returncode,
            "peak memory [MB]": round(resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1024),
            "wall time [s]": round(seconds, 1),
            "text [bytes]": len(done.stdout.encode()) + len(done.stderr.encode()),
        }
        files = ("fit.json", "report.html", "data.nc", "predictions.csv")
        found |= {f"{item} [bytes]": (folder / item).stat().st_size for item in files if done.returncode != 2}
        print(json.dumps(found, indent=1))
        if done.returncode == 2:
            print(done.stderr[-2000:], file=sys.stderr)
    return done.returncode


if __name__ == "__main__":
    raise SystemExit(main(int(sys.argv[1]), sys.argv[2:]))
