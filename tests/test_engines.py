"""Engine settings: numbers of the stored set, the rows of engines, recipes, and what is refused.
What engines do with them is run by `scripts/nightly.py engines`.
"""

import json
import re

import numpy as np
import pytest
from support import engines as of_engines
from support import ports

import fitball
from fitball.base.errors import FitballError
from fitball.exports import engine, engine_page
from fitball.exports.engines import chosen, engines
from fitball.exports.parameter_set import set_of_model
from fitball.exports.ports import port


@pytest.fixture(scope="module")
def wang():
    return of_engines.wang_set()


@pytest.fixture(scope="module")
def exported(wang):
    return json.loads(engine_page.settings_json([wang], ""))


def test_the_stored_set_has_the_settings_that_engines_were_run_with(exported):
    """Numbers of the export that sixteen engines were run with."""
    (of_set,) = exported["sets"]
    of_space, of_plane, own = of_set["settings"]
    assert [row["inertia"] for row in (of_space, of_plane, own)] == [0.4, 0.5, 0.56]
    for row in (of_space, of_plane, own):
        assert row["e"] == pytest.approx(0.7483, abs=5e-5)
        assert row["mu"] == pytest.approx(0.5693, abs=5e-5)
    names = ("v_x2", "v_y2", "omega_2")
    assert [own["rms"][name] for name in names] == pytest.approx([1.24, 0.61, 24.7], rel=0.01)
    assert [of_space["rms"][name] for name in names] == pytest.approx([2.08, 0.61, 57.9], rel=0.01)
    assert of_plane["rms"]["omega_2"] == pytest.approx(34.0, rel=0.02)
    # 0.56 x 0.0576 kg x (0.03302 m)^2.
    assert own["inertia_kg_m2"] == pytest.approx(3.517e-5, rel=1e-3)
    assert own["inertia_per_mass_m2"] == pytest.approx(6.106e-4, rel=1e-3)


def test_limits_are_those_of_the_range(wang, exported):
    (of_set,) = exported["sets"]
    rebounds = engine.model_rebounds(wang, wang.usual)
    fastest = max(np.abs(wang.usual.omega_1).max(), np.abs(rebounds["omega_2"]).max())
    assert of_set["spin_at_least"] >= 1.2 * fastest
    assert of_set["spin_at_least"] < 1.5 * fastest
    assert of_set["speed_threshold"] < wang.usual.v_y1.min()
    steps = of_set["step_at_most"]
    # At 16.39 m/s a ball of 33 mm sinks in by a twentieth of its radius in 0.1 ms.
    assert steps["lever"] == pytest.approx(0.05 * 0.03302 / 16.39, rel=1e-6)
    assert steps["rotation"] * of_set["spin_at_least"] == pytest.approx(np.pi / 4.0)
    assert steps["contact"] == pytest.approx(of_set["mujoco"]["contact_time"] / 20.0)


def test_each_recipe_has_the_numbers_of_the_set(exported):
    (of_set,) = exported["sets"]
    own = of_set["settings"][-1]
    assert {*of_set["recipes"]} == {key for key, one in engines().items() if one.recipe}
    assert {*of_set["ports"]} == {"pymunk", "chipmunk", "planck", "pybullet", "rapier", "cannon"}
    for key, code in of_set["recipes"].items():
        assert not re.search("@[a-z]+@", code), key
        numbers = [float(text) for text in re.findall(r"\d+\.?\d*(?:e-?\d+)?", code)]
        of_inertia = "per_mass_m2" if key in ("havok", "godot3") else "kg_m2"
        assert near(numbers, own["mu"]), key
        assert near(numbers, own[f"inertia_{of_inertia}"]), key
        if key != "mujoco":
            assert near(numbers, own["e"]), key


def near(numbers, wanted):
    """Whether a number is among others, to the digits that recipes have."""
    return any(abs(number - wanted) <= 1e-9 * wanted for number in numbers)


