"""The parameter set of `tests/data/engines/wang_all.json` with the impacts that it was fitted to,
and what physics engines make of it.
"""

import json
from pathlib import Path

import numpy as np

import fitball
from fitball.exports import engine
from fitball.exports.parameter_set import ParameterSet

STORED = Path(__file__).resolve().parent.parent / "data" / "engines" / "wang_all.json"


def wang_set():
    """The set: all of Wang's impacts, two-mass. Exports of later fits move, this one stays."""
    stored = json.loads(STORED.read_text(encoding="utf-8"))
    ball = fitball.Ball(inertia_ratio=stored["values"]["inertia_ratio"])
    model = fitball.model(stored["model"], ball=ball)
    impacts = fitball.load_table("wang_all.csv").impacts
    return ParameterSet("", model, stored["values"], stored["origin"], {}, impacts)


def incident(parameters):
    """The impacts of a set, a row (v_x1, v_y1, omega_1) each."""
    forwards = parameters.usual.forwards
    return np.stack([forwards.v_x1, forwards.v_y1, forwards.omega_1], axis=1)


def rms(parameters, rebounds, phases):
    """Root mean squares of rebounds (impacts phases, 3) less the model, by column."""
    true = engine.model_rebounds(parameters, parameters.usual.forwards)
    wanted = np.stack([true[name] for name in ("v_x2", "v_y2", "omega_2")], axis=1)
    errors = np.asarray(rebounds) - np.repeat(wanted, phases, axis=0)
    return np.sqrt(np.mean(errors**2, axis=0))
