"""The looks at every parameter as plain content for `fit.json`, and back."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

import numpy as np

from fitball.inference.looks import (
    ActionLook,
    ContractionLook,
    Direction,
    End,
    Examination,
    InformationLook,
    Looks,
    PowerLook,
    Profile,
    Spectrum,
)


def looks_content(examination: Examination) -> dict[str, Any]:
    """Every look with its fields by name; arrays and tuples become lists."""
    found: dict[str, Any] = _plain(asdict(examination))
    return found


def _plain(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, np.ndarray):
        return value.tolist()
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    return str(value) if isinstance(value, End) else value


def read_examination(content: Mapping[str, Any]) -> Examination:
    """The examination from its content. Raises KeyError, TypeError or ValueError for content that is none."""
    spectrum = content["spectrum"]
    return Examination(
        looks={name: _looks(item) for name, item in content["looks"].items()},
        spectrum=Spectrum(
            directions=tuple(Direction(**item) for item in spectrum["directions"]),
            directions_without_scene=tuple(Direction(**item) for item in spectrum["directions_without_scene"]),
            sentences=tuple(spectrum["sentences"]),
        ),
        profiles_missing=content["profiles_missing"],
        profile_coverage=content["profile_coverage"],
    )


def _looks(item: Mapping[str, Any]) -> Looks:
    information, contraction, power, action = (item[key] for key in ("information", "contraction", "power", "action"))
    return Looks(
        profile=_profile(item["profile"]),
        alone=_profile(item["alone"]),
        information=None if information is None else InformationLook(**information),
        contraction=None
        if contraction is None
        else ContractionLook(contraction["contraction"], _pair(contraction["open_sides"])),
        power=None if power is None else PowerLook(**power),
        action=None if action is None else _action(action),
        disagreement=item["disagreement"],
    )


def _action(item: Mapping[str, Any]) -> ActionLook:
    return ActionLook(
        impacts=tuple(item["impacts"]),
        acting=item["acting"],
        of=item["of"],
        regimes=tuple(item["regimes"]),
        doubtful=tuple(item["doubtful"]),
        in_doubt=item["in_doubt"],
        share_doubtful=item["share_doubtful"],
    )


def _pair(item: Any) -> Any:
    left, right = item
    return left, right


def _profile(item: Mapping[str, Any] | None) -> Profile | None:
    if item is None:
        return None
    left, right = item["ends"]
    return Profile(
        name=item["name"],
        values=np.array(item["values"], dtype=np.float64),
        drop=np.array(item["drop"], dtype=np.float64),
        best=item["best"],
        interval_68=_pair(item["interval_68"]),
        interval_95=_pair(item["interval_95"]),
        ends=(End(left), End(right)),
        leans_on=(tuple(item["leans_on"][0]), tuple(item["leans_on"][1])),
        unsettled=item["unsettled"],
    )
