"""The verbs of a fit: one function each, for Python and the command line. `fit` is a Fit or its
folder.

A signature is the list of options, a docstring the help, as in `fitball.verbs`.
"""

from __future__ import annotations

from pathlib import Path

from fitball.base.options import File, Names, Pairs, names_of, read_pairs, read_texts
from fitball.verb_types import Drawn, Exported, Fit, Frames, Model, TableSource


def predict(
    fit: Fit | File,
    data: TableSource | None = None,
    *,
    impact: str = "",
    level: Pairs = None,
    model: Model | str = "",
) -> Frames:
    """Predict rebounds of new impacts, from a table or in words, and compare them with what was
    measured.

    A table is read with the names, units and signs of the fit's own; stated errors of incident
    states count. Where it has rebounds, they are compared with the predictions.

    Args:
        fit (FIT): the folder of a fit
        data (DATA): a table of impacts (CSV, workbook, Parquet, frame), with or without rebounds
        impact (IMPACT): impacts in words instead, a number, its error, or a range with a number of
            points
        level (COLUMN=LABEL): the surface or ball of all impacts, new: one of which nothing was
            measured
        model (NAME): the function of one's own that the fit was made with, FILE.py:NAME

    Raises:
        ParameterError: neither a table nor impacts in words, or both (`no-impacts`); words that
            cannot be read (`impact`); a level that is unknown, missing or named twice
            (`unknown-level`, `unknown-label`, `label-missing`, `level-twice`, `pairs`).
        InputError: the table has faults (the code is that of the first).
        FolderError: there is no fit that can be read (`no-fit`, `other-version`, `changed`).
        ModelError: another function than the one of the fit (`own-model`).

    Example:
        >>> import fitball
        >>> fit = fitball.calibrate("wang_zero_spin", model="brody", point_only=True)
        >>> predicted = fitball.predict(fit, impact="v_1=17, theta_1=20 deg")
        >>> frame = predicted.frames["predictions"].set_index("column")
        >>> round(float(frame["point"]["v_x2"]), 1)
        10.4

    Command line:
        fitball predict fits/wang_all/default new_impacts.csv
        fitball predict fits/wang_all/default --impact "v_1=17, theta_1=10..60:6, omega_1=100±5"
        fitball predict fits/courts/default new_impacts.csv --level surface=new
    """
    return _fit(fit, model).predict(data, impact=impact, level=level)


def plan(
    fit: Fit | File,
    *,
    target: Names = (),
    speed: str = "",
    angle: str = "",
    spin: str = "",
    level: Pairs = None,
    count: int = 5,
    sensor: Pairs = None,
    model: Model | str = "",
) -> Frames:
    """Choose the impacts, and the way of measuring them, that would say most about a target.

    The gain is the expected information in nats: one nat reduces the sd of one quantity to 37 %.
    The result has a table to fill in, `to_fill_in.csv`, which calibrate reads.

    Args:
        fit (FIT): a fit or its folder
        target (A,B,...): parameters, derived quantities, or impact="v_1=30, theta_1=16 deg" for its
            rebound (default: all free parameters of the model)
        speed (LOW..HIGH:N): of the machine, such as "10..40 m/s:7" (default: round numbers in the
            range and unit of the table; so are the others)
        angle (LOW..HIGH:N): between flight and court, such as 15..60:10 (degrees)
        spin (LOW..HIGH:N): such as "-3000..3000 rpm:5"
        level (COLUMN=LABEL): on this surface, or with this ball, alone
        count (N): impacts
        sensor (COLUMN=SD,... or none): ways of measuring, tried one at a time: contact_time=0.1ms;
            gaps=SHARE of the usual errors of what is between the flights; drop=HEIGHT; none: as
            before alone (default: what the table has not)
        model (FILE.py:NAME): the function of your own that the fit was made with

    Raises:
        ParameterError: a target is unknown or fixed (`unknown-quantity`, `fixed`, `nothing-free`).
            A range or number cannot be read (`impact`), or is of what was not measured
            (`not-measured`). A level is none of the fit (`unknown-level`, `unknown-label`,
            `no-such-levels`, `pairs`), or a sensor none of the model (`sensor`). The number of
            impacts or settings is impossible (`count`, `too-many-settings`). The fit has no
            posterior (`point-fit`), or the model no answer (`no-answer`).
        FolderError: there is no fit that can be read (`no-fit`, `other-version`, `changed`).
        ModelError: another function than the one of the fit (`own-model`).

    Example:
        >>> import fitball
        >>> fit = fitball.calibrate("wang_zero_spin", model="brody")
        >>> planned = fitball.plan(fit, target="mu", count=2)
        >>> len(planned.frames["plan"])
        2

    Command line:
        fitball plan fits/wang_all/default --target k_y --sensor contact_time=0.1ms
        fitball plan fits/wang_all/default --target mu --speed "10..40 m/s:7" --count 8
    """
    return _fit(fit, model).plan(
        target=target,
        speed=speed,
        angle=angle,
        spin=spin,
        level=level,
        count=count,
        sensor=sensor,
    )


