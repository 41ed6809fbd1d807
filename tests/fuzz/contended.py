"""Target: one folder that several processes write, some of them killed, some on a disk that is full.

What is left is no result, or a whole one.
"""

from __future__ import annotations

import shlex
import sys
from pathlib import Path

from fuzz.examples import TABLES
from fuzz.harness import Target
from fuzz.mutators import pick

ROOT = Path(__file__).resolve().parents[2]
QUICK = ("--cores", "1", "--model", "grip-slip", "--no-figures", "--quiet")
COMMANDS = (
    *[("calibrate", "impacts.csv", "--point-only", *QUICK, "--overwrite", "--seed", seed, "--out", "out")
      for seed in "123"],
    ("calibrate", "impacts.csv", "--max-steps", "150", *QUICK, "--overwrite", "--out", "out"),
    ("calibrate", "impacts.csv", "--max-steps", "150", *QUICK, "--resume", "--out", "out"),
    ("batch", "impacts.csv", "--point-only", *QUICK, "--out", "season"),
    ("plot", "out", "sketch"), ("export", "out", "--to", "json", "--out", "p.json", "--overwrite"),
)  # fmt: skip
# A file may have so many blocks of 512 bytes, as on a disk that fills up; or the process ends after so many seconds.
FAULTS = ("{}", "{}", "ulimit -f 0; {}", "ulimit -f 8; {}", "ulimit -f 60; {}", "ulimit -f 300; {}",
          "timeout -s KILL {s} {}")  # fmt: skip


def _build(folder):
    (folder / "impacts.csv").write_text(TABLES[0], encoding="utf-8")


def _contend(folder, rng):
    fitball = ["env", f"PYTHONPATH={ROOT}", sys.executable, "-m", "fitball"]
    beside = []
    for _ in range(int(rng.integers(1, 4))):
        command = shlex.join([*fitball, *pick(rng, COMMANDS)])
        fault = pick(rng, FAULTS).replace("{s}", f"{rng.uniform(0.5, 6.0):.2f}")
        beside.append(f"({fault.replace('{}', command)}) &")
    whole = shlex.join([*fitball, "plot", "out", "sketch", "--out", "pictures", "--quiet"])
    left = f"test ! -e out/fit.json || {whole} || exit 3"
    return f"cd {shlex.quote(str(folder))}; {' '.join(beside)} wait; {left}"


def contended():
    """For `run_in_shell`; exit 3 is a folder with a result that cannot be read."""
    return Target("contended folder", _build, _contend, (("{text}",),), exits=(0,), few=1)
