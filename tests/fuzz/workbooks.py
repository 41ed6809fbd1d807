"""Target: workbooks whose cells, dimensions and parts are not what a table has."""

from __future__ import annotations

import zipfile

import openpyxl
from fuzz.examples import TABLES
from fuzz.harness import Target
from fuzz.mutators import NUMBERS, TEXTS, damage_file, pick

SHEET = "xl/worksheets/sheet1.xml"
PLACES = (
    "A1", "A900", "Z30", "AZ1048576", "XFD1", "XFD3000", "XFD50000", "A1048576", "XFE1", "A0", "1A", "", "a1:b2",
)  # fmt: skip
# What stands in a sheet, and what comes in its place; `{}` is a cell's place.
SWAPS = (
    ('r="A1"', 'r="{}"'), ('r="B2"', 'r="{}"'), ('<dimension ref="A1', '<dimension ref="A1:{}" x="A1'),
    ("<sheetData>", '<sheetData><row r="1048576"/>'), ("<sheetData>", '<sheetData><row><c r="{}"/></row>'),
    ("<sheetData>", "<sheetData><sheetData>"), ("</worksheet>", ""), ("<v>", "<v>9e999"), ("<v>", "<v>#N/A"),
    ('t="s"', 't="e"'), ('t="n"', 't="s"'), ('t="n"', 't="b"'),
)  # fmt: skip


def _build(folder):
    book = openpyxl.Workbook()
    for line in TABLES[0].strip().splitlines():
        book.active.append([_number(cell) for cell in line.split(",")])
    book.save(folder / "impacts.xlsx")


def _number(cell):
    try:
        return float(cell)
    except ValueError:
        return cell


def _damage(folder, rng):
    place, way = folder / "impacts.xlsx", int(rng.integers(6))
    if way == 0:
        return damage_file(place, rng)
    if way < 3:
        return _filled(place, rng)
    with zipfile.ZipFile(place) as book:
        parts = {name: book.read(name) for name in book.namelist()}
    if way == 3:
        name = pick(rng, sorted(parts))
        said = f"no {name}"
        del parts[name]
    else:
        old, new = pick(rng, SWAPS)
        new, said = new.replace("{}", pick(rng, PLACES)), f"{new} for {old}"
        count = -1 if rng.integers(2) else 1
        parts[SHEET] = parts[SHEET].decode().replace(old, new, count).encode("utf-8", "replace")
    with zipfile.ZipFile(place, "w", zipfile.ZIP_DEFLATED) as book:
        for name, data in parts.items():
            book.writestr(name, data)
    return said


def _filled(place, rng):
    """Cells anywhere in it, as a person's cat or a program leaves them, and sheets beside it."""
    book, said = openpyxl.load_workbook(place), []
    for _ in range(int(rng.integers(1, 4))):
        cell = f"{pick(rng, ('A', 'C', 'Z', 'ZZ', 'XFD'))}{pick(rng, (1, 2, 4, 40, 3000, 1048576))}"
        text = " " if rng.integers(2) else pick(rng, (*TEXTS, *NUMBERS))
        book.active[cell] = "".join(letter for letter in text[:200] if letter >= " " and letter.isprintable())
        said.append(cell)
    if rng.integers(3) == 0:
        book.create_sheet("x")["XFD2"] = " "
    book.save(place)
    return f"written into {', '.join(said)}"


def workbooks():
    return Target(
        "workbook", _build, _damage,
        (
            ("datasets", "check", "{folder}/impacts.xlsx"), ("datasets", "show", "{folder}/impacts.xlsx", "--json"),
            ("calibrate", "{folder}/impacts.xlsx", "--point-only", "--cores", "1", "--model", "grip-slip", "--out",
             "{folder}/out"),
        ),
        exits=(0, 1, 2), few=12,
    )  # fmt: skip
