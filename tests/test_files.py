"""How files are written: whole or not at all, over regular files only, by one run at a time in a folder."""

from __future__ import annotations

import errno
import os
import stat
import subprocess
import sys
import threading
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
from validation.harness import Study, run

import fitball
from fitball import files
from fitball.cli.main import main
from fitball.errors import ResultFolderError
from fitball.inference.sampling.chain_file import ChainFile, EnsembleChain, read_chains
from fitball.report.form import folders
from fitball.report.form.files import refuse_existing, remove, write_csv, write_text
from fitball.report.form.folders import LOCK_NAME, held
from fitball.scheduling.engine import engine

ROOT = Path(__file__).resolve().parent.parent
POSIX = pytest.mark.skipif(os.name != "posix", reason="pipes, links and limits of a POSIX system")
POINT = ["calibrate", "wang_zero_spin.csv", "--model", "brody", "--point-only", "--no-figures"]


def names(folder):
    return sorted(place.name for place in folder.iterdir())


def chain(steps, seed=1):
    """A chain of 20 walkers in 3 dimensions, 1,280 bytes a step with its densities."""
    rng = np.random.default_rng(seed)
    state = np.random.RandomState(seed).get_state()
    return EnsembleChain(rng.normal(size=(steps, 20, 3)), rng.normal(size=(steps, 20)), np.zeros(20), state)


# What is written over.


@POSIX
@pytest.mark.parametrize("mask", [0o022, 0o077, 0o002])
def test_a_file_has_the_permissions_of_the_umask(tmp_path, mask):
    before = os.umask(mask)
    try:
        write_text(tmp_path / "a.txt", "a")
        ChainFile(tmp_path / "posterior.h5", "one").write([chain(3)], ["a", "b", "c"], [False] * 3)
    finally:
        os.umask(before)
    assert {stat.S_IMODE(place.stat().st_mode) for place in tmp_path.iterdir()} == {0o666 & ~mask}


@POSIX
def test_no_link_under_the_name_of_a_temporary_file_is_followed(tmp_path, monkeypatch):
    """Not under any name: the random one is made to be foreseen."""
    precious = tmp_path / "precious"
    precious.write_text("kept")
    monkeypatch.setattr(files.secrets, "token_hex", lambda _size: "foreseen")
    (tmp_path / ".fitball-foreseen.partial").symlink_to(precious)
    with pytest.raises(ResultFolderError, match="exists"):
        write_text(tmp_path / "a.txt", "new")
    assert precious.read_text() == "kept" and not (tmp_path / "a.txt").exists()


@POSIX
def test_a_link_in_a_result_folder_is_replaced_and_never_followed(small_fit, tmp_path):
    """Under the names of files, and under those that temporary files once had."""
    precious, out = tmp_path / "precious", tmp_path / "out"
    precious.write_text("kept")
    out.mkdir()
    planted = ["sketch.png", ".sketch.partial.png", "posterior.h5", "posterior.h5.partial", ".fit.partial.json"]
    for name in planted:
        (out / name).symlink_to(precious)
    assert main(["plot", str(small_fit), "sketch", "--out", str(out)]) == 0
    ChainFile(out / "posterior.h5", "one").write([chain(3)], ["a", "b", "c"], [False] * 3)
    assert precious.read_text() == "kept"
    assert [name for name in planted if (out / name).is_symlink()] == [planted[1], *planted[3:]]


@POSIX
def test_a_link_that_the_user_names_leads_to_what_is_written(small_fit, tmp_path, capsys):
    target, link, loop = tmp_path / "target.json", tmp_path / "link.json", tmp_path / "loop.json"
    link.symlink_to(target.name)
    loop.symlink_to(loop.name)
    command = ["export", str(small_fit), "--to", "json", "--out"]
    assert main([*command, str(link)]) == 0
    assert link.is_symlink() and target.read_text() == fitball.load_fit(small_fit).export("json")[".json"]
    assert main([*command, str(link)]) == 2
    assert main([*command, str(link), "--overwrite"]) == 0 and link.is_symlink()
    assert main([*command, str(loop)]) == 2
    own = tmp_path / "own.json"
    own.symlink_to(small_fit / "fit.json")
    before = (small_fit / "fit.json").read_bytes()
    assert main([*command, str(own), "--overwrite"]) == 2
    assert "reserved for results" in capsys.readouterr().err
    assert (small_fit / "fit.json").read_bytes() == before


