"""Hostile input: damaged files, odd words and names, broken surroundings, all held to one rule
(POSIX systems).

    python scripts/hostile.py                   # 3,000 cases; --share 0.1 of them; --seed 2: others
    python scripts/hostile.py scene names:17    # some kinds; or one again, by the seed alone
    python scripts/hostile.py --control         # with a guard removed the rule finds a fault

The rule: exit code 0, 1 or 2 (or a signal's), 2 with words; no traceback, no warning of a library,
no control character shown; of the input nothing executed, nor unescaped in HTML, C, C#, JavaScript,
Python, TeX or CSV; no file outside of --out changed, no older result lost or mixed unless
--overwrite, new ones whole; limits of time and memory.
"""

import argparse
import ast
import csv
import io
import json
import os
import re
import resource
import shlex
import shutil
import subprocess
import sys
import tempfile
import tomllib
import traceback
import warnings
from collections import Counter
from contextlib import redirect_stderr, redirect_stdout
from hashlib import sha256
from importlib import import_module
from pathlib import Path
from types import SimpleNamespace as Ending
from typing import Any
from unittest.mock import patch

from numpy.random import Generator as Rng
from numpy.random import default_rng

from fitball import cli
from fitball.base import files
from fitball.data.bundled import datasets_folder

CPU = 60.0
MEMORY = 1_000_000
SAID = 20_000  # seconds, kilobytes, letters of errors
# What is put into files, and the commands of each kind of case.
DATA = json.loads(Path(__file__).with_suffix(".json").read_text("utf-8"))
CASES = DATA["cases"]
TABLE = DATA["tables"][0]
# Whatever is qz7 must stay text: no call, element, attribute, command of TeX, formula.
ODD = [*DATA["odd"], "9" * 400, "9" * 5000, "a" * 30_000, "(" * 2000, "../" * 30]
MISTAKES = tomllib.loads(
    (Path(__file__).parents[1] / "tests" / "data" / "mistakes.toml").read_text("utf-8")
)["verb"]
LINES = [f"{verb} {words}" for verb, lines in MISTAKES.items() for words, _ in lines]
TOKEN = re.compile(r"[+-]?[0-9][0-9.]*(?:e[+-]?[0-9]+)?|[A-Za-z_][\w .-]*")
NEVER = re.compile("(?!)")
# Comments and texts of C, C# and JavaScript: what is left is code.
QUOTED = re.compile(
    r"""/\*.*?\*/|//(?:(?:\\|\?\?/)\r?\n|[^\n\r\u2028\u2029])*|"(?:\\.|[^"\\\n])*"|'(?:\\.|[^'\\\n])*'""",
    re.DOTALL,
)
ENDS = {"png": b"\xaeB`\x82", "html": b"</html>", "json": b"}"}
OLDER = ("report.html", "fit.json", "old.png", "mine.txt")
Words = list[str]


def pick(rng: Rng, items: Any) -> Any:
    """One of some."""
    return items[int(rng.integers(len(items)))]


def damaged(text: str, rng: Rng) -> str:
    """A text with up to three words, numbers, spans or letters replaced."""
    for _ in range(int(rng.integers(1, 4))):
        at = int(rng.integers(len(text) + 1))
        way = int(rng.integers(6))
        found = list(TOKEN.finditer(text))
        span = pick(rng, found).span() if way < 4 and found else (at, at + int(rng.integers(20)))
        text = (
            text[: span[0]]
            + (pick(rng, ODD) if way < 5 else chr(int(rng.integers(0x180))))
            + text[span[1] :]
        )
    return text


def spoil(place: Path, rng: Rng) -> None:
    """Replace, cut off or double bytes of a file, encode them otherwise, or put others."""
    data = place.read_bytes()
    some = bytearray(data)
    first, last = sorted(int(rng.integers(len(data) + 1)) for _ in range(2))
    for at in rng.integers(max(len(data), 1), size=5) if data else ():
        some[at] = int(rng.integers(256))
    wide = data.decode("utf-8", "replace").encode("utf-16")
    place.write_bytes(
        bytes(
            pick(rng, (some, data[:first], data[:last] + data[first:], b"", wide, rng.bytes(500)))
        )
    )


