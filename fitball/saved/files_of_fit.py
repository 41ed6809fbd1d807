"""A fit as two files, with one SHA-256 of both; nothing else is checked, nothing repaired.

`fit.json` has the fields of `Fit` as their types have them, the schema; long arrays, the
measurements and the draws stand in `fit.nc`. A file that was changed, or is of another run, does
not agree with the digest.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import MISSING, Field, fields, replace
from hashlib import sha256
from pathlib import Path
from typing import Any, TypeAlias, get_args, get_type_hints

import msgspec
import numpy as np

from fitball.base.errors import FolderError
from fitball.base.files import FIT_FILE, content_of, json_bytes
from fitball.base.text import one_line
from fitball.base.values import FloatArray
from fitball.inference.fitted import Fitted, Run
from fitball.models.model import Model
from fitball.models.specs import INERTIA
from fitball.saved.arrays import packed, unpacked

# What `kind` of the record says: other programs write files called fit.json too.
FIT_KIND = "fitball fit"
# The version of both files that is written and read: another number where an old reader would
# misread them.
FORMAT_VERSION = 1
ARRAYS_FILE = "fit.nc"
# Inertia of a ball over M R^2 where neither scene nor fit state it: that of 3.0.dev0.
OLDER_INERTIA_RATIO = 0.56
# Most numbers of an array that stands in the record itself, where people can read it.
MOST_NUMBERS_IN_RECORD = 500
# Fields that are not in the record: draws stand in the other file, a user's function nowhere.
_ELSEWHERE = ("posterior", "own")
# Any array that a field holds.
_Array: TypeAlias = np.ndarray[Any, Any]


def files(fit: Fitted) -> Mapping[str, Callable[[], bytes]]:
    """What gives the contents of both files of a fit by name, `fit.json`, the record, last."""
    contents: dict[str, bytes] = {}

    def both() -> dict[str, bytes]:
        if not contents:
            contents.update(_contents(fit))
        return contents

    return {ARRAYS_FILE: lambda: both()[ARRAYS_FILE], FIT_FILE: lambda: both()[FIT_FILE]}


def _contents(fit: Fitted) -> dict[str, bytes]:
    """The contents of both files by name."""
    long_arrays: dict[str, _Array] = {}
    record: dict[str, object] = {
        "kind": FIT_KIND,
        "version": FORMAT_VERSION,
        "digest": "",
        "drawn": fit.posterior is not None,
        "names": [] if fit.posterior is None else [*fit.posterior.names],
    }
    for field in fields(fit):
        if field.name not in _ELSEWHERE:
            record[field.name] = _plain(getattr(fit, field.name), field.name, long_arrays)
    arrays = packed(long_arrays, fit.run.table, fit.posterior)
    record["digest"] = _digest(record, arrays)
    return {ARRAYS_FILE: arrays, FIT_FILE: json_bytes(record)}


def _plain(value: object, name: str, long_arrays: dict[str, _Array]) -> object:
    """The value of a field as JSON has it; arrays that are too long are put into `long_arrays`."""

    def plain_of_other(inner: Mapping[str, object] | np.generic | _Array) -> object:
        """What msgspec does not know, as what it knows."""
        if isinstance(inner, Mapping):
            return dict(inner)
        if isinstance(inner, np.generic):
            return inner.item()
        if inner.size > MOST_NUMBERS_IN_RECORD:
            key = f"{name}_{len(long_arrays)}"
            long_arrays[key] = inner
            return {"in": key}
        return inner.tolist()

    return _finite(msgspec.to_builtins(value, enc_hook=plain_of_other))


def _finite(value: object) -> object:
    """What is no finite number as text: nan, inf, -inf. Null is another value, that of what there
    is not.
    """
    if isinstance(value, float) and not np.isfinite(value):
        return str(value)
    if isinstance(value, dict):
        return {key: _finite(inner) for key, inner in value.items()}
    return [_finite(inner) for inner in value] if isinstance(value, list | tuple) else value


def _digest(record: Mapping[str, object], arrays: bytes) -> str:
    """The SHA-256 of the record without its digest and of the bytes of the arrays."""
    text = json.dumps({**record, "digest": ""}, sort_keys=True)
    return sha256(text.encode() + arrays).hexdigest()


def read(folder: Path, user_model: Model | None = None) -> Fitted:
    """The fit in a folder, which its record may name as well. `user_model` is the user's function
    that it was made with, if it was.

    Raises:
        FolderError: there is no fit (`no-fit`), it is of another version (`other-version`), or a
            file was changed (`changed`).
    """
    folder = folder.parent if folder.name == FIT_FILE else folder
    record = _record(folder)
    arrays = _content(folder / ARRAYS_FILE)
    if _digest(record, arrays) != record.get("digest"):
        raise FolderError(
            f"{folder}: fit.json and fit.nc were changed, or are of two runs; run calibrate again",
            "changed",
        )
    long_arrays, posterior = unpacked(arrays, tuple(record["names"]))
    hints = get_type_hints(Fitted)
    # What older fits have not has a default.
    names = [field.name for field in fields(Fitted) if field.name in record or _required(field)]
    # Not strict: numbers may be texts.
    try:
        values = {
            name: msgspec.convert(
                record[name],
                hints[name],
                strict=False,
                dec_hook=_array_reader(long_arrays),
            )
            for name in names
        }
    except (KeyError, msgspec.ValidationError) as error:
        reason = one_line(str(error))
        text = f"not a fit as this version writes it ({reason}); run calibrate again"
        raise FolderError(f"{folder / FIT_FILE}: {text}", "no-fit") from None
    values["run"] = _with_ball_of_its_time(values["run"])
    return Fitted(**values, posterior=posterior, own=user_model)


def _with_ball_of_its_time(run: Run) -> Run:
    """A stored run with its ball as it was: older ones do not say which inertia they took where the
    scene states none.
    """
    ball = run.scene.ball
    stated = ball.inertia is not None or ball.inertia_ratio is not None
    if stated or INERTIA in run.known:
        return run
    older = msgspec.structs.replace(ball, inertia_ratio=OLDER_INERTIA_RATIO)
    return replace(run, scene=msgspec.structs.replace(run.scene, ball=older))


def _required(field: Field[object]) -> bool:
    """Whether a record must have a field of a fit."""
    has_default = field.default is not MISSING or field.default_factory is not MISSING
    return field.name not in _ELSEWHERE and not has_default


def _array_reader(long_arrays: Mapping[str, FloatArray]) -> Callable[[type, object], _Array]:
    """What makes an array of the numbers in a record, or finds it among the long ones; it cannot be
    written to.
    """

    def array_of(kind: type, value: object) -> _Array:
        # NDArray[float64] is ndarray[shape, dtype[float64]].
        number = get_args(get_args(kind)[1])[0]
        array = long_arrays[value["in"]] if isinstance(value, dict) else np.array(value, number)
        array.setflags(write=False)
        return array

    return array_of


def key_of(folder: Path) -> str:
    """`Run.key` of the fit in a folder, all that a batch reads of what is finished; "" if there is
    none or it is damaged, and no key, `other-version`, of one that is not to be replaced.
    """
    try:
        return str(_record(folder)["run"]["key"])
    except FolderError as error:
        return error.code if error.code == "other-version" else ""


def _record(folder: Path) -> dict[str, Any]:
    """The content of `fit.json`. Raises FolderError (`no-fit`, `other-version`)."""
    file = folder / FIT_FILE
    try:
        record = json.loads(_content(file))
    except (ValueError, RecursionError):
        raise FolderError(f"{file}: not a fit, or damaged; run calibrate again", "no-fit") from None
    if not isinstance(record, dict) or record.get("kind") != FIT_KIND:
        raise FolderError(f"{file}: not a fit of fitball; run calibrate", "no-fit")
    if record.get("version") != FORMAT_VERSION:
        # The second edition called it otherwise.
        version = "a fit of the second edition or older"
        if "version" in record:
            version = f"version {record['version']}"
        text = f"{version}, which is not read, expected version {FORMAT_VERSION}"
        raise FolderError(f"{file}: {text}; run calibrate on its table", "other-version")
    return record


def _content(file: Path) -> bytes:
    """The bytes of a file. Raises FolderError (`no-fit`)."""
    try:
        return content_of(file)
    except OSError as error:
        below = file.parent.glob(f"*/{FIT_FILE}") if isinstance(error, FileNotFoundError) else ()
        first = next(iter(sorted(below)), None)
        hint = f": did you mean {first.parent}?" if first else ""
        raise FolderError(
            f"{file}: {error.strerror}; expected the folder of a fit{hint}",
            "no-fit",
        ) from None
