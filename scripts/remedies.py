"""Does what fitball proposes help? Every command and option that messages, notes and pages name is
collected over tables, run on its table, and counted: made, run, helped.

    python scripts/remedies.py                    # bundled tables and tables of faults
    python scripts/remedies.py FOLDER ...         # tables of these folders
    python scripts/remedies.py --only swapped     # tables whose name has this in it

Helped: a table that was refused is read, or refused for something else alone; the fault, note or
sentence that named the remedy is gone; another verb has an answer. An option without a value is one
that cannot be run.
"""

import argparse
import io
import re
import shlex
import shutil
import sys
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import chdir, redirect_stderr, redirect_stdout
from html.parser import HTMLParser
from pathlib import Path
from typing import NamedTuple, TypeAlias

from fitball import cli
from fitball.data.bundled import datasets_folder

# A command in the text of a page or a message.
COMMAND = re.compile(r"`(fitball \w[^`]*)`")
# An option outside of such a command, with what stands behind it; not one to be left out.
OPTION = re.compile(
    r"(?<![\w-])(?<!without )(?<!without `)(?<!leave out )--(?P<name>[a-z][a-z-]*)"
    r'(?:[ =](?P<value>"[^"]*"|\'[^\']*\'|[^\s,;:()"\']*[=\w][^\s;:()"\']*))?'
)
# Facts that only the user knows: their options cannot be filled in.
FACTS = ("fps", "mm-per-px", "ball-diameter")
# What stands in a remedy for a value that the user is to fill in.
PLACEHOLDER = re.compile(r"\b(PARAMETER|COLUMN|NAME|VALUE|FILE\.py|DIR|TABLE|LENGTH)\b")
# Tables that `track` writes beside its page.
OF_FILMS = ("impacts.csv", "positions.csv")
# Options of all verbs that say where a result goes or how it is shown: no remedies.
SHOWN = ("full", "json", "overwrite", "out", "quiet", "help")
# Exit code of what is refused; of words that are no command here.
REFUSED, NO_COMMAND = 2, 3
# Fewest models of a comparison, and how long a run is made short.
SHORT = {
    "calibrate": ("--point-only", "--figures", "none"),
    "compare": ("--models", "brody,grip-slip", "--figures", "none"),
    "batch": ("--point-only", "--figures", "none"),
    "check": (),
    "track": ("--figures", "none"),
    "plan": ("--count", "1", "--figures", "none"),
}
# Blocks of a page of which each is a sentence or a few.
BLOCKS = {"p", "li", "td", "th", "h1", "h2", "h3", "summary", "pre", "div"}
# Tables with a fault each, by name.
FAULTS = {
    "sd in some": "v_y1,v_y2,v_y2_sd\n7,5.2,0.1\n7.1,5.3,\n7.2,5.4,0.1\n",
    "cor and speeds": "v_y1,v_y2,cor\n7,5.2,0.5\n7.1,5.3,0.5\n7.2,5.4,0.5\n",
    "cor of heights": "drop_height [cm],cor\n100,0.3\n150,0.3\n200,0.3\n",
    "zero-based": "h0,h1\n65,33.0\n55,28.5\n45,25.0\n35,19.5\n",
    "ratio": "drop height (cm),rebound ratio\n100,0.56\n150,0.55\n200,0.54\n",
    "intervals": "bounce,interval [s]\n1,0.72\n2,0.61\n3,0.52\n4,0.44\n",
    "racket": "ball in (m/s),racket speed (m/s),ball out (m/s)\n23.3,13.7,28.9\n13,15.3,27.4\n",
    "height and speed": "drop_height [m],v_y1,v_y2\n2.54,6.9,5.2\n2.54,6.8,5.1\n",
    "two series": "bounce_interval,bounce_time\n0.72,0.72\n0.61,1.33\n0.52,1.85\n",
    "asymmetric": "v_y1,v_y2,v_y2_err_low,v_y2_err_high\n7,5.2,.1,.2\n7.1,5.3,.1,.2\n",
    "one row": "v_y1,v_y2\n7,5.2\n",
    "slip of a name": "v_y1,v_y2,v_x22\n7,5.2,1\n7.1,5.3,2\n",
    "own names": "v in [km/h],angle in,v out [km/h],angle out\n61,20,38,26\n60,33,37,44\n",
    "three components": "v_x1,v_y1,v_z1,v_x2,v_y2,v_z2\n20,5,1,15,4,9\n21,5,1,15,4,-9\n",
    "film without rate": "frame,x [px],y [px]\n1,10,20\n2,12,22\n3,14,24\n",
    "film": "t [s],x [m],y [m]\n0,0,1\n0.01,0.1,0.99\n0.02,0.2,0.97\n",
}
# Cells by column.
Columns: TypeAlias = Mapping[str, Sequence[object]]
ENDINGS = (".csv", ".tsv", ".txt", ".xlsx")