@POSIX
def test_only_regular_files_are_replaced_or_removed(tmp_path):
    pipe, socket_like, folder = tmp_path / "pipe", tmp_path / "device", tmp_path / "folder"
    os.mkfifo(pipe)
    folder.mkdir()
    things = [pipe, folder]
    with suppress(PermissionError):
        # A block device that no driver answers for; only root makes one, and nothing opens it here.
        os.mknod(socket_like, stat.S_IFBLK | 0o600, os.makedev(240, 200))
        things.append(socket_like)
    for place in things:
        kind = stat.S_IFMT(place.lstat().st_mode)
        for refused in (lambda at: write_text(at, "x"), remove):
            with pytest.raises(ResultFolderError, match="only regular files are replaced"):
                refused(place)
        if place is not pipe:
            with pytest.raises(ResultFolderError, match="only regular files are replaced"):
                refuse_existing(place, True)
        assert stat.S_IFMT(place.lstat().st_mode) == kind
    assert names(tmp_path) == sorted(place.name for place in things)


@POSIX
def test_what_the_user_calls_a_pipe_or_stdout_is_written_into(small_fit, tmp_path, capsys):
    """Nothing else comes there, and what stood in the file behind stdout stays."""
    text = fitball.load_fit(small_fit).export("json")[".json"]
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    heard = []
    reader = threading.Thread(target=lambda: heard.append(pipe.read_text(encoding="utf-8")))
    reader.start()
    assert main(["export", str(small_fit), "--to", "json", "--out", str(pipe)]) == 0
    reader.join()
    assert heard == [text] and stat.S_ISFIFO(pipe.stat().st_mode)
    assert capsys.readouterr().out == ""
    code = (
        "import sys\nfrom pathlib import Path\nfrom fitball.files import write_whole\nprint('first')\n"
        "for name in sys.argv[1:]:\n    write_whole(Path(name), [b'text\\n'], named=True)"
    )
    with (tmp_path / "kept.txt").open("w+", encoding="utf-8") as out:
        out.write("before\n")
        out.flush()
        words = [sys.executable, "-c", code, "/dev/stdout", "/dev/fd/1"]
        subprocess.run(words, stdout=out, env=dict(os.environ, PYTHONPATH=str(ROOT)), check=True)
        out.seek(0)
        assert out.read() == "before\nfirst\ntext\ntext\n"


# Several at once.


def test_a_reader_never_meets_an_empty_or_torn_file(tmp_path):
    place, texts, stop = tmp_path / "a.txt", ["a" * 200_000, "b" * 100_000], threading.Event()
    write_text(place, texts[0])

    def write(text):
        while not stop.is_set():
            write_text(place, text)

    writers = [threading.Thread(target=write, args=(text,)) for text in texts]
    for writer in writers:
        writer.start()
    seen = {place.read_text() for _ in range(300)}
    stop.set()
    for writer in writers:
        writer.join()
    assert seen <= {*texts} and names(tmp_path) == ["a.txt"]


HOLD = (
    "import sys\nfrom pathlib import Path\nfrom fitball.report.form.folders import held\n"
    "with held(Path(sys.argv[1])):\n    print('held', flush=True)\n    sys.stdin.read()"
)


@pytest.fixture
def holder(tmp_path):
    """A process that holds the folder `c`."""
    with subprocess.Popen(
        [sys.executable, "-c", HOLD, str(tmp_path / "c")], env=dict(os.environ, PYTHONPATH=str(ROOT)),
        stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
    ) as process:  # fmt: skip
        assert process.stdout.readline() == "held\n"
        yield process
        process.kill()


