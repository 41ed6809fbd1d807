"""`report.html`: one page that needs nothing but itself."""

from __future__ import annotations

import base64
from collections.abc import Mapping

from jinja2 import ChoiceLoader, Environment, PackageLoader, StrictUndefined

from fitball.inference.results import Fit
from fitball.report.balance_table import balance_table
from fitball.report.looks_rows import look_rows, spectrum_rows
from fitball.report.summary import diagnosis_lines, level_rows, notes, parameter_rows, prediction_table, thesis_rows
from fitball.version import __version__

CAPTIONS = {
    "corner": "Posterior of all pairs of parameters, with the prior on the diagonal and the point estimate.",
    "predictive": "Measured rebounds with error bars against the posterior prediction, along incidence angle.",
    "profiles": "Profile likelihood of every parameter: the best fit for each of its values, below the best of all; "
    "intervals of 68 and 95 % end at -0.5 and -1.92. Bars: 95 % of the posterior.",
    "regimes": "Posterior probability of each sequence of slip and grip, impact by impact.",
    "residuals": "Standardised residuals along incidence angle and against normal quantiles.",
    "trace": "Walkers of every ensemble after warm-up, and the marginals ensemble by ensemble.",
}


def render_template(package: str, template: str, **context: object) -> str:
    """A page from `template`, looked for in the templates of `package`, then among those of the reports."""
    environment = Environment(
        loader=ChoiceLoader([PackageLoader(package), PackageLoader("fitball.report")]),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    return environment.get_template(template).render(version=__version__, **context)


def embedded(images: Mapping[str, bytes], captions: Mapping[str, str]) -> dict[str, dict[str, str]]:
    """PNG files as text to embed, with their captions, in the order of `captions`."""
    return {
        name: {"data": base64.b64encode(images[name]).decode("ascii"), "caption": captions[name]}
        for name in captions
        if name in images
    }


def page(fit: Fit, images: Mapping[str, bytes]) -> str:
    """The page as text; `images` are PNG files by figure name."""
    return render_template(
        "fitball.report",
        "report.html.j2",
        fit=fit,
        table=fit.problem.table,
        scene=fit.problem.scene,
        model=fit.problem.model,
        parameters=parameter_rows(fit),
        thesis=thesis_rows(fit),
        levels=level_rows(fit),
        predictions=prediction_table(fit),
        balances=balance_table(fit.balances),
        diagnosis=diagnosis_lines(fit),
        notes=notes(fit),
        looks=look_rows(fit),
        spectrum=spectrum_rows(fit),
        figures=embedded(images, CAPTIONS),
    )
