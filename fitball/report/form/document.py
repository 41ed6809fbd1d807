"""A report as a document: words, tables and pictures, said once, and shown on a terminal, as a page, as Markdown.

A part may be for one reader `only`, and has a `rank`: "first" is what everybody sees, "full" what is seen by who asks
for all of it, "folded" what a page shows on demand.
"""

from __future__ import annotations

import base64
import re
import textwrap
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from importlib.resources import files
from typing import Any, Literal, TypeAlias

from markupsafe import Markup, escape

from fitball.inference.results.results import Verdict
from fitball.report.form.palette import style_rules, verdict_mark
from fitball.version import __version__
from fitball.visible import one_line

# A row of a table as text, by the heads of its columns, in their order: what terminal, page and certificate show.
Row: TypeAlias = dict[str, str]
WIDTH = 100
# A cell that is longer than the texts of this program is a label of the user's: a few words of it tell which.
WIDEST = 80
Only: TypeAlias = Literal["", "page", "terminal"]
Rank: TypeAlias = Literal["first", "full", "folded"]
# Rows of a table that a terminal shows, and a page.
MOST_LINES, MOST_ROWS = 40, 300
# Letters of a cell of words from which on it may break.
LONG = 34
# Dots an inch of figures as PNG files.
DPI = 150


class Cell(str):
    """Text as terminal and Markdown have it; `html` is what a page shows instead."""

    html: Markup

    def __new__(cls, text: str, html: Markup) -> Cell:
        """`text` with its other form."""
        made = super().__new__(cls, text)
        made.html = html
        return made


def term(name: str, said: str) -> Cell:
    """A name in bold with what is said of it."""
    return Cell(f"{name}: {said}", Markup("<b>{}</b>: {}").format(name, _typeset(said)))


def judged(verdict: Verdict, words: str, reason: str = "") -> Cell:
    """A verdict in its colour; the reason shows where one points at it."""
    span = Markup('<span class="v-{}" title="{}">{}</span>')
    return Cell(words, span.format(verdict_mark(verdict), reason, words))


@dataclass(frozen=True)
class Words:
    """Sentences: paragraphs, or points of a list."""

    texts: Sequence[str]
    kind: Literal["text", "lead", "quiet", "list", "code"] = "text"
    only: Only = ""
    rank: Rank = "full"


@dataclass(frozen=True)
class Table:
    """Rows of cells, heads first: the first column and those headed by one of `words` are flush left. `over` are
    heads above the heads, each with its number of columns. Of many rows, `count` in all, some are shown, and the rest
    stands in the file `rest`. A terminal has no room for the columns `aside`.
    """

    label: str
    rows: Sequence[Sequence[str]]
    words: Collection[str] = ()
    over: Sequence[tuple[str, int]] = ()
    count: int = 0
    rest: str = ""
    aside: Collection[str] = ()
    only: Only = ""
    rank: Rank = "full"

    @classmethod
    def of(cls, label: str, rows: Sequence[Row], words: Collection[str] = (), **more: Any) -> Table:
        """From rows by head, of which some may lack some."""
        heads = list(dict.fromkeys(head for row in rows for head in row))
        return cls(label, [heads, *([row.get(head, "") for head in heads] for row in rows)], words, **more)

    @property
    def left(self) -> list[bool]:
        """Which columns are flush left."""
        return [k == 0 or head in self.words for k, head in enumerate(self.rows[0])]

    def more(self, most: int) -> int:
        """How many rows are left out where `most` are shown."""
        return max(0, max(self.count, len(self.rows) - 1) - most)


@dataclass(frozen=True)
class Picture:
    """A figure of a page by its name, with its caption and what it shows in words."""

    name: str
    caption: str
    alt: str
    only: Only = "page"
    rank: Rank = "full"


Part: TypeAlias = Words | Table | Picture


@dataclass(frozen=True)
class Section:
    """Parts under a title, to which `name` leads; one without parts is left out. On paper a "short" one is kept
    together, a "leaf" begins a page.
    """

    name: str
    title: str
    parts: Sequence[Part]
    paper: Literal["", "short", "leaf"] = ""


@dataclass(frozen=True)
class Document:
    """A report: its title, what comes first, and its sections."""

    title: str
    lead: Sequence[Part]
    sections: Sequence[Section]

    def read_by(self, reader: Only) -> Iterator[tuple[Section, list[Part]]]:
        """Each section with the parts that this reader sees; what comes first has no title."""
        for section in (Section("", "", self.lead), *self.sections):
            parts = [part for part in section.parts if part.only in ("", reader) and _holds(part)]
            if parts:
                yield section, parts


def _holds(part: Part) -> bool:
    return bool(part.texts) if isinstance(part, Words) else not isinstance(part, Table) or len(part.rows) > 1


