"""Damage that keeps the form of a file, so that what reads its values meets it rather than what takes it apart."""

from __future__ import annotations

import csv
import io
import json
import re

from fuzz.mutators import NUMBERS, TEXTS, damage_text_file, pick

# Values as TOML writes them; what stands behind an equals sign.
_TOML_NUMBERS = (
    "1e308", "-1e308", "1e-308", "1e-12", "0.01", "1", "10", "1e3", "1e5", "1e20", "inf", "nan", "0", "-1",
    "true", "[]", "{}", "9" * 400, "{ value = 1, sd = 1e-30 }", "{ value = 0.5, sd = 1e-9 }",
    "{ value = 0.01, sd = 100.0 }",
)  # fmt: skip
_TOML_VALUE = re.compile(r"(?<== )(\"[^\"]*\"|[0-9][0-9.e-]*)")


def damage_table(path, rng):
    """Damage a CSV file: half of the time cells, columns or a whole column's unit, else its text. Returns what."""
    if rng.integers(2) == 0:
        return damage_text_file(path, rng)
    rows = list(csv.reader(io.StringIO(path.read_text(encoding="utf-8"))))
    while rows[0][0].startswith("#"):
        rows.pop(0)
    said = []
    for _ in range(int(rng.integers(1, 4))):
        column, way = int(rng.integers(len(rows[0]))), int(rng.integers(6))
        body = rows[1:]
        said.append(f"{rows[0][column][:20]}: {('a cell', 'scaled', 'a cell', 'renamed', 'unit', 'constant')[way]}")
        if way in (0, 2):
            row = body[rng.integers(len(body))]
            row[column] = pick(rng, NUMBERS if rng.integers(2) else TEXTS)
        elif way == 1:
            factor = 10.0 ** int(rng.integers(-10, 11))
            for row in body:
                row[column] = _times(row[column], factor)
        elif way == 3:
            rows[0][column] = pick(
                rng, (*TEXTS, "v_y1", "v_1", "theta_1", "omega_2", "contact_time", "v_x2_sd", "id")
            )
        elif way == 4:
            unit = pick(rng, ("m/s", "rpm", "deg", "rad", "s", "km/h", "kn", "us", "", "\x1b[1m"))
            rows[0][column] = f"{rows[0][column].split('[')[0]}[{unit}]"
        else:
            value = pick(rng, NUMBERS)
            for row in body:
                row[column] = value
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows(rows)
    path.write_bytes(text.getvalue().encode("utf-8", "surrogatepass"))
    return f"{path.name}: {', '.join(said)}"


def _times(cell, factor):
    try:
        return f"{float(cell) * factor:.9g}"
    except ValueError:
        return cell


def damage_toml(path, rng):
    """Damage a TOML file: half of the time values behind equals signs, else its text. Returns what."""
    if rng.integers(2) == 0:
        return damage_text_file(path, rng)
    text = path.read_text(encoding="utf-8")
    said = []
    for _ in range(int(rng.integers(1, 3))):
        matches = list(_TOML_VALUE.finditer(text))
        if not matches:
            break
        at = matches[rng.integers(len(matches))]
        quoted = at[0].startswith('"') == bool(rng.integers(4))
        # JSON's strings are TOML's but for a pair of surrogates.
        new = json.dumps(pick(rng, TEXTS)) if quoted else pick(rng, _TOML_NUMBERS)
        said.append(f"{at[0]} -> {new[:40]}")
        text = text[: at.start()] + new + text[at.end() :]
    path.write_text(text, encoding="utf-8")
    return f"{path.name}: {', '.join(said)}"
