"""Where compiled kernels are kept, and that processes which start together compile them once; draws
over threads.
"""

import os
import subprocess
import sys
from pathlib import Path

import numba
import pytest

from fitball.base import environment
from fitball.models.kernels import compiled

TINY = """
import logging, sys
logging.basicConfig(level="INFO", format="SAID %(levelname)s", stream=sys.stdout)
from fitball.models.kernels.compiled import entry, kernel_folder
from tiny import twice
from numba.core import event

class Seen(event.Listener):
    def on_start(self, event):
        print("COMPILED")

    def on_end(self, event):
        pass

event.register("numba:compile", Seen())
print(twice(21), kernel_folder())
"""


def started(folder, text, cache):
    """A process that runs `text` in `folder` and keeps what it compiles in `cache`."""
    (folder / "tiny.py").write_text(
        "from fitball.models.kernels.compiled import entry\n\n\n@entry\ndef twice(x):\n    return "
        "2 * x\n"
    )
    path = str(folder)
    if os.environ.get("PYTHONPATH"):
        path += os.pathsep + os.environ["PYTHONPATH"]
    settings = {
        **os.environ,
        "NUMBA_CACHE_DIR": str(cache),
        "PYTHONPATH": path,
    }
    return subprocess.Popen(
        [sys.executable, "-c", text],
        env=settings,
        cwd=folder,
        stdout=subprocess.PIPE,
        text=True,
    )


def words_of(process):
    """What a process has printed when it ends."""
    text, _ = process.communicate(timeout=120)
    return text.split()


def test_processes_that_start_together_compile_once(tmp_path):
    cache = tmp_path / "cache"
    together = [started(tmp_path, TINY, cache) for _ in range(2)]
    first, second = map(words_of, together)
    third = words_of(started(tmp_path, TINY, cache))
    for words in (first, second, third):
        assert words[-2] == "42"
    # One of them reports that it compiles, and later processes do not compile again.
    assert first.count("COMPILED") + second.count("COMPILED") == 1
    assert "COMPILED" not in third
    assert first.count("SAID") + second.count("SAID") == 1
    assert "SAID" not in third
    assert len(list(cache.rglob("*.nbc"))) == 1


def test_a_cache_that_cannot_be_written_is_replaced_and_cleared(tmp_path):
    (tmp_path / "file").write_text("no folder")
    impossible = tmp_path / "file" / "cache"
    words = words_of(started(tmp_path, TINY, impossible))
    *_, answer, folder = words
    assert words.count("WARNING") == 1
    assert answer == "42"
    assert not Path(folder).exists()


def test_every_source_of_the_kernels_counts(tmp_path, monkeypatch):
    names = ("compiled.py", "contact.py", "motion.py")
    for name in names:
        (tmp_path / name).write_text("x = 1\n")
    monkeypatch.setattr(compiled, "__file__", str(tmp_path / "compiled.py"))
    folder = compiled.kernel_folder.__wrapped__
    assert folder() == folder()
    folders = {folder()}
    for name in names:
        (tmp_path / name).write_text("x = 2\n")
        assert folder() == folder()
        folders.add(folder())
    assert len(folders) == 4
    # Numba's own setting is as it was for the user's functions.
    assert os.environ.get("NUMBA_CACHE_DIR", "") == numba.config.CACHE_DIR


def test_work_that_failed_is_not_marked_as_done(tmp_path):
    mark = tmp_path / "mark"
    with pytest.raises(FloatingPointError), environment.once_for_all_processes(mark, "working"):
        raise FloatingPointError
    assert not mark.exists()
    with environment.once_for_all_processes(mark, "working"):
        assert not mark.exists()
    assert mark.exists()


@pytest.mark.parametrize(
    ("size", "least", "count", "parts"),
    [
        (0, 10, 4, 1),
        (19, 10, 4, 1),
        (20, 10, 4, 2),
        (7, 1, 3, 3),
    ],
)
def test_parts_are_the_whole(size, least, count, parts):
    seen = []
    with environment.threads(count):
        environment.run_in_threads(lambda first, last: seen.append((first, last)), size, least)
    firsts, lasts = zip(*sorted(seen), strict=True)
    assert len(seen) == parts
    assert firsts[0] == 0
    assert lasts[-1] == size
    assert lasts[:-1] == firsts[1:]
    if parts > 1:
        assert min(last - first for first, last in seen) >= least


def test_an_error_in_a_thread_arrives():
    def work(first, last):
        if first:
            raise FloatingPointError

    with environment.threads(2), pytest.raises(FloatingPointError):
        environment.run_in_threads(work, 10, 1)


@pytest.mark.skipif(not hasattr(os, "fork"), reason="no fork here")
def test_a_child_has_threads_of_its_own(tmp_path):
    text = """
import os
from fitball.base import environment
def run():
    seen = []
    environment.run_in_threads(lambda a, b: seen.append(b - a), 10, 5)
    return seen
with environment.threads(2):
    run()
    child = os.fork()
    if not child:
        os._exit(sum(run()))
    print(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]))
"""
    assert words_of(started(tmp_path, text, tmp_path)) == ["10"]
