"""Files whole or not at all, folders of one run at a time."""

import errno
import io
import os
import signal
import subprocess
import sys
import threading
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from fitball.base.environment import cache_folder
from fitball.base.errors import FolderError
from fitball.base.files import csv_bytes, json_bytes, result_folder

LOCK = ".fitball.lock"
WRITTEN = ".fitball-files"
POSIX = pytest.mark.skipif(os.name != "posix", reason="links and signals of a POSIX system")


def names(folder):
    return sorted(path.name for path in folder.iterdir() if path.name != WRITTEN)


def run(code, *words, **more):
    head = (
        "import os, signal, sys\nfrom pathlib import Path\nfrom fitball.base.files import "
        "result_folder\n"
    )
    return subprocess.Popen(
        [sys.executable, "-c", head + code, *map(str, words)],
        text=True,
        **more,
    )


def refused(code, *words, **more):
    with pytest.raises(FolderError) as caught, result_folder(*words, **more):
        pytest.fail("held")
    assert caught.value.code == code


HOLD = "with result_folder(Path(sys.argv[1])):\n    print(1, flush=True)\n    sys.stdin.read()"
MANY = (
    "for k in range(20):\n"
    "    with result_folder(Path(sys.argv[1]), overwrite=True, record='fit.json', wait=60) as "
    "folder:\n"
    "        folder.clear()\n"
    "        for name in (sys.argv[2], 'summary.csv', 'fit.json'):\n"
    "            folder.write(name, f'{sys.argv[2]} {k}'.encode())\n"
)


def test_a_second_run_waits_or_is_refused_and_a_dead_one_holds_nothing(tmp_path):
    with run(HOLD, tmp_path / "c", stdin=subprocess.PIPE, stdout=subprocess.PIPE) as other:
        assert other.stdout.readline() == "1\n"
        refused("folder-in-use", tmp_path / "c")
        threading.Timer(0.3, other.kill).start()
        with result_folder(tmp_path / "c", wait=60.0) as folder:
            folder.write("a", b"a")
    assert names(tmp_path / "c") == ["a"]


def test_of_many_processes_at_once_the_folder_holds_the_result_of_one(tmp_path):
    runs = [run(MANY, tmp_path / "c", name) for name in "abc"]
    assert [process.wait() for process in runs] == [0, 0, 0]
    folder = tmp_path / "c"
    (last,) = set(names(folder)) - {"fit.json", "summary.csv"}
    contents = {path.read_text() for path in folder.glob("[!.]*")}
    assert contents == {f"{last} 19"}


KILL = (
    "with result_folder(Path(sys.argv[1]), record='fit.json') as folder:\n"
    "    folder.write('trace.png', b'old')\n"
    "    os.fsync = lambda file: os.kill(os.getpid(), signal.SIGKILL)\n"
    "    folder.write('summary.csv', b'half')\n"
)


@POSIX
def test_nothing_of_a_killed_run_mixes_with_the_next(tmp_path):
    (tmp_path / "mine.csv").write_text("mine")
    assert run(KILL, tmp_path).wait() == -signal.SIGKILL
    remaining = names(tmp_path)
    assert LOCK in remaining
    assert "trace.png" in remaining
    assert "summary.csv" not in remaining
    assert len(remaining) == 4
    with result_folder(tmp_path, record="fit.json") as folder:
        folder.clear()
        folder.write("fit.json", b"{}")
    assert names(tmp_path) == ["fit.json", "mine.csv"]


def test_an_older_result_is_kept_until_there_is_another(tmp_path):
    with result_folder(tmp_path, record="fit.json") as folder:
        for name in ("corner.png", "fit.json"):
            folder.write(name, b"1")
    refused("older-result", tmp_path, record="fit.json")
    # A run that adds to a result removes nothing, the folder of a table included; nor does one that
    # fails.
    with result_folder(tmp_path) as folder:
        folder.clear()
        folder.write("trace.png", b"2")
        folder.below("table").write("fit.json", b"3")
    with pytest.raises(KeyError), result_folder(tmp_path, record="fit.json", overwrite=True):
        raise KeyError
    assert names(tmp_path) == ["corner.png", "fit.json", "table", "trace.png"]
    with result_folder(tmp_path, record="fit.json", overwrite=True) as folder:
        folder.clear()
        # A record without a list of files goes too.
        (tmp_path / "fit.json").write_text("copied")
        folder.clear()
    assert names(tmp_path) == ["table"]
    assert names(tmp_path / "table") == ["fit.json"]


