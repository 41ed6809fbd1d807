"""Files of a result folder held against the structure they must have, once, at reading, into frozen values."""

from __future__ import annotations

import json
import re
import reprlib
import tomllib
from collections.abc import Callable, Iterator, Mapping
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any, TypeVar, get_args

import msgspec
import numpy as np

from fitball.errors import FitballError, ResultFolderError
from fitball.report.form.files import read_bounded
from fitball.wording import spoken

Kept = TypeVar("Kept")
Section = TypeVar("Section", bound=msgspec.Struct)
Content = dict[str, Any]
FIT_NAME = "fit.json"
REMEDY = "put back the file that fitball wrote, or run calibrate again"
# Characters of a message that quotes a file.
LONGEST_MESSAGE = 500
_STEP = re.compile(r"\.(?P<field>[^.\[\]]+)|\[(?P<index>\d+)\]|\[(?P<any>\.\.\.)\]")

_QUOTED = re.compile("`([^`]*)`")
_WORDS = {
    "float": "a number", "int": "a whole number", "str": "a text", "bool": "true or false", "object": "a section",
    "array": "a list",
}  # fmt: skip


def _kinds(match: re.Match[str]) -> str:
    return " or ".join(_WORDS.get(name, name) for name in match[1].split(" | "))


class OlderFileError(ResultFolderError):
    """A file that an older fitball wrote."""