class Remedy(NamedTuple):
    """Words of a command, the sentence that named it, and the option that is not filled in."""

    words: tuple[str, ...]
    sentence: str
    unfilled: str = ""


class Outcome(NamedTuple):
    """Exit code and sentences of a command."""

    code: int
    sentences: tuple[str, ...]


class Sentences(HTMLParser):
    """The texts of the blocks of a page, code in backquotes."""

    def __init__(self) -> None:
        super().__init__()
        self.texts = [""]
        self.skipped = 0

    def handle_starttag(self, tag: str, _attributes: object) -> None:
        """Begin a block, code, or what is not read."""
        self.skipped += tag in ("script", "style", "pre")
        if tag == "code":
            self.texts[-1] += "`"
        elif tag in BLOCKS:
            self.texts.append("")

    def handle_endtag(self, tag: str) -> None:
        """End a block, code, or what is not read."""
        self.skipped -= tag in ("script", "style", "pre")
        if tag == "code":
            self.texts[-1] += "`"
        elif tag in BLOCKS:
            self.texts.append("")

    def handle_data(self, data: str) -> None:
        """Add a text."""
        if not self.skipped:
            self.texts[-1] += data


def sentences_of_page(page: Path) -> list[str]:
    """The texts of a page."""
    parser = Sentences()
    parser.feed(page.read_text(encoding="utf-8"))
    return [" ".join(text.split()) for text in parser.texts if text.strip()]


def run(words: Sequence[str], out: Path) -> Outcome:
    """Run a command in this process, with its result in a folder."""
    shutil.rmtree(out, ignore_errors=True)
    shown, said = io.StringIO(), io.StringIO()
    with redirect_stdout(shown), redirect_stderr(said):
        try:
            code = cli.main([*words, "--out", str(out)])
        except SystemExit as end:
            code = NO_COMMAND if end.code else 0
    sentences = [line.strip(" -") for line in said.getvalue().splitlines()]
    page = out / "report.html"
    if page.exists():
        sentences += sentences_of_page(page)
    return Outcome(code, tuple(filter(None, sentences)))


def remedies_in(sentences: Sequence[str], words: Sequence[str], fit: Path) -> Iterator[Remedy]:
    """The remedies that sentences name: commands as they are, and options for the command of these
    `words`, whose fit is in a folder.
    """
    for sentence in sentences:
        for text in COMMAND.findall(sentence):
            command = [of_page(word, fit) for word in shlex.split(text)[1:]]
            unfilled = PLACEHOLDER.search(text)
            yield Remedy(tuple(command), sentence, unfilled[0] if unfilled else "")
        for match in OPTION.finditer(COMMAND.sub("", sentence)):
            remedy = option_remedy(match["name"], match["value"] or "", sentence, words)
            if remedy is not None:
                yield remedy


