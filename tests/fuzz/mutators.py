"""Ways to damage files and texts, blindly and with an eye for what hurts a reader."""

from __future__ import annotations

import os
import re

import numpy as np

# Where numbers are expected.
NUMBERS = (
    "1e308", "-1e308", "1e-308", "5e-324", "1e999", "inf", "-inf", "nan", "NaN", "0", "-0.0", "-1", "1e5", "1e20",
    "1e-20", "9" * 400, "9" * 5000, "0." + "0" * 400 + "1", "1" * 309, "0x1F", "1_000", "1,5", "true", "false",
    "null", "", " ", "10**9", "1e", "--1", "+1", "\u0661\u0662", "\u22121.5", "\u221e", "1\u00a0000", '"5"', "[1, 2]",
    "{}", "{ value = 1 }", "1979-05-27T07:32:00Z", "1j",
)  # fmt: skip
# Where text is expected.
TEXTS = (
    "", " ", "\x1b[31mred\x1b[0m", "\x1b]0;title\x07", "\x9b2J", "\x7f", "\x00", "\r", "\r\nv", "\u202egnp.exe",
    "\u2066x", "\ufeff", "\u200b", "\u2028", "\U0001f3be", "\U000e0041", "e\u0301" * 50, "a" * 100_000, "../" * 100,
    "/dev/null", ".", "..", "~", "%s%n{0}{x}", "$(id)", "`id`", "<script>alert(1)</script>", "'; --", '"', "'", "\\",
    "\\u0000", "\ud83d", "=1+1", "#", ",", ";", "[", "]", "(" * 2000, "[" * 2000, "None", "__class__", "id", "v_x1",
    "two-mass", "normal(0, 1)", "1", "-1", "CON",
)  # fmt: skip
_NUMBER = re.compile(r"[+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?")
_WORD = re.compile(r"[A-Za-z_][A-Za-z0-9_ .-]*")


def pick(rng, items):
    return items[rng.integers(len(items))]


def _replace_match(text, rng, pattern, choices):
    matches = list(pattern.finditer(text))
    if not matches:
        return text + pick(rng, choices)
    at = matches[rng.integers(len(matches))]
    return text[: at.start()] + pick(rng, choices) + text[at.end() :]


def _number(text, rng):
    return _replace_match(text, rng, _NUMBER, NUMBERS)


def _scaled(text, rng):
    """A number as large or small as a wrong unit makes it."""
    matches = list(_NUMBER.finditer(text))
    if not matches:
        return text
    at = matches[rng.integers(len(matches))]
    return text[: at.start()] + f"{float(at[0]) * 10.0 ** int(rng.integers(-8, 9)):.6g}" + text[at.end() :]


def _word(text, rng):
    return _replace_match(text, rng, _WORD, TEXTS)


def _insert(text, rng):
    at = int(rng.integers(len(text) + 1))
    return text[:at] + pick(rng, TEXTS) + text[at:]


def _delete(text, rng):
    first, last = sorted(int(rng.integers(len(text) + 1)) for _ in range(2))
    return text[:first] + text[min(last, first + 40) :]


def _truncate(text, rng):
    return text[: int(rng.integers(len(text) + 1))]


def _character(text, rng):
    at = int(rng.integers(len(text) + 1))
    return text[:at] + chr(int(rng.integers(0x180))) + text[at + 1 :]


def _lines(text, rng):
    """Two lines swapped, one left out, or one many times over."""
    lines = text.splitlines(keepends=True)
    if not lines:
        return text
    one, other, way = int(rng.integers(len(lines))), int(rng.integers(len(lines))), int(rng.integers(3))
    if way == 0:
        lines[one], lines[other] = lines[other], lines[one]
    elif way == 1:
        del lines[one]
    else:
        lines[one:one] = [lines[other]] * int(rng.integers(1, 400))
    return "".join(lines)


TEXT_WAYS = (
    _number, _number, _scaled, _scaled, _word, _word, _insert, _delete, _truncate, _character, _lines,
)  # fmt: skip


def damaged(text, rng):
    """`text`, damaged once, twice or, seldom, three times."""
    for _ in range(1 + int(rng.integers(2)) * int(rng.integers(1, 3))):
        text = TEXT_WAYS[rng.integers(len(TEXT_WAYS))](text, rng)
    return text


def damage_text_file(path, rng):
    """Damage a text file; one time in eight its bytes or the file itself. Returns what was done, in a few words."""
    if rng.integers(8) == 0:
        return damage_file(path, rng)
    text = damaged(path.read_text(encoding="utf-8"), rng)
    path.write_bytes(text.encode("utf-8", "surrogatepass"))
    return f"{path.name}: its text"


def _bytes(data, rng):
    """Some bytes replaced."""
    content = np.frombuffer(data, dtype=np.uint8).copy()
    if content.size:
        content[rng.integers(content.size, size=int(rng.integers(1, 8)))] = rng.integers(256)
    return content.tobytes()


def _span(data, rng):
    """A span left out, doubled or zeroed."""
    first, last = sorted(int(rng.integers(len(data) + 1)) for _ in range(2))
    middle = (b"", data[first:last] * 2, bytes(last - first))[rng.integers(3)]
    return data[:first] + middle + data[last:]


BYTE_WAYS = {
    "bytes replaced": _bytes,
    "a span damaged": _span,
    "cut off": lambda data, rng: data[: int(rng.integers(len(data) + 1))],
    "emptied": lambda _data, _rng: b"",
    "in UTF-16": lambda data, _rng: data.decode("utf-8", "replace").encode("utf-16"),
    "a byte order mark in front": lambda data, _rng: b"\xef\xbb\xbf" + data,
    "noise": lambda _data, rng: rng.bytes(int(rng.integers(1, 2000))),
}


def damage_bytes(path, rng):
    """Damage a file's bytes. Returns what was done."""
    way = list(BYTE_WAYS)[rng.integers(len(BYTE_WAYS))]
    path.write_bytes(BYTE_WAYS[way](path.read_bytes(), rng))
    return f"{path.name}: {way}"


def damage_file(path, rng):
    """Damage a file's bytes, or put something else where the file was. Returns what was done."""
    way = int(rng.integers(12))
    if way > 3:
        return damage_bytes(path, rng)
    path.unlink()
    if way == 0:
        path.mkdir()
        return f"{path.name}: a folder"
    if way == 1:
        path.symlink_to(path.name)
        return f"{path.name}: a link to itself"
    if way == 2:
        return f"{path.name}: gone"
    path.write_bytes(b"x")
    path.chmod(0)
    return f"{path.name}: unreadable"


def damage_place(path, rng):
    """Put something in the place of a file that never ends or never begins. Returns what it is."""
    path.unlink()
    way = int(rng.integers(4))
    if way == 0:
        os.mkfifo(path)
        return f"{path.name}: a pipe"
    if way == 1:
        path.symlink_to("/dev/zero")
        return f"{path.name}: a link to endless zeros"
    path.touch()
    os.truncate(path, (0, 0, 2**26 + 1, 2**40)[way])
    return f"{path.name}: {('', '', 'many', 'very many')[way]} zeros"
