"""A report as a document: words, tables and pictures, said once, and shown on a terminal, as a page, as Markdown.

A part may be for one reader `only`, and has a `rank`: "first" is on the first screen of a terminal, "full" where all
is asked for, and open on a page, "folded" where all is asked for, and folded on a page, as a whole section may be.
"""

from __future__ import annotations

import base64
import re
import textwrap
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from importlib.resources import files
from typing import Any, Literal, TypeAlias

from markupsafe import Markup, escape

from fitball.inference.results.results import Verdict
from fitball.report.form.palette import VERDICTS, style_rules, verdict_mark
from fitball.version import __version__
from fitball.visible import one_line, visible
from fitball.wording import Screen, screen, shown_on

# A row of a table as text, by the heads of its columns, in their order: what terminal, page and certificate show.
Row: TypeAlias = dict[str, str]
# A cell that is longer than the texts of this program is a label of the user's: a few words of it tell which.
WIDEST = 80
Only: TypeAlias = Literal["", "page", "terminal"]
Rank: TypeAlias = Literal["first", "full", "folded"]
# Rows of a table that a terminal shows, and a page.
MOST_LINES, MOST_ROWS = 40, 300
# Rows of a table on the first screen of a terminal.
FIRST_LINES = 20
# Letters of a cell of words from which on it may break.
LONG = 34
# Dots an inch of figures as PNG files.
DPI = 150


class Cell(str):
    """Text as Markdown has it; `html` is what a page shows instead, `colour` how a terminal that can shows it."""

    html: Markup
    colour: str

    def __new__(cls, text: str, html: Markup, colour: str = "") -> Cell:
        """`text` with its other forms."""
        cell = super().__new__(cls, text)
        cell.html, cell.colour = html, colour
        return cell


def term(name: str, meaning: str) -> Cell:
    """A name in bold and its meaning."""
    return Cell(f"{name}: {meaning}", Markup("<b>{}</b>: {}").format(name, _typeset(meaning)))


def judged(verdict: Verdict, words: str, reason: str = "") -> Cell:
    """A verdict in its colour; the reason shows where one points at it."""
    span = Markup('<span class="v-{}" title="{}">{}</span>')
    return Cell(words, span.format(verdict_mark(verdict), reason, words), VERDICTS[verdict].terminal)


@dataclass(frozen=True)
class Words:
    """Sentences: paragraphs, or points of a list."""

    texts: Sequence[str]
    kind: Literal["text", "lead", "quiet", "list", "code"] = "text"
    only: Only = ""
    rank: Rank = "full"

    def __bool__(self) -> bool:
        return bool(self.texts)


@dataclass(frozen=True)
class Table:
    """Rows of cells, heads first: the first column and those headed by one of `words` are flush left. `over` are
    heads above the heads, each with its number of columns. Of many rows, `count` in all, some are shown; the file
    `rest` has the others. A terminal has no room for the columns `aside`, a narrow one none for `spare`; its first
    screen shows the first column and those headed by one of `brief`.
    """

    label: str
    rows: Sequence[Sequence[str]]
    words: Collection[str] = ()
    over: Sequence[tuple[str, int]] = ()
    count: int = 0
    rest: str = ""
    aside: Collection[str] = ()
    brief: Collection[str] = ()
    spare: str = ""
    only: Only = ""
    rank: Rank = "full"

    @classmethod
    def from_rows(cls, label: str, rows: Sequence[Row], words: Collection[str] = (), **more: Any) -> Table:
        """From rows by head, of which some may lack some."""
        heads = list(dict.fromkeys(head for row in rows for head in row))
        return cls(label, [heads, *([row.get(head, "") for head in heads] for row in rows)], words, **more)

    def __bool__(self) -> bool:
        return len(self.rows) > 1

    @property
    def left(self) -> list[bool]:
        """Which columns are flush left."""
        return [k == 0 or head in self.words for k, head in enumerate(self.rows[0])]


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
    """Parts under a title, to which `name` leads; one without parts is left out. A page folds one whose rank is
    "folded"; on paper a "short" one is kept together, a "leaf" begins a page.
    """

    name: str
    title: str
    parts: Sequence[Part]
    paper: Literal["", "short", "leaf"] = ""
    rank: Rank = "full"


