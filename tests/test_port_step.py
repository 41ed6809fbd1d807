"""A step of a flight in which a number is not finite: each in turn, in every language that can be
run. The ball stays as it was, and the status says so.
"""

import itertools
import math
import shutil
import subprocess
from typing import NamedTuple

import pytest
from support import engines as of_engines
from support import ports

from fitball.exports.ports import port

# A flight, an acceleration, a time and a plane: the ball bounces within the step.
COUNT = 13 + 3 + 1 + 7
NUMBERS = [
    *(0.1, 0.05, 0.2),
    *(20.0, -5.0, 1.0),
    *(5.0, 0.0, -200.0),
    *(0.1, 0.2, 0.3),
    *(0.001,),
    *(0.0, -9.81, 0.0),
    *(1 / 60,),
    *(0.0, 1.0, 0.0),
    *(0.0,),
    *(1.0, 0.0, 0.0),
]
BAD = (math.nan, math.inf, -math.inf)
CASES = [*itertools.product(range(COUNT), BAD)]

# Each number is left out, or is none. Prints the status of the whole step, then what is wrong.
JAVASCRIPT = """
const Bounce = require("./bounce.js");
const vector = (x, y, z) => ({ x, y, z });
const made = () => [
    { position: vector(0.1, 0.05, 0.2), velocity: vector(20, -5, 1), spin: vector(5, 0, -200),
      turn: vector(0.1, 0.2, 0.3), ahead: 0.001, bounces: 0 },
    vector(0, -9.81, 0), 1 / 60,
    { normal: vector(0, 1, 0), height: 0, velocity: vector(1, 0, 0) }, Bounce.BALL,
];
const shown = (value) => JSON.stringify(value, (key, x) => typeof x === "number" ? `${x}` : x);
const moving = ({ position, velocity, spin, turn, ahead }) =>
    shown({ position, velocity, spin, turn, ahead });
const wrong = [];
let tried = 0;
function look(place, change) {
    const asked = made();
    change(asked);
    const before = shown(asked);
    const after = Bounce.step(...asked);
    const kept = moving(after) === moving(asked[0]) && shown(asked) === before;
    // Into the flight that it begins with.
    const into = Bounce.step(...asked, asked[0]);
    const same = into === asked[0] && shown(into) === shown(after);
    if (after.status !== -1 || after.bounces !== 0 || !kept || !same) wrong.push(place);
    ++tried;
}
function each(value, path) {
    for (const key of Object.keys(value)) {
        if (key === "bounces" || (path.length === 0 && key === "4")) continue;
        if (typeof value[key] === "object") { each(value[key], [...path, key]); continue; }
        for (const bad of [undefined, NaN, Infinity, -Infinity]) {
            look([...path, key].join(".") + ` ${bad}`, (asked) => {
                const holder = path.reduce((of, name) => of[name], asked);
                if (bad === undefined) delete holder[key]; else holder[key] = bad;
            });
        }
    }
}
each(made(), []);
const whole = Bounce.step(...made());
console.log(JSON.stringify({ whole: [whole.status, whole.bounces], tried, wrong }));
"""
# Lines of numbers to what is left of the flight, bounces and status.
C = """#include "bounce.h"
#include <stdio.h>
int main(void)
{
    double i[24];
    for (int k = 0; scanf("%lf", &i[k]) == 1; k++) {
        if (k < 23)
            continue;
        fitball_Flight f = {{i[0], i[1], i[2]}, {i[3], i[4], i[5]}, {i[6], i[7], i[8]},
                            {i[9], i[10], i[11]}, i[12], 0, 0, false};
        fitball_Vector a = {i[13], i[14], i[15]};
        fitball_Plane p = {{i[17], i[18], i[19]}, i[20], {i[21], i[22], i[23]}};
        f = fitball_step(f, a, i[16], p, FITBALL_BALL);
        double y[] = {f.position.x, f.position.y, f.position.z, f.velocity.x, f.velocity.y,
                      f.velocity.z, f.spin.x, f.spin.y, f.spin.z, f.turn.x, f.turn.y, f.turn.z,
                      f.ahead, (double)f.bounces, (double)f.status};
        for (k = 0; k < 15; k++)
            printf(k < 14 ? "%.17g " : "%.17g\\n", y[k]);
        k = -1;
    }
    return 0;
}
"""


class Step(NamedTuple):
    """The numbers of a flight after a step, its bounces and status."""

    moving: list[float]
    bounces: float
    status: float


def lines_of_numbers():
    """The numbers of a step that is whole, then with one number that is not finite, by case."""
    lines = [NUMBERS]
    for place, bad in CASES:
        lines.append([*NUMBERS[:place], bad, *NUMBERS[place + 1 :]])
    return lines


def in_python(_folder):
    """All steps by the port in Python."""
    bounce = ports.module(port([of_engines.wang_set()], "python"))
    steps = []
    for line in lines_of_numbers():
        vectors = [bounce.Vector(*line[k : k + 3]) for k in (0, 3, 6, 9, 13, 17, 21)]
        flight = bounce.Flight(*vectors[:4], line[12], 0, 0, False)
        plane = bounce.Plane(vectors[5], line[20], vectors[6])
        after = bounce.step(flight, vectors[4], line[16], plane, bounce.BALL)
        moving = [*after.position, *after.velocity, *after.spin, *after.turn, after.ahead]
        steps.append(Step(moving, after.bounces, after.status))
    return steps


def in_c(folder):
    """All steps by the port in C."""
    if shutil.which("cc") is None:
        pytest.skip("cc is not installed")
    (folder / "bounce.h").write_text(port([of_engines.wang_set()], "c"), encoding="utf-8")
    (folder / "steps.c").write_text(C, encoding="utf-8")
    command = ["cc", "-std=c99", "-O2", "steps.c", "-o", "steps", "-lm"]
    subprocess.run(command, cwd=folder, check=True, timeout=120)
    text = "\n".join(" ".join(map(repr, line)) for line in lines_of_numbers())
    done = subprocess.run(
        ["./steps"], cwd=folder, input=text, capture_output=True, text=True, check=True, timeout=60
    )
    found = [list(map(float, line.split())) for line in done.stdout.splitlines()]
    return [Step(line[:13], line[13], line[14]) for line in found]


@pytest.mark.parametrize("run", [in_python, in_c], ids=["python", "c"])
def test_a_number_that_is_not_finite_leaves_the_ball_as_it_was(run, tmp_path):
    whole, *steps = run(tmp_path)
    assert (whole.bounces, whole.status) == (1, 0)
    for case, step, line in zip(CASES, steps, lines_of_numbers()[1:], strict=True):
        assert (step.bounces, step.status) == (0, -1), case
        assert list(map(str, step.moving)) == list(map(str, map(float, line[:13]))), case


def test_a_number_that_is_left_out_leaves_the_objects_as_they_were(tmp_path):
    found = ports.in_node(tmp_path, [of_engines.wang_set()], JAVASCRIPT)
    assert found == {"whole": [0, 1], "tried": 4 * COUNT, "wrong": []}
