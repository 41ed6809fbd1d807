"""What every fit can do, whatever it is a fit of: be drawn, predict, be exported, repeated, resumed and reported.

Each kind of fit is made once, too short to converge, and each verb is held against it: from files alone, far from the
table, comes to the last byte what the run itself made.
"""

from __future__ import annotations

import shutil
from dataclasses import dataclass, replace
from pathlib import Path

import pandas as pd
import pytest
from samples import restored, same_values
from synthetic_drop import COR, write_case

import fitball
from fitball.api import Fit, begin, pose
from fitball.cli.main import main
from fitball.exports.bounces import bounces_of
from fitball.exports.formats import FORMATS
from fitball.exports.port.port import port_of, python_port
from fitball.exports.tables import golden_table
from fitball.inference.calibrate import fingerprint
from fitball.inference.effort import Effort
from fitball.inference.problem.build import Choices
from fitball.inference.sampling.ensembles import SamplingInterrupted
from fitball.report.fit.document import _pictures
from fitball.report.fit.folder import write_all

ROWS = [
    "id,surface,group,v_x1 [m/s],v_y1 [m/s],omega_1 [rpm],v_x2 [m/s],v_y2 [m/s],omega_2 [rpm],v_x1_sd,"
    "omega_1_sd [rpm]",
    "a,clay,hand,16.0,5.0,0,11.5,4.1,2400,0.2,50",
    "b,clay,machine,15.0,7.5,50,8.9,6.0,2700,0.2,50",
    "c,grass,hand,13.0,10.0,0,7.6,7.6,2500,0.2,50",
    "d,grass,machine,10.0,13.0,-30,5.6,9.5,1900,0.2,50",
    "e,clay,hand,6.0,15.0,10,2.9,10.6,1000,0.2,50",
]
EXACT, NO_SPIN, DROP = range(9), (0, 2, 3, 4, 6, 7), (0, 4, 7)
# Few parameters are free: figures of pairs grow with their square.
FLAT, QUIET = {"cor_slope": -0.013}, {"velocity_sd": 0.3}
HELD = {"e_x": 0.1, "offset": 2e-3, **FLAT}
NOISE = {"spin_sd": 12.0, **QUIET}
# Columns of the table (None: a simulated drop test with force records), and what is chosen.
KINDS = {
    "plain": (EXACT, Choices(model="grip-slip", fix=HELD)),
    "pooled": (EXACT, Choices(model="grip-slip", fix=HELD | NOISE, pool={"mu": "surface"})),
    "group offsets": (
        NO_SPIN,
        Choices(model="brody", fix={"cor_slope": -0.013, "velocity_sd": 0.3}, offsets="group"),
    ),
    "uncertain incidence": (range(11), Choices(model="grip-slip", fix=HELD | NOISE)),
    "Student-t": (
        EXACT,
        Choices(model="grip-slip", fix=HELD | {"spin_sd": 12.0}, noise="student-t", velocity_noise="separate"),
    ),
    "force records": (None, Choices(fix={"cor_10": COR, "force_sd": 4.0, **FLAT, **QUIET})),
    "drop test": (DROP, Choices()),
    "no spin": (NO_SPIN, Choices(fix=FLAT)),
}
EFFORT = Effort(seed=3, ensembles=2, max_steps=200, cores=1)


@dataclass(frozen=True)
class Made:
    """A fit, what it was asked for, and its folder."""

    fit: Fit
    table: Path
    choices: Choices
    folder: Path


def files(folder):
    """Name -> content of a result folder, but for its figures."""
    return {item.name: item.read_bytes() for item in folder.iterdir() if item.suffix != ".png"}


