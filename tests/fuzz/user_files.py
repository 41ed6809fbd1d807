"""Targets: what users write by hand. Impact tables, scenes, force records, answers of a port, texts of options."""

from __future__ import annotations

import datetime
import io
import shutil

import numpy as np
import pandas
from fuzz.examples import DIALECTS, IMPACTS, PRIORS, SCENE, TABLES
from fuzz.harness import Target
from fuzz.mutators import damage_file, damaged
from fuzz.structured import damage_table, damage_toml

from fitball.data.bundled import bundled_folder
from fitball.inference.problem.noise import KINDS

TABLE = "impacts.csv"
SHOWN = (
    ("datasets", "check", "{folder}/" + TABLE),
    ("datasets", "check", "{folder}/" + TABLE, "--json"),
    ("datasets", "show", "{folder}/" + TABLE),
    ("datasets", "show", "{folder}/" + TABLE, "--json"),
)
_OUT = ("--out", "{folder}/out")
_SIMULATED = ("simulate", "--impact", "v=17, theta=18", *_OUT)
_GRIP_SLIP = ("calibrate", "{folder}/" + TABLE, "--point-only", "--cores", "1", *_OUT, "--model", "grip-slip")
# Options, texts they take, and a command to use them with.
OPTIONS = (
    ("--impact", IMPACTS, ("simulate", "--quiet", *_OUT)),
    ("--set", ("mu=0.6", "zeta_y=0.2"), _SIMULATED),
    ("--prior", PRIORS, _GRIP_SLIP),
    ("--fix", ("mu=0.6", "e_x = 0.2", "cor_10=0.7"), _GRIP_SLIP),
    ("--pool", ("mu=surface", "e_x=group"), _GRIP_SLIP),
    ("--closure", ("normal=total", "torsion=free"), _GRIP_SLIP),
    ("--model", ("two-mass+normal=total", "thesis-exact", "two-mass+torsion=free"), _SIMULATED),
    ("--noise", tuple(KINDS), _GRIP_SLIP),
    ("--offsets", ("group", "surface"), _GRIP_SLIP),
)  # fmt: skip


def _build_tables(folder):
    for k, text in enumerate(TABLES):
        (folder / f"table{k}.csv").write_text(text, encoding="utf-8")


def _damage_table(folder, rng):
    (folder / f"table{rng.integers(len(TABLES))}.csv").rename(folder / TABLE)
    return damage_table(folder / TABLE, rng)


def _build_dialects(folder):
    for k, text in enumerate(DIALECTS):
        (folder / f"table{k}.csv").write_text(text, encoding=("utf-8", "utf-16")[k])


def _damage_dialect(folder, rng):
    k = int(rng.integers(len(DIALECTS)))
    place = (folder / f"table{k}.csv").rename(folder / TABLE)
    if rng.integers(8) == 0:
        return damage_file(place, rng)
    text = damaged(DIALECTS[k], rng)
    coding = ("utf-8", "cp1252", "utf-16", "utf-16-le", "utf-8-sig")[rng.integers(5)]
    place.write_bytes(text.encode(coding, "replace" if coding == "cp1252" else "surrogatepass"))
    return f"{place.name}: its text, as {coding}"


def _build_workbook(folder):
    for k, text in enumerate(TABLES):
        place = folder / f"table{k}.xlsx"
        pandas.read_csv(io.StringIO(text), comment="#").to_excel(place, index=False, engine="openpyxl")


def _damage_workbook(folder, rng):
    """Its bytes, or, half of the time, a cell."""
    place = (folder / f"table{rng.integers(len(TABLES))}.xlsx").rename(folder / "impacts.xlsx")
    if rng.integers(2) == 0:
        return damage_file(place, rng)
    frame = pandas.read_excel(place, header=None, dtype=object, engine="openpyxl")
    odd = (
        None, 1e308, -1e300, True, "text\ttabbed", "a" * 10_000, 10**18, "#DIV/0!", "1,234", "21 ± 1", "=1+1",
        pandas.Timestamp("2026-01-01"), datetime.time(3, 4),
    )  # fmt: skip
    at = [int(rng.integers(size)) for size in frame.shape]
    frame.iat[at[0], at[1]] = odd[rng.integers(len(odd))]
    frame.to_excel(place, index=False, header=False, engine="openpyxl")
    return f"{place.name}: row {at[0] + 1}, column {at[1] + 1} = {str(frame.iat[at[0], at[1]])[:40]}"


