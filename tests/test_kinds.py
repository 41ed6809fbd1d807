"""Arguments of a wrong kind are refused in words, by every public function and method, before anything begins."""

from __future__ import annotations

import inspect
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import fitball
from fitball import FitballError, load_fit
from fitball.errors import ParameterError

FRAME = pd.DataFrame({"v_y1": [4.0, 6.0], "v_y2": [3.2, 4.7]})
# What no argument of any function is, and what some may be.
WRONG = (
    None, True, 5, 2.5, -1, 1j, float("nan"), 10**400, "", "x", "a\0b", "\ud800", "n" * 5000, b"x", [], [1], ["a"],
    [None], [[]], (1, 2), {}, {1: 2}, {"a": None}, {"a"}, set(), iter([1]), object(), int, FRAME, np.array(3),
    np.arange(3), Path("nowhere"), fitball.Scene,
)  # fmt: skip


@pytest.fixture(scope="module")
def fit(small_fit):
    return load_fit(small_fit)


@pytest.fixture(scope="module")
def batch(tmp_path_factory):
    tables = {"a": {"v_1": [17.0]}}
    return fitball.calibrate_many(tables, "brody", out=tmp_path_factory.mktemp("many") / "out", cores=1)


NAMED = [
    (lambda fit, _: fit.export(FRAME), "to: read a value of type DataFrame, expected a text"),
    (lambda *_: fitball.load_table(FRAME, scene=FRAME), "scene: .*DataFrame, expected a value of type Scene$"),
    (lambda _, batch: batch.population(1.0), "quantities: read 1.0, expected a text"),
    (lambda fit, _: fit.plot({}), "kind: read {}, expected a text"),
    (lambda *_: fitball.calibrate(FRAME, flip=5), "flip: read 5, expected a text or a list, each a text"),
    (lambda *_: fitball.calibrate_many([FRAME], progress=True), "progress: read True, expected a function$"),
    (lambda *_: fitball.calibrate(FRAME, point_only="no"), "point_only: read 'no', expected True or False"),
    (lambda *_: fitball.calibrate(FRAME, seed=True), "seed = True: expected a whole number$"),
    (lambda *_: fitball.load_fit("a\0b"), "path: read 'a.x00b', expected a text or a path"),
    (lambda *_: fitball.load_table(FRAME, columns={"v_y1": 5}), "columns: .*expected a dict, each value a text"),
    (lambda *_: fitball.model("brody", normal=5), "normal: read 5, expected a text"),
    (lambda *_: fitball.regime_name(-1), "code = -1: expected a packed sequence of phases"),
]  # fmt: skip


@pytest.mark.parametrize(("call", "said"), NAMED)
def test_a_wrong_kind_is_named(call, said, fit, batch):
    with pytest.raises(ParameterError, match=said):
        call(fit, batch)


def called(fit, batch):
    """Functions and methods with arguments that they take, where nothing long begins even then."""
    impact, table = fitball.impacts(10.0, 5.0), {"v_y1": [4.0, 6.0], "v_y2": [3.2, 4.7]}
    values = {"mu": 0.5, "e_x": 0.1, "offset": 0.003, "cor_10": 0.75, "cor_slope": -0.01}
    # A table that cannot be fitted, so that no right argument begins a fit.
    short = {"v_1": [17.0]}
    return [
        (fitball.load_table, {"source": table}), (fitball.load_scene, {"table_source": None}),
        (fitball.check, {"data": table}), (fitball.model, {"name": "grip-slip"}), (fitball.regime_name, {"code": 1}),
        (fitball.impacts, {"v_x1": 1.0, "v_y1": 2.0}), (fitball.Ball, {}), (fitball.load_fit, {"path": "nowhere"}),
        (fitball.Impacts, {"v_x1": [1.0], "v_y1": [2.0], "omega_1": [3.0]}),
        (fitball.load_batch, {"folder": "nowhere"}), (fitball.calibrate, {"table": short}),
        (fitball.compare, {"data": short}), (fitball.plot, {"fit": "nowhere", "kind": "sketch"}),
        (fitball.simulate, {"impact": "v=17, theta=18"}), (fitball.export, {"fit": fit, "to": "csv"}),
        (fit.predict, {"data": "v=17, theta=25"}), (fit.predict_interval, {"impacts": impact}),
        (fit.export, {"to": "csv"}), (fit.simulate, {"impact": "v=17"}), (fit.plan, {"target": "no parameter"}),
        (fit.plot, {"kind": "no figure"}), (fit.plot.corner, {"package": "none"}),
        (batch.population, {}), (batch.__getitem__, {"name": "a"}),
        (fitball.model("grip-slip").rebound, {"parameters": values, "impacts": impact}),
    ]  # fmt: skip


def test_no_wrong_kind_reaches_the_depth(fit, batch, tmp_path, monkeypatch):
    """Every argument of all of these as each of the WRONG: it is taken, or there is an error in words."""
    monkeypatch.chdir(tmp_path)
    refused = 0
    for function, right in called(fit, batch):
        for name, item in inspect.signature(function).parameters.items():
            for wrong in WRONG:
                args, named = [], right | {name: wrong}
                if item.kind is item.VAR_POSITIONAL:
                    args, named = [wrong], right
                elif item.kind is item.VAR_KEYWORD:
                    named = right | {"other": wrong}
                try:
                    function(*args, **named)
                except (FitballError, OSError):
                    refused += 1
                except KeyError:
                    mapping = function == batch.__getitem__
                    refused += mapping
                    if not mapping:
                        raise
    assert refused > 1000


def test_what_is_public_is_checked():
    """Each public function with arguments, and each public method of what these give, goes through the one check."""
    public = {name: getattr(fitball, name) for name in fitball.__all__ if inspect.isfunction(getattr(fitball, name))}
    for owner in (fitball.Fit, fitball.Batch, fitball.Comparison, fitball.Plan):
        methods = inspect.getmembers(owner, inspect.isfunction)
        public |= {f"{owner.__name__}.{name}": item for name, item in methods if not name.startswith("_")}
    # Arrays and numbers of `impacts` are looked at by `Impacts`; `get` is Python's own.
    own = {"impacts", "Batch.get"}
    bare = {
        name for name, item in public.items()
        if len(inspect.signature(item).parameters) > name.count(".") and "wrapper" not in item.__code__.co_name
    }  # fmt: skip
    # The verbs of a fit hand all to its methods, and so does `exported`.
    assert bare == own | {"predict", "plan", "export", "Fit.exported"}


@pytest.mark.parametrize("v_y1", [0.0, 5e-324])
@pytest.mark.parametrize("v_y2", [1e-310, 1.0])
def test_extreme_numbers_make_no_noise(v_y1, v_y2):
    """Warnings are errors here."""
    spun = {"v_x1": [10.0, v_y1, 3.0], "omega_1": [v_y2, 1, 2], "v_x2": [5.0, v_y2, 2.0], "omega_2": [v_y1, 2, 3]}
    for more in ({}, spun):
        fitball.check({"v_y1": [v_y1, 5.0, 6.0], "v_y2": [v_y2, 3.0, 4.0], **more}, as_read=True)
        fitball.check({"v_y1": [v_y1, 5.0, 6.0], "v_y2": [v_y2, 3.0, 4.0], **more})
