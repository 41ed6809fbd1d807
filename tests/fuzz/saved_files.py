"""Targets: files of a result folder, changed since by a person, a disk or another program; what is asked of a fit."""

from __future__ import annotations

import copy
import json
import shutil

import h5py
import numpy as np
from fuzz.examples import GRIDS, IMPACTS, POINTS, TABLES
from fuzz.harness import Target
from fuzz.mutators import TEXTS, damage_file, damage_place, damage_text_file
from fuzz.structured import damage_table
from fuzz.user_files import TABLE, option_target
from samples import problem_of

from fitball.exports.bounces import bounces_of
from fitball.exports.formats import FORMATS
from fitball.exports.tables import golden_table
from fitball.inference.calibrate import fingerprint, run
from fitball.inference.effort import Effort
from fitball.inference.sampling.chain_file import ChainFile
from fitball.report.saved.fit_file import read_fit

FIT = "{folder}/fit"
ODD = (
    None, True, 0, -1, 1, 3, 0.5, -1.5, 1e5, 1e308, -1e308, 5e-324, 10**30, "", "1.5", "nan", "mu", "a" * 100_000, [],
    {}, [1, 2, 3], [[1.0], [2.0, 3.0]], {"a": 1}, ["x", None], *TEXTS[2:8],
)  # fmt: skip
IMPACT = ("--impact", "v=17, theta=18")
PREDICT = ("predict", FIT, *IMPACT)
OUT = ("--out", "{folder}/out")
EXPORTS = tuple(("export", FIT, "--to", name, "--out", "{folder}/exported") for name in FORMATS)
PLOTS = tuple(("plot", FIT, kind, *OUT) for kind in ("profiles", "residuals", "trace", "corner", "all"))
REPEAT = ("repeat", FIT, "--cores", "1")
# The run that `short_chain` began.
RESUME = (
    "calibrate", "wang_zero_spin.csv", "--model", "grip-slip", "--seed", "4", "--cores", "1", "--max-steps", "100",
    "--resume", "--quiet", "--out", FIT,
)  # fmt: skip


def of_a_fit(fit):
    """The targets that need the result folder of a short fit."""

    def build(folder):
        shutil.copytree(fit, folder / "fit")
        (folder / TABLE).write_text(TABLES[0], encoding="utf-8")

    def build_port(folder):
        build(folder)
        (folder / "port.csv").write_text(golden_table(bounces_of(read_fit(folder / "fit"))), encoding="utf-8")

    verify = ("verify", "{folder}/port.csv", "--fit", FIT)
    predict = ("predict", FIT, "{folder}/" + TABLE)
    read = (PREDICT, (*PREDICT, "--json"), *EXPORTS)
    return (
        Target("fit.json", build, _damage("fit.json", damage_json), read, few=100),
        Target("plotted fit.json", build, _damage("fit.json", damage_json), PLOTS, few=8),
        Target("posterior.nc", build, _damage("posterior.nc", damage_hdf5), (PREDICT, EXPORTS[-1]), few=40),
        Target("data.nc", build, _damage("data.nc", damage_hdf5), (PLOTS[1], EXPORTS[-1]), few=20),
        Target("run.toml", build, _damage("run.toml", damage_text_file), (REPEAT,), (0, 1, 2), few=8),
        Target("repeated fit.json", build, _damage("fit.json", damage_json), (REPEAT,), (0, 1, 2), few=8),
        Target("posterior.h5", short_chain, _damage("posterior.h5", damage_hdf5), (RESUME,), (0, 1, 2), few=3),
        Target("port", build_port, lambda folder, rng: damage_table(folder / "port.csv", rng),
               (verify, (*verify, "--json"), (*verify, "--quiet")), (0, 1, 2)),
        Target("new impacts", build, lambda folder, rng: damage_table(folder / TABLE, rng),
               (predict, (*predict, "--json"), (*predict, "--out", "{folder}/predicted.csv"))),
        option_target("impact of a fit", build, IMPACTS, ("predict", FIT, "--impact", "{text}"),
               ("predict", FIT, "--impact", "{text}", "--json")),
        option_target("range", build, GRIDS, ("export", FIT, "--to", "lookup", "--range", "{text}")),
        option_target("at", build, POINTS, ("export", FIT, "--to", "engine", "--at", "{text}")),
    )  # fmt: skip


def short_chain(folder):
    """Write the chain of a run that stopped after its steps and before its files."""
    problem = problem_of("wang_zero_spin.csv", "grip-slip")
    effort = Effort(seed=4, cores=1, max_steps=100)
    (folder / "fit").mkdir()
    run(problem, effort, ChainFile(folder / "fit" / "posterior.h5", fingerprint(problem, effort)))