def plot(
    fit: Fit | File,
    figures: Names = (),
    *,
    format: str = "png",
    width: str = "",
    parameters: Names = (),
    columns: Names = (),
    groups: Names = (),
    model: Model | str = "",
) -> Drawn:
    """Draw figures of a fit into its folder; without names all.

    Args:
        fit (FIT): the folder of a fit
        figures (FIGURE ...): curves, corner, profiles, forest, predictive, regimes, regime_map,
            residuals, trace
        format (FORMAT): png, svg or pdf
        width (WIDTH): of a column of your journal: 88mm, 8.8cm or 3.5in (default: 6in)
        parameters (A,B,...): of corner, profiles, forest and trace, derived quantities too
        columns (A,B,...): measured columns of curves, predictive and residuals
        groups (LABEL,...): surfaces or balls of curves, all at the same speed and spin
        model (FILE.py:NAME): the function of your own that the fit was made with

    Raises:
        ParameterError: no such format (`format`), width (`width`) or figure (`unknown-figure`), or
            the fit has no data for it (`no-such-data`). A figure does not show what was chosen
            (`not-for-this-figure`), or there is no such parameter or column (`unknown-quantity`) or
            group (`unknown-label`).
        FolderError: there is no fit that can be read (`no-fit`, `other-version`, `changed`).
        ModelError: another function than the one of the fit (`own-model`).

    Example:
        >>> import fitball
        >>> fit = fitball.calibrate("wang_zero_spin", model="brody", point_only=True)
        >>> drawn = fitball.plot(fit, "curves", format="svg")
        >>> drawn
        <Drawn: curves, as svg>

    Command line:
        fitball plot fits/wang_all/default
        fitball plot fits/wang_all/default curves corner --format pdf
        fitball plot fits/wang_all/default corner --parameters mu,cor_10 --width 88mm
    """
    from fitball.report.figures.chosen import Chosen
    from fitball.report.plotted import choose_figures, width_of
    from fitball.results.drawn import Drawn

    chosen = Chosen(*(tuple(names_of(names)) for names in (parameters, columns, groups)))
    wide = width_of(width)
    return Drawn(choose_figures(_fit(fit, model), names_of(figures), format, chosen, wide))


def simulate(
    fit: Fit | File = "",
    *,
    impact: str,
    level: Pairs = None,
    model: Model | str = "",
    fix: Pairs = None,
) -> Frames:
    """Follow one impact through time, of a fit or of a model at set values.

    Args:
        fit (FIT): a fit or its folder: at its best values, with the band of its posterior
        impact (WORDS): such as "v_1=25, theta_1=20 deg, omega_1=-1500 rpm"
        level (COLUMN=LABEL): on this surface, or with this ball, where the fit has several
        model (NAME): without a fit, two-mass or thesis-exact, with +NAME=OPTION (default: two-mass)
        fix (NAME=VALUE): without a fit, values in SI or literature:KEY, others at their typical
            value

    Raises:
        ParameterError: values for a fit, or levels without one (`fit-and-values`). The impact
            cannot be read (`impact`), or has what was not measured (`not-measured`). A level is
            unknown or missing (`unknown-level`, `unknown-label`, `label-missing`, `pairs`). A value
            is of an unknown parameter, no number or out of bounds (`unknown-parameter`,
            `unknown-key`, `not-a-number`, `out-of-bounds`). The model has no answer (`no-answer`).
        FolderError: there is no fit that can be read (`no-fit`, `other-version`, `changed`).
        ModelError: the model is unknown (`unknown-model`, `unknown-option`), or has no time axis
            (`no-history`).

    Example:
        >>> import fitball
        >>> simulated = fitball.simulate(impact="v_1=25, theta_1=20 deg", fix={"mu": "0.5"})
        >>> simulated.frames["phases"]["phase"].tolist()
        ['slide']

    Command line:
        fitball simulate fits/wang_all/default --impact "v_1=25, theta_1=20 deg"
        fitball simulate --model thesis-exact --fix mu=0.5 --impact "v_1=25, theta_1=20 deg"
    """
    from fitball.base.errors import ParameterError
    from fitball.exports.parameter_set import set_of_model
    from fitball.models.registry import model as model_of
    from fitball.report import simulate as page
    from fitball.results.result import Frames
    from fitball.uses.simulate import impact_in_words, simulate_point

    if fit and not fix:
        return _fit(fit, model).simulate(impact=impact, level=level)
    if fit or level:
        text = "a fit has values of its own, and a model at set values has no levels"
        raise ParameterError(
            f"simulate: {text}; name a fit with level, or model and fix",
            "fit-and-values",
        )
    chosen = model_or_none(model) or model_of("two-mass")
    point = set_of_model(chosen, read_pairs("fix", fix)).values
    findings = simulate_point(chosen, point, {}, impact_in_words(impact))
    return Frames(findings, page.PAGE)


