"""What work costs: CPU seconds of rivals that take turns, the least of several; time and memory of processes."""

from __future__ import annotations

import math
import os
import subprocess
import sys
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from itertools import repeat

Action = Callable[[], object]
# Run by a fresh process after its work. On Linux getrusage reports at least the memory of the parent process, so that
# the process reads its own; Windows has no such number.
REPORT = """
import os, sys, time
spent = time.process_time() + sum(os.times()[2:4])
try:
    with open("/proc/self/status") as file:
        most = float(file.read().split("VmHWM:")[1].split()[0]) / 1024
except (OSError, IndexError):
    try:
        import resource
        most = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / (1024 ** 2 if sys.platform == "darwin" else 1024)
    except ImportError:
        most = float("nan")
print("\\n", spent, most, flush=True)
"""


@dataclass(frozen=True)
class Pace:
    """How often rivals take turns, and how long a turn lasts at least [s], enough for the clock."""

    rounds: int
    turn: float


def by_turns(actions: Mapping[str, Action], pace: Pace) -> dict[str, float]:
    """CPU seconds that one call of each action takes: the least over the rounds, in each of which all have a turn.

    CPU time, because the machine may do other things; the least, because these can only add to it; by turns, because
    they may last for minutes.
    """
    calls = {name: _calls(action, pace.turn) for name, action in actions.items()}
    least = dict.fromkeys(actions, math.inf)
    for _ in range(pace.rounds):
        for name, action in actions.items():
            least[name] = min(least[name], _spent(action, calls[name]))
    return least


def _calls(action: Action, turn: float) -> int:
    """Calls that make a turn; the first of all, which may compile, is not counted."""
    action()
    return max(1, math.ceil(turn / max(_spent(action, 1), 1e-7)))


def _spent(action: Action, calls: int) -> float:
    begun = time.process_time()
    for _ in repeat(None, calls):
        action()
    return (time.process_time() - begun) / calls


@dataclass(frozen=True)
class Spent:
    """Words that a process `printed`, its CPU `seconds` with those of its children, and the most memory it held."""

    printed: list[str]
    seconds: float
    megabytes: float


def fresh_process(code: str, **environment: str) -> Spent:
    """What Python code takes in a process of its own, its children's time included.

    Raises CalledProcessError where it fails.
    """
    output = subprocess.run(
        [sys.executable, "-c", code + REPORT], env={**os.environ, **environment}, check=True, stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL, text=True,
    ).stdout  # fmt: skip
    *printed, seconds, megabytes = output.split()
    return Spent(printed, float(seconds), float(megabytes))
