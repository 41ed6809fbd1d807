"""Structs in place, as JavaScript has them: functions that would go wrong if an object were written
before it is read; results in an object of the caller; how much memory a rebound takes.
"""

import json
import math
import shutil
import subprocess
from typing import NamedTuple

import pytest
from support import engines as of_engines

from fitball.exports.ports import dialects, in_place, port, source

pytestmark = pytest.mark.skipif(not shutil.which("node"), reason="needs node")


class Pair(NamedTuple):
    """Two numbers."""

    a: float
    b: float


class Nest(NamedTuple):
    """Two pairs and a number."""

    first: Pair
    second: Pair
    more: float


START = Pair(1.0, 2.0)


def swapped(pair: Pair) -> Pair:
    """A pair the other way round."""
    return Pair(pair.b, pair.a)


def turned(first: Pair, second: Pair) -> tuple[Pair, Pair]:
    """Two pairs the other way round, and their numbers mixed."""
    return Pair(second.a, first.b), Pair(first.a, second.b)


def loop(x: float) -> Pair:
    """A variable that is made of itself, by a function and by fields."""
    pair = START
    for k in range(5):
        pair = swapped(pair)
        pair = Pair(pair.b + x, pair.a * k)
    return pair


def exchange(x: float) -> Nest:
    """A tuple whose items are arguments of the call that makes them."""
    p = Pair(x, 2.0)
    q = Pair(3.0, x * x)
    for _ in range(3):
        p, q = turned(q, p)
        q, p = turned(swapped(p), q)
    return Nest(p, q, p.a - q.b)


def kept(x: float) -> Nest:
    """A value that stays what it was when its source is made anew."""
    pair = Pair(x, -x)
    nest = Nest(pair, swapped(pair), 0.0)
    pair = swapped(pair)
    before = nest
    nest = Nest(nest.second, nest.first, before.first.b)
    inner = nest.second
    nest = nest._replace(first=pair, more=inner.a + before.more)
    return Nest(before.first, nest.first, inner.b + nest.more)


def returned(x: float, early: bool) -> Nest:
    """Variables that are returned in two places, one of them elsewhere."""
    one = Pair(x, 1.0)
    two = swapped(one)
    if early:
        return Nest(one, Pair(two.b, one.b), two.a)
    one = Pair(two.a + one.a, one.b)
    return Nest(one, two, one.a)


def chosen(x: float) -> Pair:
    """A choice in a loop, of which an earlier one is kept."""
    kept_pair = START
    for k in range(4):
        pair = swapped(kept_pair) if k % 2 == 0 else START
        kept_pair = Pair(pair.a + x, kept_pair.b) if k < 2 else pair
    return kept_pair


def remembered(x: float) -> Pair:
    """What was a part of a struct of the turn before."""
    inner = START
    total = 0.0
    for k in range(4):
        nest = Nest(Pair(x + k, x * k), START, total)
        total = total + inner.a * nest.first.b
        inner = nest.first
    return Pair(total, inner.a)


def least_of(x: float, y: float) -> Pair:
    """Minima and maxima of terms, some of which are no numbers."""
    low = min(min(x * y, y), max(x, 2.0 * y))
    return Pair(low, max(max(y, math.nan), min(x + y, -y)))


def large(x: float, y: float) -> float:
    """A function whose numbers are handed over in an object."""
    total = 0.0
    for k in range(3):
        total = total * x + y * k - x * x + 2.0 * total * y + 0.5 * x * y - 0.25 * y
        total = total + 0.125 * x * y * y - 0.5 * total
    return total


def nested(x: float) -> Pair:
    """Calls of it within its own arguments."""
    return Pair(large(large(x, 0.5), large(0.25, x)), large(x, large(x, large(x, 1.0))))


def outer(x: float, y: float) -> Nest:
    """All of these."""
    early = returned(x, True)
    late = returned(y, False)
    first = loop(x)
    mixed = exchange(y)
    stays = kept(x)
    low = least_of(x, y)
    deep = nested(x * 0.25)
    pair = Pair(mixed.more + stays.more + first.b, early.second.a + late.more + chosen(y).a)
    deep = Pair(deep.a + low.b, deep.b + late.second.a + early.more + stays.second.b)
    return Nest(pair, deep, low.a + first.a + mixed.first.b + early.first.a + late.first.a)


def flat(value):
    """All numbers of a struct."""
    if isinstance(value, tuple):
        return [number for part in value for number in flat(part)]
    return [value]


def of_javascript(function, calls):
    """What a function returns in JavaScript: all numbers of it, for each call."""
    dialect = dialects.JAVASCRIPT
    whole = source.source_of((function,), {}, {}, dialect.helpers)
    texts = [dialect.constant_of(*item) for item in whole.constants.items()]
    texts += [in_place.translated(whole, name, dialect) for name in whole.functions]
    made = in_place.definitions(whole.compounds, "\n".join(texts))
    program = [
        '"use strict";',
        *made,
        *texts,
        "const flat = (one) => typeof one === 'object' ? Object.values(one).flatMap(flat) : [one];",
        f"const found = {json.dumps(calls)}.map((one) => flat({function.__name__}(...one)));",
        "console.log(JSON.stringify(found));",
    ]
    return json.loads(in_node("\n".join(program)))