def of_page(word: str, fit: Path | str) -> str:
    """A word of a command on a page: the page names its own folder, and files in it."""
    if word == ".":
        return str(fit)
    return str(Path(fit, word)) if word in OF_FILMS else word


def option_remedy(name: str, text: str, sentence: str, words: Sequence[str]) -> Remedy | None:
    """The remedy of an option that a sentence names, with the text behind it, for the command of
    these `words`. One that the verb does not have is tried too, since that leads nowhere.
    """
    if name in SHOWN:
        return None
    option = f"--{name}"
    parameters = cli.parameters_of(cli.VERBS[words[0]])
    # A trailing underscore keeps a name from being a word of Python, as in `from_`.
    options = {key.rstrip("_").replace("_", "-"): value for key, value in parameters.items()}
    parameter = options.get(name)
    if parameter is None or isinstance(parameter.default, bool):
        return Remedy((*words, option), sentence)
    value = text.strip("\"'")
    unfilled = PLACEHOLDER.search(value)
    if name in FACTS and not re.search(r"[0-9]", value):
        return None
    if not value or unfilled:
        return Remedy((*words, option), sentence, unfilled[0] if unfilled else option)
    return Remedy((*without(words, option), option, value), sentence)


def without(words: Sequence[str], option: str) -> list[str]:
    """The words of a command without an option and its value."""
    kept = list[str]()
    skipped = False
    for word in words:
        if not skipped and word != option:
            kept.append(word)
        skipped = word == option
    return kept


def helps(remedy: Remedy, before: Outcome, words: Sequence[str], out: Path) -> tuple[bool, bool]:
    """Whether a remedy of the command of these `words` runs, and whether it helps."""
    short = [word for word in SHORT.get(remedy.words[0], ()) if word not in remedy.words]
    if remedy.words == tuple(words):
        # The same without what makes it short: the posterior.
        short = ["--max-steps", "400", "--figures", "none"]
    after = run([*remedy.words, *short], out)
    if after.code not in (0, 1) and remedy.words[0] == "compare":
        # These do not differ on impacts without motion along the court.
        after = run([*remedy.words, "--figures", "none"], out)
    # What comes up after all earlier faults are gone is the next remedy's.
    is_next = after.code == before.code == REFUSED and {*before.sentences}.isdisjoint(
        after.sentences
    )
    ran = after.code in (0, 1) or is_next
    if remedy.words[0] == "check" != words[0]:
        # It helps where it says more than that all is well.
        return ran, ran and after.code == 1
    if remedy.words[0] != words[0]:
        return ran, ran
    better = after.code < before.code or remedy.sentence not in after.sentences
    return ran, ran and better