@dataclass(frozen=True)
class Document:
    """A report: its title, what comes first, and its sections."""

    title: str
    lead: Sequence[Part]
    sections: Sequence[Section]

    def read_by(self, reader: Only) -> Iterator[tuple[Section, list[Part]]]:
        """Each section with the parts that this reader sees; what comes first has no title."""
        for section in (Section("", "", self.lead), *self.sections):
            parts = [part for part in section.parts if part.only in ("", reader) and part]
            if parts:
                yield section, parts


def columns(
    rows: Sequence[Sequence[str]], left: int | Sequence[bool] = 1, colour: bool = False, gap: int = 2
) -> list[str]:
    """Rows of cells as lines: the first `left` columns, or those it names, flush left, the others right, `gap` spaces
    between them. A cell stays in its line, and has its colour where there is to be `colour`.
    """
    aligned = [k < left for k in range(len(rows[0]))] if isinstance(left, int) else left
    widths = _widths(rows)
    lines = []
    for row in rows:
        cells = []
        for cell, width, flush in zip(row, widths, aligned, strict=True):
            text = one_line(cell, WIDEST)
            text = text.ljust(width) if flush else text.rjust(width)
            cells.append(_coloured(text, cell.colour) if colour and isinstance(cell, Cell) else text)
        lines.append((" " * gap).join(cells).rstrip())
    return lines


def _widths(rows: Sequence[Sequence[str]]) -> list[int]:
    return [max(len(one_line(row[k], WIDEST)) for row in rows) for k in range(len(rows[0]))]


def _coloured(text: str, colour: str) -> str:
    """Text in a colour of ISO 6429 (its number); what fills a column stays as it is."""
    core = text.strip()
    return text.replace(core, f"\x1b[{colour}m{core}\x1b[0m") if colour and core else text


# What no line is broken inside of: an interval, a number and its unit, what is added to or taken from a number.
UNITS = r"%|[kmc]?m|m?s|k?g|k?N|J|deg|rad|sd|rpm|[a-zA-Z]+/[a-z]+\^?2?"
UNBROKEN = re.compile(
    rf"\[[^\[\]]{{1,40}}\]|[0-9]* ?(?:\+-|\u00b1) [0-9]|[<>] (?=[0-9])|[0-9] (?=(?:{UNITS})(?:[\s.,:;)]|$))"
)
# The number of bold letters (ISO 6429).
BOLD = "1"
# A space that textwrap does not take for one.
HARD = "\u00a0"


def unbroken(text: str) -> str:
    """The text with hard spaces where no line is to be broken."""
    return UNBROKEN.sub(lambda found: found[0].replace(" ", HARD), text)


def wrapped(texts: Iterable[str], first: str = "", others: str = "") -> list[str]:
    """Texts as lines of the screen's width, the first line of each indented by `first`, its others by `others`."""
    return [
        line.replace(HARD, " ")
        for text in texts
        for line in textwrap.wrap(
            unbroken(visible(text)),
            screen().width,
            initial_indent=first,
            subsequent_indent=others,
            break_on_hyphens=False,
        )
    ]


def more(count: int, where: str, most: int = MOST_LINES) -> list[str]:
    """A line that says how many of `count` rows are not shown, and where they are; nothing when all are."""
    return [f"... and {count - most:,} more{': ' * bool(where)}{where}"] if count > most else []


def shortened(texts: Sequence[str], most: int, where: str) -> Sequence[str]:
    """The first texts, and how many more there are."""
    return texts if len(texts) <= most + 1 else [*texts[:most], *more(len(texts), where, most)]


def on_terminal(document: Document, wanted: Screen | None = None) -> str:
    """Text in lines of a terminal's width, for the screen that is `wanted`, or else that of now; what has rank
    "first" alone where not all is to be shown.
    """
    with shown_on(wanted or screen()):
        return "\n\n".join(_blocks(document))


