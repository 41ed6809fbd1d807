"""A page with sliders: the bounce computed in the browser by the JavaScript port; one file, no network."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from markupsafe import Markup

from fitball.exports.port.face import total_moment
from fitball.exports.port.languages import javascript_script
from fitball.exports.port.port import Port, make_port, range_sentences
from fitball.inference.prediction.engine_fit import middle_impact
from fitball.inference.prediction.outputs import golden
from fitball.inference.results.fitted_model import FittedModel
from fitball.models.types import PHASE_SYMBOL
from fitball.report.form.document import render_template
from fitball.report.form.palette import PHASES
from fitball.values import Impacts

# Ends and steps of the sliders [m/s, deg, rpm]: from a ball let fall to the fastest serve.
SPEED, ANGLE, SPIN = (2.0, 70.0, 0.1), (2.0, 90.0, 0.1), (-6000.0, 6000.0, 10.0)
MU, COR = (0.0, 1.5, 0.001), (0.2, 0.99, 0.001)
# Columns of every kernel's row.
BALL = ("ball_mass", "ball_radius", "ball_inertia")
RPM = 30.0 / math.pi
# Areas of slip and grip by the names of the page, coloured as in figures and films.
SHADES = dict(zip(("slide", "back", "grip", "hold", "free"), PHASES, strict=True))


def interactive_page(fitted: FittedModel, impact: Impacts, intro: str, origin: str, measured: bool = True) -> str:
    """The page, begun at `impact`; `intro` (a sentence) and `origin` (a phrase) say where the parameters are from.
    Unless `measured`, they are those of no fit.

    Raises ModelError as `make_port` does.
    """
    followed = not fitted.model.no_history
    more = (total_moment,) if followed else ()
    port = make_port(fitted, golden(fitted, fitted.impacts), origin, more, measured)
    names = ("total_moment", "newScratch", "CODES", "RIGID") if followed else ()
    return render_template(
        "fitball.exports",
        "interactive.html.j2",
        port=port,
        intro=intro,
        tangential=fitted.tangential,
        followed=followed,
        script=_inline(javascript_script(port, names)),
        settings=_inline(json.dumps(_settings(port, fitted, impact, followed), indent=1)),
        sentences=range_sentences(port),
        shades=SHADES,
        parameters=[(name, value) for name, value in port.row if name in {*fitted.names, *BALL}],
    )


def round_impact(fitted: FittedModel) -> Impacts:
    """The middle of the calibrated range, in round numbers of the sliders."""
    middle = middle_impact(fitted)
    v_x, v_y, omega = (float(column[0]) for column in (middle.v_x1, middle.v_y1, middle.omega_1))
    speed, angle = round(math.hypot(v_x, v_y), 1), math.radians(round(math.degrees(math.atan2(v_y, v_x))))
    along = speed * math.cos(angle) if fitted.tangential else 0.0
    spin = round(omega * RPM, -1) / RPM if fitted.tangential else 0.0
    towards = speed * math.sin(angle) if fitted.tangential else speed
    return Impacts(np.array([along]), np.array([towards]), np.array([spin]))


def _settings(port: Port, fitted: FittedModel, impact: Impacts, followed: bool) -> dict[str, Any]:
    v_x, v_y, omega = (float(column[0]) for column in (impact.v_x1, impact.v_y1, impact.omega_1))
    values = dict(port.row)
    names, cor = list(values), 0.75 if impact.cor is None else float(impact.cor[0])
    own = "cor_10" in values and not port.needs_cor
    sliders = {
        "speed": _slider(SPEED, math.hypot(v_x, v_y)),
        "angle": _slider(ANGLE, math.degrees(math.atan2(v_y, v_x)) if fitted.tangential else 90.0),
        "spin": _slider(SPIN, omega * RPM),
        "mu": _slider(MU, values.get("mu", 0.0)),
        "cor": _slider(COR, values["cor_10"] if own else cor),
    }
    return {
        "tangential": fitted.tangential,
        "followed": followed,
        "toldCor": port.needs_cor,
        "place": {"mu": names.index("mu") if "mu" in values else None, "cor": names.index("cor_10") if own else None},
        "ball": {"mass": fitted.ball.mass, "radius": fitted.ball.radius, "inertia": fitted.ball.inertia},
        "phases": {int(code): name for code, name in PHASE_SYMBOL.items()},
        "sliders": sliders,
    }


def _slider(ends: tuple[float, float, float], value: float) -> Mapping[str, float]:
    """Ends wide enough for where it begins."""
    low, high, step = ends
    return {"low": min(low, math.floor(value)), "high": max(high, math.ceil(value)), "step": step, "start": value}


def _inline(script: str) -> Markup:
    """A script that no text within it ends too early."""
    return Markup(script.replace("</", "<\\/").replace("<!--", "<\\!--"))
