"""Target: names of tables, as hostile as a file system allows, through every verb that repeats them."""

from __future__ import annotations

import functools
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

from fuzz.examples import TABLES
from fuzz.harness import Target
from fuzz.mutators import TEXTS, pick

from fitball.api import pose
from fitball.data.read import load_table
from fitball.errors import FitballError
from fitball.exports.formats import FORMATS
from fitball.inference.calibrate import run
from fitball.inference.effort import Effort
from fitball.inference.problem.build import Choices
from fitball.report.fit.folder import write_all

# Ends of comments and texts in languages of ports, formulas of spreadsheets, patterns of shells, TeX, markup.
PARTS = (
    *TEXTS, "*/", "*\\", "\\*", "`", "${1}", "'''", '"""', "\\input", "$x^2$", "%", "&amp;", "-->", "]]>", "*", "?",
    "[a-z]", "=1+1", "@x", "-v", "--out", " ", ".", "..", ".csv", "joint_mu", "batch", "NUL", "é", "e\u0301",
    "\udcff", "\n", "\t", "{folder}", "{}", "%s", "fits", "fit.json",
)  # fmt: skip
_TABLE = "{folder}/{text}"
_CALIBRATED = ("--point-only", "--cores", "1", "--model", "grip-slip", "--out", "{folder}/out")


def _build(folder):
    (folder / "impacts.csv").write_text(TABLES[0], encoding="utf-8")


@functools.cache
def _fit():
    """A fit of the table under another name: it differs by nothing else from one under the hostile name."""
    with TemporaryDirectory() as folder:
        _build(Path(folder))
        problem = pose(Path(folder) / "impacts.csv", Choices(model="grip-slip"))
        return run(problem, Effort(point_only=True, cores=1))


def _rename(folder, rng):
    """Give the table another name, and fit it under that name, so that what is exported repeats it."""
    parts = [pick(rng, PARTS).replace("/", "\\").replace("\0", "")[:60] for _ in range(int(rng.integers(1, 4)))]
    name = "".join(parts).encode("utf-8", "surrogatepass")[:200].decode("utf-8", "surrogateescape") + ".csv"
    place = (folder / "impacts.csv").rename(folder / name)
    try:
        table = load_table(place)
        fit = _fit()
        named = replace(fit.problem.table, name=table.name, source=table.source)
        (folder / "fit").mkdir()
        write_all(replace(fit, problem=replace(fit.problem, table=named)), folder / "fit", figures=False)
    except FitballError:
        # A name that is refused; the commands then find no fit.
        pass
    return name


def file_names():
    return Target(
        "file name", _build, _rename,
        (
            *(("export", "{folder}/fit", "--to", form) for form in FORMATS),
            ("plot", "{folder}/fit", "sketch"), ("datasets", "check", _TABLE), ("datasets", "show", _TABLE, "--json"),
            ("calibrate", _TABLE, *_CALIBRATED), ("batch", _TABLE, *_CALIBRATED), ("batch", "{folder}", *_CALIBRATED),
        ),
        exits=(0, 1, 2), few=8,
    )  # fmt: skip
