"""A model of one's own: a Python function with priors as defaults, tried, known by its source, sent
to processes.
"""

import hashlib
import subprocess
import sys

import cloudpickle
import numba
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

import fitball
from fitball.base.errors import FitballError, ModelError, ParameterError
from fitball.base.values import Ball, Impacts
from fitball.data.scene import Scene
from fitball.inference.noise import NOISE_KINDS
from fitball.inference.problem.camera import CAMERA_SPECS
from fitball.models.specs import SPECS
from fitball.models.types import Status

STATES = fitball.impacts([10.0, 8.0, -12.0], [9.0, 12.0, 5.0], [100.0, -50.0, 0.0])


def sliding(
    v_x1,
    v_y1,
    omega_1,
    ball,
    mu="lognormal(0.5, 0.5)",
    e_x="normal(0, 0.3)",
    cor_10="uniform(0, 1)",
):
    a = ball.inertia / (ball.mass * ball.radius**2)
    slip = v_x1 - ball.radius * omega_1
    change = np.clip(
        a / (1 + a) * (1 + e_x) * slip,
        -mu * (1 + cor_10) * v_y1,
        mu * (1 + cor_10) * v_y1,
    )
    return v_x1 - change, cor_10 * v_y1, omega_1 + change / (a * ball.radius)


@numba.njit
def looped(v_x1, v_y1, omega_1, ball, e_y="uniform(0, 1)"):
    v_y2 = np.empty_like(v_y1)
    for k in range(len(v_y1)):
        v_y2[k] = e_y[k] * v_y1[k]
    return v_x1 * 0.5, v_y2, omega_1 + ball.radius


def written(folder, text):
    """A model of a file."""
    (folder / "mine.py").write_text(text, encoding="utf-8")
    return f"{folder / 'mine.py'}:f"


def faulty(body, arguments="e_y='uniform(0, 1)'"):
    return f"import numpy as np\n\ndef f(v_x1, v_y1, omega_1, ball, {arguments}):\n    {body}\n"


def test_it_is_a_model_like_grip_slip():
    mine = fitball.model_from(sliding)
    theirs = fitball.model("grip-slip")
    names = ("mu", "e_x", "cor_10")
    assert tuple(spec.name for spec in mine.parameters) == names
    assert not mine.timed
    assert mine.text == "sliding"
    draws = np.array([[0.3, 0.1, 0.7], [0.8, -0.2, 0.75]])
    common = {name: draws[:, k] for k, name in enumerate(names)} | {
        "ball_mass": 0.058,
        "ball_radius": 0.0335,
    }
    rebounds = mine.rebound(common, STATES)
    wanted = theirs.rebound({**common, "offset": 0.0, "cor_slope": 0.0}, STATES)
    for name in ("v_x2", "v_y2", "omega_2", "contact_time"):
        assert_allclose(
            getattr(rebounds, name),
            getattr(wanted, name),
            rtol=1e-12,
            atol=1e-12,
        )
    assert rebounds.regime.max() == 0
    assert rebounds.status.max() == 0
    # Every draw of states of its own.
    of_draws = Impacts(
        *(np.stack([c, c[::-1]]) for c in (STATES.v_x1, STATES.v_y1, STATES.omega_1))
    )
    each = mine.evaluate(names, draws, of_draws)
    assert_array_equal(
        each.v_x2[1],
        mine.evaluate(names, draws[1:], STATES).v_x2[0, ::-1],
    )


def test_parameters_of_fitball_keep_their_meaning_and_others_have_the_bounds_of_their_priors():
    def f(
        v_x1,
        v_y1,
        omega_1,
        ball,
        mu="uniform(0.2, 1)",
        k="uniform(-1, 2)",
        b_1="lognormal(3, 1)",
        c="half-t(1, 4)",
    ):
        return v_x1 * mu, v_y1 * k, omega_1 * b_1 * c

    mu, keep, b_1, c = fitball.model_from(f).parameters
    assert mu.lower == 0.0
    assert mu.upper == 5.0
    assert mu.unit == ""
    assert mu.meaning == SPECS["mu"].meaning
    assert mu.prior == "uniform(0.2, 1)"
    assert keep.lower == -1.0
    assert keep.upper == 2.0
    assert b_1.lower == c.lower == 0.0
    assert b_1.logarithmic
    assert not c.logarithmic


