"""What physics engines do with a ball: a row an engine (`engines.toml`), and recipes as code."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Literal

import msgspec

from fitball.base.errors import ParameterError, suggestion

_HERE = Path(__file__).parent


class Engine(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """An engine at the `version` at which it was run, or of which only documents were read.

    `works`: by settings, by settings with fine steps, or by the port alone. `restitution` and
    `friction` say how those of ball and court combine. `seen` are root mean squares of rebounds
    less the model, v_x2 and v_y2 [m/s], omega_2 [rad/s], by steps a second. `recipe`, with
    settings, and `port`, with a port in their place, are files of `recipes`, whose ending is their
    language; empty without one. `install` is the command that installs the version.
    """

    name: str
    version: str
    run: bool
    works: Literal["settings", "fine steps", "port"]
    restitution: str
    friction: str
    threshold: str
    spin_limit: str
    damping: str
    inertia: str
    step: str
    contact: str
    rest: str
    recipe: str
    port: str = ""
    install: str = ""
    seen: Mapping[str, tuple[float, float, float]] = {}


def recipe(file: str, numbers: Mapping[str, str]) -> str:
    """A file of `recipes` as code with these `numbers` as texts by name."""
    text = (_HERE / "recipes" / file).read_text("utf-8")
    return re.sub(r"@([a-z]+)@", lambda match: numbers[match[1]], text)


@cache
def engines() -> Mapping[str, Engine]:
    """All engines by key."""
    tree = tomllib.loads((_HERE / "engines.toml").read_text("utf-8"))
    return msgspec.convert(tree, dict[str, Engine])


def chosen(name: str) -> Mapping[str, Engine]:
    """The engine of a name, in any case, by its key; all engines without a name.

    Raises:
        ParameterError: there is no such engine (`unknown-engine`).
    """
    if not name:
        return engines()
    keys = dict[str, str]()
    for key, engine in engines().items():
        for word in (key, *re.split(r"[ ,()]+", engine.name)):
            keys.setdefault(word.casefold(), key)
    key = keys.get(name.strip().casefold(), "")
    if not key:
        near = suggestion(name.strip().casefold(), engines())
        every = ", ".join(engines())
        raise ParameterError(f"unknown engine '{name}': {near} Engines: {every}", "unknown-engine")
    return {key: engines()[key]}
