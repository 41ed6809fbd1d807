"""A certificate: one page to print and sign, with the result of a drop test, of a court pace test or of any other
fit, its interval, whether the model describes the measurements, and what it was made from. Nothing is computed here.
"""

from __future__ import annotations

from dataclasses import dataclass

from fitball.inference.results.drop_test import DropTest
from fitball.inference.results.pace_rating import CourtPace
from fitball.inference.results.results import Estimate, Verdict
from fitball.report.fit.drop_rows import drop_lead, drop_remarks, drop_table
from fitball.report.fit.pace_rows import court_lines, pace_remarks, place_rows, surface_rows
from fitball.report.form.display_units import handy
from fitball.report.form.rounding import decimals, fixed, interval, significant
from fitball.report.form.template import render_template
from fitball.report.saved.saved_fit import SavedFit

# Rows of a table that one page has room for, in two halves; and lines of remarks.
MOST_ROWS, MOST_PLACES, MOST_REMARKS = 24, 12, 9


@dataclass(frozen=True)
class Part:
    """A table of the page: `rows`, or two `halves` side by side where it is long and `narrow`; `more` is what it
    leaves out.
    """

    title: str
    heads: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    more: str = ""
    narrow: bool = False

    @property
    def halves(self) -> tuple[tuple[tuple[str, ...], ...], ...]:
        """The rows in two halves, none where they are few."""
        middle = (len(self.rows) + 1) // 2
        return (self.rows[:middle], self.rows[middle:]) if self.narrow and len(self.rows) > 8 else ()


@dataclass(frozen=True)
class _Content:
    title: str
    result: tuple[str, ...]
    parts: tuple[Part, ...]
    remarks: tuple[str, ...]


def certificate(saved: SavedFit) -> str:
    """The page as HTML that needs nothing but itself and prints on one sheet of A4."""
    file = saved.file
    content = _content(saved)
    sources = tuple(
        f"Prior of {name}: {item.prior}, {item.prior_source}"
        for name, item in saved.parameters.items()
        if item.prior_source
    )
    remarks = (*sources, *content.remarks)[:MOST_REMARKS]
    return render_template(
        "fitball.report",
        "certificate.html.j2",
        title=content.title,
        subject=f"Table {file.table.name}: {file.table.impacts} impacts; fitball {file.versions['fitball']}",
        table=file.table,
        result=content.result,
        parts=content.parts,
        adequacy="Not looked at." if file.adequacy is None else file.adequacy.sentence,
        remarks=remarks or ("Nothing besides the table and its scene.",),
        facts=_facts(saved),
    )


def _content(saved: SavedFit) -> _Content:
    dropped, pace = saved.file.drop_test, saved.file.court_pace
    if dropped is not None and not dropped.missing:
        return _of_drops(dropped)
    if pace is not None and (pace.ratings or pace.measured is not None):
        return _of_court(pace)
    return _of_parameters(saved)


def _of_drops(test: DropTest) -> _Content:
    shown = drop_table(test)
    parts = []
    if shown.balls:
        rows = tuple(
            (row.label, row.impacts, row.height, row.interval_95, row.passes) for row in shown.balls[:MOST_ROWS]
        )
        heads = ("ball", "drops", "rebound [cm]", "95 %", "passes")
        parts.append(
            Part("Rebound from 254 cm, ball by ball", heads, rows, _left_out(len(test.balls), "balls"), True)
        )
    elif len(shown.speeds) > 1:
        rows = tuple((row.speed, row.impacts, row.cor, row.interval_95, row.measured) for row in shown.speeds)
        heads = ("speed [m/s]", "drops", "COR", "95 %", "measured mean")
        parts.append(Part("Restitution at the tested speeds", heads, rows))
    return _Content("Drop test of tennis balls", drop_lead(test), tuple(parts), drop_remarks(test))


def _of_court(pace: CourtPace) -> _Content:
    parts, surfaces = [], surface_rows(pace)
    places = place_rows(pace)
    if places:
        measured = tuple(
            (row.label, row.impacts, row.mean, row.rating, row.interval_95, row.friction, row.restitution)
            for row in places[:MOST_PLACES]
        )
        heads = ("place", "impacts", "mean rating", "beyond noise", "95 %", "mu", "restitution")
        left = _left_out(len(places), "places", MOST_PLACES)
        parts.append(Part("Places on the court, as measured", heads, measured, left))
    # There is room for one long table, not for two.
    most = MOST_PLACES - len(places)
    if 0 < len(surfaces) <= most or not places:
        rated = tuple(
            (row.surface, row.impacts, row.rating, row.interval_95, row.category, row.friction)
            for row in surfaces[:most]
        )
        title = "What the fitted model would show the test (30 m/s, 16 degrees)"
        rating_heads = ("surface or place", "impacts", "rating", "95 %", "category", "mu of the test")
        parts.append(Part(title, rating_heads, rated, _left_out(len(surfaces), "surfaces", most)))
    result = court_lines(pace) or tuple(
        f"ITF court pace rating{f' of {row.surface}' if len(surfaces) > 1 else ''} by the model: {row.rating} "
        f"{row.interval_95} (95 %), {row.category}."
        for row in surfaces[:4]
    )
    return _Content("Court pace", result, tuple(parts), tuple(pace_remarks(pace)))


def _of_parameters(saved: SavedFit) -> _Content:
    told = [item for item in saved.parameters.values() if item.verdict in (Verdict.IDENTIFIED, Verdict.GIVEN)]
    rows = tuple(_parameter(item) for item in told[:MOST_ROWS])
    parts = (
        (Part("Parameters that the table tells", ("parameter", "unit", "value", "95 %"), rows, "", True),)
        if rows
        else ()
    )
    return _Content(f"Fit of model {saved.file.model.name}", (saved.verdict,), parts, ())


def _parameter(item: Estimate) -> tuple[str, ...]:
    scale = handy(item.name, item.unit)
    if item.median is None or item.sd is None or item.q025 is None or item.q975 is None:
        return item.name, scale.unit, significant(item.point * scale.factor, 4), "-"
    places = decimals(item.sd * scale.factor)
    ends = interval(item.q025 * scale.factor, item.q975 * scale.factor, places)
    return item.name, scale.unit, fixed(item.median * scale.factor, places), ends


def _left_out(count: int, what: str, most: int = MOST_ROWS) -> str:
    return f"{count - most} more {what} stand in report.html." if count > most else ""


def _facts(saved: SavedFit) -> tuple[tuple[str, str], ...]:
    file = saved.file
    ball = file.ball
    columns = ", ".join((*file.data.incident_columns, *file.data.measurements))
    labels = f"; labels {', '.join(file.data.labels)}" if file.data.labels else ""
    closures = ", ".join(f"{name} {option}" for name, option in file.model.closures.items())
    facts = [
        ("Table", f"{file.table.file}, {file.table.impacts} impacts: {columns}{labels}"),
        ("Ball", f"{1e3 * ball.mass:.4g} g, radius {1e3 * ball.radius:.4g} mm"),
        ("Model", f"{file.model.name}{f' ({closures})' if closures else ''}; {file.status}, seed {file.seed}"),
        ("Software", ", ".join(f"{name} {number}" for name, number in list(file.versions.items())[:4])),
    ]
    if file.table.flipped:
        facts.append(("Counted the other way round", ", ".join(file.table.flipped)))
    return tuple(facts)
