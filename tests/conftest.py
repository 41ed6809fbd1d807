"""Shared fixtures: Wang's incident conditions and draws from the default priors."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, settings
from samples import leave_out_figures, save_without_figures, search_briefly

import fitball
from fitball.api import Fit
from fitball.data.read import load_table
from fitball.inference.problem.parameters import parse_prior
from fitball.models.model import Model
from fitball.report.saved.fit_file import fit_text
from fitball.report.saved.netcdf_files import write_data, write_netcdf
from fitball.report.saved.run_file import run_text
from fitball.values import FloatArray, Impacts

# Examples that hypothesis draws are the same everywhere, and none depends on how fast the machine is.
settings.register_profile("suite", deadline=None, derandomize=True, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("suite")


# Files of which `scripts/test --fast` runs nothing: they fit, sample or solve for tens of seconds, and what they tell
# of a room is told in part by a quicker file. In others single tests are marked.
SLOW_FILES = (
    "arviz", "bench", "benchmarks", "chapter_five", "cli_compare", "cli_plot", "compare", "court_pace", "docs",
    "error_budget", "evidence", "force_likelihood", "force_report", "fuzz", "hard_cases", "house",
    "incident_errors", "inference_fit", "information_ends", "jacobian", "large_tables", "new_model",
    "noise_structure", "oracle", "oracle_runge_kutta", "own_model", "point_and_chain", "portable",
    "power_scaling", "profile", "repeat", "report_browser", "report_html", "sbc", "site", "small_and_flat",
    "stragglers", "thesis_verdicts", "tied_draws", "track_study", "trust", "verify",
)  # fmt: skip


def pytest_addoption(parser: pytest.Parser) -> None:
    """How often each kind of input is damaged."""
    parser.addoption("--fuzz", type=int, metavar="N", help="damage each kind of input N times (see test_fuzz.py)")


def _is_slow(path: Path) -> bool:
    return path.name.removeprefix("test_").removesuffix(".py") in SLOW_FILES


def pytest_ignore_collect(collection_path: Path, config: pytest.Config) -> bool | None:
    """Slow files are not even imported where only quick tests are asked for."""
    return True if _is_slow(collection_path) and config.option.markexpr == "not slow" else None


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Every test of a slow file is slow; slow files come first, so that no process waits for another's last file."""
    for item in items:
        if _is_slow(item.path):
            item.add_marker(pytest.mark.slow)
    items.sort(key=lambda item: not _is_slow(item.path))


# Programs that some tests need besides Python, as the reasons name them for which these are skipped.
PROGRAMS = {
    "browser": "install chromium, Chrome or Edge, or name one: FITBALL_BROWSER=/path/to/it",
    "C compiler": "install gcc or clang",
    "node": "install nodejs",
    "mcs and mono": "install mono-mcs and mono-runtime",
    "openssl": "install openssl",
}


@pytest.hookimpl(wrapper=True, tryfirst=True)
def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> Iterator[None]:
    """After all else: how many tests were skipped for want of a program, and how to get it."""
    yield
    reasons = [str(report.longrepr) for report in terminalreporter.getreports("skipped")]
    for program, remedy in PROGRAMS.items():
        if missed := sum(f"no {program}" in reason for reason in reasons):
            terminalreporter.write_line(
                f"Tests skipped because there is no {program}: {missed}. To run them, {remedy}."
            )


@pytest.fixture
def without_figures(monkeypatch: pytest.MonkeyPatch) -> None:
    """Results are saved without their figures."""
    leave_out_figures(monkeypatch)


@pytest.fixture
def brief(monkeypatch: pytest.MonkeyPatch, without_figures: None) -> None:
    """Fits are searched briefly, and saved without figures."""
    search_briefly(monkeypatch)


