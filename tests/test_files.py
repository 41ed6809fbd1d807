"""Files whole or not at all, folders of one run at a time."""

import errno
import io
import os
import shutil
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
from fitball.base.files import content_of, csv_bytes, json_bytes, result_folder

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
    "        names = (sys.argv[2], 'summary.csv', 'fit.json')\n"
    "        folder.replace({name: f'{sys.argv[2]} {k}'.encode() for name in names})\n"
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


OLD = {"fit.nc": b"old", "trace.png": b"old", "fit.json": b"old"}
NEW = {"fit.nc": b"new", "corner.png": b"new", "fit.json": b"new"}
# Every way to the disk is counted, and the process is killed before that of the number stated.
KILL = f"""
steps = [int(sys.argv[2])]
def stopping(call):
    def stopped(*words, **more):
        steps[0] -= 1
        if steps[0] < 0:
            os.kill(os.getpid(), signal.SIGKILL)
        return call(*words, **more)
    return stopped
for name in ("fsync", "replace", "rename", "unlink", "mkdir", "rmdir"):
    setattr(os, name, stopping(getattr(os, name)))
with result_folder(Path(sys.argv[1]), overwrite=True, record="fit.json") as folder:
    folder.replace({NEW})
"""


def put(folder, contents, **options):
    with result_folder(folder, record="fit.json", **options) as locked:
        return locked.replace(contents)


def contents_of(folder):
    return {name: content_of(folder / name) for name in ("fit.nc", "fit.json")}


@POSIX
def test_wherever_a_run_is_killed_one_whole_result_is_there(tmp_path):
    put(tmp_path / "before", OLD)
    (tmp_path / "before" / "mine.csv").write_text("mine")
    seen = []
    for step in range(200):
        folder = tmp_path / str(step)
        shutil.copytree(tmp_path / "before", folder)
        end = run(KILL, folder, step).wait()
        read = contents_of(folder)
        seen.append(read["fit.json"])
        assert {*read.values()} in ({b"old"}, {b"new"})
        # The next run ends what was begun, keeps what was whole, and is not held up.
        with result_folder(folder, record="fit.json", overwrite=True):
            kept = {path.name: path.read_bytes() for path in folder.glob("[!.]*")}
        whole = OLD if seen[-1] == b"old" else NEW
        assert kept == whole | {"mine.csv": b"mine"}
        put(folder, {"fit.json": b"third"}, overwrite=True)
        assert names(folder) == ["fit.json", "mine.csv"]
        if end == 0:
            break
    # From one step on it is the new one, and each way to the disk was tried.
    assert end == 0
    assert len(seen) > 15
    turn = seen.index(b"new")
    assert seen == [b"old"] * turn + [b"new"] * (len(seen) - turn)
    assert turn < len(seen) - 5


@POSIX
def test_what_a_killed_first_run_leaves_holds_up_no_other(tmp_path):
    assert run(KILL, tmp_path, 6).wait() == -signal.SIGKILL
    left = names(tmp_path)
    assert LOCK in left
    assert len(left) == 2
    put(tmp_path, NEW)
    assert names(tmp_path) == sorted(NEW)


def test_an_older_result_is_kept_until_there_is_another(tmp_path):
    put(tmp_path, {"corner.png": b"1", "fit.json": b"1"})
    refused("older-result", tmp_path, record="fit.json")
    # A run that adds to a result removes nothing, the folder of a table included; nor does one that
    # fails.
    with result_folder(tmp_path) as folder:
        folder.write("trace.png", b"2")
        folder.below("table").replace({"fit.json": b"3"})
    with pytest.raises(KeyError), result_folder(tmp_path, record="fit.json", overwrite=True):
        raise KeyError
    assert names(tmp_path) == ["corner.png", "fit.json", "table", "trace.png"]
    assert put(tmp_path, {"fit.json": b"4"}, overwrite=True) == (tmp_path / "fit.json",)
    assert names(tmp_path) == ["fit.json", "table"]
    assert names(tmp_path / "table") == ["fit.json"]
    # A batch without pages has fits alone.
    refused("older-result", tmp_path / "table", record="report.html")


@pytest.mark.parametrize("number", [errno.ENOSPC, errno.EIO])
@pytest.mark.parametrize("whole", [0, 2])
def test_a_disk_that_is_full_keeps_the_older_result(tmp_path, monkeypatch, number, whole):
    put(tmp_path, OLD)
    synced = []

    def full(_file):
        synced.append(1)
        if len(synced) > whole:
            raise OSError(number, os.strerror(number))

    with monkeypatch.context() as patched:
        patched.setattr(os, "fsync", full)
        with pytest.raises(FolderError) as caught:
            put(tmp_path, NEW, overwrite=True)
    assert caught.value.code == "not-written"
    assert {name: (tmp_path / name).read_bytes() for name in names(tmp_path)} == OLD
    put(tmp_path, NEW, overwrite=True)
    assert {name: (tmp_path / name).read_bytes() for name in names(tmp_path)} == NEW


def test_a_folder_in_the_place_of_a_file_refuses_the_new_result_alone(tmp_path):
    put(tmp_path, OLD)
    (tmp_path / "corner.png").mkdir()
    with pytest.raises(FolderError) as caught:
        put(tmp_path, NEW, overwrite=True)
    assert caught.value.code == "not-written"
    assert "corner.png" in str(caught.value)
    assert names(tmp_path) == sorted({*OLD, "corner.png"})
    assert contents_of(tmp_path) == {"fit.nc": b"old", "fit.json": b"old"}


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
    (path / WRITTEN).write_bytes(b"../precious\n/etc/hostname\n\n..\n\xff\na\0b\nc\ntrace.pn")
    (path / "trace.pn").write_text("a line that is cut off names no file")
    (path / "c").mkdir()
    put(path, {"fit.json": b"2"}, overwrite=True)
    assert precious.read_text() == "kept"
    assert names(path) == ["c", "fit.json", "trace.pn"]
    assert not (path / "fit.json").is_symlink()
    (tmp_path / LOCK).symlink_to(precious)
    refused("no-folder", tmp_path)
    assert precious.read_text() == "kept"


@POSIX
@pytest.mark.parametrize("target", ["kept\n", None], ids=["file", "nothing"])
@pytest.mark.parametrize("name", [WRITTEN, "curves.png", ".fitball-next"])
def test_a_link_in_a_result_is_replaced_and_nothing_written_through_it(tmp_path, name, target):
    path = tmp_path / "c"
    precious = tmp_path / "precious"
    put(path, OLD)
    if target is not None:
        precious.write_text(target)
    (path / name).unlink(missing_ok=True)
    (path / name).symlink_to(precious)
    with result_folder(path) as folder:
        folder.write("curves.png", b"drawn")
    assert not (path / name).is_symlink()
    assert (path / "curves.png").read_bytes() == b"drawn"
    # Nor is what it says taken over.
    assert "curves.png" in (path / WRITTEN).read_text()
    assert "kept" not in (path / WRITTEN).read_text()
    assert precious.exists() == (target is not None)
    assert target is None or precious.read_text() == target
    put(path, NEW, overwrite=True)
    # What the link hid of the list stays beside the new result; what was drawn since goes.
    assert {*names(path)} - {*NEW} == ({"trace.png"} if name == WRITTEN else set())
    assert not (path / WRITTEN).is_symlink()
    assert precious.exists() == (target is not None)
    assert target is None or precious.read_text() == target


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