@pytest.fixture(scope="module", autouse=True)
def quick():
    """Few starts; figures of few dots that nobody lays out, and none on the pages: they are those beside them."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("fitball.inference.point.point_fit.STARTS", 3)
        patch.setattr("fitball.inference.point.point_fit.SCREENED", 100)
        patch.setattr("fitball.inference.sampling.ensembles.POOL", 300)
        patch.setattr("fitball.report.figures.canvas.save_figure.__defaults__", ("png", 30))
        patch.setattr("matplotlib.layout_engine.do_constrained_layout", lambda *_, **__: None)
        patch.setattr("fitball.report.fit.document._pictures", lambda fit, _images: _pictures(fit, {}))
        yield


FAST = ("plain", "drop test")


@pytest.fixture(
    scope="module",
    params=[pytest.param(kind, marks=() if kind in FAST else pytest.mark.slow) for kind in KINDS],
    ids=list(KINDS),
)
def made(request, tmp_path_factory):
    home = tmp_path_factory.mktemp("kind")
    columns, choices = KINDS[request.param]
    if columns is None:
        table = write_case(home, 4, step=1e-4)
    else:
        table = home / "table.csv"
        lines = [",".join(line.split(",")[k] for k in columns) for line in ROWS]
        table.write_text("\n".join(lines) + "\n", encoding="utf-8")
    fit = started(table, choices, home / "fit").fit()
    write_all(fit, home / "fit")
    return Made(fit, table, choices, home / "fit")


def started(table, choices, folder, **ways):
    problem = pose(table, choices)
    return begin(problem, replace(EFFORT, walkers=2 * problem.dimension), folder, **ways)


def test_plot_draws_the_figures_of_the_run_without_the_table(made, tmp_path, capsys):
    copy = tmp_path / "moved"
    shutil.copytree(made.folder, copy)
    assert main(["plot", str(copy), "all", "--out", str(tmp_path), "--quiet"]) == 0
    drawn = capsys.readouterr().out.split()
    assert {Path(place).name for place in drawn} == {item.name for item in made.folder.glob("*.png")}
    for place in map(Path, drawn):
        assert place.read_bytes() == (made.folder / place.name).read_bytes(), place.name


def test_the_problem_is_read_back_as_it_was(made):
    read, effort = restored(made.folder), replace(EFFORT, walkers=60)
    assert fingerprint(read.problem, effort) == fingerprint(made.fit.problem, effort)
    assert read.problem.parameters == made.fit.problem.parameters
    same_values(read.point.rebound, made.fit.point.rebound)
    same_values(read.posterior, made.fit.posterior)
    same_values(read.predictive.observables, made.fit.predictive.observables)
    same_values(read.predictive.regimes, made.fit.predictive.regimes)
    same_values(read.identifiability, made.fit.identifiability)


def test_predict_says_of_files_what_it_says_of_the_fit(made):
    table = made.fit.problem.table
    given = {"seed": 5, "incident_covariance": table.incident_covariance}
    given |= {"levels": {"surface": "clay"}} if made.choices.pool else {}
    saved = fitball.load_fit(made.folder)
    same_values(saved.predict_interval(table.impacts, **given), made.fit.predict_interval(table.impacts, **given))
    predicted, notes = saved.predict(table), " ".join(saved.predict(table).attrs["notes"])
    pd.testing.assert_frame_equal(predicted, made.fit.predict(table))
    assert ("predictions are without bias" in notes) == (made.choices.offsets is not None)
    assert saved == made.fit


def test_export_writes_of_files_what_it_writes_of_the_fit(made, tmp_path, capsys):
    saved = fitball.load_fit(made.folder)
    bounces = [bounces_of(item) for item in (saved, made.fit)]
    assert python_port(port_of(bounces[0])) == python_port(port_of(bounces[1]))
    tables = [golden_table(item) for item in bounces]
    assert tables[0] == tables[1]
    for name in FORMATS.keys() - {"pdf"}:
        assert main(["export", str(made.folder), "--to", name, "--out", str(tmp_path / name)]) == 0, name
    capsys.readouterr()


def test_repeat_makes_every_file_again(made, without_figures, capsys):
    """The page among them."""
    again = made.folder.with_name("again")
    assert main(["repeat", str(made.folder), "--out", str(again), "--cores", "1", "--quiet"]) == 0
    assert "bit-equal" in capsys.readouterr().out
    assert_same_files(again, made.folder)


def test_resume_ends_where_an_uninterrupted_run_does(made, without_figures):
    def interrupt(_stage, progress):
        if progress is not None:
            raise KeyboardInterrupt

    folder = made.folder.with_name("resumed")
    with pytest.raises(SamplingInterrupted):
        started(made.table, made.choices, folder).fit(interrupt)
    assert [item.name for item in folder.iterdir()] == ["posterior.h5"]
    resumed = started(made.table, made.choices, folder, resume=True)
    assert resumed.resumes
    write_all(resumed.fit(), folder)
    assert_same_files(folder, made.folder)


def assert_same_files(one, other):
    found, wanted = files(one), files(other)
    assert found.keys() == wanted.keys()
    assert [name for name in wanted if found[name] != wanted[name]] == []