@pytest.mark.parametrize("number", [errno.ENOSPC, errno.EIO])
def test_what_cannot_be_written_leaves_the_older_file(tmp_path, monkeypatch, number):
    with result_folder(tmp_path) as folder:
        folder.write("a", b"old")

        def full(_file):
            raise OSError(number, os.strerror(number))

        monkeypatch.setattr(os, "fsync", full)
        with pytest.raises(FolderError) as caught:
            folder.write("a", b"new")
    assert caught.value.code == "not-written"
    assert str(tmp_path / "a") in str(caught.value)
    assert names(tmp_path) == ["a"]
    assert (tmp_path / "a").read_bytes() == b"old"


def test_a_folder_that_cannot_be_or_was_made_for_nothing(tmp_path):
    (tmp_path / "file").write_text("x")
    for path in ("file", "file/c", "a" * 300):
        refused("no-folder", tmp_path / path)
    with result_folder(tmp_path / "fits" / "clay" / "default"):
        pass
    with pytest.raises(FolderError) as caught, result_folder(tmp_path) as folder:
        folder.below("file")
    assert caught.value.code == "no-folder"
    assert names(tmp_path) == ["file"]


@POSIX
def test_links_that_others_planted_are_not_followed(tmp_path):
    precious = tmp_path / "precious"
    path = tmp_path / "c"
    precious.write_text("kept")
    path.mkdir()
    (path / "fit.json").symlink_to(precious)
    (path / WRITTEN).write_text("../precious\n/etc/hostname\n\n..\ntrace.pn")
    (path / "trace.pn").write_text("a line that is cut off names no file")
    with result_folder(path, record="fit.json", overwrite=True) as folder:
        folder.clear()
        folder.write("fit.json", b"2")
    assert precious.read_text() == "kept"
    assert names(path) == ["fit.json", "trace.pn"]
    (tmp_path / LOCK).symlink_to(precious)
    refused("no-folder", tmp_path)
    assert precious.read_text() == "kept"


@pytest.mark.parametrize("variable", ["NUMBA_CACHE_DIR", "HOME"])
def test_what_is_compiled_has_a_folder_without_a_cache_or_home(tmp_path, monkeypatch, variable):
    def homeless():
        raise RuntimeError("no home")

    for name in ("NUMBA_CACHE_DIR", "XDG_CACHE_HOME", "LOCALAPPDATA"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr(Path, "home", homeless)
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    monkeypatch.setenv(variable, "/dev/null")
    assert cache_folder.__wrapped__().parent == tmp_path


def test_csv_keeps_every_digit_and_no_formula():
    values = np.append(np.random.default_rng(1).normal(size=50) * 1e-7, np.nan)
    labels = ["=1+1", "@x", "-3.5e2", "-x", "'=a", "a,b", "Sand\r\n"] + ["clay"] * 44
    frame = pd.DataFrame({"x [m/s]": values, "=label": labels}, index=pd.RangeIndex(51, name="id"))
    before = frame.copy()
    content = csv_bytes(frame)
    back = pd.read_csv(io.BytesIO(content), index_col="id")
    assert back["x [m/s]"].equals(frame["x [m/s]"])
    assert back.columns[1] == "'=label"
    assert frame.equals(before)
    written = list(back["'=label"])
    assert written[:7] == ["'=1+1", "'@x", "-3.5e2", "'-x", "''=a", "a,b", "Sand\r\n"]
    assert csv_bytes(pd.DataFrame({"a": [1]})) == b"a\n1\n"


def test_json_has_no_numbers_that_json_has_not():
    assert json_bytes({"a": 0.1}) == b'{\n "a": 0.1\n}\n'
    with pytest.raises(ValueError, match="JSON"):
        json_bytes([np.nan])
