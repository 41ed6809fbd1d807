"""Target: environment variables, limits and broken streams about a command, which a process of its own runs."""

from __future__ import annotations

import shlex
import subprocess
import sys
from pathlib import Path

from fuzz.harness import Target
from fuzz.mutators import NUMBERS, pick

ROOT = Path(__file__).resolve().parents[2]
SETTINGS = (
    *(f"NUMBA_{name}" for name in ("NUM_THREADS", "DISABLE_JIT", "OPT", "CACHE_DIR", "DEBUG_CACHE", "CPU_NAME")),
    "MPLBACKEND", "MATPLOTLIBRC", "MPLCONFIGDIR", "HOME", "TMPDIR", "LANG", "LC_ALL", "COLUMNS",
    "LINES", "TERM", "OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "OPENBLAS_CORETYPE",
    "XDG_CACHE_HOME", "PYTHONOPTIMIZE", "NO_COLOR", "FORCE_COLOR", "TZ",
)  # fmt: skip
VALUES = (
    *(number for number in NUMBERS if "\0" not in number), "garbage", "/nonexistent", "/dev/null", "/proc/x", ".",
    "C", "ascii:strict", "latin-1", "error", "default", "1", "2", "agg", "Haswell", "Nehalem", "{folder}/rc",
    "{folder}",
)  # fmt: skip
# How a shell runs the command `{}`.
SHELLS = (
    "{}", "{} >&-", "{} 2>&-", "{} >&- 2>&-", "{} <&- >&- 2>&-", "{} >/dev/full", "{} 2>/dev/full", "{} | head -c 1",
    "{} 2>&1 | head -c 1", "ulimit -v 300000; {}", "ulimit -v 700000; {}", "ulimit -n 30; {}", "ulimit -s 512; {}",
    "mkdir gone; cd gone; rmdir ../gone; {}", "trap '' PIPE; {} | true",
)  # fmt: skip
RC = ("text.usetex: True\n", "figure.dpi: 1e9\nlines.linewidth: 90\n", "backend: TkAgg\n", "\xff: :\nfont.size: x\n")
COMMANDS = (
    ("--version",), ("calibrate", "--help"), ("datasets", "show", "wang_zero_spin.csv"), ("calibrate", "no such.csv"),
    ("simulate", "--impact", "v=17, theta=18", "--out", "{folder}/out"),
    ("calibrate", "wang_zero_spin.csv", "--point-only", "--model", "grip-slip", "--out", "{folder}/out"),
)  # fmt: skip


def _surround(folder, rng):
    (folder / "rc").write_text("".join(pick(rng, RC) for _ in range(2)), encoding="latin-1")
    words = [f"{pick(rng, SETTINGS)}={pick(rng, VALUES)}" for _ in range(int(rng.integers(3)))]
    if rng.integers(4) == 0:
        # Python itself refuses to start with what is no encoding, and complains of what is no filter.
        words.append(f"PYTHONWARNINGS={pick(rng, ('error', 'default', 'error::RuntimeWarning'))}")
        words.append(f"PYTHONIOENCODING={pick(rng, ('ascii:strict', 'latin-1', 'cp1252'))}")
    if rng.integers(4) == 0:
        words.append("MATPLOTLIBRC={folder}/rc")
    command = ["env", f"PYTHONPATH={ROOT}", *words, sys.executable, "-m", "fitball", *pick(rng, COMMANDS)]
    shell = pick(rng, SHELLS)
    line = shell.replace("{}", shlex.join(word.replace("{folder}", str(folder)) for word in command))
    return f"cd {shlex.quote(str(folder))}; {line}"


def run_in_shell(words):
    """Stands for `main`: what a shell shows of the line, and its exit code."""
    done = subprocess.run(["sh", "-c", words[0]], capture_output=True, check=False)
    out, err = (text.decode("utf-8", "replace") for text in (done.stdout, done.stderr))
    if "Traceback" in out + err or "Exception ignored" in err:
        raise AssertionError(err[-2000:])
    print(out)
    # A stream that is closed holds no word, whatever was said.
    print(err or "(nothing)", file=sys.stderr)
    return done.returncode


def surroundings():
    return Target("surroundings", lambda _folder: None, _surround, (("{text}",),), few=2)
