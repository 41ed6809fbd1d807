"""A `fit.json` of version 4, which was laid out by hand, as the types have it."""

from __future__ import annotations

from pathlib import Path

from fitball.inference.results.results import SCHEMA_VERSION, TARGET_ESS
from fitball.report.saved.structure import Content, damaged


def version_4(place: Path, old: Content) -> Content:
    """The same content in the layout of `SCHEMA_VERSION`. Raises ResultFolderError for one that is damaged."""
    try:
        return _moved(old)
    except (LookupError, TypeError, AttributeError, ValueError) as error:
        raise damaged(place, f"not the layout of version 4: {error}") from None


def _moved(old: Content) -> Content:
    new = {name: part for name, part in old.items() if name not in _GONE}
    data, scores, diagnostics = dict(old["data"]), dict(old["scores"]), old["diagnostics"]
    squares = dict(scores.pop("least_squares"))
    squares["missing"] = squares.pop("stderr_missing")
    for section in ("parameters", "derived"):
        new[section] = {
            name: {"name": name, **{key: number for key, number in item.items() if key != "thesis_units"}}
            for name, item in old.get(section, {}).items()
        }
    if diagnostics is not None:
        free = [item for item in new["parameters"].values() if item["verdict"] != "fixed"]
        looks = {look: {item["name"]: item[look] for item in free} for look in ("ess_bulk", "ess_tail", "r_hat")}
        made = diagnostics["ensembles"] * diagnostics["steps"] * diagnostics["walkers"]
        new["diagnostics"] = {**diagnostics, **looks, "evaluations": made, "target_ess": TARGET_ESS}
    rebound = dict(old["golden"]["rebound"])
    count = len(rebound["v_x2"])
    rebound["status"] = [0] * count
    rebound["contact_time"] = rebound["contact_time"] or [None] * count
    model = {"model_name": old["model"]["name"], "options": old["model"]["closures"], "ball": old["ball"]}
    return {
        **new,
        **scores,
        "schema_version": SCHEMA_VERSION,
        "optima": [],
        "optima_log_posterior": [],
        "source": {"columns": {}, "force": None, **data, "digest": data["sha256"], **old["table"]},
        "covariance": old["covariance"] and old["covariance"]["values"],
        "correlation": old["correlation"] and old["correlation"]["values"],
        "least_squares": {**squares, "starts": 0, "optima": [], "optima_chi_square": [], "evaluations": 0},
        "error_budget": {key: part for key, part in old["error_budget"].items() if key != "share"},
        "golden": {**old["golden"], "rebound": rebound},
        "fitted": {**old["fitted"], **model},
    }


# Sections of version 4 that are part of others, or say again what others say.
_GONE = ("table", "data", "model", "ball", "noise", "scores")
