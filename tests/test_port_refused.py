"""Models without a port: exports of their numbers work, and source code is refused with a code."""

import math
from typing import ClassVar

import numpy as np
import pytest
from support import ports
from support.fit_by_hand import table_of

import fitball
from fitball import cli
from fitball.base.errors import ModelError
from fitball.exports import FORMATS
from fitball.exports.ports import offered
from fitball.exports.ports.offered import FLAGS
from fitball.models import registry
from fitball.models.grip_slip import GripSlip, struck
from fitball.models.kernels.contact import OK, law_of, restitution
from fitball.models.kernels.phases import Outcome
from fitball.models.model import KernelSolver, Model
from fitball.models.specs import SPECS

COLUMNS = ("mu", "cor_10", "cor_slope", "ball_mass", "ball_radius", "inertia_ratio")
PORTED = {"c", "csharp", "javascript", "esm", "types", "python", "gdscript", "golden", "page"}
OF_FITS = {"latex", "siunitx", "markdown", "arviz"}
FUNCTION = """import numpy as np


def sliding(v_x1, v_y1, omega_1, ball, mu="lognormal(0.5, 0.5)", cor_10="uniform(0, 1)"):
    a = ball.inertia / (ball.mass * ball.radius**2)
    slip = v_x1 - ball.radius * omega_1
    limit = mu * (1 + cor_10) * v_y1
    change = np.clip(a / (1 + a) * slip, -limit, limit)
    return v_x1 - change, cor_10 * v_y1, omega_1 + change / (a * ball.radius)
"""


def brody_rows(rows, *others):
    """A batch of the toy: that of grip-slip without its other two parameters."""
    none = np.zeros((len(rows), 2))
    friction = rows[:, :1]
    all_columns = np.hstack([friction, none, rows[:, 1:]])
    return GripSlip.batch(all_columns, *others)


class Toy(KernelSolver):
    """Brody's ball by a row of six columns, as a contributor would ship a model of three
    parameters.
    """

    entry = staticmethod(GripSlip.entry)
    batch = staticmethod(brody_rows)
    columns: ClassVar[tuple[str, ...]] = COLUMNS


def toy(name, text, ball, tangential, _options):
    flags = (0,) * 7
    absent = (0.0,) * 3
    parameters = tuple(SPECS[key] for key in COLUMNS[:3])
    solver = Toy(flags, absent)
    return Model(name, text, ball, {}, parameters, solver, tangential)


@pytest.fixture
def shipped(monkeypatch):
    """A shipped model without a port, by name."""
    models = {**registry.MODELS, "toy": registry.Entry(toy)}
    monkeypatch.setattr(registry, "MODELS", models)
    return "toy"


@pytest.fixture(scope="module")
def mine(tmp_path_factory):
    """A function in a file, by name."""
    file = tmp_path_factory.mktemp("models") / "mine.py"
    file.write_text(FUNCTION, encoding="utf-8")
    return f"{file}:sliding"


def answer(capsys, folder, *words):
    """The exit code of an export and the files that it leaves."""
    code = cli.main(["export", *words, "--out", str(folder)])
    assert "Traceback" not in capsys.readouterr().err
    return code, {path.name for path in folder.rglob("*") if path.suffix != ".lock"}


@pytest.mark.parametrize("form", FORMATS)
@pytest.mark.parametrize("kind", ["shipped", "mine"])
def test_values_of_a_model_without_port(kind, form, request, tmp_path, capsys):
    model = request.getfixturevalue(kind)
    fix = "mu=0.5,cor_10=0.7"
    refused = form in PORTED | OF_FITS
    wanted = (2, set()) if refused else (0, {FORMATS[form].file})
    assert answer(capsys, tmp_path, "--model", model, "--fix", fix, "--to", form) == wanted
    if form in PORTED:
        with pytest.raises(ModelError) as caught:
            fitball.export(model=model, fix={"mu": 0.5, "cor_10": 0.7}, to=form)
        assert caught.value.code == {"shipped": "no-port", "mine": "own-model"}[kind]


@pytest.mark.parametrize("kind", ["shipped", "mine"])
def test_a_fit_of_a_model_without_port(kind, request, tmp_path, capsys):
    model = request.getfixturevalue(kind)
    fitball.calibrate(table_of(24), model=model, point_only=True).save(tmp_path / "fit")
    mine = ("--model", model) if kind == "mine" else ()
    for form in FORMATS:
        # A point fit has no draws.
        refused = form in PORTED | {"arviz"}
        wanted = (2, set()) if refused else (0, {FORMATS[form].file})
        words = (str(tmp_path / "fit"), *mine, "--to", form)
        assert answer(capsys, tmp_path / form, *words) == wanted, form


def sliding_ball(
    row: offered.Parameters, _share: float, v_x: float, v_y: float, omega: float
) -> Outcome:
    """Brody's ball as a port has it."""
    status, law = law_of(row.cor_10, row.cor_slope, 1.0, FLAGS)
    bad, cor, _ = restitution(law, v_y, math.nan)
    mass = row.ball_mass
    radius = row.ball_radius
    a = row.inertia_ratio
    answer = struck(row.mu, 0.0, 0.0, cor, mass, radius, a, v_x, v_y, omega)
    return answer._replace(status=bad if status == OK else status)


def test_a_model_with_a_row_of_fronts_has_a_port(shipped, monkeypatch):
    monkeypatch.setitem(offered.FRONTS, Toy, offered.Front(sliding_ball, lambda _flags: False))
    fix = {"mu": 0.5, "cor_10": 0.7, "cor_slope": -0.01}
    exported = fitball.export(model=shipped, fix=fix, to="python")
    (text,) = exported.contents.values()
    port = ports.module(text)
    assert port.self_test() < 1e-12
    bounced = port.rebound(20.0, 10.0, 30.0, port.BALL)
    impact = fitball.impacts(20.0, 10.0, 30.0)
    brody = fitball.model("brody").rebound(fix, impact)
    wanted = (brody.v_x2[0], brody.v_y2[0], brody.omega_2[0])
    assert bounced[:3] == pytest.approx(wanted, rel=1e-12)


@pytest.mark.parametrize("form", sorted(PORTED - {"golden"}))
def test_a_port_that_reads_what_the_model_has_not_is_refused(shipped, monkeypatch, form):
    # It reads `e_x`, of which the toy has no column: Python would notice it at the first bounce.
    monkeypatch.setitem(offered.FRONTS, Toy, offered.FRONTS[GripSlip])
    with pytest.raises(ModelError) as caught:
        fitball.export(model=shipped, fix={"mu": 0.5, "cor_10": 0.7}, to=form)
    assert caught.value.code == "no-port"
