"""Generated parts, links, words and commands of README.md and docs/: `docs.py [--check] [--run]
[PAGE ...]`.

Without an option the generated parts are written from the code. `--check` says which are out of
date and which links lead nowhere, and counts words. `--run` runs the pages, each in a folder that
is empty at first (of --keep DIR):

    ```sh          in bash, must succeed; `sh exit=2` must end with that code; `sh show` is not run
    ```python      blocks of a page share their names; `python show` is not run
    ```csv a.csv   is written to that file, of any language
    ```text        output: its lines that are not printed are named, no fault, since digits depend
                   on the machine

Words are counted without generated parts and output, and without pages for developers.
"""

import argparse
import ast
import os
import re
import subprocess
import sys
import tempfile
from collections.abc import Iterable, Iterator
from pathlib import Path

from fitball import cli
from fitball.base import units as spellings
from fitball.base.columns import COLUMNS
from fitball.base.prior_families import FAMILIES
from fitball.data import scene as scenes
from fitball.data.bundled import published_priors
from fitball.models.registry import MODELS, model
from fitball.models.specs import BALL_PARAMETERS, SPECS

ROOT = Path(__file__).resolve().parent.parent
PAGES = [
    ROOT / "README.md",
    *sorted((ROOT / "docs").glob("*.md")),
    *sorted((ROOT / "docs/tutorials").glob("*.md")),
]
MOST_WORDS = 16_000
_PART = re.compile(r"(<!-- generated: (\w+) -->\n).*?(<!-- end -->)", re.DOTALL)
_FENCE = re.compile(r"^(`{3,})(\S*) ?(.*)\n((?:.*\n)*?)\1$", re.MULTILINE)
# A page as a program: line n of the page is its line n, so that tracebacks lead there.
_RUN = """import subprocess, sys
def _sh(code, wanted):
    print("$ " + code.rstrip().replace("\\n", "\\n$ "), flush=True)
    shell = ["bash", "-euo", "pipefail", "-c", code]
    got = subprocess.run(shell, stdout=subprocess.PIPE, text=True)
    said.extend(got.stdout.splitlines())
    print(got.stdout, flush=True)
    if got.returncode != wanted:
        raise SystemExit(f"exit code {got.returncode}, expected {wanted}: {code}")
def _text(shown):
    for line in set(shown.splitlines()) - set(said) if said else ():
        print("NOT PRINTED NOW:", line)
said = []
names = {"__name__": "__main__", "_sh": _sh, "_text": _text}
exec(compile(sys.argv[2], sys.argv[1], "exec"), names)
"""


def table(heads: str, rows: Iterable[Iterable[object]]) -> str:
    """A table of Markdown."""
    lines = [heads.split("|"), ["---"] * (heads.count("|") + 1), *rows]
    return "".join(f"| {' | '.join(str(cell) for cell in line)} |\n" for line in lines)


def columns() -> str:
    """Columns of numbers."""
    rows = []
    for one in COLUMNS.values():
        unit, factor = ("deg", 57.29577951) if one.unit == "rad" else (one.unit, 1.0)
        limits = " to ".join(f"{limit * factor:.4g}" for limit in one.limits)
        rows.append((f"`{one.name}`", one.title, unit, limits, one.opposite))
    return table("column|means|without a unit|limits|`--flip` reads it", rows)


def units() -> str:
    """Units, and how else they are spelled."""
    words = {**spellings._WORDS, **spellings._WHOLE}
    rows = []
    for si, every in spellings._UNITS.items():
        for symbol, (above, below) in every.items():
            others = ", ".join(
                f"`{word}`" for word, meant in words.items() if meant == symbol != word
            )
            rows.append((f"`{symbol}`", f"{above / below:.8g} {si}", others))
    return table("unit|is|also spelled", rows)


