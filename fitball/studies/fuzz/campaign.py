"""Thousands of cases, in a process of their own that may hang, die or eat memory without harm to the campaign."""

from __future__ import annotations

import multiprocessing
import resource
import shlex
import shutil
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from pathlib import Path

from fitball.studies.fuzz.harness import Case, Main, Target, complaints, make_case, run_case

# What a command on a small damaged input may take: it is read, refused or fitted to its best point.
MOST_SECONDS = 60.0
MOST_BYTES = 1_000_000_000


@dataclass(frozen=True)
class Finding:
    """A case that broke the rule, how it did, and the traceback if there was one."""

    case: Case
    complaints: tuple[str, ...]
    error: str = ""


def run_target(
    target: Target, seed: int, cases: int, folder: Path, main: Main, report: Callable[[int], None]
) -> list[Finding]:
    """Run cases 0 to `cases` - 1 of a target below `folder`; the files of those that broke the rule are left there.

    `report` is told the number of cases done.
    """
    valid = folder / "valid" / target.name
    shutil.rmtree(valid, ignore_errors=True)
    valid.mkdir(parents=True)
    target.build(valid)
    broken = []
    worker = _Worker(target, main)
    try:
        for index in range(cases):
            place = folder / "cases" / f"{target.name}_{index}"
            shutil.rmtree(place, ignore_errors=True)
            place.parent.mkdir(parents=True, exist_ok=True)
            case = make_case(target, valid, place, seed, index)
            finding = worker.judge(case)
            if finding is None:
                shutil.rmtree(place)
            else:
                broken.append(finding)
            report(index + 1)
    finally:
        worker.stop()
    return broken


def finding_text(finding: Finding) -> str:
    """A finding in lines, ASCII alone: its command may hold anything."""
    case = finding.case
    words = ascii(shlex.join(["fitball", *case.words])[:400])
    lines = [
        f"{case.target} {case.index} ({case.damage[:80]!a}): {'; '.join(map(ascii, finding.complaints))}",
        words,
    ]
    return "\n  ".join([*lines, *finding.error.strip().splitlines()[-6:]])


class _Worker:
    """A process that runs cases one after the other; a new one after each that hung, died or took much memory."""

    def __init__(self, target: Target, main: Main) -> None:
        self.target = target
        self.main = main
        self.process: BaseProcess | None = None

    def judge(self, case: Case) -> Finding | None:
        """Run a case. None when it kept the rule."""
        self._start()
        self.pipe.send(case)
        if not self.pipe.poll(MOST_SECONDS):
            self.stop()
            return Finding(case, (f"over {MOST_SECONDS:g} s",))
        try:
            ending, peak = self.pipe.recv()
        except EOFError:
            assert self.process is not None
            self.process.join()
            code, self.process = self.process.exitcode, None
            return Finding(case, (f"the process died: exit code {code}",))
        said = complaints(self.target, case, ending)
        if peak > MOST_BYTES:
            # The peak of a process never falls: the next case begins with a new one.
            said.append(f"{peak / 1e9:.2f} GB of memory")
            self.stop()
        return Finding(case, tuple(said), ending.error) if said else None

    def _start(self) -> None:
        if self.process is not None:
            return
        # A fresh process: forking one that runs threads (as numerical libraries do) may hang.
        context = multiprocessing.get_context("spawn")
        self.pipe, theirs = context.Pipe()
        self.process = context.Process(target=_serve, args=(theirs, self.main), daemon=True)
        self.process.start()
        theirs.close()

    def stop(self) -> None:
        """End the process, if there is one."""
        if self.process is not None:
            self.process.kill()
            self.process.join()
            self.process = None


def _serve(pipe: Connection, main: Main) -> None:
    """Run cases as they come, until the other side leaves."""
    for case in _received(pipe):
        pipe.send((run_case(case, main), _peak_bytes()))


def _received(pipe: Connection) -> Iterator[Case]:
    while True:
        try:
            yield pipe.recv()
        except EOFError:
            return


def _peak_bytes() -> int:
    """The most memory this process ever held."""
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak if sys.platform == "darwin" else 1024 * peak