def _blocks(document: Document) -> Iterator[str]:
    bold = BOLD if screen().colour else ""
    if document.title:
        title = "\n".join(wrapped([document.title]))
        yield f"{_coloured(title, bold)}\n{'=' * max(map(len, title.splitlines()))}"
    for section, parts in document.read_by("terminal"):
        kept = [part for part in parts if screen().full or part.rank == "first"]
        tables = [part for part in kept if isinstance(part, Table)]
        texts = ["\n".join(_lines(part, part in tables[1:])) for part in kept if not isinstance(part, Picture)]
        if section.title and texts:
            listed = isinstance(kept[0], Words) and kept[0].kind == "list"
            yield _coloured(section.title, bold) + ("\n" if listed else "\n\n") + texts.pop(0)
        yield from texts


def _lines(part: Words | Table, labelled: bool) -> Iterable[str]:
    """`labelled` is a table that is not the only one of its section."""
    if isinstance(part, Words):
        if part.kind == "list":
            return wrapped(part.texts, "- ", "  ")
        between = "\n" if part.kind == "lead" else "\n\n"
        return [between.join("\n".join(wrapped([text])) for text in part.texts)]
    most, count = MOST_LINES if screen().full else FIRST_LINES, max(part.count, len(part.rows) - 1)
    # A line that says "1 more" is as long as that row.
    most += count == most + 1
    brief = part.brief if part.brief and not screen().full else part.rows[0]
    kept = [k for k, head in enumerate(part.rows[0]) if head not in part.aside and (k == 0 or head in brief)]
    rows = [[row[k] for k in kept] for row in part.rows[: most + 1]]
    if part.over:
        rows.insert(0, [text if k == 0 else "" for text, count in part.over for k in range(count)])
    lines: list[str] = []
    widths = _widths(rows)
    # Columns are closer where that alone makes room for all of them.
    room, gaps = screen().width - sum(widths), len(widths) - 1
    if part.spare and room < gaps:
        return _lines(replace(part, aside=(*part.aside, part.spare), spare=""), labelled)
    gap = 1 if gaps <= room < 2 * gaps else 2
    blocks = _side_by_side(widths, gap)
    if count > most and not screen().full:
        # A first screen has as many lines, one below the other.
        most //= len(blocks)
        rows = rows[: most + 1 + bool(part.over)]
    for places in blocks:
        block = [[row[k] for k in places] for row in rows]
        lines += [""] * bool(lines)
        lines += columns(block, [part.left[kept[k]] for k in places], screen().colour, gap)
    lines += more(count, part.rest.replace("`", ""), most)
    return [f"{part.label}:", "", *lines] if labelled else lines


def _side_by_side(widths: Sequence[int], gap: int) -> list[list[int]]:
    """Numbers of the columns that the screen has room for at once, the first in every block."""
    blocks, taken = [[0]], widths[0]
    for k, width in enumerate(widths[1:], start=1):
        if taken + gap + width > screen().width and len(blocks[-1]) > 1:
            blocks.append([0])
            taken = widths[0]
        blocks[-1].append(k)
        taken += gap + width
    return blocks


def as_page(document: Document, images: Mapping[str, bytes]) -> str:
    """A page of HTML that needs nothing but itself; `images` are the PNG files of its pictures."""
    body = [Markup("<h1>{}</h1>").format(document.title)]
    shown = list(document.read_by("page"))
    titled = [section for section, _parts in shown if section.name]
    for section, parts in shown:
        inside = Markup("\n").join(_html(part, images) for part in parts) if section.name else _beside(parts, images)
        kind = Markup(' class="{}"').format(section.paper) if section.paper else ""
        if section.name:
            whole = FOLDED_SECTION if section.rank == "folded" else SECTION
            inside = whole.format(section.name, kind, section.title, inside)
        body.append(inside)
        if not section.name and len(titled) > 4:
            links = (Markup('<li><a href="#{}">{}</a></li>').format(it.name, it.title) for it in titled)
            contents = Markup('<nav class="toc" aria-label="Contents"><b>Contents</b>\n<ol>\n{}\n</ol></nav>')
            body.append(contents.format(Markup("\n").join(links)))
    return PAGE.format(title=escape(document.title), style=page_style(), body="\n\n".join(body))