def scene() -> str:
    """Keys of scenes."""
    rows = []
    for key, one in scenes._KEYS.items():
        section, _, name = key.partition(".")
        if isinstance(one, scenes._Size):
            takes = (
                f"{one.low:g} to {one.high:g} {one.unit}" if one.low > -1e300 else "a number in SI"
            )
        else:
            takes = (
                ", ".join(f"`{text}`" for text in one) or "a text"
                if isinstance(one, tuple)
                else "columns"
            )
        rows.append((f"`[{section}]`", f"`{name or 'value, sd'}`", takes))
    return table("section|key|takes", rows)


def options() -> str:
    """Arguments and options of all verbs."""
    shared = cli.help_of(cli.VERBS["calibrate"]).arguments
    parts = []
    for verb in cli.VERBS.values():
        words = cli.help_of(verb)
        rows = []
        for name, one in cli.parameters_of(verb).items():
            value, means = words.arguments.get(name) or shared.get(name) or ("", "")
            flag = f"--{name.replace('_', '-')} " if one.kind is one.KEYWORD_ONLY else ""
            rows += [(f"`{(flag + value).strip()}`", means)] * (name != "progress")
        listed = [table("argument|means", rows).rstrip()] * bool(rows)
        parts += [f"### {verb.__name__}", words.summary, *filter(None, [words.text]), *listed]
    common = table("option|means", ((f"`--{name}`", means) for name, means in cli.COMMON.items()))
    return "\n\n".join([*parts, "### Every verb", common])


def parameters() -> str:
    """Parameters of models, with their default priors."""
    of = {name: {spec.name for spec in model(name).parameters} for name in MODELS}
    rows = []
    for name, one in SPECS.items():
        rest = (
            "all, with an sd in the scene"
            if name in BALL_PARAMETERS
            else "two-mass with other options"
        )
        models = ", ".join(text for text, names in of.items() if name in names) or rest
        rows.append((f"`{name}`", one.meaning, one.unit, f"`{one.prior}`", models))
    return table("parameter|means|unit|default prior|models", rows)


def families() -> str:
    """Families of priors: the meaning is the first sentence of each class."""
    rows = []
    for family in FAMILIES.values():
        meaning = (family.__doc__ or "").partition(".")[0].replace("\n", " ")
        rows.append((f"`{family.form}`", " ".join(meaning.split()), family.coordinate_kind.name))
    return table("prior|of|coordinate", rows)


def priors() -> str:
    """Published priors."""
    rows = []
    for row in published_priors():
        prior = f"`{row['distribution']}({row['value']}, {row['sd']})`"
        rows.append(
            (
                f"`{row['parameter']}`",
                f"`literature:{row['key']}`",
                prior,
                f"{row['source']}: {row['note']}",
            )
        )
    return table("parameter|key|prior|source", rows)


def codes() -> str:
    """Codes of errors, faults and notes, as calls have them."""
    found = dict[str, set[str]]()
    calls = {"fault": "Fault", "_fault": "Fault", "refusal": "Fault", "note": "Note"}
    for place in Path(cli.__file__).parent.rglob("*.py"):
        for call in (
            node
            for node in ast.walk(ast.parse(place.read_text("utf-8")))
            if isinstance(node, ast.Call)
        ):
            name = getattr(call.func, "id", getattr(call.func, "attr", ""))
            texts = [
                one.value
                for one in call.args
                if isinstance(one, ast.Constant) and isinstance(one.value, str)
            ]
            if (kind := calls.get(name, name)) in ("Fault", "Note") or kind.endswith("Error"):
                found.setdefault(kind, set()).update(
                    filter(re.compile(r"[a-z]+(-[a-z]+)*").fullmatch, texts[:2])
                )
    rows = (
        (kind, ", ".join(f"`{one}`" for one in sorted(found[kind])))
        for kind in sorted(found)
        if found[kind]
    )
    return table("carried by|codes", rows)