class Part(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A section of a file: fields that are required unless they have a default, and no others."""


def place_of(path: Path, name: str) -> Path:
    """The file called `name` that a user names by itself or by its folder. Raises ResultFolderError."""
    try:
        return path / name if path.is_dir() else path
    except OSError as error:
        raise ResultFolderError(f"{str(path)[:200]}: cannot be opened: {error.strerror}") from None


def read_json(place: Path) -> Content:
    """The object in a JSON file, where no key comes twice and every number is finite. Raises ResultFolderError."""

    def read(data: bytes) -> Any:
        content = msgspec.json.decode(data)
        json.loads(data, object_pairs_hook=_each_key_once)
        return content

    content = _read(place, "JSON", read)
    return content if isinstance(content, dict) else {}


def read_toml(place: Path) -> Content:
    """The content of a TOML file in which every number is finite. Raises ResultFolderError."""
    made: Content = _read(place, "TOML", lambda data: tomllib.loads(data.decode("utf-8"), parse_float=_finite))
    return made


def _read(place: Path, language: str, read: Callable[[bytes], Any]) -> Any:
    try:
        data = read_bounded(place)
    except FileNotFoundError:
        below = sorted(str(found.parent) for found in place.parent.glob(f"*/{place.name}"))
        meant = f"; did you mean {' or '.join(below[:5])}?" if below else ""
        message = f"{place}: no such file or folder; expected a result of fitball calibrate{meant}"
        raise ResultFolderError(message) from None
    except (OSError, ValueError) as error:
        raise ResultFolderError(f"{place}: cannot be opened: {getattr(error, 'strerror', None) or error}") from None
    try:
        return read(data)
    except (ValueError, RecursionError) as error:
        words = "too many nested brackets" if isinstance(error, RecursionError) else error
        raise ResultFolderError(f"{place}: not readable as {language}: {words}; {REMEDY}") from None


def refuse_foreign(place: Path, content: Content, kind: str, version: int) -> None:
    """Raise ResultFolderError for a file of another `kind`, or of an older or newer schema than `version`."""
    if content.get("kind") != kind:
        read = reprlib.repr(content.get("kind"))
        raise ResultFolderError(f"{place}: read kind {read}, expected '{kind}'; {REMEDY}")
    version_read = content.get("schema_version")
    if isinstance(version_read, bool) or version_read != version:
        older = isinstance(version_read, int) and version_read < version
        read = f"{place}: schema_version {reprlib.repr(version_read)}; this fitball reads version {version}: "
        if older:
            verb = spoken("`fitball repeat FOLDER --out NEW`", "the verb repeat of the command line")
            again = f", or use {verb} to repeat the run of the run.toml beside it" * (place.name == FIT_NAME)
            raise OlderFileError(f"{read}run calibrate again{again}")
        raise ResultFolderError(f"{read}install the version of fitball that wrote it")


def structured(place: Path, content: Content, kind: type[Kept]) -> Kept:
    """`content` as the frozen structure `kind`.

    Raises ResultFolderError that says which field is wrong, what was read and what was expected.
    """
    try:
        made = msgspec.convert(content, kind, dec_hook=_array)
    except msgspec.ValidationError as error:
        words = _QUOTED.sub(_kinds, str(error).partition(" - at ")[0])
        wrong, where = _located(content, kind, str(error))
        shown = "" if wrong is content else f"read {reprlib.repr(wrong)}, "
        raise damaged(place, f"{where}: {shown}{words[:1].lower()}{words[1:]}" if where else words) from None
    except FitballError as error:
        raise damaged(place, str(error)) from None
    wrong = next(_other_fields(content, made, ""), None)
    if wrong is not None:
        raise damaged(place, wrong)
    return made


def _other_fields(content: object, made: object, at: str) -> Iterator[str]:
    """Fields that the content has beside those of what was made of it, or lacks: with those of a dataclass msgspec is
    less strict.
    """
    if isinstance(content, dict):
        if is_dataclass(made):
            known = [item.name for item in fields(made)]
            yield from (f"unknown field {at}{name}"[:200] for name in content if name not in known)
            yield from (f"no field {at}{name}" for name in known if name not in content)
        for name, inner in content.items():
            item = made[name] if isinstance(made, Mapping) else getattr(made, name)
            yield from _other_fields(inner, item, f"{at}{name}.")
    elif isinstance(content, list) and isinstance(made, tuple) and content and isinstance(content[0], dict):
        for k, (inner, item) in enumerate(zip(content, made, strict=True)):
            yield from _other_fields(inner, item, f"{at}{k}.")


def part(kind: type[Section], source: object, **others: Any) -> Section:
    """The section `kind` with what `source` has under the names of its fields, but for the `others`."""
    names = [name for name in kind.__struct_fields__ if name not in others]
    return kind(**{name: getattr(source, name) for name in names}, **others)


def plain(value: object) -> Any:
    """`value` as what JSON and TOML know: sections by name, lists, texts, numbers."""
    return msgspec.to_builtins(value, enc_hook=_unpacked)


def _unpacked(value: Any) -> Any:
    """What msgspec does not know: read-only mappings, and arrays and numbers of NumPy; null stands for NaN."""
    if isinstance(value, Mapping):
        return dict(value)
    if isinstance(value, np.ndarray) and value.dtype.kind == "f" and np.isnan(value).any():
        return np.where(np.isnan(value), np.array(None), value).tolist()
    return value.tolist()


def damaged(place: Path, what: str) -> ResultFolderError:
    """The error of a file that is not what fitball wrote: `what` says which part is not, and why."""
    return ResultFolderError(
        f"{place}: damaged: {what if len(what) < LONGEST_MESSAGE else what[:LONGEST_MESSAGE] + '...'}; {REMEDY}"
    )


def _each_key_once(pairs: list[tuple[str, Any]]) -> Content:
    content = dict(pairs)
    if len(content) < len(pairs):
        names = [name for name, _ in pairs]
        raise ValueError(f"key {reprlib.repr(next(name for name in names if names.count(name) > 1))} comes twice")
    return content


def _finite(text: str) -> float:
    value = float(text)
    if not np.isfinite(value):
        raise ValueError(f"read {text}, expected a finite number")
    return value


def _array(kind: type, value: object) -> np.ndarray:
    """Numbers in lists, or in lists of lists, of which msgspec knows no arrays."""
    dtype = get_args(get_args(kind)[1])[0]
    number: Any = int if np.issubdtype(dtype, np.integer) else float | None
    lists = isinstance(value, list) and value and isinstance(value[0], list)
    try:
        column = np.array(
            msgspec.convert(value, tuple[tuple[number, ...], ...] if lists else tuple[number, ...]), dtype
        )
    except msgspec.ValidationError as error:
        # With a plain ValueError msgspec adds where the column is.
        raise ValueError(str(error).partition(" - at ")[0]) from None
    except (ValueError, OverflowError) as error:
        raise ValueError(f"Expected an array of numbers: {error}") from None
    column.setflags(write=False)
    return column


def _located(content: Content, kind: type[Any], error: str) -> tuple[object, str]:
    """The value at the path that ends an `error`, and the path with its keys: msgspec writes [...] for any key."""
    value, path = content, ""
    for match in _STEP.finditer(error.rpartition("`$")[2].removesuffix("`")):
        step: Any = match["field"] or int(match["index"] or 0)
        if match["any"]:
            step = next((key for key in list(value) if _says(content, kind, value, key, error)), "?")
        path += f"[{step}]" if match["index"] else f".{step}"
        try:
            value = value[step]
        except (LookupError, TypeError):
            value = content
            break
    return value, path.removeprefix(".")[:200]


def _says(content: Content, kind: type[Any], inner: Content, key: str, error: str) -> bool:
    """Whether the content still gives that error with one key alone in a mapping in it."""
    kept = dict(inner)
    inner.clear()
    inner[key] = kept[key]
    try:
        msgspec.convert(content, kind, dec_hook=_array)
    except msgspec.ValidationError as found:
        return str(found) == error
    except FitballError:
        return False
    finally:
        inner.clear()
        inner.update(kept)
    return False