def put(name: str, text: str, rng: Rng) -> None:
    """Write a damaged text; seldom damaged bytes, or what never ends or begins."""
    (place := Path(name)).unlink(missing_ok=True)
    way = rng.integers(40)
    if way < 2:
        place.symlink_to(("/dev/zero", name)[way])
    else:
        place.write_bytes(damaged(text, rng).encode("utf-8", "surrogatepass"))
    if 2 <= way < 8:
        spoil(place, rng)


def given(text: str) -> str:
    """A word as a program receives it: no zero bytes, and what is no UTF-8 as surrogates."""
    return (
        text.replace("\0", "")
        .encode("utf-8", "surrogatepass")[:200]
        .decode("utf-8", "surrogateescape")
    )


def put_workbook(rng: Rng) -> None:
    """A workbook with odd cells and sheets; one of three has damaged bytes."""
    book = import_module("openpyxl").Workbook()
    for row in csv.reader(
        io.StringIO(re.sub("[\x00-\x08\x0b-\x1f\ud83d]", "", damaged(TABLE, rng)))
    ):
        book.active.append(
            [float(one) if re.fullmatch(r"-?[\d.]{0,9}\d", one) else one for one in row]
        )
    book.active[pick(rng, ("A900", "AZ1048576", "A3", "A4", "A5"))] = pick(rng, (" ", "x", 1.0))
    book.save("t.xlsx")
    if rng.integers(3) == 0:
        spoil(Path("t.xlsx"), rng)


def put_fit(rng: Rng) -> None:
    """A saved fit: damaged, or with texts of somebody else and signed again."""
    place = Path("F/fit.json")
    arrays = Path("F/fit.nc")
    if rng.integers(4) == 0:
        spoil(pick(rng, (place, arrays)), rng)
        return
    content = json.loads(place.read_text())
    texts = [pick(rng, ODD).replace("\ud83d", "") for _ in range(5)]
    content["headline"], run = texts[3], content["run"]
    run["table"]["labels"]["id"][0], run["table"]["name"], run["version"] = texts[:3]
    run["scene"] = {
        "source": {"description": texts[3], "citation": texts[4]},
        "laboratory": {texts[3]: texts[4]},
    }
    if rng.integers(4) == 0:
        run["choices"]["model"], run["scene"]["model"] = pick(
            rng,
            (("evil.py:f", {}), ("", {"name": "evil.py:f"})),
        )
    whole = json.dumps({**content, "digest": ""}, sort_keys=True).encode()
    place.write_text(
        json.dumps({**content, "digest": sha256(whole + arrays.read_bytes()).hexdigest()})
    )


def put_names(rng: Rng) -> tuple[str, str]:
    """A table of an odd name with an odd label, and an odd place for results."""
    parts = [*ODD, *DATA["names"]]
    name, other = (
        given("".join(pick(rng, parts)[:60] for _ in range(int(rng.integers(1, 4))))) for _ in "ab"
    )
    label = given(pick(rng, parts)).replace('"', '""')
    other = other.replace("/", "_")
    name = name.replace("/", "_") + pick(rng, (".csv", "", ".toml"))
    name = name if name.strip(".") and name[0] != "-" else f"./{name}x.csv"
    Path(name).write_bytes(TABLE.replace("clay", f'"{label}"').encode("utf-8", "surrogateescape"))
    return name, pick(rng, ("out", other, f"out/{other}", "out/../out", "t" * 300))


