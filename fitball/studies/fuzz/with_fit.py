"""Targets that need a fit: answers of a port, and texts of options that say where to evaluate it."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from fitball.exports.formats import TEXT_FORMATS, Options
from fitball.report.saved.saved_fit import read_fit
from fitball.studies.fuzz.examples import GRIDS, IMPACTS, POINTS, TABLES
from fitball.studies.fuzz.harness import Target
from fitball.studies.fuzz.structured import damage_table
from fitball.studies.fuzz.user_files import TABLE, option_target

FIT = "{folder}/fit"
MakeFit = Callable[[Path], None]


def with_fit(make_fit: MakeFit) -> tuple[Target, ...]:
    """The targets; `make_fit` writes a result folder of a short fit into a folder that is not there yet."""

    def build(folder: Path) -> None:
        make_fit(folder / "fit")
        (folder / TABLE).write_text(TABLES[0], encoding="utf-8")
        texts = TEXT_FORMATS["golden"].make(read_fit(folder / "fit"), Options())
        (folder / "port.csv").write_text(next(iter(texts.values())), encoding="utf-8")

    verify = ("verify", "{folder}/port.csv", "--fit", FIT)
    predict = ("predict", FIT, "{folder}/" + TABLE)
    return (
        Target("port", build, lambda folder, rng: damage_table(folder / "port.csv", rng),
               (verify, (*verify, "--json"), (*verify, "--quiet")), (0, 1, 2)),
        Target("new impacts", build, lambda folder, rng: damage_table(folder / TABLE, rng),
               (predict, (*predict, "--json"), (*predict, "--out", "{folder}/predicted.csv"))),
        option_target("impact of a fit", build, IMPACTS, ("predict", FIT, "--impact", "{text}"),
               ("predict", FIT, "--impact", "{text}", "--json")),
        option_target("range", build, GRIDS, ("export", FIT, "--to", "lookup", "--range", "{text}")),
        option_target("at", build, POINTS, ("export", FIT, "--to", "engine", "--at", "{text}")),
    )  # fmt: skip