def _beside(parts: Sequence[Part], images: Mapping[str, bytes]) -> Markup:
    """What comes first on a page: a picture beside the table that follows it, where there is room."""
    made: list[Markup] = []
    for k, part in enumerate(parts):
        before, after = parts[k - 1 : k], parts[k + 1 : k + 2]
        if isinstance(part, Picture) and after and isinstance(after[0], Table):
            made.append(
                Markup('<div class="beside">\n{}\n{}\n</div>').format(_html(part, images), _html(after[0], images))
            )
        elif not (isinstance(part, Table) and before and isinstance(before[0], Picture)):
            made.append(_html(part, images))
    return Markup("\n").join(made)


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
SECTION = Markup('<section id="{}"{}>\n<h2>{}</h2>\n{}\n</section>')
FOLDED_SECTION = Markup('<section id="{}"{}>\n<details><summary><h2>{}</h2></summary>\n{}\n</details>\n</section>')
# What is wide scrolls in a box of its own, which the keyboard reaches.
BOX = Markup('<div class="wide" role="region" tabindex="0" aria-label="{}"{}>\n{}</div>')
WORDS = {
    "text": Markup("<p>{}</p>"), "lead": Markup('<p class="verdict">{}</p>'),
    "quiet": Markup('<p class="quiet">{}</p>'), "list": Markup("<li>{}</li>"), "code": Markup("<pre>{}</pre>"),
}  # fmt: skip


# An option of the command line, whose hyphens are no place to break a line.
OPTION = re.compile(r"(?<![\w-])--[a-z][a-z-]+")


def _typeset(text: str) -> Markup:
    """What terminals have in ASCII, as print has it; names of files and commands between backquotes."""
    if isinstance(text, Cell):
        return Markup(unbroken(text.html))
    plain = str(escape(unbroken(text.replace("+-", "\u00b1"))))
    plain = OPTION.sub(r'<span class="option">\g<0></span>', plain)
    # What is copied from code has the spaces that people type.
    return Markup(re.sub(r"`([^`]*)`", lambda found: f"<code>{found[1].replace(HARD, ' ')}</code>", plain))


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
    return Markup('<ul class="points">\n{}\n</ul>').format(made) if part.kind == "list" else made


def figure_html(png: bytes, caption: str, alt: str) -> Markup:
    """A PNG file of `DPI` as a figure; width and height are the first numbers of its header chunk."""
    width, height = (int.from_bytes(png[k : k + 4], "big") / DPI for k in (16, 20))
    image = Markup('<img alt="{}" src="data:image/png;base64,{}" style="min-width: {:.1f}rem">').format(
        alt, base64.b64encode(png).decode("ascii"), min(width * 3.6, 60.0)
    )
    widest = Markup(' style="max-width: {:.1f}rem"').format(max(width * 6.25, 45.0))
    tall = Markup(' class="tall"') if height > 1.5 * width else ""
    return Markup("<figure{}>{}\n<figcaption>{}</figcaption></figure>").format(
        tall, BOX.format("figure", widest, image), _typeset(caption)
    )


def _table(part: Table) -> Markup:
    kinds = [_kind(part, k) for k in range(len(part.rows[0]))]
    over = Markup("").join(Markup('<th class="text" colspan="{1}">{0}</th>').format(*head) for head in part.over)
    head = Markup("<tr>{}</tr>\n").format(over) if over else Markup("")
    # The heads of words are flush left, whether their cells may break or not.
    head += _line("th", part.rows[0], [kind and "text" for kind in kinds])
    body = Markup("\n").join(_line("td", row, kinds) for row in part.rows[1 : MOST_ROWS + 1])
    many = Markup(' class="many"') if len(part.rows[0]) > 10 else ""
    whole = Markup("<table{}>\n<caption>{}</caption>\n<thead>{}</thead>\n<tbody>\n{}\n</tbody></table>")
    made = BOX.format(part.label, "", whole.format(many, part.label, head, body))
    if (left := max(part.count, len(part.rows) - 1) - MOST_ROWS) > 0:
        made += Markup('\n<p class="quiet">{:,} more: {}.</p>').format(left, _typeset(part.rest))
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