def command_of(kind: str, rng: Rng) -> Words:
    """Write the files of a case into the folder where it is; the words of its command."""
    line = pick(rng, DATA["commands"][kind]).split()
    if kind == "words":
        line = shlex.split(pick(rng, LINES))
        # Nothing that would run for minutes.
        may = line[0] != "compare" and rng.integers(4)
        place = int(rng.integers(len(line))) * int(rng.integers(2)) - 1
        line[place] = given(damaged(line[place], rng) if may else pick(rng, ODD))
        more = {
            "calibrate": DATA["quick"],
            "batch": DATA["quick"],
            "bench": "--at=x",
            "rederive": "--at=x",
        }
        return [*line, *more.get(line[0], "").split()]
    if kind == "surroundings":
        shell = pick(rng, DATA["shells"]).replace("{s}", f"{rng.uniform(0.3, 6.0):.2f}")
        return [
            "sh",
            "-c",
            shell.replace("{}", shlex.join([sys.executable, "-P", "-m", "fitball", *line])),
        ]
    if kind == "names":
        file, out = put_names(rng)
        return [file if one == "FILE" else one.replace("PLACE", out) for one in line]
    if kind == "table":
        put("t.csv", pick(rng, DATA["tables"]), rng)
    elif kind == "scene":
        Path("t.csv").write_text(pick(rng, DATA["tables"]))
        put("t.toml", DATA["scene"], rng)
    elif kind == "film":
        put("p.csv", Path("p.csv").read_text()[: pick(rng, (60, 4000))], rng)
    else:
        {"workbook": put_workbook, "fit": put_fit}[kind](rng)
    return list(line)


def unescaped(kind: str, text: str) -> Words:
    """Where a text of the input is more than text, by the ending of a file or the format of an
    export.
    """
    if kind in ("html", "page"):
        scripts = "".join(re.findall(r"<script\b[^>]*>(.*?)</script>", text, re.DOTALL))
        return re.findall("<qz7.{9}", text) + unescaped("js", scripts)
    if kind in ("py", "python"):
        return [
            node.id
            for node in ast.walk(ast.parse(text))
            if isinstance(node, ast.Name) and "qz7" in node.id
        ]
    if kind in ("h", "c", "cs", "csharp", "js", "javascript"):
        return re.findall(r".{0,20}qz7 ?[({].{0,9}", QUOTED.sub("", text))
    if kind in ("csv", "golden"):
        cells = [cell for row in csv.reader(io.StringIO(text)) for cell in row]
        return [
            f"formula {one[:40]}" for one in cells if re.match(r"[=+@\t\r-](?!inf|nan|[\d.]+)", one)
        ]
    tex = kind in ("latex", "tex", "bib")
    markdown = kind in ("md", "markdown")
    return re.findall(
        r"\\(?:qz|input)." if tex else r"(?<!\\)<qz7|<script" if markdown else NEVER,
        text,
    )


def contents() -> dict[str, bytes]:
    """Files as far as three folders above, by name from here, and where links lead."""
    found = [one for one in Path("../../..").rglob("*") if one.is_symlink() or one.is_file()]
    return {
        os.path.relpath(one): bytes(one.readlink()) if one.is_symlink() else one.read_bytes()
        for one in found
    }


def run(asked: Words) -> Ending:
    """A command in this process, its streams as strict as those of a terminal, or a line of the
    shell.
    """
    end = Ending(code=None, out="", err="", trace="", heard=[], cpu=0.0, growth=0)
    began = resource.getrusage(0)
    if asked[:1] == ["sh"]:
        done = subprocess.run(
            asked,
            capture_output=True,
            check=False,
            stdin=subprocess.DEVNULL,
            timeout=300,
        )
        end.code = done.returncode
        end.out = done.stdout.decode()
        end.err = done.stderr.decode(errors="replace")
        return end
    streams = [
        io.TextIOWrapper(io.BytesIO(), "utf-8", e, "", False, True)
        for e in ("strict", "backslashreplace")
    ]
    with (
        redirect_stdout(streams[0]),
        redirect_stderr(streams[1]),
        warnings.catch_warnings(record=True) as warned,
    ):
        warnings.simplefilter("always")
        try:
            end.code = cli.main(asked)
        except SystemExit as stop:
            end.code = stop.code
        except BaseException:
            end.trace = traceback.format_exc()
    now = resource.getrusage(0)
    end.cpu = sum(now[:2]) - sum(began[:2])
    end.growth = now.ru_maxrss - began.ru_maxrss
    end.heard = [f"warning: {one.filename}:{one.lineno}: {one.message}" for one in warned]
    end.out, end.err = (bytes(stream.detach().getvalue()).decode() for stream in streams)
    return end


