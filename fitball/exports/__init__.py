"""Room: parameter sets and ports for other programs."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

from fitball.base.errors import ModelError, ParameterError, suggestion
from fitball.base.text import listed
from fitball.exports import arviz, engine_page, page, parameters
from fitball.exports.parameter_set import ParameterSet, set_of_model, sets_of_fit
from fitball.exports.ports import FILES, port
from fitball.inference.fitted import Fitted
from fitball.models.model import Model


class Format(NamedTuple):
    """A format of exports, and the name of its `file`.

    `make` writes the content from parameter sets, the fit or None, an impact in words or names of
    parameters, and the name of a physics engine. If it `needs_fit`, it is of a whole fit with all
    its surfaces. If it `takes_impact`, it depends on the impact; if it `takes_engine`, on the
    engine; if it `takes_parameters`, on which are chosen. If it is `ported`, it has the bounce as
    source code, or tests it, which not every model allows.
    """

    file: str
    make: Callable[..., str | bytes]
    needs_fit: bool = False
    takes_impact: bool = False
    takes_engine: bool = False
    takes_parameters: bool = False
    ported: bool = False


FORMATS: Mapping[str, Format] = {
    **{
        name: Format(file, lambda sets, *_others, name=name: port(sets, name), ported=True)
        for name, file in FILES.items()
    },
    "page": Format(
        "bounce.html",
        lambda sets, _fit, at, _engine: page.page(sets, at),
        takes_impact=True,
        ported=True,
    ),
    "engine": Format(
        "engine.md",
        lambda sets, _fit, at, name: engine_page.settings_page(sets, at, name),
        takes_impact=True,
        takes_engine=True,
    ),
    "engine-json": Format(
        "engine.json",
        lambda sets, _fit, at, name: engine_page.settings_json(sets, at, name),
        takes_impact=True,
        takes_engine=True,
    ),
    "json": Format("parameters.json", lambda sets, fit, *_others: parameters.as_json(sets, fit)),
    "latex": Format(
        "parameters.tex",
        lambda _sets, fit, chosen, _engine: parameters.as_latex(fit, chosen),
        needs_fit=True,
        takes_parameters=True,
    ),
    "siunitx": Format(
        "parameters.tex",
        lambda _sets, fit, chosen, _engine: parameters.as_latex(fit, chosen, siunitx=True),
        needs_fit=True,
        takes_parameters=True,
    ),
    "markdown": Format(
        "parameters.md",
        lambda _sets, fit, chosen, _engine: parameters.as_markdown(fit, chosen),
        needs_fit=True,
        takes_parameters=True,
    ),
    "arviz": Format("arviz.nc", lambda _sets, fit, *_others: arviz.netcdf(fit), needs_fit=True),
}


def _meant(to: str) -> str:
    """The format that a name which is none could mean: that of files with this ending, as `js`."""
    for name, form in FORMATS.items():
        if form.file.endswith(f".{to.lstrip('.').casefold()}"):
            return f"did you mean '{name}'?"
    return suggestion(to, FORMATS)


def export(
    source: Fitted | Model,
    to: str,
    *,
    level: Mapping[str, str],
    fix: Mapping[str, str | float],
    at: str,
    engine: str = "",
    medians: bool = False,
    chosen: Sequence[str] = (),
) -> Mapping[str, str | bytes]:
    """Contents of files by name, for another program.

    Args:
        source: a fit, at its best fit on each of its surfaces; or a model
        to: a format of FORMATS
        level: labels by column, of the surface and ball of a fit; empty for all
        fix: values of parameters of a model, numbers in SI or `literature:KEY`; other parameters
            have their typical value
        at: an impact in words, for formats that take one
        engine: a physics engine, for formats that take one; all without it
        medians: the medians of a fit in place of its best values
        chosen: names of the parameters of a table; all without it

    Raises:
        ParameterError: the format is unknown (`unknown-format`), or does not take an option
            (`not-for-this-format`). There is no such parameter (`unknown-quantity`). A label
            (`unknown-label`), parameter (`unknown-parameter`) or key (`unknown-key`) is unknown. A
            value is no number (`not-a-number`), is outside its bounds (`out-of-bounds`), is missing
            (`parameters`) or has no answer (`no-answer`). The impact cannot be read (`impact`). The
            engine is unknown (`unknown-engine`).
        ModelError: the model is a Python function (`own-model`), or has no port (`no-port`).
        FitError: a point fit has no draws (`no-draws`).
    """
    if to not in FORMATS:
        raise ParameterError(f"unknown format '{to}': {_meant(to)}", "unknown-format")
    form = FORMATS[to]
    fit = source if isinstance(source, Fitted) else None
    with_impact = [name for name, other in FORMATS.items() if other.takes_impact]
    faults = {
        f"format {to} needs a fit": form.needs_fit and fit is None,
        f"format {to} has all surfaces of a fit: leave out level": form.needs_fit and bool(level),
        "level chooses a surface or ball of a fit: leave it out": fit is None and bool(level),
        "fix sets values of a model: leave it out, or name a model instead of a fit": (
            fit is not None and bool(fix)
        ),
        f"at is an impact for {listed(with_impact, last='and')}, not for {to}": (
            bool(at) and not form.takes_impact
        ),
        f"engine is a physics engine, not for {to}": bool(engine) and not form.takes_engine,
        f"parameters are rows of a table, not for {to}": (
            bool(chosen) and not form.takes_parameters
        ),
        "medians are those of a fit: leave them out": medians and fit is None,
        f"format {to} has the whole fit: leave out medians": medians and form.needs_fit,
    }
    for sentence, holds in faults.items():
        if holds:
            raise ParameterError(sentence, "not-for-this-format")
    if isinstance(source, Model):
        sets: tuple[ParameterSet, ...] = (set_of_model(source, fix),)
    else:
        sets = sets_of_fit(source, level, medians=medians)
    try:
        return {form.file: form.make(sets, fit, chosen if form.takes_parameters else at, engine)}
    except ModelError as error:
        if not form.ported:
            raise
        others = (name for name, other in FORMATS.items() if not other.ported)
        remedy = f"{error}. Its numbers can be exported: {listed(others, last='or', most=20)}"
        raise ModelError(remedy, error.code) from None
