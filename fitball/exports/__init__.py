"""Room: parameter sets and ports for other programs."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

from fitball.base.errors import ModelError, ParameterError, suggestion
from fitball.base.text import listed
from fitball.exports import arviz, engine, page, parameters
from fitball.exports.parameter_set import set_of_model, sets_of_fit
from fitball.exports.ports import FILES, port
from fitball.inference.fitted import Fitted
from fitball.models.model import Model


class Format(NamedTuple):
    """The `file` of a format; who makes it of sets, the fit or None and an impact in words;
    `measured`: of a whole fit, no less; `at`: takes an impact; `ported`: holds or tests the bounce
    as source code, which not every model has.
    """

    file: str
    make: Callable[..., str | bytes]
    measured: bool = False
    at: bool = False
    ported: bool = False


FORMATS: Mapping[str, Format] = {
    **{
        name: Format(file, lambda sets, _fit, _at, name=name: port(sets, name), ported=True)
        for name, file in FILES.items()
    },
    "page": Format(
        "bounce.html",
        lambda sets, _fit, at: page.page(sets, at),
        at=True,
        ported=True,
    ),
    "engine": Format("engine.md", lambda sets, _fit, at: engine.settings_page(sets, at), at=True),
    "engine-json": Format(
        "engine.json", lambda sets, _fit, at: engine.settings_json(sets, at), at=True
    ),
    "json": Format("parameters.json", lambda sets, fit, _at: parameters.as_json(sets, fit)),
    "latex": Format(
        "parameters.tex",
        lambda _sets, fit, _at: parameters.as_latex(fit),
        measured=True,
    ),
    "markdown": Format(
        "parameters.md",
        lambda _sets, fit, _at: parameters.as_markdown(fit),
        measured=True,
    ),
    "arviz": Format("arviz.nc", lambda _sets, fit, _at: arviz.netcdf(fit), measured=True),
}


def export(
    source: Fitted | Model,
    to: str,
    *,
    level: Mapping[str, str],
    fix: Mapping[str, Any],
    at: str,
) -> Mapping[str, str | bytes]:
    """Files by name: a fit at its point on each of its surfaces, or those of `level`; or a model at
    numbers or `literature:KEY`, other parameters at their typical value. Raises ParameterError
    (`unknown-format`, `unknown-label`, `not-for-this-format`), ModelError (`own-model`, `no-port`).
    """
    if to not in FORMATS:
        raise ParameterError(f"unknown format '{to}': {suggestion(to, FORMATS)}", "unknown-format")
    form = FORMATS[to]
    fit = source if isinstance(source, Fitted) else None
    faults = {
        f"format {to} needs a fit": form.measured and fit is None,
        f"format {to} has all surfaces of a fit: leave out level": form.measured and bool(level),
        "level chooses a surface or ball of a fit: leave it out": fit is None and bool(level),
        "fix sets values of a model: leave it out, or name a model instead of a fit": fit
        is not None
        and bool(fix),
        f"at is an impact for {listed((n for n, f in FORMATS.items() if f.at), last='and')}, not "
        f"for {to}": (bool(at) and not form.at),
    }
    for fault, found in faults.items():
        if found:
            raise ParameterError(fault, "not-for-this-format")
    sets = (set_of_model(source, fix),) if isinstance(source, Model) else sets_of_fit(source, level)
    try:
        return {form.file: form.make(sets, fit, at)}
    except ModelError as error:
        if not form.ported:
            raise
        others = (name for name, other in FORMATS.items() if not other.ported)
        remedy = f"{error}. Its numbers can be exported: {listed(others, last='or', most=20)}"
        raise ModelError(remedy, error.code) from None