@pytest.fixture
def interrupts() -> Iterator[None]:
    """Ctrl-C works as in a terminal, here and in processes started here; a job in the background has it ignored."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.fixture
def start(interrupts: None) -> Iterator[Callable[..., subprocess.Popen[str]]]:
    """A function that starts Python with some words in a process group of its own, as a terminal does, in the folder
    `cwd`; modules of the folder `first` come before all others. No process outlives its test.
    """
    begun: list[subprocess.Popen[str]] = []

    def start_python(*words: str, cwd: Path, first: Path | None = None) -> subprocess.Popen[str]:
        places = [str(place) for place in (first, Path(__file__).resolve().parent.parent) if place is not None]
        process = subprocess.Popen(
            [sys.executable, *words], cwd=cwd, env=dict(os.environ, PYTHONPATH=os.pathsep.join(places)),
            stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True,
        )  # fmt: skip
        begun.append(process)
        return process

    yield start_python
    for process in begun:
        with suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
        with process:
            pass


@pytest.fixture(scope="session")
def cluster() -> Iterator[str]:
    """The address of a Dask scheduler with two processes."""
    distributed = pytest.importorskip("distributed")
    with distributed.LocalCluster(2, threads_per_worker=1, dashboard_address=":0") as made:
        yield made.scheduler_address


@pytest.fixture(scope="session")
def wang_impacts() -> Impacts:
    """The 21 incident conditions of Wang's three tables."""
    return load_table("wang_all.csv").impacts


@pytest.fixture(scope="session")
def draw_priors() -> Callable[[Model, np.random.Generator, int], FloatArray]:
    """A function that draws (draws, parameters) from a model's default priors."""

    def draw(model: Model, rng: np.random.Generator, count: int) -> FloatArray:
        columns = [
            parse_prior(spec.name, spec.prior, spec.lower, spec.upper).draw(rng, count) for spec in model.parameters
        ]
        return np.stack(columns, axis=1)

    return draw


@pytest.fixture(scope="session")
def short_fit() -> Fit:
    """A fit of grip-slip that is too short to converge."""
    return fitball.calibrate("wang_zero_spin.csv", model="grip-slip", seed=4, cores=1, max_steps=100)


@pytest.fixture(scope="session")
def small_fit(short_fit: Fit, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Its folder: fit.json, posterior.nc, data.nc and run.toml, without figures."""
    fit = short_fit
    folder = tmp_path_factory.mktemp("small") / "fit"
    folder.mkdir()
    assert fit.posterior is not None
    write_netcdf(fit, fit.posterior, folder / "posterior.nc")
    write_data(fit.problem, folder / "data.nc")
    (folder / "run.toml").write_text(run_text(fit, folder), encoding="utf-8")
    (folder / "fit.json").write_text(fit_text(fit), encoding="utf-8")
    return folder


@pytest.fixture(scope="session")
def grip_slip_fit() -> Fit:
    """A converged fit of an algebraic model to Wang's 21 impacts."""
    return fitball.calibrate("wang_all.csv", model="grip-slip", seed=4, cores=2)


@pytest.fixture(scope="session")
def grip_slip_folder(grip_slip_fit: Fit, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Its result folder, without figures."""
    return save_without_figures(grip_slip_fit, tmp_path_factory.mktemp("results") / "wang_all" / "grip-slip")


@pytest.fixture(scope="session")
def grip_slip_page(grip_slip_fit: Fit, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Its page, with figures."""
    return grip_slip_fit.save(tmp_path_factory.mktemp("page")) / "report.html"


@pytest.fixture(scope="session")
def point_fit() -> Fit:
    """A point fit of the default model."""
    return fitball.calibrate("wang_zero_spin.csv", point_only=True, cores=2)


@pytest.fixture(scope="session")
def point_page(point_fit: Fit, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Its page."""
    return point_fit.save(tmp_path_factory.mktemp("point")) / "report.html"


@pytest.fixture(scope="session")
def drop_page(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The page of a drop test."""
    folder = tmp_path_factory.mktemp("drop")
    table = folder / "drop.csv"
    table.write_text("v_y1,v_y2\n4,3.21\n6,4.68\n8,6.13\n10,7.48\n", encoding="utf-8")
    return fitball.calibrate(table, point_only=True, cores=2).save(folder / "out") / "report.html"
