"""What surrounds a run: settings of matplotlib and numba, kept kernels, limits, streams that are closed or full."""

from __future__ import annotations

import os
import shlex
import subprocess
import sys
from importlib import util
from pathlib import Path

import matplotlib as mpl
import numba
import pytest

import fitball
from fitball import environment
from fitball.environment import tell_nobody, when_compiling
from fitball.errors import MemoryShortageError
from fitball.models.kernels import compiled
from fitball.models.kernels.compiled import KernelFiles
from fitball.report.figures.canvas import rendered

HOSTILE = {
    "text.usetex": True, "figure.dpi": 1e6, "font.family": "No Such Font", "savefig.format": "pdf",
    "lines.linewidth": 40.0, "axes.prop_cycle": mpl.cycler(color=["white"]), "figure.constrained_layout.use": True,
}  # fmt: skip
POSIX = pytest.mark.skipif(sys.platform == "win32", reason="POSIX")
FULL = pytest.mark.skipif(not Path("/dev/full").exists(), reason="no /dev/full here")


@pytest.mark.parametrize("form", ["png", "svg", "pdf"])
def test_figures_do_not_depend_on_the_callers_settings_nor_change_them(form, small_fit):
    with mpl.rc_context():
        drawn = {
            "fit": lambda: fitball.plot(small_fit, "sketch"),
            "simulate": fitball.simulate("v=17, theta=18").plot,
        }
        plain = {name: rendered(draw(), form, 50) for name, draw in drawn.items()}
        mpl.rcParams.update(HOSTILE)
        before = dict(mpl.rcParams)
        assert {name: rendered(draw(), form, 50) for name, draw in drawn.items()} == plain
        assert dict(mpl.rcParams) == before