def test_a_second_run_is_told_who_holds_the_folder_and_a_dead_one_holds_none(holder, tmp_path, capsys, brief):
    folder = tmp_path / "c"
    command = [*POINT, "--out", str(folder)]
    assert main(command) == 2
    said = capsys.readouterr().err
    assert f"process {holder.pid} of user " in said and " since 20" in said
    assert names(folder) == [LOCK_NAME]
    holder.kill()
    holder.wait()
    # What it leaves is nobody's file, nor in the way.
    assert LOCK_NAME in names(folder)
    (folder / ".fitball-0123456789abcdef.partial").write_text("half a fi")
    (folder / ".mine").write_text("mine")
    assert main(command) == 0
    assert fitball.load_fit(folder).parameters and [name for name in names(folder) if name[0] == "."] == [".mine"]


RUNS = {
    "calibrate": POINT,
    "compare": ["compare", "wang_zero_spin.csv", "--models", "brody,grip-slip"],
    "batch": ["batch", "wang_zero_spin.csv", "--model", "brody", "--point-only"],
    "simulate": ["simulate", "--impact", "v=17, theta=18"],
    "map": ["simulate", "--map", "v=20", "--model", "grip-slip"],
    "rederive": ["rederive"],
    "bench": ["bench", "--quick"],
    "plot": ["plot", "FIT", "sketch"],
    "repeat": ["repeat", "FIT"],
}


@pytest.mark.parametrize("words", RUNS.values(), ids=RUNS)
def test_every_verb_that_writes_a_folder_leaves_one_alone_that_is_held(
    words, small_fit, tmp_path, capsys, monkeypatch
):
    monkeypatch.setattr(folders, "PATIENCE", 0.0)
    folder = tmp_path / "c"
    command = [str(small_fit) if word == "FIT" else word for word in words]
    with held(folder):
        assert main([*command, "--out", str(folder)]) == 2
        assert f"process {os.getpid()} of user " in capsys.readouterr().err
        assert names(folder) == [LOCK_NAME]
    assert names(folder) == []


def test_python_holds_the_folders_that_it_writes(short_fit, tmp_path):
    folder = tmp_path / "c"
    tables = {"a": "wang_zero_spin"}
    with held(folder):
        with pytest.raises(ResultFolderError, match="another run"):
            short_fit.save(folder)
        with pytest.raises(ResultFolderError, match="another run"):
            fitball.calibrate_many(tables, "brody", out=folder, point_only=True, cores=1)
    many = fitball.calibrate_many(tables, "brody", out=folder, point_only=True, cores=1)
    with held(folder), pytest.raises(ResultFolderError, match="another run"):
        many.summarise()
    assert LOCK_NAME not in names(folder)


