"""How whole fits grow with the rows of a table: CPU time and the most memory of a process each."""

import json
import os
import signal
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

from fitball.base.errors import MachineError, Note, ParameterError
from fitball.base.files import csv_bytes
from fitball.base.findings import Findings
from fitball.base.numbers import counted
from fitball.base.progress import Progress
from fitball.base.values import DataFrame

# A fit of fewer rows is one of a few impacts, which growth is not about.
LEAST_ROWS = 2
# The name of this fitball among those measured.
OURS = "this fitball"
# The model of tables and fits: its bounce is quick, so that other work is seen too.
MODEL = "grip-slip"
# Velocities before the bounce [m/s] and spin [rad/s], least and most: strokes of play.
STATES = {"v_x1": (10.0, 30.0), "v_y1": (2.0, 15.0), "omega_1": (-200.0, 200.0)}
# Sds of what is measured, SI.
SDS = {"v_x2": 0.2, "v_y2": 0.2, "omega_2": 8.0}
# Units of the largest resident size that the system counts, in bytes.
RESIDENT_UNIT = 1 if sys.platform == "darwin" else 1024


class Cost(NamedTuple):
    """CPU seconds of a process and its children, and the most memory of it [MB]."""

    seconds: float
    megabytes: float


def rows_of(texts: Sequence[str]) -> list[int]:
    """Numbers of rows, rising. Raises ParameterError (`rows`)."""
    counts = set[int]()
    for text in texts:
        if not text.isascii() or not text.isdigit() or int(text) < LEAST_ROWS:
            wanted = f"expected whole numbers from {LEAST_ROWS} on, as in 60,1000"
            raise ParameterError(f"rows: read '{text}'; {wanted}", "rows")
        counts.add(int(text))
    return sorted(counts)


def simulated(count: int) -> DataFrame:
    """A table of so many impacts with noise, at the typical values of the model."""
    import numpy as np
    import pandas as pd

    from fitball.base.values import Impacts
    from fitball.models.registry import model

    rng = np.random.default_rng(1)
    states = {name: rng.uniform(*ends, count) for name, ends in STATES.items()}
    chosen = model(MODEL)
    values = {spec.name: spec.typical for spec in chosen.parameters if spec.typical is not None}
    rebound = chosen.rebound(values, Impacts(**states))
    after = {
        name: np.ravel(getattr(rebound, name)) + rng.normal(0.0, sd, count)
        for name, sd in SDS.items()
    }
    return pd.DataFrame({**states, **after}).round(4)


# Runs a command and writes its exit code, CPU time [s] and most memory. On Linux a process begins
# with the most memory of the one that started it, so this one is small.
_RUN_AND_COUNT = """
import json, os, subprocess, sys
process = subprocess.Popen(sys.argv[2:])
_, status, usage = os.wait4(process.pid, 0)
process.returncode = os.waitstatus_to_exitcode(status)
cost = [process.returncode, usage.ru_utime + usage.ru_stime, usage.ru_maxrss]
with open(sys.argv[1], "w") as file:
    json.dump(cost, file)
"""


def cost_of(command: Sequence[str], folder: Path) -> Cost:
    """What a command costs that is run in a folder. Raises MachineError (`growth`)."""
    record = folder / "cost.json"
    record.unlink(missing_ok=True)
    small = [sys.executable, "-c", _RUN_AND_COUNT, str(record), *command]
    with (folder / "log.txt").open("wb") as log:
        process = subprocess.Popen(
            small, cwd=folder, stdout=log, stderr=log, start_new_session=True
        )
        try:
            process.wait()
        except BaseException:
            os.killpg(process.pid, signal.SIGKILL)
            process.wait()
            raise
    words = (folder / "log.txt").read_text(errors="replace").strip()[-500:]
    if not record.exists():
        raise MachineError(f"a fit could not be started: {words}", "growth")
    code, seconds, resident = json.loads(record.read_bytes())
    # Code 1 is a result with a warning.
    if code not in (0, 1):
        text = f"a fit ended with code {code}: {words}"
        raise MachineError(text, "growth")
    return Cost(seconds, 1e-6 * resident * RESIDENT_UNIT)


def growth(texts: Sequence[str], pythons: Sequence[str], progress: Progress) -> Findings:
    """The frame `growth`: a row for each number of rows, in words, and each fitball, this one and
    those of other `pythons`, which take turns; `seconds` of CPU and the most `megabytes` of a fit
    on one core, from the file to page and figures.

    Raises:
        ParameterError: a number cannot be read (`rows`).
        MachineError: this system counts no memory of a process, or a fit failed (`growth`).
    """
    import pandas as pd

    if not hasattr(os, "wait4"):
        raise MachineError("this system does not say what a process costs", "growth")
    counts = rows_of(texts)
    editions = {OURS: sys.executable, **{python: python for python in pythons}}
    rows = []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for k, (count, edition, command) in enumerate(_commands(counts, editions, folder)):
            progress(f"fitting {counted(count, 'row')}", k / (len(counts) * len(editions)))
            cost = cost_of(command, folder)
            rows.append({"fitball": edition, "rows": count, **cost._asdict()})
    note = Note(
        "timings",
        "CPU times on this machine, of one run each; only ratios carry over.",
    )
    return Findings({"growth": pd.DataFrame(rows)}, (note,))


def _commands(
    counts: Sequence[int], editions: dict[str, str], folder: Path
) -> Iterator[tuple[int, str, list[str]]]:
    """The fits in turn: number of rows, name of the fitball, and its command."""
    for count in counts:
        file = folder / f"rows_{count}.csv"
        file.write_bytes(csv_bytes(simulated(count)))
        for number, (edition, python) in enumerate(editions.items()):
            out = str(folder / f"fit_{count}_{number}")
            options = ["--model", MODEL, "--cores", "1", "--out", out, "--quiet"]
            yield count, edition, [python, "-m", "fitball", "calibrate", str(file), *options]