def broken(asked: Words, before: dict[str, bytes], after: dict[str, bytes], end: Ending) -> Words:
    """What the rule has against how a case ended."""
    shell = asked[:1] == ["sh"]
    said = end.out + end.err
    verb = "".join(asked[:1])
    line = " ".join(asked)
    wild = {
        letter
        for letter in said
        if (letter < " " and letter not in "\n\t") or "\x7f" <= letter <= "\x9f"
    }
    inside = next(
        (one[6:] for one in asked if one.startswith("--out=")),
        "out" if "--out" in line else "",
    )
    out = (
        os.path.normpath(inside)
        if inside
        else "F"
        if verb == "plot"
        else f"F/{verb}"
        if "F" in asked
        else "fits"
    )
    older = "out/mine.txt" in before and "rm -r out" not in line
    replaced = "--overwrite" in line and (end.code in (0, 1) or shell)
    lost = [one for one in OLDER if older and after.get(f"out/{one}") != b"old"]
    bad = {
        f"traceback: {(end.trace or said)[-200:]}": end.trace
        or "Traceback (" in said
        or "Exception ignored" in said,
        f"exit code {end.code}": end.code not in (0, 1, 2, *(124, 130, 137, 143) * shell)
        and not end.trace,
        "exit code 2 without a word": end.code == 2 and not shell and not end.err.strip(),
        f"{len(end.err)} letters of errors": len(end.err) > SAID,
        f"control characters: {sorted(wild)}": wild,
        f"limits: {end.cpu:.0f} s of CPU, {end.growth} kB": end.cpu > CPU or end.growth > MEMORY,
        f"older result lost: {lost}": [one for one in lost if one == "mine.txt" or not replaced],
        "older result mixed": older
        and replaced
        and not shell
        and after.get("out/old.png") == b"old",
    }
    faults = [*end.heard, *(fault for fault, found in bad.items() if found)]
    for name in sorted(one for one in before | after if before.get(one) != after.get(one)):
        data = after.get(name, b"gone")
        kind = name.rpartition(".")[2]
        if (not shell or name in ("evil.py", "qz7")) and not name.startswith(f"{out}/"):
            faults.append(f"outside of {out}: {name}" if data else f"executed: {name}")
        elif not data or not data.rstrip().endswith(ENDS.get(kind, b"")):
            faults += [f"not whole: {name}"] * (
                kind in ("csv", "html", "png", "json", "nc") and name in after
            )
        elif name in after:
            faults += [f"{name}: {one}" for one in unescaped(kind, data.decode(errors="replace"))]
    return faults + (
        unescaped(asked[asked.index("--to") + 1], end.out)
        if end.code == 0 and "--to" in asked
        else []
    )


def case(kind: str, index: int, seed: int, folder: Path) -> tuple[str, Ending, Words]:
    """The command of a case, how it ended in a new folder, what the rule has against it."""
    rng = default_rng([seed, sum(map(ord, kind)), index])
    shutil.copytree(folder.parent / "made", folder / "a" / "b" / "c")
    os.chdir(folder / "a" / "b" / "c")
    tempfile.tempdir = str(Path.cwd())
    older = not rng.integers(3)
    asked = command_of(kind, rng)
    if older or kind == "surroundings":
        Path("out").mkdir(exist_ok=True)
        for name in (*OLDER, ".fitball-files"):
            Path("out", name).write_text(
                "old" if name in OLDER else "report.html\nfit.json\nold.png\n"
            )
        asked += ["--overwrite"] * (
            int(rng.integers(2)) and asked[0] not in ("export", "plot") and "out" in asked
        )
    before = contents()
    end = run(asked)
    return ascii(shlex.join(asked))[:300], end, broken(asked, before, contents(), end)


def prepare(made: Path) -> None:
    """A fit, a batch and positions, to be damaged; files that must not run."""
    made.mkdir()
    os.chdir(made)
    for name, text in DATA["files"].items():
        Path(name).write_text(text)
    film = (datasets_folder() / "tracks" / "table_tennis_topspin.csv").read_text()[:2000]
    Path("p.csv").write_text(film.rpartition("\n")[0] + "\n")
    with redirect_stdout(io.StringIO()):
        cli.main(DATA["prepare"][0].split())
    Path("t.csv").write_text(TABLE)