def generated(text: str) -> str:
    """A page with its generated parts made anew."""
    return _PART.sub(lambda part: part[1] + globals()[part[2]]() + part[3], text)


def anchors(page: Path) -> set[str]:
    """Of headings, as forges make them."""
    heads = re.findall(r"^#+ (.*)$", _FENCE.sub("", page.read_text("utf-8")), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", head.lower()).replace(" ", "-") for head in heads}


def dead_links(page: Path, text: str) -> Iterator[str]:
    """Links of a page to files and headings that are not there."""
    for link in re.findall(r"\]\(([^()\s]+)\)", re.sub(r"`[^`\n]*`", "", _FENCE.sub("", text))):
        name, _, anchor = link.partition("#")
        place = page.parent / name if name else page
        if not re.match(r"\w+:", link) and not (
            place.exists() and (not anchor or anchor in anchors(place))
        ):
            yield f"no such place: {link}"


def check() -> int:
    """Print the words of each page and what is wrong with it; the number of faults."""
    bad = whole = 0
    for page in PAGES:
        text = page.read_text("utf-8")
        name = page.relative_to(ROOT).as_posix()
        faults = ["generated parts are out of date: run scripts/docs.py"] * (
            generated(text) != text
        )
        faults += dead_links(page, text)
        read = _FENCE.sub(lambda block: "" if block[2] == "text" else block[0], _PART.sub("", text))
        words = len(read.split())
        bad = bad + len(faults)
        whole += words * ("/" in name and page.stem != "architecture")
        print(f"{words:6} {name}", *faults, sep="\n       ")
    print(f"{whole} words in docs/ of at most {MOST_WORDS}; {bad} faults")
    return bad + (whole > MOST_WORDS)


def run(page: Path, folder: Path) -> bool:
    """Run a page in a folder; whether it failed."""
    folder.mkdir(parents=True)
    text = page.read_text("utf-8")
    lines = [""] * (text.count("\n") + 1)
    for block in _FENCE.finditer(text):
        line = text.count("\n", 0, block.start()) + 1
        language = block[2]
        more = block[3].strip()
        code = block[4]
        if "." in more:
            lines[line] = f"open({more!r}, 'w', encoding='utf-8').write({code!r})"
        elif language == "python" and more != "show":
            lines[line : line + code.count("\n")] = code.splitlines()
        elif language == "text":
            lines[line] = f"_text({code!r})"
        elif language == "sh" and more != "show":
            lines[line] = f"_sh({code!r}, {int(more.removeprefix('exit=') or 0)})"
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    command = [sys.executable, "-P", "-c", _RUN, str(page), "\n".join(lines)]
    return (
        subprocess.run(
            command,
            cwd=folder,
            env={**os.environ, "PATH": path},
            timeout=3600,
        ).returncode
        != 0
    )


def main() -> int:
    """Write, check or run."""
    parser = argparse.ArgumentParser(
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--check", action="store_true")
    parser.add_argument("--run", action="store_true")
    parser.add_argument("--keep", type=Path, metavar="DIR")
    parser.add_argument("pages", nargs="*", type=Path, metavar="PAGE", help="to run (default: all)")
    asked = parser.parse_args()
    bad = check() if asked.check else 0
    failed = []
    for page in () if asked.check or asked.run else PAGES:
        page.write_text(generated(page.read_text("utf-8")), "utf-8")
    with tempfile.TemporaryDirectory() as made:
        for page in asked.pages or PAGES if asked.run else ():
            print(f"==== {page.stem}", flush=True)
            failed += [page.stem] * run(
                page.resolve(),
                (asked.keep or Path(made)).resolve() / page.stem,
            )
    if asked.run:
        print(
            f"{len(asked.pages or PAGES) - len(failed)} pages ran, failed: "
            f"{', '.join(failed) or 'none'}"
        )
    return int(bad > 0 or bool(failed))


if __name__ == "__main__":
    sys.exit(main())