def test_of_many_runs_at_once_the_folder_holds_the_result_of_one(tmp_path):
    """Half of the threads save one fit, half another: never a mixture, and none loses both."""
    made = [
        fitball.calibrate("wang_zero_spin.csv", model, point_only=True, cores=1) for model in ("brody", "grip-slip")
    ]
    folder, saved = tmp_path / "c", []

    def save(fit):
        for _ in range(8):
            with suppress(ResultFolderError):
                fit.save(folder, overwrite=True, figures=False)
                saved.append(fit)

    threads = [threading.Thread(target=save, args=(fit,)) for fit in (*made, *made)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    whole = {}
    for k, fit in enumerate(made):
        fit.save(tmp_path / str(k), figures=False)
        whole[k] = {place.name: place.read_bytes() for place in (tmp_path / str(k)).glob("*.csv")}
    found = {place.name: place.read_bytes() for place in folder.glob("*.csv")}
    assert saved and found in [*whole.values()] and fitball.load_fit(folder) in made
    assert names(folder) == names(tmp_path / "0")


def test_of_a_run_that_was_killed_while_it_wrote_nothing_mixes_with_the_next(short_fit, tmp_path):
    """Its files lie there without fit.json, some of them of kinds that a point fit has not."""
    point = fitball.calibrate("wang_zero_spin.csv", "brody", point_only=True, cores=1)
    point.save(tmp_path / "alone", figures=False)
    short_fit.save(tmp_path / "c", figures=False)
    (tmp_path / "c" / "mine.csv").write_text("mine")
    (tmp_path / "c" / "fit.json").unlink()
    point.save(tmp_path / "c", figures=False)
    assert names(tmp_path / "c") == sorted([*names(tmp_path / "alone"), "mine.csv"])


@POSIX
def test_where_a_lock_would_lie_no_link_or_pipe_is_opened(tmp_path):
    precious = tmp_path / "precious"
    precious.write_text("kept")
    (tmp_path / "a").mkdir()
    (tmp_path / "a" / LOCK_NAME).symlink_to(precious)
    (tmp_path / "b").mkdir()
    os.mkfifo(tmp_path / "b" / LOCK_NAME)
    for name in "ab":
        with pytest.raises(ResultFolderError, match=LOCK_NAME), held(tmp_path / name):
            pytest.fail("held")
    assert precious.read_text() == "kept"


def test_a_file_system_without_locks_is_written_on_with_a_warning(tmp_path, monkeypatch):
    """As flock says on some network file systems."""
    fcntl = pytest.importorskip("fcntl")

    def none(_file, _how):
        raise OSError(errno.ENOSYS, os.strerror(errno.ENOSYS))

    monkeypatch.setattr(fcntl, "flock", none)
    with pytest.warns(UserWarning, match="no locks"), held(tmp_path):
        write_text(tmp_path / "a.txt", "a")
    assert (tmp_path / "a.txt").read_text() == "a"


def test_verbs_that_read_a_fit_leave_its_folder_as_it_is(small_fit, tmp_path):
    """It may lie where nothing can be written."""
    before = {place.name: place.stat().st_mtime_ns for place in (small_fit, *small_fit.iterdir())}
    assert main(["plot", str(small_fit), "sketch", "--out", str(tmp_path / "figures")]) == 0
    assert main(["export", str(small_fit), "--to", "json", "--out", str(tmp_path / "p.json")]) == 0
    assert main(["predict", str(small_fit), "--impact", "v=17, theta=20", "--out", str(tmp_path / "p.csv")]) == 0
    assert {place.name: place.stat().st_mtime_ns for place in (small_fit, *small_fit.iterdir())} == before


# A full disk.

NO_ROOM = r"the disk is full: it needs at least [\d,]+ bytes, [\d,]+ are free"


@pytest.fixture
def disk(monkeypatch):
    """A function that lets so many bytes into regular files from now on; then the disk is full."""
    room, write = [], os.write

    def limited(file, content):
        if not room or not stat.S_ISREG(os.fstat(file).st_mode):
            return write(file, content)
        if len(content) and not room[0]:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        done = write(file, memoryview(content)[: room[0]])
        room[0] -= done
        return done

    monkeypatch.setattr(os, "write", limited)

    def leave(count):
        room[:] = [] if count is None else [count]

    return leave


def test_a_chain_that_has_no_room_leaves_the_older_one_to_go_on_with(tmp_path, disk):
    file = ChainFile(tmp_path / "posterior.h5", "one")
    file.write([chain(10)], ["a", "b", "c"], [False] * 3)
    before = file.path.read_bytes()
    for room in (0, 1000, 20_000):
        disk(room)
        with pytest.raises(ResultFolderError, match=f"posterior.h5: {NO_ROOM}"):
            file.write([chain(200)], ["a", "b", "c"], [False] * 3)
        assert file.path.read_bytes() == before and names(tmp_path) == ["posterior.h5"]
    (kept,) = file.read(1, 20, ["a", "b", "c"])
    assert np.array_equal(kept.chain, chain(10).chain)
    disk(None)
    file.write([chain(200)], ["a", "b", "c"], [False] * 3)
    assert len(read_chains(file.path)[2][0].chain) == 200


def test_a_result_is_written_with_all_its_files_or_none(short_fit, tmp_path, disk):
    """Wherever between the first byte and the last the disk is full."""
    short_fit.save(tmp_path / "whole", figures=False)
    sizes = [place.stat().st_size for place in (tmp_path / "whole").iterdir()]
    total, out = sum(sizes), tmp_path / "c"
    for share in (0.0, 0.3, 0.6, 0.8, 0.9, 0.97, 0.999):
        disk(500 + int(share * total))
        with pytest.raises(ResultFolderError, match=NO_ROOM):
            short_fit.save(out, figures=False)
        assert names(out) == []
    disk(None)
    short_fit.save(out, figures=False)
    assert names(out) == names(tmp_path / "whole")


# How much is let through before the disk is full, and what is then in the folder.
FULL = {
    "calibrate": (POINT, 3000, []),
    "plot": (["plot", "FIT", "sketch"], 2000, []),
    "plot svg": (["plot", "FIT", "sketch", "--format", "svg"], 2000, []),
    "simulate": (["simulate", "--impact", "v=17, theta=18"], 30_000, []),
    "map": (["simulate", "--map", "v=20", "--model", "grip-slip"], 20_000, []),
    "batch": (RUNS["batch"], 300, ["batch.json", "wang_zero_spin"]),
    "repeat": (["repeat", "FIT"], 3000, []),
    "all": (POINT, 0, []),
}


@pytest.mark.parametrize(("words", "room", "left"), FULL.values(), ids=FULL)
def test_a_verb_on_a_full_disk_ends_in_words(words, room, left, small_fit, tmp_path, disk, capsys, brief):
    out = tmp_path / "c"
    disk(room)
    assert main([*(str(small_fit) if word == "FIT" else word for word in words), "--out", str(out)]) == 2
    said = capsys.readouterr().err
    assert "the disk is full" in said and str(out) in said, said
    assert set(names(out)) <= {*left, "posterior.h5"}


@pytest.mark.parametrize("to", ["json", "netcdf", "c", "lookup", "certificate"])
def test_an_export_on_a_full_disk_leaves_the_older_file(to, small_fit, tmp_path, disk, capsys):
    place = tmp_path / "out.txt"
    place.write_text("older")
    disk(1000)
    assert main(["export", str(small_fit), "--to", to, "--out", str(place), "--overwrite"]) == 2
    assert "the disk is full: it needs" in capsys.readouterr().err
    disk(None)
    assert {path.read_text() for path in tmp_path.iterdir()} == {"older"}


def test_other_files_on_a_full_disk(small_fit, tmp_path, disk, capsys):
    disk(100)
    assert main(["predict", str(small_fit), "--impact", "v=17, theta=20", "--out", str(tmp_path / "p.csv")]) == 2
    assert "p.csv: the disk is full: it needs" in capsys.readouterr().err
    with pytest.raises(ResultFolderError, match="the disk is full"):
        write_csv(tmp_path / "long.csv", ({"a": k, "b": "x" * 50} for k in range(5000)))
    disk(None)
    assert run(Study("grown", lambda _seed, number: [{"a": number}], {}), 1, 2, tmp_path, engine(1)) == [
        [{"a": 0}], [{"a": 1}]
    ]  # fmt: skip
    assert names(tmp_path) == ["grown.jsonl"]


LIMITED = (
    "import resource, sys\nfrom pathlib import Path\nfrom test_files import chain\n"
    "from fitball.errors import FitballError\nfrom fitball.inference.sampling.chain_file import ChainFile\n"
    "resource.setrlimit(resource.RLIMIT_FSIZE, (100_000, 100_000))\n"
    "try:\n    ChainFile(Path('posterior.h5'), 'one').write([chain(500)], ['a', 'b', 'c'], [False] * 3)\n"
    "except FitballError as error:\n    print(error)\n    sys.exit(2)"
)


@POSIX
def test_a_limit_on_file_sizes_ends_in_words_and_no_signal(tmp_path):
    """The kernel's own refusal, at which the HDF5 library once ended the process (exit code 139)."""
    env = dict(os.environ, PYTHONPATH=os.pathsep.join([str(ROOT), str(ROOT / "tests"), str(ROOT / "scripts")]))
    done = subprocess.run(
        [sys.executable, "-c", LIMITED], cwd=tmp_path, env=env, capture_output=True, text=True, check=False
    )
    assert done.returncode == 2, done
    assert "(ulimit -f): it needs" in done.stdout
    assert names(tmp_path) == []