DAMAGES = {
    "empty": lambda content: b"",
    "cut in its checksum": lambda content: content[:10],
    "cut in half": lambda content: content[: len(content) // 2],
    "garbage": lambda content: b"garbage" * 100,
    "one bit": lambda content: content[:500] + bytes([content[500] ^ 1]) + content[501:],
}


@pytest.fixture
def compiles(tmp_path, monkeypatch):
    """A function that loads a kernel anew, as another run does: its value at 2, and the kernels compiled for it."""
    monkeypatch.setattr(numba.config, "CACHE_DIR", "")
    source = tmp_path / "toy.py"
    source.write_text(
        "from fitball.models.kernels.compiled import compiled\n\n@compiled\ndef toy(x):\n    return 3.0 * x\n"
    )
    told = []

    def load():
        told.clear()
        when_compiling(lambda compiling: compiling and told.append(compiling.kernel))
        spec = util.spec_from_file_location("fitball.toy", source)
        module = util.module_from_spec(spec)
        spec.loader.exec_module(module)
        return module.toy(2.0), list(told)

    yield load
    when_compiling(tell_nobody)


def test_a_damaged_kernel_on_disk_is_made_anew(compiles, tmp_path):
    assert [compiles(), compiles()] == [(6.0, ["toy"]), (6.0, [])]
    (place,) = tmp_path.rglob("*.nbc")
    whole = place.read_bytes()
    for what, damage in DAMAGES.items():
        place.write_bytes(damage(whole))
        assert compiles() == (6.0, ["toy"]), what
        assert compiles() == (6.0, []), what


def test_a_kernel_that_cannot_be_kept_is_used(compiles, tmp_path, monkeypatch):
    def full(_source, _target):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(compiled.os, "replace", full)
    assert [compiles(), compiles()] == [(6.0, ["toy"])] * 2
    assert not [file for file in tmp_path.rglob("*") if file.suffix in (".nbc", ".tmp")]


def test_kernel_files_are_those_of_their_key_and_sources(tmp_path):
    mine, later = KernelFiles(tmp_path, "toy", (1,)), KernelFiles(tmp_path, "toy", (2,))
    mine.save("float", 1)
    mine.save("int", 2)
    assert (mine.load("float"), mine.load("int"), mine.load("bool"), later.load("int")) == (1, 2, None, None)
    mine.place("float").replace(mine.place("bool"))
    assert mine.load("bool") is None


@pytest.mark.parametrize(
    ("limit", "threads", "fits"),
    [(600_000 * 1024, "1", False), (1_043_999_999, "1", False), (1_044_000_000, "1", True), (-1, "64", True)],
)
@POSIX
def test_too_little_address_space_is_refused_with_both_numbers(limit, threads, fits, monkeypatch):
    import resource

    monkeypatch.setenv("OPENBLAS_NUM_THREADS", threads)
    monkeypatch.setattr(resource, "getrlimit", lambda _which: (limit, limit))
    if fits:
        environment.check_address_space()
    else:
        with pytest.raises(MemoryShortageError, match=rf"limited to {limit / 1e6:,.0f} MB, .* needs 1,044 MB"):
            environment.check_address_space()


def fitball_in(words, shell="{}", folder=None, **setting):
    """`fitball words` as a shell runs it: the command stands for `{}`."""
    line = shell.format(shlex.join([sys.executable, "-m", "fitball", *words]))
    return subprocess.run(
        ["sh", "-c", line], env={**os.environ, **setting}, cwd=folder, capture_output=True, text=True, check=False
    )


LIGHT = ["datasets", "show", "wang_zero_spin.csv"]
SIMULATED = ["simulate", "--impact", "v=17, theta=18", "--quiet"]


@pytest.mark.parametrize(
    ("setting", "said"),
    [
        ({"NUMBA_NUM_THREADS": "0"}, "NUMBA_NUM_THREADS=0"),
        ({"NUMBA_NUM_THREADS": "many"}, "NUMBA_NUM_THREADS"),
        ({"NUMBA_DISABLE_JIT": "1"}, "unset NUMBA_DISABLE_JIT"),
        ({"PYTHONOPTIMIZE": "2"}, "PYTHONOPTIMIZE"),
    ],
)
def test_settings_that_cannot_be_used_are_refused(setting, said, tmp_path):
    done = fitball_in([*SIMULATED, "--out", str(tmp_path)], **setting)
    assert done.returncode == 2 and said in done.stderr and "Traceback" not in done.stderr
    assert len(done.stderr.splitlines()) == 1


@POSIX
def test_a_limit_of_address_space_ends_a_run_before_it_begins():
    done = fitball_in(LIGHT, "ulimit -v 600000; {}")
    assert done.returncode == 2 and "614 MB" in done.stderr and "Traceback" not in done.stderr


@POSIX
@pytest.mark.parametrize("closed", [">&-", "<&- >&- 2>&-"])
def test_closed_streams_are_no_fault(closed, small_fit, tmp_path):
    place = tmp_path / "parameters.json"
    done = fitball_in(["export", str(small_fit), "--to", "json", "--out", str(place)], "{} " + closed)
    assert (done.returncode, done.stderr) == (0, "")
    # Nothing that is printed has found its way into a file that took the stream's number.
    assert place.read_text().startswith("{") and place.read_text().endswith("}\n")
    assert fitball_in(["calibrate", "no such.csv"], "{} " + closed).returncode == 2


@FULL
@pytest.mark.parametrize("words", [["--version"], ["calibrate", "--help"], LIGHT])
def test_output_that_nobody_could_take_is_told(words):
    done = fitball_in(words, "{} >/dev/full")
    assert done.returncode == 2 and "standard output: cannot be used" in done.stderr
    assert len(done.stderr.splitlines()) == 1


@FULL
def test_remarks_that_nobody_could_take_are_lost_and_the_work_is_done(tmp_path):
    done = fitball_in(["simulate", "--impact", "v=17, theta=18", "--out", str(tmp_path / "out")], "{} 2>/dev/full")
    assert done.returncode == 0 and (tmp_path / "out" / "simulate.json").exists()


@POSIX
def test_a_reader_who_leaves_early_is_no_fault():
    done = fitball_in(LIGHT, "({}; echo $? >&2) | head -1")
    assert (len(done.stdout.splitlines()), done.stderr) == (1, "0\n")


def test_figures_are_drawn_whatever_mplbackend_and_matplotlibrc_say(small_fit, tmp_path):
    (tmp_path / "matplotlibrc").write_text("text.usetex: True\nfigure.dpi: 1e9\nbackend: TkAgg\n", "utf-8")
    (tmp_path / "bytes").write_bytes(b"\xff")
    places = [tmp_path / "plain", tmp_path / "hostile", tmp_path / "no text"]
    settings = [
        {},
        {"MPLBACKEND": "garbage", "MATPLOTLIBRC": str(tmp_path / "matplotlibrc")},
        {"MATPLOTLIBRC": str(tmp_path / "bytes")},
    ]
    for place, setting in zip(places, settings, strict=True):
        done = fitball_in(["plot", str(small_fit), "sketch", "--out", str(place)], **setting)
        assert done.returncode == 0, done.stderr
    assert len({(place / "sketch.png").read_bytes() for place in places}) == 1


def test_a_matplotlibrc_here_that_is_no_text_is_told(tmp_path):
    (tmp_path / "matplotlibrc").write_bytes(b"\xff")
    done = fitball_in(LIGHT, folder=tmp_path, PYTHONPATH=str(Path(fitball.__file__).parent.parent))
    assert done.returncode == 2 and "matplotlibrc" in done.stderr and len(done.stderr.splitlines()) == 1


@POSIX
def test_a_current_folder_that_is_gone_is_told(tmp_path):
    gone = tmp_path / "gone"
    gone.mkdir()
    done = fitball_in(LIGHT, "rmdir ../gone; {}", folder=gone, PYTHONPATH=str(Path(fitball.__file__).parent.parent))
    assert done.returncode == 2 and "current folder" in done.stderr and len(done.stderr.splitlines()) == 1


def test_packages_that_register_parts_of_themselves_do_so_once():
    """A session that has xarray already, and ArviZ afterwards: neither warns of the other."""
    code = """
import warnings, xarray
from xarray.core.extensions import AccessorRegistrationWarning
warnings.simplefilter("error", AccessorRegistrationWarning)
from fitball.inference.sampling import array_stats
import arviz_stats
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