def export(
    fit: Fit | File = "",
    *,
    to: str,
    level: Pairs = None,
    model: Model | str = "",
    fix: Pairs = None,
    at: str = "",
    engine: str = "",
    medians: bool = False,
    parameters: Names = (),
) -> Exported:
    """Write parameters, or the bounce itself as source code, for another program.

    Of a fit, at its best values, each surface and ball has its own; or of a model at values that
    you set. Without --out the text is printed.

    Args:
        fit (FIT): result folder of fitball calibrate; without it --model
        to (FORMAT): c, csharp, javascript, esm, types (of esm), python, gdscript (code with a
            self-test), golden (impacts and rebounds of that test), page (HTML with sliders),
            engine, engine-json (settings and recipes for physics engines), json, latex, siunitx,
            markdown (parameters), arviz (draws)
        level (COLUMN=LABEL): one surface or ball of the fit; surface=new: one that was not measured
        model (NAME): a model without a fit, or the function of your own that the fit was made with
        fix (NAME=VALUE): value of a parameter of --model in SI, or a published one,
            mu=literature:clay
        at (COLUMN=VALUE,...): impact of engine, and where page begins: "v_1=17, theta_1=30 deg,
            omega_1=0"
        engine (NAME): the recipe of this physics engine alone
        medians: medians of the fit in place of its best values
        parameters (A,B,...): rows of latex, siunitx and markdown (default: all)

    Raises:
        ParameterError: neither a fit nor a model (`fit-or-model`). The format is unknown
            (`unknown-format`), or does not take an option (`not-for-this-format`). A label,
            parameter or key is unknown (`unknown-label`, `unknown-parameter`, `unknown-key`). A
            value is no number or out of bounds (`not-a-number`, `out-of-bounds`), or has no answer
            (`no-answer`). The impact cannot be read (`impact`). The engine is unknown
            (`unknown-engine`). An option is no mapping (`pairs`). There is no such row
            (`unknown-quantity`).
        ModelError: the model has no source code to export (`no-port`), is a function (`own-model`),
            or is unknown (`unknown-model`, `unknown-option`).
        FolderError: there is no fit that can be read (`no-fit`, `other-version`, `changed`).
        FitError: a point fit has no draws to export (`no-draws`).

    Example:
        >>> import fitball
        >>> fitball.export(model="two-mass", to="c")
        <Exported: bounce.h>

    Command line:
        fitball export fits/wang_all/default --to c > bounce.h
        fitball export fits/wang_all/default --to json --out exports
        fitball export --model two-mass --fix mu=literature:clay --to page > clay.html
    """
    from fitball.base.errors import ParameterError
    from fitball.exports import export as exported
    from fitball.results.exported import Exported

    source = _fit(fit, model) if fit else model_or_none(model)
    if source is None:
        raise ParameterError("expected the folder of a fit, or --model (model=)", "fit-or-model")
    levels = read_texts("level", level)
    values = read_pairs("fix", fix)
    contents = exported(
        source,
        to,
        level=levels,
        fix=values,
        at=at,
        engine=engine,
        medians=medians,
        chosen=names_of(parameters),
    )
    return Exported(contents)


def load_fit(place: File, model: Model | str = "") -> Fit:
    """The fit in a folder that `Fit.save` or `fitball calibrate` wrote; `model` is the function of
    your own that it was made with.

    Raises:
        FolderError: there is no fit that can be read (`no-fit`, `other-version`, `changed`).
        ModelError: it was made with another function, or with none (`own-model`).

    Example:
        >>> import fitball
        >>> fit = fitball.calibrate("wang_zero_spin", model="brody", point_only=True)
        >>> paths = fit.save("my_fit", figures=False)
        >>> fitball.load_fit("my_fit") == fit
        True
    """
    from fitball.base.errors import ModelError
    from fitball.results.fit import Fit
    from fitball.saved import files_of_fit

    user_model = model_or_none(model)
    fitted = files_of_fit.read(Path(place), user_model)
    if user_model is not None and not fitted.run.model_source:
        shipped = files_of_fit.read(Path(place)).problem.forward.model.text
        raise ModelError(
            f"{place}: this fit was made with {shipped}; leave model= out", "own-model"
        )
    return Fit.of(fitted)


def _fit(fit: Fit | File, model: Model | str = "") -> Fit:
    """A fit, or that of a folder."""
    return load_fit(fit, model) if isinstance(fit, str | Path) else fit


def model_or_none(model: Model | str) -> Model | None:
    """A model, or that of a name; None without a name. Raises ModelError."""
    from fitball.models.model import Model
    from fitball.models.registry import model as model_of

    if model == "":
        return None
    return model if isinstance(model, Model) else model_of(model)
