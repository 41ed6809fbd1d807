"""Tasks for other processes, which have little to import."""

from __future__ import annotations

import os
import signal
import time
from pathlib import Path
from types import SimpleNamespace

from fitball.errors import FitError
from fitball.wording import on_command_line


def slow_to_fast(number):
    """The later, the sooner done."""
    time.sleep(0.05 * max(0, 4 - number))
    return number, os.getpid(), on_command_line()


def folder_elsewhere(task):
    """The folder that another process works in; the `parent` waits until it has begun."""
    return elsewhere((*task, "")), str(Path.cwd())


def elsewhere(task):
    """A task that only another process does at once; the `parent` waits until it has."""
    place, parent, what = task
    if os.getpid() == parent:
        while not place.exists():
            time.sleep(0.01)
        return "here"
    place.touch()
    if what == "abort":
        os.abort()
    if what == "killed":
        os.kill(os.getpid(), signal.SIGKILL)
    if what == "fails":
        raise FitError("no such ball")
    return "elsewhere"


def dies_at_first(task):
    """A task that kills its process the first time."""
    place, folder = task
    if folder is not None and not place.exists():
        place.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return place.name


def blamed(task):
    """A task that Dask blames the first time, or always."""
    from distributed.scheduler import KilledWorker

    place, always = task
    if always or not place.exists():
        place.touch()
        raise KilledWorker(place.name, SimpleNamespace(address="tcp://nowhere"), 3)
    return place.name


def busy(place):
    """A task that says which process works at it, and never ends."""
    (place / str(os.getpid())).touch()
    while True:
        pass