def test_a_compiled_function_is_one_too():
    model = fitball.model_from(looped)
    assert model.rebound({"e_y": 0.5}, STATES).v_y2.tolist() == [4.5, 6.0, 2.5]
    with pytest.raises(ModelError) as caught:
        model.kernel_call({"e_y": 0.5})
    assert caught.value.code == "own-model"


def test_without_an_answer_it_is_nan_with_a_status():
    def f(v_x1, v_y1, omega_1, ball, e_y="uniform(0, 1)"):
        return v_x1, np.where(e_y > 0.72, np.nan, e_y * v_y1), omega_1

    model = fitball.model_from(f)
    states = Impacts(np.ones(3), np.array([8.0, -8.0, 1e-4]), np.ones(3))
    rebounds = model.evaluate(("e_y",), np.array([[0.8], [0.5]]), states)
    assert rebounds.status[0].tolist() == [Status.NO_ANSWER, Status.NO_IMPACT, Status.NO_ANSWER]
    assert rebounds.status[1].tolist() == [Status.OK, Status.NO_IMPACT, Status.OK]
    assert np.isnan(rebounds.v_x2).tolist() == [[True] * 3, [False, True, False]]
    assert rebounds.v_y2[1, 0] == 4.0
    with pytest.raises(ParameterError) as caught:
        model.rebound({"e_y": 0.8}, STATES)
    assert caught.value.code == "no-answer"


@pytest.mark.parametrize(
    ("text", "code", "words"),
    [
        (faulty("return v_x1, v_y1"), "own-model", "tuple"),
        (faulty("return v_x1, v_y1[:-1], omega_1"), "own-model", "v_y2 of shape"),
        (faulty("return v_x1, v_y1, 1j * omega_1"), "own-model", "complex128"),
        (faulty("return v_x1, v_y1 * np.nan, omega_1"), "own-model", "v_y1 = "),
        (faulty("return v_x1, v_y1.mean() + 0 * v_y1, omega_1"), "own-model", "v_y2 = "),
        # The largest speed, and the last rows, have it right.
        (faulty("return v_x1 / v_x1.max(), v_y1, omega_1"), "own-model", "v_x2 = "),
        (faulty("return np.sort(v_x1), v_y1, omega_1"), "own-model", "v_x2 = "),
        (faulty("raise SystemExit"), "own-model", "line 4 of mine.py with SystemExit"),
        (
            faulty("return v_x1, lost * v_y1, omega_1"),
            "own-model",
            "line 4 of mine.py with NameError",
        ),
        (
            faulty("return (v_x1 if v_x1 > 9 else v_x1), v_y1, omega_1"),
            "own-model",
            "line 4 of mine.py",
        ),
        (faulty("return v_x1, v_y1, omega_1", "e_y"), "prior", "e_y"),
        (faulty("return v_x1, v_y1, omega_1", "e_y=0.5"), "prior", "e_y"),
        (faulty("return v_x1, v_y1, omega_1", "mu=''"), "prior", "mu"),
        (faulty("return v_x1, v_y1, omega_1", "*rest"), "prior", "rest"),
        (
            "def f(v_x1, v_y1, omega_1, ball):\n    return v_x1, v_y1, omega_1\n",
            "own-model",
            "omega_1, ball",
        ),
        ("def f(v, e_y='uniform(0, 1)'):\n    return v, v, v\n", "own-model", "(v, e_y)"),
        ("x = 1\n", "own-model", "'f'"),
        ("f = 1\n", "own-model", "'f'"),
        ("x = 1\ny = 1 / 0\n", "own-model", "line 2 of mine.py with ZeroDivisionError"),
        ("import sys\nsys.exit(0)\n", "own-model", "line 2 of mine.py with SystemExit"),
        ("x = 1\ndef f(:\n", "own-model", "line 2 of mine.py"),
    ],
)
def test_a_fault_has_a_code_and_a_place(tmp_path, text, code, words):
    with pytest.raises(FitballError) as caught:
        fitball.model(written(tmp_path, text))
    assert caught.value.code == code
    assert words in str(caught.value)