def _build_parquet(folder):
    for k, text in enumerate(TABLES):
        place = folder / f"table{k}.csv"
        place.write_text(text, encoding="utf-8")
        pandas.read_csv(place, comment="#").to_parquet(folder / f"table{k}.parquet")
        place.unlink()


def _damage_parquet(folder, rng):
    """Its bytes, or, half of the time, a cell of the table it holds, or a column's type."""
    place = folder / "impacts.parquet"
    (folder / f"table{rng.integers(len(TABLES))}.parquet").rename(place)
    if rng.integers(2) == 0:
        return damage_file(place, rng)
    frame = pandas.read_parquet(place)
    column = int(rng.integers(frame.shape[1]))
    name = str(frame.columns[column])
    odd = (
        None, float("nan"), float("inf"), 1e308, -1e300, True, b"\xff\x00", "text\x1b[2J", "a" * 100_000, 10**18,
        [1.0, 2.0], {"value": 1.0}, pandas.Timestamp("2026-01-01"), pandas.Timedelta("1s"), np.datetime64("NaT"),
    )  # fmt: skip
    new = odd[rng.integers(len(odd))]
    rows = rng.integers(2, size=len(frame)) == 0
    mixed = [new if row else value for row, value in zip(rows, frame[name], strict=True)]
    try:
        frame[name] = pandas.Series(mixed, dtype=object).infer_objects()
        frame.to_parquet(place)
    except (ValueError, TypeError, OverflowError):
        # Arrow holds no column of mixed types: all cells alike then.
        frame[name] = pandas.Series([new] * len(frame))
        frame.to_parquet(place)
    return f"{place.name}: {name} = {str(new)[:40]}"


def _build_scene(folder):
    shutil.copy(bundled_folder() / "wang_zero_spin.csv", folder / TABLE)
    (folder / "impacts.toml").write_text(SCENE, encoding="utf-8")


def _build_force(folder):
    """The drop test with force records that comes with fitball, four impacts of it."""
    lines = (bundled_folder() / "synthetic_drop.csv").read_text(encoding="utf-8").splitlines(keepends=True)
    data = [line for line in lines if not line.startswith("#")]
    (folder / TABLE).write_text("".join(data[:5]), encoding="utf-8")
    names = {line.split(",")[0] for line in data[1:5]}
    samples = (bundled_folder() / "synthetic_drop_force.csv").read_text(encoding="utf-8").splitlines(keepends=True)
    head, *rest = (line for line in samples if not line.startswith("#"))
    kept = [line for line in rest if line.split(",")[0] in names]
    (folder / "impacts_force.csv").write_text("".join([head, *kept]), encoding="utf-8")


def hand_written():
    return (
        Target("table", _build_tables, _damage_table, (*SHOWN, _GRIP_SLIP), few=40),
        Target(
            "parquet", _build_parquet, _damage_parquet,
            tuple(tuple(word.replace(".csv", ".parquet") for word in command) for command in SHOWN),
        ),
        Target("dialect", _build_dialects, _damage_dialect, (*SHOWN, _GRIP_SLIP), few=40),
        Target(
            "workbook", _build_workbook, _damage_workbook,
            tuple(tuple(word.replace(".csv", ".xlsx") for word in command) for command in SHOWN),
        ),
        Target("scene", _build_scene, lambda folder, rng: damage_toml(folder / "impacts.toml", rng),
               (*SHOWN, _GRIP_SLIP), few=40),
        Target("force", _build_force, lambda folder, rng: damage_table(folder / "impacts_force.csv", rng),
               (SHOWN[0],)),
        *(option_target(name[2:], _build_table, texts, (*command, name, "{text}"), few=3)
          for name, texts, command in OPTIONS),
    )  # fmt: skip


def _build_table(folder):
    (folder / TABLE).write_text(TABLES[0], encoding="utf-8")


def option_target(name, build, texts, *commands, few=20):
    """The target of an option whose valid texts are `texts`; `{text}` in `commands` is the damaged one."""

    def mutate(_folder, rng):
        text = damaged(texts[rng.integers(len(texts))], rng)
        # As a program receives it: no zero bytes, and undecodable bytes as the surrogates that stand for them.
        return text.replace("\0", "").encode("utf-8", "surrogatepass").decode("utf-8", "surrogateescape")

    return Target(name, build, mutate, commands, few=few)
