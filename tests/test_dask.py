"""Work on a Dask cluster: two workers and a scheduler, processes of this machine.

Programs of their own ask it, with a time limit each: a client has a thread that a warning, taken
for an error, would end, and its answers would be waited for.
"""

import json
import os
import subprocess
import sys
import time
from contextlib import contextmanager

import pytest
from support.fit_by_hand import table_of

pytest.importorskip("distributed")
pytestmark = pytest.mark.skipif(os.name != "posix", reason="signals of a POSIX system")

# How long processes may take to begin, and programs to end [s]: only a fault takes that long.
LONGEST = 600


@contextmanager
def processes(folder, workers):
    """The file of a scheduler with so many workers, and its process; all end with the block."""
    file = folder / "scheduler.json"
    log = (folder / "log.txt").open("wb")
    begun = []

    def start(name, *options):
        command = [sys.executable, "-m", f"distributed.cli.dask_{name}", "--scheduler-file", file]
        command += ["--host", "127.0.0.1", "--dashboard-address", "127.0.0.1:0", *options]
        begun.append(subprocess.Popen(command, stdout=log, stderr=log, cwd=folder))

    try:
        start("scheduler", "--port", "0")
        for _ in range(workers):
            start("worker", "--nthreads", "1", "--no-nanny", "--local-directory", folder)
        end = time.monotonic() + LONGEST
        while not file.exists():
            assert begun[0].poll() is None, (folder / "log.txt").read_text()
            assert time.monotonic() < end
            time.sleep(0.05)
        yield str(file), begun
    finally:
        for process in begun:
            process.kill()
            process.wait()
        log.close()


@pytest.fixture(scope="module")
def cluster(tmp_path_factory):
    """The file of a scheduler with two workers, and their process ids."""
    with processes(tmp_path_factory.mktemp("cluster"), 2) as (file, begun):
        yield file, {process.pid for process in begun[1:]}


def ran(*arguments, cwd):
    """A run of Python with these arguments."""
    return subprocess.run(
        [sys.executable, *arguments],
        capture_output=True,
        text=True,
        timeout=LONGEST,
        check=False,
        cwd=cwd,
    )


ANSWERS = """
import os, sys
from fitball.base.errors import FitError
from fitball.base.scheduling import as_completed

def square(case):
    if case == 3:
        raise FitError("three cannot be fitted", "three")
    return os.getpid(), case**2

answers = dict(as_completed(square, range(5), address=sys.argv[1]))
assert answers.pop(3).code == "three"
assert {k: value for k, (_, value) in answers.items()} == {0: 0, 1: 1, 2: 4, 4: 16}
print(*{process for process, _ in answers.values()})
exist = as_completed(os.path.exists, ["here", "there"], address=sys.argv[1])
assert dict(exist) == {0: True, 1: False}
"""


def test_a_dask_scheduler_gives_the_same(cluster, tmp_path):
    file, workers = cluster
    (tmp_path / "here").touch()
    run = ran("-c", ANSWERS, file, cwd=tmp_path)
    assert run.returncode == 0, run.stderr[-2000:]
    assert {int(process) for process in run.stdout.split()} <= workers


def contents_of(folder):
    """What the files below a folder have, by name: bytes, of fits without times that they took."""
    contents = {}
    for file in folder.rglob("*"):
        if file.name == "fit.json":
            fit = json.loads(file.read_bytes())
            contents[str(file.relative_to(folder))] = fit
            assert fit.pop("seconds")
            # Of all fields, times too.
            assert fit.pop("digest")
        elif file.is_file():
            contents[str(file.relative_to(folder))] = file.read_bytes()
    return contents


def test_a_batch_on_a_cluster_writes_the_same_bytes(cluster, tmp_path):
    file, _ = cluster
    (tmp_path / "courts").mkdir()
    table = table_of(8)
    for name, rows in (("a", table), ("b", table.iloc[:6])):
        rows.to_csv(tmp_path / "courts" / f"{name}.csv", index=False)
    command = ["-m", "fitball", "batch", "courts", "--model", "grip-slip", "--point-only"]
    for out, option in (("there", ["--scheduler", file]), ("here", ["--cores", "1"])):
        run = ran(*command, "--out", out, *option, cwd=tmp_path)
        assert run.returncode in (0, 1), run.stderr[-2000:]
    there = contents_of(tmp_path / "there")
    assert "batch.csv" in there
    assert {f"{name}/fit.json" for name in "ab"} <= {*there}
    assert there == contents_of(tmp_path / "here")


ENDS = """
import os, signal, sys, threading, time
from fitball.base import scheduling
from fitball.base.errors import FitballError

scheduling._PATIENCE = scheduling._WORKER_PATIENCE = float(sys.argv[2])

def work(case):
    if case != "0":
        os.kill(int(case), signal.SIGKILL)
    time.sleep(600.0)

try:
    list(scheduling.as_completed(work, sys.argv[3:] or ["0"], address=sys.argv[1]))
except FitballError as error:
    print(type(error).__name__, error.code)
"""


def test_a_scheduler_that_does_not_answer_or_has_no_worker_is_a_mistake(tmp_path):
    run = ran("-c", ENDS, "nonsense", "0.5", cwd=tmp_path)
    assert run.stdout == "ParameterError scheduler\n", run.stderr[-2000:]
    with processes(tmp_path, 0) as (file, _):
        run = ran("-c", ENDS, file, "2", cwd=tmp_path)
    assert run.stdout == "ParameterError scheduler\n", run.stderr[-2000:]


def test_a_scheduler_that_ends_ends_the_work(tmp_path):
    with processes(tmp_path, 1) as (file, (scheduler, _)):
        run = ran("-c", ENDS, file, "60", str(scheduler.pid), cwd=tmp_path)
    assert run.stdout == "MachineError scheduler\n", run.stderr[-2000:]
