"""The table of rebound columns: what the rooms above take from it holds of the models and of each other."""

from __future__ import annotations

import json
from dataclasses import fields
from importlib.resources import files

import numpy as np
import pytest

import fitball
from fitball.data.checks import independent
from fitball.data.columns import REBOUND
from fitball.data.scene import Scene
from fitball.data.scene_keys import SIZES
from fitball.data.units import UNITS
from fitball.inference.prediction.outputs import OUTPUTS as COMPARED_OUTPUTS
from fitball.models.model import INPUTS, by_output
from fitball.models.types import OUTPUTS, Rebound
from fitball.observables import COMPARED, INCIDENT_UNITS, NOISE_OF, OBSERVABLES, SHARED_SD, VELOCITIES
from fitball.report.form.numbers import output_scale

POINT = {"mu": 0.55, "eps_10": 2e-3, "eps_slope": 0.0, "cor_10": 0.77, "cor_slope": -0.015, "mass_ratio": 0.87,
         "k_y": 2e4, "k_theta": 20.0}  # fmt: skip


def test_what_is_no_function_of_the_velocity_is_what_models_give():
    assert {name for name, item in OBSERVABLES.items() if item.function is None} == set(OUTPUTS)
    assert {item.name for item in fields(Rebound)} == {*OUTPUTS, "regime", "status"}
    assert set(COMPARED_OUTPUTS) == set(OBSERVABLES)
    assert COMPARED_OUTPUTS[: len(COMPARED)] == COMPARED
    assert tuple(INCIDENT_UNITS) == INPUTS


@pytest.mark.parametrize("name", OBSERVABLES)
def test_derivatives_are_those_of_the_prediction(name):
    """By differences of the two-mass ball's own rebound along each component of the incident state."""
    model = fitball.model("two-mass")
    names = tuple(POINT)
    values = np.array([list(POINT.values())])
    impacts = fitball.impacts([14.0, 9.0, 11.0], [6.0, 9.0, 8.0], [0.0, -150.0, 200.0])
    found = model.jacobian(names, values, impacts, ())
    item = OBSERVABLES[name]
    slopes = item.slopes(found.rebound, by_output(found.inputs))
    state = np.stack([impacts.v_x1, impacts.v_y1, impacts.omega_1])
    for place, step in enumerate((1e-5, 1e-5, 1e-4)):
        move = np.zeros((3, 1))
        move[place] = step
        ends = [item.predict(model.evaluate(names, values, fitball.impacts(*(state + s * move)))) for s in (1, -1)]
        np.testing.assert_allclose(slopes[..., place], (ends[0] - ends[1]) / (2.0 * step), rtol=1e-5, atol=1e-9)


def test_no_column_of_the_velocity_is_left_out_where_it_stands_alone():
    for name in VELOCITIES:
        assert independent([name], "2") == (name,)


def test_files_and_scenes_know_every_column():
    assert set(REBOUND) == set(OBSERVABLES)
    schema = json.loads((files("fitball.data") / "scene.schema.json").read_text("utf-8"))
    measurement = schema["properties"]["measurement"]["properties"]
    for name, item in OBSERVABLES.items():
        assert UNITS[output_scale(name).unit].to_si(1.0) * output_scale(name).factor == pytest.approx(1.0)
        assert f"[{item.unit}]" in measurement[item.noise.name]["description"]
    for noise in (SHARED_SD, *NOISE_OF.values()):
        assert getattr(Scene(), noise) is None
        assert f"measurement.{noise}" in SIZES