def in_node(program, *options, folder=None):
    """What a program prints."""
    command = ["node", *options, "-e", program]
    done = subprocess.run(
        command, capture_output=True, text=True, cwd=folder, timeout=120, check=False
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.mark.parametrize(
    "function",
    [loop, exchange, kept, chosen, remembered, least_of, nested, outer],
    ids=lambda one: one.__name__,
)
def test_values_stay_what_they_were(function):
    count = function.__code__.co_argcount
    calls = [[0.5, 2.0][:count], [-1.25, 0.75][:count], [3.0, -2.5][:count]]
    assert of_javascript(function, calls) == [flat(function(*call)) for call in calls]


def down(x: float) -> Pair:
    """A function that calls itself."""
    return down(x - 1.0) if x > 0.0 else START


def test_a_circle_of_calls_is_refused():
    dialect = dialects.JAVASCRIPT
    whole = source.source_of((down,), {}, {}, dialect.helpers)
    with pytest.raises(source.UnportableError):
        in_place.translated(whole, "down", dialect)


# Impacts in the plane and in space, and steps of a flight with bounces, into objects that were
# returned before, and new ones. Prints what differs, and whether the object was taken.
INTO = """
const Bounce = require("./bounce.js");
const same = (a, b) => JSON.stringify(a) === JSON.stringify(b);
const up = { x: 0.1, y: 1, z: -0.2 };
let number = 1, differ = 0, taken = 0;
const drawn = (size) => size * ((number = (number * 48271) % 2147483647) / 1073741823.5 - 1);
const vector = (size) => ({ x: drawn(size), y: drawn(size), z: drawn(size) });
const plane = Bounce.rebound(3, 4, 5, Bounce.BALL);
const space = Bounce.rebound_3d({ x: 1, y: -2, z: 3 }, up, up, Bounce.BALL);
Bounce.warn = null;
for (let k = 0; k < 3000; ++k) {
    const impact = [drawn(40), 20 + drawn(22), drawn(500), Bounce.BALL];
    const first = Bounce.rebound(...impact);
    taken += Bounce.rebound(...impact, plane) === plane;
    differ += !same(first, plane);
    const vectors = [vector(30), vector(400), up, Bounce.BALL];
    const other = Bounce.rebound_3d(...vectors);
    taken += Bounce.rebound_3d(...vectors, space) === space;
    differ += !same(other, space);
    // Its own answer as what it is asked.
    const asked = structuredClone(other), normal = vector(1);
    const wanted = Bounce.rebound_3d(asked.velocity, asked.spin, normal, Bounce.BALL);
    Bounce.rebound_3d(other.velocity, other.spin, normal, Bounce.BALL, other);
    differ += !same(wanted, other);
}
const court = { normal: up, height: 0, velocity: { x: 1, y: 0, z: 0 } };
const flight = {
    position: { x: 0, y: 2, z: 0 }, velocity: { x: 20, y: -3, z: 1 }, spin: { x: 5, y: 0, z: -200 },
    turn: { x: 0, y: 0, z: 0 }, ahead: 0, bounces: 0, status: 0, extrapolated: false,
};
let fresh = structuredClone(flight), bounces = 0;
for (let k = 0; k < 2000; ++k) {
    const down = { x: 0, y: -9.81, z: 0 };
    fresh = Bounce.step(fresh, down, 1 / 60, court, Bounce.BALL);
    taken += Bounce.step(flight, down, 1 / 60, court, Bounce.BALL, flight) === flight;
    differ += !same(fresh, flight);
    bounces += flight.bounces;
}
console.log(JSON.stringify([differ, taken, bounces]));
"""
# Bytes a rebound, once it is compiled; without waiting for a compiler beside it, nor for memory
# that is given back. Numbers that are handed over are kept in objects too.
MEMORY = """
const Bounce = require("./bounce.js");
const result = Bounce.rebound(3, 4, 5, Bounce.BALL), states = [];
for (let k = 0; k < 500; ++k) states.push([(k * 7) % 40 + 0.5, (k * 3) % 20 + 1.5, k - 250.5]);
const run = () => {
    for (const [v_x, v_y, omega] of states) Bounce.rebound(v_x, v_y, omega, Bounce.BALL, result);
};
for (let k = 0; k < 60; ++k) run();
globalThis.gc();
const before = process.memoryUsage().heapUsed;
for (let k = 0; k < 4; ++k) run();
console.log((process.memoryUsage().heapUsed - before) / 2000);
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    place = tmp_path_factory.mktemp("port")
    (place / "bounce.js").write_text(port([of_engines.wang_set()], "javascript"), "utf-8")
    return place


def test_results_are_written_where_the_caller_says(folder):
    differ, taken, bounces = json.loads(in_node(INTO, folder=folder))
    assert differ == 0
    assert taken == 2 * 3000 + 2000
    assert bounces > 5


def test_a_rebound_takes_no_memory(folder):
    options = ["--expose-gc", "--no-concurrent-recompilation", "--max-semi-space-size=64"]
    bytes_each = float(in_node(MEMORY, *options, folder=folder))
    # With an object for each struct it was 15,000.
    assert bytes_each < 500.0