def columns(rows: Sequence[Sequence[str]], left: int | Sequence[bool] = 1) -> list[str]:
    """Rows of cells as lines: the first `left` columns, or those it names, flush left, the others right. A cell stays
    in its line.
    """
    aligned = [k < left for k in range(len(rows[0]))] if isinstance(left, int) else left
    rows = [[one_line(cell, WIDEST) for cell in row] for row in rows]
    widths = [max(len(row[k]) for row in rows) for k in range(len(rows[0]))]
    lines = []
    for row in rows:
        cells = [
            cell.ljust(width) if flush else cell.rjust(width)
            for cell, width, flush in zip(row, widths, aligned, strict=True)
        ]
        lines.append("  ".join(cells).rstrip())
    return lines


def wrapped(texts: Iterable[str], first: str = "", others: str = "") -> list[str]:
    """Texts as lines of `WIDTH`, the first line of each indented by `first`, its others by `others`."""
    return [
        line
        for text in texts
        for line in textwrap.wrap(text, WIDTH, initial_indent=first, subsequent_indent=others, break_on_hyphens=False)
    ]


def more(count: int, where: str) -> list[str]:
    """A line that says how many of `count` rows are not shown, and where they are; nothing when all are."""
    return [f"... and {count - MOST_LINES:,} more: {where}"] if count > MOST_LINES else []


def on_terminal(document: Document, full: bool = True) -> str:
    """Plain text in lines of a terminal's width; what has rank "first" alone where it is not to be `full`."""
    blocks = [f"{document.title}\n{'=' * len(document.title)}"] if document.title else []
    for section, parts in document.read_by("terminal"):
        shown = [part for part in parts if full or part.rank == "first"]
        tables = [part for part in shown if isinstance(part, Table)]
        texts = ["\n".join(_lines(part, part in tables[1:])) for part in shown if not isinstance(part, Picture)]
        if section.title and texts:
            listed = isinstance(shown[0], Words) and shown[0].kind == "list"
            blocks.append(section.title + ("\n" if listed else "\n\n") + texts.pop(0))
        blocks += texts
    return "\n\n".join(blocks)


def _lines(part: Words | Table, labelled: bool) -> Iterable[str]:
    """`labelled` is a table that is not the only one of its section."""
    if isinstance(part, Words):
        if part.kind == "list":
            return wrapped(part.texts, "- ", "  ")
        between = "\n" if part.kind == "lead" else "\n\n"
        return [between.join("\n".join(wrapped([text])) for text in part.texts)]
    kept = [k for k, head in enumerate(part.rows[0]) if head not in part.aside]
    shown = [[row[k] for k in kept] for row in part.rows[: MOST_LINES + 1]]
    if part.over:
        shown.insert(0, [text if k == 0 else "" for text, count in part.over for k in range(count)])
    lines = columns(shown, [part.left[k] for k in kept])
    lines += (
        [f"... and {part.more(MOST_LINES):,} more: {part.rest.replace('`', '')}"] if part.more(MOST_LINES) else []
    )
    return [f"{part.label}:", "", *lines] if labelled else lines


def as_page(document: Document, images: Mapping[str, bytes]) -> str:
    """A page of HTML that needs nothing but itself; `images` are the PNG files of its pictures."""
    body = [Markup("<h1>{}</h1>").format(document.title)]
    shown = list(document.read_by("page"))
    titled = [section for section, _parts in shown if section.name]
    for section, parts in shown:
        inside = Markup("\n").join(_html(part, images) for part in parts)
        kind = Markup(' class="{}"').format(section.paper) if section.paper else ""
        whole = Markup('<section id="{}"{}>\n<h2>{}</h2>\n{}\n</section>')
        body.append(whole.format(section.name, kind, section.title, inside) if section.name else inside)
        if not section.name and len(titled) > 4:
            links = (Markup('<li><a href="#{}">{}</a></li>').format(it.name, it.title) for it in titled)
            contents = Markup('<nav class="toc" aria-label="Contents"><b>Contents</b>\n<ol>\n{}\n</ol></nav>')
            body.append(contents.format(Markup("\n").join(links)))
    return PAGE.format(title=escape(document.title), style=page_style(), body="\n\n".join(body))


def page_style() -> str:
    """The style sheet of all pages."""
    sheet = files("fitball.report").joinpath("templates/page.css").read_text(encoding="utf-8")
    return f"{sheet}{style_rules()}\n"


def render_template(package: str, template: str, **context: object) -> str:
    """A page from `template`, looked for in the templates of `package`, then among those of the reports."""
    from jinja2 import ChoiceLoader, Environment, PackageLoader, StrictUndefined

    environment = Environment(
        loader=ChoiceLoader([PackageLoader(package), PackageLoader("fitball.report")]),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        finalize=lambda value: value.replace("+-", "\u00b1") if isinstance(value, str) else value,
    )
    return environment.get_template(template).render(version=__version__, colours=style_rules(), **context)