def tables_of_faults() -> dict[str, str]:
    """Tables with a fault each, by name, as CSV."""
    header, *rows = (datasets_folder() / "wang_all.csv").read_text("utf-8").splitlines()
    cells = [row.split(",") for row in rows]
    columns: dict[str, Sequence[object]] = {}
    columns |= dict(zip(header.split(","), zip(*cells, strict=True), strict=True))
    spins = {name: columns[name] for name in ("omega_1 [rad/s]", "omega_2 [rad/s]")}
    speeds = {name: columns[name] for name in ("v_y1 [m/s]", "v_y2 [m/s]")}
    swapped = dict(zip(speeds, reversed(speeds.values()), strict=True))
    drops = [4.0 + k // 4 for k in range(24)]
    wobble = [0.01 * ((7 * k) % 5 - 2) for k in range(24)]
    ball = ["a" if k % 2 else "b" for k in range(24)]
    two_balls = [v * (0.7 if name == "a" else 0.8) for v, name in zip(drops, ball, strict=True)]
    slow = [2.0 + 0.125 * k for k in range(24)]
    curved = [v * (0.39 + 0.257 * v - 0.044 * v * v) for v in slow]
    return FAULTS | {
        "backspin": as_csv(columns | times(-1.0, spins)),
        "rebound backspin": as_csv(columns | times(-1.0, spins, "omega_2 [rad/s]")),
        "rpm": as_csv(columns | times(9.549297, spins)),
        "swapped": as_csv(columns | swapped),
        "no spin of the rebound": as_csv(columns | times(0.0, spins, "omega_2 [rad/s]")),
        "typing error": as_csv(columns | {"v_y2 [m/s]": ["7.x", *columns["v_y2 [m/s]"][1:]]}),
        "curved drops": as_csv({"v_y1": slow, "v_y2": added(curved, wobble)}),
        "two balls": as_csv({"v_y1": drops, "v_y2": added(two_balls, wobble), "make": ball}),
        "drops of balls": as_csv({"v_y1": drops, "v_y2": added(two_balls, wobble), "ball": ball}),
    }


def times(factor: float, columns: Columns, *names: str) -> dict[str, Sequence[object]]:
    """Columns, or those of these names, multiplied by a factor."""
    return {
        name: [float(str(cell)) * factor for cell in cells]
        for name, cells in columns.items()
        if not names or name in names
    }


def added(first: Sequence[float], second: Sequence[float]) -> list[float]:
    """The sums of two columns."""
    return [round(a + b, 4) for a, b in zip(first, second, strict=True)]


def as_csv(columns: Columns) -> str:
    """Columns as the text of a file."""
    lines = [",".join(columns)]
    lines += [",".join(map(str, cells)) for cells in zip(*columns.values(), strict=True)]
    return "\n".join(lines) + "\n"


def study(
    tables: Sequence[Path],
    work: Path,
    verbs: Sequence[str] = ("check", "calibrate"),
) -> tuple[int, int, int, list[str]]:
    """How many remedies of some verbs, of films `track`, were made, run and helped on tables, and a
    line for each that did not.
    """
    made = ran = helped = 0
    lines = list[str]()
    for table in tables:
        tried = set[tuple[str, ...]]()
        for verb in ("track",) if "film" in table.name else verbs:
            words = [verb, table.name]
            fit = work / "fit"
            before = run([*words, *SHORT[verb]], fit)
            for remedy in remedies_in(before.sentences, words, fit):
                if remedy.words in tried:
                    continue
                tried.add(remedy.words)
                made += 1
                runs, helps_it = False, False
                if not remedy.unfilled:
                    runs, helps_it = helps(remedy, before, words, work / "again")
                ran += runs
                helped += helps_it
                if not helps_it:
                    what = "unfilled" if remedy.unfilled else "ran" if runs else "did not run"
                    lines.append(f"{what}: {shlex.join(remedy.words)}: {remedy.sentence[:400]}")
                    print(lines[-1], flush=True)
    return made, ran, helped, lines


def main() -> int:
    """Count remedies over tables; 1 where one does not run or does not help."""
    parser = argparse.ArgumentParser(
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("folders", nargs="*", type=Path)
    parser.add_argument("--only", default="")
    parser.add_argument("--verbs", nargs="+", default=["check", "calibrate"])
    arguments = parser.parse_args()
    folders = [folder.resolve() for folder in arguments.folders] or [datasets_folder()]
    with tempfile.TemporaryDirectory(prefix="fitball-") as name, chdir(name):
        place = Path(name)
        for folder in folders:
            for file in sorted(folder.iterdir()):
                if file.suffix in (*ENDINGS, ".toml"):
                    shutil.copy(file, place)
        if not arguments.folders:
            for stem, text in tables_of_faults().items():
                (place / f"{stem}.csv").write_text(text, encoding="utf-8")
        files = [file for file in sorted(place.iterdir()) if file.suffix in ENDINGS]
        tables = [file for file in files if arguments.only in file.name]
        made, ran, helped, _ = study(tables, place / "work", arguments.verbs)
    print(f"{len(tables)} tables: {made} remedies made, {ran} run, {helped} helped")
    return int(helped < made)


if __name__ == "__main__":
    sys.exit(main())
