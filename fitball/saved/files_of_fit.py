"""The pair, with one SHA-256 of both; nothing else is checked, nothing repaired.

`fit.json` has the fields of `Fit` as their types have them, the schema; long arrays, the
measurements and the draws stand in `fit.nc`. A file that was changed, or is of another run, does
not agree with the digest.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import fields
from hashlib import sha256
from pathlib import Path
from typing import Any, get_args, get_type_hints

import msgspec
import numpy as np

from fitball.base.errors import FolderError
from fitball.base.files import json_bytes
from fitball.base.text import one_line
from fitball.inference.fitted import Fitted
from fitball.models.model import Model
from fitball.saved.arrays import packed, unpacked

KIND = "fitball fit"
VERSION = 1
RECORD = "fit.json"
ARRAYS = "fit.nc"
# Numbers of an array that stands in the record itself.
SHORT = 500
# Fields that are not in the record: draws stand in the other file, a function of one's own nowhere.
_ELSEWHERE = ("posterior", "own")


def files(fit: Fitted) -> Mapping[str, Callable[[], bytes]]:
    """fit.nc, then fit.json, the record."""
    made: dict[str, bytes] = {}

    def both() -> dict[str, bytes]:
        if not made:
            arrays: dict[str, np.ndarray[Any, Any]] = {}
            content = {
                "kind": KIND,
                "version": VERSION,
                "digest": "",
                "drawn": fit.posterior is not None,
            }
            content["names"] = [] if fit.posterior is None else list(fit.posterior.names)
            for field in fields(fit):
                if field.name not in _ELSEWHERE:
                    content[field.name] = _plain(getattr(fit, field.name), field.name, arrays)
            made[ARRAYS] = packed(arrays, fit.run.table, fit.posterior)
            content["digest"] = _digest(content, made[ARRAYS])
            made[RECORD] = json_bytes(content)
        return made

    return {ARRAYS: lambda: both()[ARRAYS], RECORD: lambda: both()[RECORD]}


def _plain(value: Any, name: str, arrays: dict[str, np.ndarray[Any, Any]]) -> Any:
    """A value as JSON has it; long arrays are put into `arrays`."""

    def hook(inner: Any) -> Any:
        if isinstance(inner, Mapping):
            return dict(inner)
        if isinstance(inner, np.generic):
            return inner.item()
        if inner.size > SHORT:
            key = f"{name}_{len(arrays)}"
            arrays[key] = inner
            return {"in": key}
        return inner.tolist()

    return _finite(msgspec.to_builtins(value, enc_hook=hook))


def _finite(value: Any) -> Any:
    """What is no finite number as text: nan, inf, -inf. Null is another value, that of what there
    is not.
    """
    if isinstance(value, float) and not np.isfinite(value):
        return str(value)
    if isinstance(value, dict):
        return {key: _finite(inner) for key, inner in value.items()}
    return [_finite(inner) for inner in value] if isinstance(value, list | tuple) else value


def _digest(content: Mapping[str, Any], arrays: bytes) -> str:
    whole = json.dumps({**content, "digest": ""}, sort_keys=True).encode()
    return sha256(whole + arrays).hexdigest()


def read(place: Path, own: Model | None = None) -> Fitted:
    """The fit in a folder, all of it. Raises FolderError (`no-fit`, `other-version`, `changed`)
    with the remedy.
    """
    place = place.parent if place.name == RECORD else place
    content = _record(place)
    arrays = _bytes(place / ARRAYS)
    if _digest(content, arrays) != content.get("digest"):
        raise FolderError(
            f"{place}: fit.json and fit.nc were changed, or are of two runs; run calibrate again",
            "changed",
        )
    long, posterior = unpacked(arrays, tuple(content["names"]))

    def array(kind: Any, value: Any) -> Any:
        dtype = get_args(get_args(kind)[1])[0]
        found = long[value["in"]] if isinstance(value, dict) else np.array(value, dtype)
        found.setflags(write=False)
        return found

    hints = get_type_hints(Fitted)
    kept = {
        field.name: hints[field.name] for field in fields(Fitted) if field.name not in _ELSEWHERE
    }
    # Not strict: numbers may be texts.
    try:
        made = {
            name: msgspec.convert(content[name], hint, strict=False, dec_hook=array)
            for name, hint in kept.items()
        }
    except (KeyError, msgspec.ValidationError) as error:
        words = f"not a fit as this version writes it ({one_line(str(error))}); run calibrate again"
        raise FolderError(f"{place / RECORD}: {words}", "no-fit") from None
    return Fitted(**made, posterior=posterior, own=own)


def key_of(place: Path) -> str:
    """`Run.key` of the fit in a folder, all that a batch reads of what is finished; "" if there is
    none or it is damaged, and no key, `other-version`, of what is to be kept.
    """
    try:
        return str(_record(place)["run"]["key"])
    except FolderError as error:
        return error.code if error.code == "other-version" else ""


def _record(place: Path) -> dict[str, Any]:
    """The content of `fit.json`. Raises FolderError (`no-fit`, `other-version`)."""
    try:
        content = json.loads(_bytes(place / RECORD))
    except (ValueError, RecursionError):
        raise FolderError(
            f"{place / RECORD}: not a fit, or damaged; run calibrate again",
            "no-fit",
        ) from None
    if not isinstance(content, dict) or content.get("kind") != KIND:
        raise FolderError(f"{place / RECORD}: not a fit of fitball; run calibrate", "no-fit")
    if content.get("version") != VERSION:
        # The second edition called it otherwise.
        made = (
            f"version {content['version']}"
            if "version" in content
            else "a fit of the second edition or older"
        )
        text = (
            f"{place / RECORD}: {made}, which is not read, expected version {VERSION}; run "
            "calibrate on its table"
        )
        raise FolderError(text, "other-version")
    return content


def _bytes(place: Path) -> bytes:
    """A file whole. Raises FolderError (`no-fit`)."""
    try:
        return place.read_bytes()
    except OSError as error:
        within = place.parent.glob(f"*/{RECORD}") if isinstance(error, FileNotFoundError) else ()
        inside = next(iter(sorted(within)), None)
        near = f": did you mean {inside.parent}?" if inside else ""
        raise FolderError(
            f"{place}: {error.strerror}; expected the folder of a fit{near}",
            "no-fit",
        ) from None
