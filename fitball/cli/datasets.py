"""`fitball datasets`: list the bundled tables, show one, check a file of one's own, list published priors."""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterable
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from fitball.cli.options import COLUMNS, FLIP, FORCE, READING, SCENE, Option, Run, Verb, fitting_of, option, switch
from fitball.cli.terminal import show
from fitball.visible import one_line

if TYPE_CHECKING:
    from fitball.data.scene import Scene
    from fitball.data.table import ImpactTable, Notice
    from fitball.report.form.document import Table


def _list(args: argparse.Namespace) -> int:
    from fitball.data.bundled import bundled_tables

    tables = bundled_tables()
    if args.json:
        _print_json([asdict(table) | {"path": str(table.path)} for table in tables])
        return 0
    width = max((len(table.name) for table in tables), default=0)
    for table in tables:
        print(f"{table.name:<{width}}  {table.description}")
    return 0


def _priors(args: argparse.Namespace) -> int:
    from fitball.data.published import PREFIX, published_priors
    from fitball.report.form.document import wrapped

    rows = published_priors()
    if args.json:
        _print_json([asdict(row) | {"prior": row.text} for row in rows])
        return 0
    print("Published priors, in SI units. Use one with --prior NAME=literature:KEY, or in [priors] of a scene.")
    for row in rows:
        print(f"\n{row.parameter}={PREFIX}{row.key}  {row.text}")
        print("\n".join(wrapped([row.note, f"Source: {row.source}"], "  ", "  ")))
    return 0


def _show(args: argparse.Namespace) -> int:
    from fitball.data.balances import scene_balances
    from fitball.data.misreading import doubt_of_table
    from fitball.data.read import load_table
    from fitball.data.scene import load_scene
    from fitball.report.fit.rows import balance_table
    from fitball.report.form.document import Document, Section, Words, on_terminal

    scene = load_scene(args.data, as_read=True)
    table = load_table(args.data, scene=scene, flip=args.flip, columns=args.columns)
    if args.json:
        _print_json(_as_json(table, scene))
        return 0
    doubt = doubt_of_table(table, scene.ball)
    balances, meanings = balance_table(scene_balances(table, scene))
    lists = {
        "known": _known(scene),
        "assumed": scene.assumed,
        "notices": table.remarks,
        "another reading of the table fits much better": () if doubt is None else doubt.lines(scene),
    }
    heads = filter(None, (scene.citation, f"file {table.source}", f"SHA-256 {table.digest}"))
    sections = [Section("table", "the table as it is read:", [_table(table)])]
    sections += [
        Section("balances", "balances of momentum and energy, without a model:", [balances, Words(meanings, "list")])
    ]
    sections += [Section(head, f"{head}:", [Words([*map(one_line, texts)], "list")]) for head, texts in lists.items()]
    title = one_line(f"{table.name}: {scene.description or table.source}")
    show(on_terminal(Document(title, [Words([*map(one_line, heads)], "lead")], sections)))
    return 0


def _check(args: argparse.Namespace) -> int:
    from fitball.api.reading import check, reading_of

    found = check(args.data, force=args.force, **reading_of(fitting_of(args)))
    if args.json:
        notices = _notices(found.notices)
        _print_json({"source": args.data, "ok": found.ok, "faults": found.faults, "notices": notices})
    elif args.quiet:
        print("".join(f"{fault}\n" for fault in found.errors), end="")
    else:
        print(found)
    return 0 if found.ok else 2


def _notices(notices: Iterable[Notice]) -> list[dict[str, Any]]:
    return [{"message": item.message, "row": item.row, "columns": item.columns} for item in notices]


def _columns(table: ImpactTable) -> dict[str, Any]:
    """Name with SI unit -> values, incident first."""
    from fitball.observables import SI_UNITS

    columns = {name: getattr(table.impacts, name) for name in table.incident_columns}
    columns |= {measurement.name: measurement.values for measurement in (*table.measurements, *table.redundant)}
    return {f"{name} [{SI_UNITS[name]}]": values for name, values in columns.items()}


def _table(table: ImpactTable) -> Table:
    """For people: SI units, but angles in degrees."""
    from fitball.data.units import UNITS
    from fitball.report.form.document import MOST_LINES, Table
    from fitball.report.form.numbers import significant

    cells = [["id", *table.ids[:MOST_LINES]]]
    for name, values in _columns(table).items():
        if name.endswith(" [rad]"):
            name, values = name.replace("[rad]", "[deg]"), UNITS["deg"].from_si(values)
        cells.append([name, *(significant(float(value), 6) for value in values[:MOST_LINES])])
    return Table("Impacts", list(zip(*cells, strict=True)), count=len(table), rest="--json")


def _known(scene: Scene) -> tuple[str, ...]:
    ball = scene.ball
    lines = [
        f"ball: {1e3 * ball.mass:g} g, radius {1e3 * ball.radius:g} mm, I/(M R^2) = {ball.inertia_ratio:.4g}",
        f"model: {scene.model}",
    ]
    if scene.surface:
        lines.append(f"surface: {scene.surface}")
    if scene.mu is not None:
        value, sd = scene.mu
        lines.append(f"friction coefficient {value:g}" + ("" if sd is None else f" ± {sd:g}"))
    if scene.contact_time is not None:
        value, spread = scene.contact_time
        lines.append(f"contact time {1e3 * value:g} ± {1e3 * spread:g} ms")
    return tuple(lines)


def _as_json(table: ImpactTable, scene: Scene) -> dict[str, Any]:
    return {
        "name": table.name,
        "source": table.source,
        "digest": table.digest,
        "description": scene.description,
        "citation": scene.citation,
        "ids": table.ids,
        "columns": {
            name: [None if value != value else value for value in values.tolist()]
            for name, values in _columns(table).items()
        },
        "measurements": [measurement.name for measurement in table.measurements],
        "redundant": [item.name for item in table.redundant],
        "labels": dict(table.labels),
        "notices": _notices(table.notices),
        "known": _known(scene),
        "assumed": scene.assumed,
    }


def _print_json(content: object) -> None:
    print(json.dumps(content, indent=2, ensure_ascii=False))


def _action(run: Run, name: str, help: str, example: str, *options: Option) -> Verb:
    known = (*options, switch("--json", "print JSON for other programs"))
    return Verb(name, help, known, run, f"example:\n  fitball datasets {example}\n")


DATA = option("data", "DATA", "a table (CSV, workbook, Parquet), or the name of a bundled one")
DATASETS = Verb(
    "datasets",
    "list, show and check tables of impacts; list published priors",
    (),
    _list,
    """examples:
  fitball datasets list
  fitball datasets show wang_zero_spin.csv
  fitball datasets check my_impacts.csv
  fitball datasets check my_impacts.csv --json
  fitball datasets priors
""",
    description="List the bundled tables, show a table, check a table for faults, or list published priors.",
    actions=(
        _action(_list, "list", "list the bundled tables", "list"),
        _action(
            _show, "show", "show a table as it is read, and its scene", "show wang_all",
            DATA, FLIP, COLUMNS,
        ),
        _action(
            _check, "check", "list the faults of a table, its scene and its force records", "check my_impacts.csv",
            DATA, SCENE, FORCE, *READING, switch("--quiet", "print faults only"),
        ),
        _action(
            _priors, "priors", "list published priors and their sources, for --prior NAME=literature:KEY", "priors",
        ),
    ),
)  # fmt: skip
