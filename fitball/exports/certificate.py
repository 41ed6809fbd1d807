"""A certificate: one page to print and sign, with the result of a drop test, of a court pace test or of any other
fit, its interval, whether the model describes the measurements, and what it was made from. Nothing is computed here.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from fitball.inference.results.drop_test import DropTest
from fitball.inference.results.pace_rating import CourtPace
from fitball.inference.results.results import Fit, Verdict
from fitball.report.fit.itf_tests import (
    ball_rows,
    category_words,
    court_lines,
    drop_lead,
    drop_remarks,
    pace_remarks,
    place_rows,
    rating_words,
    rests,
    speed_rows,
    surface_rows,
    surface_words,
)
from fitball.report.form.document import Row, render_template
from fitball.report.form.numbers import parameter_row

# Rows of a table that one page has room for, in two halves; and lines of remarks.
MOST_ROWS, MOST_PLACES, MOST_REMARKS = 24, 12, 9


@dataclass(frozen=True)
class Part:
    """A table of the page: of its `listed` rows the columns of `heads`, in two `halves` side by side where they are
    many and `narrow`; `more` is what it leaves out.
    """

    title: str
    heads: tuple[str, ...]
    listed: Sequence[Row]
    more: str = ""
    narrow: bool = False

    @property
    def rows(self) -> tuple[tuple[str, ...], ...]:
        """Rows of cells, a dash where there is none."""
        return tuple(tuple(row.get(head, "-") for head in self.heads) for row in self.listed)

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


def certificate(saved: Fit) -> str:
    """The page as HTML that needs nothing but itself and prints on one sheet of A4."""
    content = _content(saved)
    sources = tuple(
        f"Prior of {name}: {item.prior}, {item.prior_source}"
        for name, item in saved.parameters.items()
        if item.prior_source
    )
    remarks = (*sources, *content.remarks)
    more = _left_out(len(remarks), "remarks", MOST_REMARKS)
    return render_template(
        "fitball.report",
        "certificate.html.j2",
        title=content.title,
        subject=f"Table {saved.source.name}: {saved.source.impacts} impacts; fitball {saved.versions['fitball']}",
        table=saved.source,
        result=content.result,
        parts=content.parts,
        adequacy="Not looked at." if saved.adequacy is None else saved.adequacy.sentence,
        remarks=[*remarks[:MOST_REMARKS], *([more] if more else [])] or ["Nothing besides the table and its scene."],
        facts=_facts(saved),
    )


def _content(saved: Fit) -> _Content:
    dropped, pace = saved.drop_test, saved.court_pace
    if dropped is not None and not dropped.missing:
        return _of_drops(dropped)
    if pace is not None and (pace.ratings or pace.measured is not None):
        return _of_court(pace, rests(saved.parameters, saved.adequacy) if pace.ratings else "")
    return _of_parameters(saved)


def _of_drops(test: DropTest) -> _Content:
    balls, speeds = ball_rows(test), speed_rows(test)
    parts = []
    if balls:
        heads = ("ball", "drops", "rebound from 254 cm [cm]", "95 %", "passes")
        left = _left_out(len(test.balls), "balls")
        parts.append(Part("Rebound from 254 cm, ball by ball", heads, balls[:MOST_ROWS], left, True))
    elif len(speeds) > 1:
        heads = ("speed [m/s]", "drops", "COR", "95 %", "measured mean")
        parts.append(Part("Restitution at the tested speeds", heads, speeds))
    title = "Drop test" if test.rebound is None else "Drop test of tennis balls"
    return _Content(title, drop_lead(test), tuple(parts), drop_remarks(test))


def _of_court(pace: CourtPace, said: str) -> _Content:
    parts, places = [], place_rows(pace)
    surfaces = [
        row | {"category": category_words(item)} for row, item in zip(surface_rows(pace), pace.ratings, strict=True)
    ]
    if places:
        left = _left_out(len(places), "places", MOST_PLACES)
        parts.append(Part("Places on the court, as measured", tuple(places[0]), places[:MOST_PLACES], left))
    # There is room for one long table, not for two.
    most = MOST_PLACES - len(places)
    if 0 < len(surfaces) <= most or not places:
        title = "What the fitted model would show the test (30 m/s, 16 degrees)"
        heads = ("surface", "impacts", "rating", "95 %", "category", "mu of the test")
        parts.append(Part(title, heads, surfaces[:most], _left_out(len(surfaces), "surfaces", most)))
    result = court_lines(pace) or tuple(
        f"ITF court pace rating{f' of {surface_words(rating)}' if len(surfaces) > 1 else ''} by the model: "
        f"{rating_words(rating)}."
        for rating in pace.ratings[:4]
    )
    remarks = [f"The rating by the model is {said}."] if said else []
    return _Content("Court pace", result, tuple(parts), (*remarks, *pace_remarks(pace)))


def _of_parameters(saved: Fit) -> _Content:
    sure = (Verdict.IDENTIFIED, Verdict.GIVEN, Verdict.UNEXAMINED)
    told = [item for item in saved.parameters.values() if item.verdict in sure]
    listed = [
        {"parameter": row.name, "unit": row.unit, "value": row.best, "95 %": row.interval_95}
        for row in map(parameter_row, told[:MOST_ROWS])
    ]  # fmt: skip
    parts = (Part("Parameters that the table tells", tuple(listed[0]), listed, "", True),) if listed else ()
    return _Content(f"Fit of model {saved.fitted.model_name}", (saved.verdict,), parts, ())


def _left_out(count: int, what: str, most: int = MOST_ROWS) -> str:
    return f"{count - most} more {what} stand in report.html." if count > most else ""


def _facts(saved: Fit) -> tuple[tuple[str, str], ...]:
    ball = saved.fitted.ball
    columns = ", ".join((*saved.source.incident_columns, *saved.source.measurements))
    labels = f"; labels {', '.join(saved.source.labels)}" if saved.source.labels else ""
    closures = ", ".join(f"{name} {option}" for name, option in saved.fitted.options.items())
    facts = [
        ("Table", f"{saved.source.file}, {saved.source.impacts} impacts: {columns}{labels}"),
        ("Ball", f"{1e3 * ball.mass:.4g} g, radius {1e3 * ball.radius:.4g} mm"),
        (
            "Model",
            f"{saved.fitted.model_name}{f' ({closures})' if closures else ''}; {saved.status}, seed {saved.seed}",
        ),
        ("Software", ", ".join(f"{name} {number}" for name, number in list(saved.versions.items())[:4])),
    ]
    if saved.source.flipped:
        facts.append(("Counted the other way round", ", ".join(saved.source.flipped)))
    return tuple(facts)