def _damage(name, way):
    return lambda folder, rng: damaged_somehow(folder / "fit" / name, way, rng)


def damaged_somehow(path, way, rng):
    """Damage a file in its own way, or one time in ten put in its place what never ends."""
    return (way if rng.integers(10) else damage_place)(path, rng)


def damage_json(path, rng):
    """Change, take away or add something anywhere in a JSON file; one time in five damage its text instead."""
    if rng.integers(5) == 0:
        return damage_text_file(path, rng)
    content = json.loads(path.read_text(encoding="utf-8"))
    done = [_damage_tree(content, rng) for _ in range(int(rng.integers(1, 3)))]
    path.write_text(json.dumps(content), encoding="utf-8")
    return f"{path.name}: {'; '.join(done)}"


def _damage_tree(content, rng):
    """Go down to a random place and damage what is there. Returns where, and what it is now."""
    node, where = content, []
    if not content:
        return "nothing is left"
    while True:
        keys = list(node) if isinstance(node, dict) else list(range(len(node)))
        key = keys[rng.integers(len(keys))]
        where.append(str(key))
        inner = node[key]
        if not (isinstance(inner, dict | list) and inner) or rng.integers(8) == 0:
            break
        node = inner
    odd = copy.deepcopy(ODD[rng.integers(len(ODD))])
    way = int(rng.integers(8))
    if way == 0:
        del node[key]
        odd = "gone"
    elif way == 1 and isinstance(node, dict):
        node["more"] = odd
    elif way == 1:
        node.append(inner)
        odd = "twice"
    elif way == 2 and isinstance(inner, int | float):
        node[key] = odd = float(inner) * 10.0 ** int(rng.integers(-8, 9))
    else:
        node[key] = odd
    return f"{'.'.join(where)} = {str(odd)[:30]!r}"


def damage_hdf5(path, rng):
    """Change an array or an attribute of an HDF5 file; one time in three damage its bytes instead."""
    if rng.integers(3) == 0:
        return damage_file(path, rng)
    places: list[str] = []
    with h5py.File(path, "r+") as file:
        file.visit(places.append)
        name = places[rng.integers(len(places))]
        way = list(HDF5_WAYS)[rng.integers(len(HDF5_WAYS))]
        if isinstance(file[name], h5py.Group):
            way = "gone" if rng.integers(2) else "an attribute"
        HDF5_WAYS[way](file, name, rng)
    return f"{path.name}: {name}: {way}"


def _attribute(file, name, rng):
    attributes = file[name].attrs if rng.integers(2) and file[name].attrs else file.attrs
    if len(attributes):
        key = list(attributes)[rng.integers(len(attributes))]
        attributes[key] = ("odd", 7, 1e308, np.zeros((3, 2)), np.array([], dtype=int))[rng.integers(5)]


def _entry(value):
    def change(file, name, rng):
        array = file[name]
        if array.size and array.dtype.kind in "fiu":
            flat = array[()].astype(np.float64).ravel()
            flat[rng.integers(flat.size)] = value
            _put(file, name, flat.reshape(array.shape))

    return change


def _put(file, name, value):
    del file[name]
    file[name] = value


HDF5_WAYS = {
    "gone": lambda file, name, _rng: file.__delitem__(name),
    "an attribute": _attribute,
    "not a number": _entry(float("nan")),
    "infinite": _entry(float("inf")),
    "huge": _entry(1e308),
    "negative": _entry(-1.0),
    "whole numbers": lambda file, name, _rng: _put(file, name, np.zeros(file[name].shape, dtype=np.int32)),
    "texts": lambda file, name, _rng: _put(file, name, np.full(file[name].shape, b"text")),
    "a scalar": lambda file, name, _rng: _put(file, name, 1.0),
    "empty": lambda file, name, _rng: _put(file, name, np.empty(0)),
    "another axis": lambda file, name, _rng: _put(file, name, np.zeros((*file[name].shape, 2))),
    "half": lambda file, name, _rng: _put(file, name, file[name][()].ravel()[::2]),
    "a group": lambda file, name, _rng: (file.__delitem__(name), file.create_group(name))[0],
    "endless": lambda file, name, _rng: (
        file.__delitem__(name),
        file.create_dataset(name, shape=(10**6, 10**6), dtype="f8", chunks=(1000, 1000)),
    )[0],
    "all equal": lambda file, name, _rng: _put(file, name, np.ones(file[name].shape)),
}