PAGE = """<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>{title} - fitball</title>
<style>
{style}</style>
</head>
<body>
{body}
</body>
</html>
"""
# What is wide scrolls in a box of its own, which the keyboard reaches.
BOX = Markup('<div class="wide" role="region" tabindex="0" aria-label="{}"{}>\n{}</div>')
WORDS = {
    "text": Markup("<p>{}</p>"), "lead": Markup('<p class="verdict">{}</p>'),
    "quiet": Markup('<p class="quiet">{}</p>'), "list": Markup("<li>{}</li>"), "code": Markup("<pre>{}</pre>"),
}  # fmt: skip


def _typeset(text: str) -> Markup:
    """What terminals have in ASCII, as print has it; names of files and commands between backquotes."""
    if isinstance(text, Cell):
        return text.html
    return Markup(re.sub(r"`([^`]*)`", r"<code>\1</code>", str(escape(text.replace("+-", "\u00b1")))))


def _html(part: Part, images: Mapping[str, bytes]) -> Markup:
    if isinstance(part, Picture):
        return figure_html(images[part.name], part.caption, part.alt)
    if isinstance(part, Table):
        return _table(part)
    if part.kind == "lead":
        return WORDS["lead"].format(Markup("<br>\n").join(map(_typeset, part.texts)))
    if part.kind == "code":
        return Markup("\n").join(WORDS["code"].format(text) for text in part.texts)
    made = Markup("\n").join(WORDS[part.kind].format(_typeset(text)) for text in part.texts)
    return Markup('<ul class="told">\n{}\n</ul>').format(made) if part.kind == "list" else made


def figure_html(png: bytes, caption: str, alt: str) -> Markup:
    """A PNG file of `DPI` as a figure; its width is the first number of its header chunk."""
    width = int.from_bytes(png[16:20], "big") / DPI
    image = Markup('<img alt="{}" src="data:image/png;base64,{}" style="min-width: {:.1f}rem">').format(
        alt, base64.b64encode(png).decode("ascii"), min(width * 3.6, 60.0)
    )
    widest = Markup(' style="max-width: {:.1f}rem"').format(max(width * 6.25, 45.0))
    return Markup("<figure>{}\n<figcaption>{}</figcaption></figure>").format(
        BOX.format("figure", widest, image), caption
    )


def _table(part: Table) -> Markup:
    kinds = [_kind(part, k) for k in range(len(part.rows[0]))]
    over = Markup("").join(Markup('<th class="text" colspan="{1}">{0}</th>').format(*head) for head in part.over)
    head = Markup("<tr>{}</tr>\n").format(over) if over else Markup("")
    # The heads of words are flush left, whether their cells may break or not.
    head += _line("th", part.rows[0], [kind and "text" for kind in kinds])
    body = Markup("\n").join(_line("td", row, kinds) for row in part.rows[1 : MOST_ROWS + 1])
    whole = Markup("<table>\n<caption>{}</caption>\n<thead>{}</thead>\n<tbody>\n{}\n</tbody></table>")
    made = BOX.format(part.label, "", whole.format(part.label, head, body))
    if left := part.more(MOST_ROWS):
        made += Markup('\n<p class="quiet">{:,} more stand in {}.</p>').format(left, _typeset(part.rest))
    folded = Markup("<details><summary>{}</summary>\n{}</details>")
    return folded.format(part.label, made) if part.rank == "folded" else made


def _kind(part: Table, column: int) -> str:
    """The class of a column's cells: "words" where they may break."""
    if not part.left[column]:
        return ""
    return "words" if any(len(row[column]) > LONG for row in part.rows[1 : MOST_ROWS + 1]) else "text"


def _line(tag: str, cells: Sequence[str], kinds: Sequence[str]) -> Markup:
    made = (
        Markup("<{0}{1}>{2}</{0}>").format(tag, Markup(' class="{}"').format(kind) if kind else "", _typeset(cell))
        for cell, kind in zip(cells, kinds, strict=True)
    )
    return Markup("<tr>{}</tr>").format(Markup("").join(made))


def as_markdown(document: Document) -> str:
    """Markdown of what the page says, without pictures."""
    blocks = [f"# {document.title}"]
    for section, parts in document.read_by("page"):
        blocks += [f"## {section.title}"] if section.title else []
        for part in parts:
            if isinstance(part, Words):
                first, between = ("- ", "\n") if part.kind == "list" else ("", "\n\n")
                blocks.append(between.join(f"{first}{text}" for text in part.texts))
            elif isinstance(part, Table):
                blocks.append(markdown_table(part.rows))
    return "\n\n".join(blocks) + "\n"


def markdown_table(rows: Sequence[Sequence[str]]) -> str:
    """A table in Markdown, heads first; a cell may hold what divides cells, or a line break."""
    plain = ([" ".join(cell.split()).replace("|", r"\|") for cell in row] for row in rows)
    head, *lines = ("|" + "".join(f" {cell} |" if cell else " |" for cell in row) for row in plain)
    return "\n".join([head, "|" + "---|" * len(rows[0]), *lines])
