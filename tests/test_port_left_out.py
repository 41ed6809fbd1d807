"""A rebound with a parameter that is no finite number, each in turn, in every language that can be
run: no rebound, and a status that says so.
"""

import itertools
import math

import numpy as np
import pytest
from support import engines, ports

from fitball.exports.ports import port

BAD = (math.nan, math.inf, -math.inf)
# Velocity and spin in the plane; velocity, spin and normal in three dimensions.
LANDING = [15.0, 7.0, 20.0, *(15.0, -7.0, 1.0), *(5.0, 0.0, -20.0), *(0.0, 1.0, 0.0)]
# The same of a ball that moves away from the surface.
LEAVING = [15.0, -7.0, 20.0, *(15.0, 7.0, 1.0), *(5.0, 0.0, -20.0), *(0.0, 1.0, 0.0)]
STATUS = ports.OUTPUTS.index("status")
# Velocity and spin of the rebound in the plane, and in three dimensions.
REBOUND = (0, 1, 2, *range(10, 16))

# Each parameter is left out, or is no finite number. Prints what is wrong.
JAVASCRIPT = """
const Bounce = require("./bounce.js");
Bounce.warn = () => {};
const wrong = [];
let tried = 0;
for (const name of Object.keys(Bounce.BALL))
    for (const bad of [undefined, NaN, Infinity, -Infinity]) {
        const ball = { ...Bounce.BALL, [name]: bad };
        if (bad === undefined) delete ball[name];
        const up = { x: 0, y: 1, z: 0 }, none = { x: 0, y: 0, z: 0 };
        for (const v_y of [7, -7]) {
            const flat = Bounce.rebound(15, v_y, 20, ball);
            const spatial = Bounce.rebound_3d({ x: 15, y: -v_y, z: 1 }, none, up, ball);
            const { v_x2, v_y2, omega_2 } = flat;
            const numbers = [v_x2, v_y2, omega_2, ...Object.values(spatial.velocity)];
            if (flat.status !== -1 || spatial.status !== -1 || !numbers.every(Number.isNaN))
                wrong.push(`${name} ${bad} ${v_y}: ${flat.status} ${spatial.status}`);
            ++tried;
        }
    }
const whole = Bounce.rebound(15, 7, 20, Bounce.BALL);
console.log(JSON.stringify({ whole: whole.status, tried, wrong }));
"""


def sets_of(model):
    """The parameters of a model, or those of Wang's balls."""
    return [engines.wang_set() if model == "wang" else ports.typical(model)]


@pytest.mark.parametrize("language", [*ports.LANGUAGES, "gdscript"])
@pytest.mark.parametrize("model", ["wang", "grip-slip"])
def test_a_parameter_that_is_not_finite_has_no_rebound(model, language, tmp_path):
    sets = sets_of(model)
    row = list(ports.module(port(sets, "python")).BALL)
    whole = [[*row, *impact] for impact in (LANDING, LEAVING)]
    spoilt = [
        [*row[:place], bad, *row[place + 1 :], *impact]
        for place, bad in itertools.product(range(len(row)), BAD)
        for impact in (LANDING, LEAVING)
    ]
    rebounds = ports.run(tmp_path, language, sets, np.array(whole + spoilt))
    assert rebounds[:2, STATUS].tolist() == [0, 6]
    assert np.isfinite(rebounds[:2][:, REBOUND]).all()
    for line, found in zip(spoilt, rebounds[2:], strict=True):
        assert found[STATUS] == -1, line
    assert np.isnan(rebounds[2:][:, REBOUND]).all()


@pytest.mark.parametrize("model", ["wang", "grip-slip"])
def test_a_parameter_that_an_object_lacks_has_no_rebound(model, tmp_path):
    sets = sets_of(model)
    found = ports.in_node(tmp_path, sets, JAVASCRIPT)
    count = len(ports.module(port(sets, "python")).Parameters._fields)
    assert found == {"whole": 0, "tried": 8 * count, "wrong": []}
