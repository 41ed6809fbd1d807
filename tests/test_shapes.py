"""Shapes in annotations are those of the arrays that pass, in fits and what people make of them."""

import subprocess
import sys
from pathlib import Path
from typing import Annotated

import numpy as np
import pytest
from scipy.io import wavfile
from support import shapes
from support.sounds import recording

import fitball
from fitball.base.values import FloatArray
from fitball.batches.charts import NELSON, chart_of
from fitball.thesis import appendices, ranking


def weighted(values: Annotated[FloatArray, "rows columns"], weights: Annotated[FloatArray, "rows"]):
    return values, weights


def doubled(values: Annotated[FloatArray, "rows"]) -> Annotated[FloatArray, "rows"] | None:
    return values if values.size else np.append(values, 1.0)


def faults_of(function, *arguments):
    """What is wrong with a call of one function."""
    shaped = shapes.Shaped("function", shapes.shapes_of(function))
    with shapes.held({id(function.__code__): shaped}) as trace:
        function(*arguments)
    assert trace.calls == {"function": 1}
    return trace.faults


@pytest.mark.parametrize(
    ("array", "shape", "fits"),
    [
        (np.zeros(3), "rows", True),
        (np.zeros((3, 2)), "rows 2", True),
        (np.zeros((3, 2)), "rows 3", False),
        (np.zeros((3, 2)), "rows rows", False),
        (np.zeros((4, 3, 2)), "... rows columns", True),
        (np.zeros(3), "... rows columns", False),
        (np.zeros(3), "", False),
        (np.zeros(()), "", True),
        (3.0, "", False),
    ],
)
def test_a_shape_fits_or_not(array, shape, fits):
    assert (shapes.unfit(array, shape, {}) == "") == fits


def test_one_name_is_one_size_within_a_call():
    assert not faults_of(weighted, np.zeros((3, 2)), np.zeros(3))
    assert len(faults_of(weighted, np.zeros((3, 2)), np.zeros(2))) == 1
    assert not faults_of(doubled, np.zeros(3))
    assert len(faults_of(doubled, np.zeros(0))) == 1


def linear(v_x1, v_y1, omega_1, ball, a="normal(0.7, 0.1)"):
    return v_x1, a * v_y1, omega_1


@pytest.fixture(scope="module")
def trace(tmp_path_factory):
    """What passed in fits of several kinds and in what people make of them."""
    times = 2e-4 * np.arange(60.0)
    pulse = np.where((times > 3e-3) & (times < 8e-3), np.sin(np.pi * (times - 3e-3) / 5e-3), 0.0)
    heights = {"drop_height": [2.54] * 4, "rebound_height": [1.4, 1.41, 1.39, 1.4]}
    made = tmp_path_factory.mktemp("made")
    script = Path(__file__).parent.parent / "scripts" / "render_film.py"
    subprocess.run([sys.executable, script, made / "ball.mp4", "--seed", "3"], check=True)
    signal, _ = recording(1)
    wavfile.write(made / "drops.wav", 48_000, signal)
    with shapes.held(shapes.shaped_functions(fitball)) as trace:
        fit = fitball.calibrate(
            "wang_all", model="grip-slip", pool={"mu": "group"}, max_steps=160, cores=1
        )
        fit.report()
        fit.prior_draws("cor_10", 5)
        fit.predict(impact="v_1=17±0.5, theta_1=10..60 deg:4", level={"group": "new"}).report()
        fit.plan(count=1)
        fitball.simulate(impact="v_1=17, theta_1=20 deg", fix={"mu": 0.5})
        film = fitball.track("table_tennis_topspin")
        fitball.calibrate(film.table, point_only=True, cores=1)
        fitball.compare("wang_zero_spin", models="grip-slip,brody", cores=1)
        fitball.calibrate({**heights, "ball": list("aabb")}, point_only=True).report()
        fitball.calibrate("synthetic_drop", model=fitball.model_from(linear), point_only=True)
        fitball.contact_time(times, 700.0 * pulse)
        fitball.track(made / "ball.mp4")
        fitball.track(made / "drops.wav")
        chart_of(np.sin(np.arange(30.0)), 20, NELSON)
        ranking.errors_and_points(*ranking.case_values({}))
        appendices.slips_frame()
    return trace


def test_arrays_have_the_shapes_of_their_annotations(trace):
    assert not sorted({*trace.faults})


def test_nearly_all_annotations_are_held(trace):
    """What the fits above do not call is a small part."""
    names = {function.name for function in shapes.shaped_functions(fitball).values()}
    assert len(names) > 120
    assert len(names - {*trace.calls}) < 0.2 * len(names), sorted(names - {*trace.calls})