def test_recipes_of_the_page_are_those_that_are_run(wang, exported):
    text = engine_page.settings_page([wang], "")
    lines = {line.removeprefix("    ") for line in text.splitlines()}
    (of_set,) = exported["sets"]
    for code in (*of_set["recipes"].values(), *of_set["ports"].values()):
        indented = "\n".join(f"    {line}".rstrip() for line in code.splitlines())
        assert indented in text
        assert {*code.splitlines()} <= lines


def test_what_is_promised_was_run():
    for key, one in engines().items():
        # Numbers and a recipe go together, and both with a run.
        assert bool(one.seen) == bool(one.recipe), key
        assert one.run or not one.seen, key
        assert (one.works == "port") <= (not one.recipe), key
    # The numbers of these are those of an ideal sphere at the rate of a game.
    for key in ("pymunk", "chipmunk", "planck", "pybullet", "jolt", "godot3"):
        assert engines()[key].seen["60"] == (1.25, 0.61, 24.8), key
    v_x, v_y, omega = engines()["mujoco"].seen["4000"]
    assert v_x <= 0.6 and v_y <= 0.62 and omega <= 32.0


@pytest.mark.parametrize(
    ("name", "key"),
    [("mujoco", "mujoco"), ("Bullet", "pybullet"), ("Chipmunk", "chipmunk"), ("Babylon", "havok")],
)
def test_an_engine_is_found_by_its_names(name, key):
    assert [*chosen(name)] == [key]


def test_an_engine_that_does_not_exist_gets_the_list_and_the_nearest(wang):
    with pytest.raises(FitballError) as caught:
        engine_page.settings_page([wang], "", "mujocko")
    assert caught.value.code == "unknown-engine"
    text = str(caught.value)
    assert "'mujoco'" in text
    assert all(key in text for key in engines())


def test_impacts_to_try_are_those_of_the_port_in_axes_of_an_engine(wang, exported):
    """Flat and with topspin: angular velocities of engines are the opposite of topspin."""
    text = engine_page.settings_page([wang], "", "pymunk")
    rows = {
        line.split("|")[1].strip(): line
        for line in text.splitlines()
        if line.startswith("| ") and "), " in line
    }
    assert [*rows] == ["drop from 1 m", "flat", "topspin", "backspin"]
    module = ports.module(port([wang], "python"))
    own = exported["sets"][0]["settings"][-1]
    for name, omega in (("flat", 0.0), ("topspin", 200.0), ("backspin", -200.0)):
        numbers = [float(number) for number in re.findall(r"-?\d+\.?\d*", rows[name])]
        assert numbers[:3] == [20.0, -8.0, -omega]
        rebound = module.rebound(20.0, 8.0, omega, module.BALL)
        assert numbers[3:5] == pytest.approx([rebound.v_x2, rebound.v_y2], abs=0.006)
        assert numbers[5] == pytest.approx(-rebound.omega_2, abs=0.6)
        # A sphere that slides loses mu (1 + e) v_y1, at most what stops its slip.
        slip = (20.0 - 0.03302 * omega) * 0.56 / 1.56
        lost = min(own["mu"] * (1.0 + own["e"]) * 8.0, slip)
        assert numbers[6:8] == pytest.approx([20.0 - lost, 8.0 * own["e"]], abs=0.006)
        assert numbers[8] == pytest.approx(-omega - lost / (0.56 * 0.03302), abs=0.6)


def test_what_a_row_installs_is_its_version():
    for key, one in engines().items():
        package, _, version = one.install.rpartition("@" if "npm" in one.install else "==")
        assert version in one.version or not package, key
        assert bool(one.install) >= bool(one.recipe or one.port), key


def test_one_engine_alone(wang):
    text = engine_page.settings_page([wang], "", "planck")
    assert "import { Circle" in text
    assert "pymunk" not in text


def test_drop_tests_have_restitution_alone_and_say_so():
    vertical = fitball.model("two-mass+normal=total", tangential=False)
    drops = set_of_model(vertical, {"cor_10": 0.7})
    exported = json.loads(engine_page.settings_json([drops], "v_y1=10"))
    (row,) = exported["sets"][0]["settings"]
    assert row["mu"] is None
    text = engine_page.settings_page([drops], "v_y1=10")
    assert "restitution alone" in text
