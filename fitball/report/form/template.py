"""Pages from templates: one style for all of them, in `fitball/report/templates`."""

from __future__ import annotations

from jinja2 import ChoiceLoader, Environment, PackageLoader, StrictUndefined

from fitball.report.form.palette import style_rules
from fitball.version import __version__


def _typeset(value: object) -> object:
    """What terminals have in ASCII, as print has it."""
    return value.replace("+-", "\u00b1") if isinstance(value, str) else value


def render_template(package: str, template: str, **context: object) -> str:
    """A page from `template`, looked for in the templates of `package`, then among those of the reports."""
    environment = Environment(
        loader=ChoiceLoader([PackageLoader(package), PackageLoader("fitball.report")]),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        finalize=_typeset,
    )
    return environment.get_template(template).render(version=__version__, colours=style_rules(), **context)