# What is put in the place of a guard.
INSTEAD = {
    "never": NEVER,
    "nothing": (),
    "text": str,
    "model": import_module("fitball.models.registry").model,
    "unheld": lambda place, held=files.result_folder, **more: held(
        place,
        **more | {"overwrite": True},
    ),
}


def words_of_command() -> argparse.Namespace:
    """What is asked on the command line."""
    parser = argparse.ArgumentParser(
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("what", nargs="*", help="kinds, or KIND:INDEX")
    parser.add_argument("--share", type=float, default=1.0, help="of the cases of each kind")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--control", action="store_true")
    return parser.parse_args()


def missed_without(guard: str, instead: str, kind: str, wanted: str, seed: int, root: Path) -> str:
    """Where the rule finds the fault that is `wanted` (a pattern) while a guard is removed: the
    case and the fault, or an empty text.
    """
    for index in range(150):
        with patch(guard, INSTEAD[instead]):
            faults = case(kind, index, seed, root / f"{guard}-{index}")[2]
        for fault in faults:
            if re.search(wanted, fault):
                return f"{kind}:{index}: {fault[:90]!a}"
    return ""


def run_controls(seed: int, root: Path) -> int:
    """Remove each guard in turn, and print what is seen; the number of guards that are not
    missed.
    """
    bad = 0
    for guard, instead, kind, wanted in DATA["guards"]:
        seen = missed_without(guard, instead, kind, wanted, seed, root)
        print(f"without {guard}: {seen or 'NOTHING FOUND'}", flush=True)
        bad += not seen
    return bad


def single_cases(what: Words) -> list[tuple[str, int]]:
    """The cases that are named as KIND:INDEX."""
    pairs = [word.partition(":") for word in what]
    return [(kind, int(index)) for kind, _, index in pairs if index]


def run_cases(cases: list[tuple[str, int]], alone: bool, seed: int, root: Path) -> int:
    """Run cases, print what the rule has against them, how they ended and the slowest; the number
    that broke the rule. All of a case that runs alone is printed, and its folder stays.
    """
    bad = 0
    count = Counter[str]()
    slow = list[tuple[float, str]]()
    for kind, index in cases:
        line, end, faults = case(kind, index, seed, root / f"{kind}-{index}")
        slow.append((end.cpu, f"{end.cpu:6.1f} s of CPU: {kind}:{index} {line[:150]}"))
        count[f"{kind} {end.code}"] += 1
        for fault in faults[:4]:
            print(f"{kind}:{index}: {fault[:300]!a}\n    {line}", flush=True)
        bad += bool(faults)
        if alone:
            print(line, end.out, end.err, end.trace, end.code, root, sep="\n")
        elif not faults:
            shutil.rmtree(root / f"{kind}-{index}")
    slowest = [line for _, line in sorted(slow, reverse=True)[:5]]
    print(dict(sorted(count.items())), *slowest, sep="\n")
    return bad


def main() -> int:
    """Run what is asked; 1 if the rule was broken, or with --control if a fault was not found."""
    asked = words_of_command()
    root = Path(tempfile.mkdtemp(prefix="hostile-")).resolve()
    # What takes all memory is stopped here: whoever runs this has other work.
    resource.setrlimit(resource.RLIMIT_AS, (2**33, resource.RLIM_INFINITY))
    prepare(root / "made")
    alone = single_cases(asked.what)
    if asked.control:
        bad = run_controls(asked.seed, root)
        verdict = f"{bad} guards not missed"
    else:
        cases = alone
        if not alone:
            kinds = asked.what or CASES
            cases = [(kind, k) for kind in kinds for k in range(int(asked.share * CASES[kind]))]
        bad = run_cases(cases, bool(alone), asked.seed, root)
        verdict = f"{bad} of {len(cases)} cases broke the rule"
    os.chdir("/")
    if asked.control or not (bad or alone):
        shutil.rmtree(root)
    print(verdict)
    return int(bad > 0)


if __name__ == "__main__":
    sys.exit(main())
