"""Targets: the folder of a batch, one file of it changed since by a person, a disk or another program."""

from __future__ import annotations

import shutil

from fuzz.harness import Target
from fuzz.mutators import damage_file, damage_text_file
from fuzz.saved_files import damage_hdf5, damage_json, damaged_somehow
from fuzz.structured import damage_table, damage_toml

from fitball.api import pose
from fitball.batch.many import KIND, Plan
from fitball.data.bundled import bundled_folder
from fitball.inference.effort import Effort
from fitball.inference.problem.problem import Choices
from fitball.report.batch.rows import ROW_NAME, row_of
from fitball.report.form.files import csv_text, json_text
from fitball.report.saved.fit_file import read_fit

TABLES = ("a", "b", "day/c", "day/d")
WAYS = {
    ".json": damage_json,
    ".csv": damage_table,
    ".nc": damage_hdf5,
    ".toml": damage_toml,
    ".txt": damage_text_file,
}
POPULATION = ("population", "{folder}/out")
AGAIN = (
    "batch", "{folder}/season/**/*.csv", "--out", "{folder}/out", "--model", "grip-slip", "--seed", "4", "--cores",
    "1", "--max-steps", "100",
)  # fmt: skip


def of_a_batch(fit):
    """The targets that need the result folder of a short fit."""

    def build(folder):
        plan = Plan(folder / "out", Choices(model="grip-slip"), Effort(seed=4, cores=1, max_steps=100))
        rows = []
        for name in TABLES:
            table, place = folder / "season" / f"{name}.csv", folder / "out" / name
            for made in (table.parent, place):
                made.mkdir(parents=True, exist_ok=True)
            for suffix in (".csv", ".toml"):
                shutil.copy(bundled_folder() / f"wang_zero_spin{suffix}", table.with_suffix(suffix))
            for file in ("fit.json", "data.nc", "run.toml"):
                shutil.copy(fit / file, place)
            problem = pose(table, plan.choices)
            rows.append(row_of(name, read_fit(place), problem))
            (place / ROW_NAME).write_text(json_text({"mark": plan.mark(problem), "row": rows[-1]}), encoding="utf-8")
        (folder / "out" / "batch.json").write_text(json_text({"kind": KIND}), encoding="utf-8")
        (folder / "out" / "batch.csv").write_text(csv_text(rows), encoding="utf-8")

    def mutate(folder, rng):
        files = sorted(place for place in (folder / "out").rglob("*") if place.is_file())
        # One of each kind as often as another.
        names = sorted({place.name for place in files})
        name = names[rng.integers(len(names))]
        alike = [place for place in files if place.name == name]
        place = alike[rng.integers(len(alike))]
        way = WAYS[place.suffix] if rng.integers(4) else damage_file
        return f"{place.parent.name}/{damaged_somehow(place, way, rng)}"

    asked = (*[("--parameters", "mu")] * 5, *[("--of", "cor_10", "--json")] * 4, ("--of", "spin_sd/velocity_sd"))
    return (
        Target("batch", build, mutate, tuple((*POPULATION, *words) for words in asked), (0, 1, 2), few=30),
        Target("repeated batch", build, mutate, (AGAIN,), (0, 1, 2), few=4),
    )