COMMON = ["k_y", "ball_mass", "mu_spread", "spin_sd", "court_pace", *CAMERA_SPECS]


@pytest.mark.parametrize(
    "name",
    [*COMMON, *(spec.name for kind in NOISE_KINDS.values() for spec in kind.parameters)],
)
def test_no_parameter_has_a_name_that_means_something_else(tmp_path, name):
    with pytest.raises(ModelError) as caught:
        fitball.model(
            written(tmp_path, faulty("return v_x1, v_y1, omega_1", f"{name}='uniform(0, 1)'"))
        )
    assert caught.value.code == "own-model"
    assert name in str(caught.value)


def test_what_is_no_function_or_has_a_taken_name(tmp_path):
    # Draws are stored along a dimension of this name.
    def drawn(v_x1, v_y1, omega_1, ball, draw="uniform(0, 1)"):
        return v_x1, draw * v_y1, omega_1

    for call in (
        lambda: fitball.model_from(np.add),
        lambda: fitball.model_from(sliding, name="grip-slip"),
        lambda: fitball.model(str(tmp_path / "none.py:f")),
        lambda: fitball.model_from(
            eval("lambda v_x1, v_y1, omega_1, ball, e='uniform(0, 1)': (v_x1, v_y1, e)")
        ),
        lambda: fitball.model_from(drawn),
    ):
        with pytest.raises(ModelError) as caught:
            call()
        assert caught.value.code == "own-model"
    with pytest.raises(ModelError) as caught:
        fitball.model("mine.py:f", offset="grip")
    assert caught.value.code == "unknown-option"


def test_a_scene_is_data_and_runs_no_file(tmp_path):
    address = written(tmp_path, f"open({str(tmp_path / 'ran')!r}, 'w').close()")
    with pytest.raises(ModelError) as caught:
        fitball.calibrate("wang_zero_spin.csv", scene=Scene(model={"name": address}))
    assert caught.value.code == "own-model"
    assert not (tmp_path / "ran").exists()


def test_a_file_is_read_as_it_is_now_and_known_by_the_source_of_its_function(tmp_path):
    text = faulty("return v_x1, e_y * v_y1, omega_1")
    address = written(tmp_path, text)
    first = fitball.model(address, ball=Ball(mass=0.06))
    assert first.text == address
    assert first.name == "f"
    assert first.ball.mass == 0.06
    assert first.source == hashlib.sha256(text.partition("\n\n")[2].encode()).hexdigest()
    assert fitball.model(written(tmp_path, f"# A remark.\n{text}")).source == first.source
    changed = fitball.model(written(tmp_path, text.replace("e_y * v_y1", "0.5 * e_y * v_y1")))
    assert changed.source != first.source
    assert (
        changed.rebound({"e_y": 0.8}, STATES).v_y2[0]
        == 0.5 * first.rebound({"e_y": 0.8}, STATES).v_y2[0]
        == 3.6
    )


def test_it_goes_to_another_process_without_its_file(tmp_path):
    text = "import numpy as np\nHALF = 0.5\n" + faulty("return share(v_x1), e_y * v_y1, omega_1")
    address = written(tmp_path, text + "\ndef share(v):\n    return np.multiply(v, HALF)\n")
    (tmp_path / "sent").write_bytes(cloudpickle.dumps(fitball.model(address)))
    (tmp_path / "mine.py").unlink()
    code = (
        "import fitball, pathlib, pickle, sys; model = "
        "pickle.loads(pathlib.Path(sys.argv[1]).read_bytes()); "
        "print(model.rebound({'e_y': 0.5}, fitball.impacts(3.0, 8.0)).v_x2[0], model.source)"
    )
    answer = subprocess.run(
        [sys.executable, "-c", code, str(tmp_path / "sent")],
        capture_output=True,
        text=True,
        check=True,
        cwd=tmp_path,
    ).stdout.split()
    assert float(answer[0]) == 1.5
    assert len(answer[1]) == 64
