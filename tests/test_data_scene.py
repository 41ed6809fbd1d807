"""Scenes: what a file says, what is assumed without it, and every way to get it wrong."""

import dataclasses
import json
import pickle
import tomllib
from importlib.resources import files
from pathlib import Path
from typing import Any

import jsonschema
import numpy as np
import pytest

from fitball.data.bundled import bundled_names, bundled_tables
from fitball.data.force import find_force
from fitball.data.read import load_table
from fitball.data.scene import Camera, Quantity, Scene, load_scene
from fitball.data.scene_keys import KINDS, SIZES, Kind, range_fault
from fitball.errors import SceneError, TableError
from fitball.inference.problem.build import Choices, build_problem

SCHEMA: dict[str, Any] = json.loads(files("fitball.data").joinpath("scene.schema.json").read_text(encoding="utf-8"))
TABLE = "v_y1,v_y2\n4,3\n7,5\n"
FULL = """
[source]
description = "drops on clay"
citation = "nobody (2000)"
[ball]
mass = { value = 0.058, sd = 0.0005 }
radius = 0.033
inertia = { value = 3.5e-5, sd = 1e-6 }
temperature = { value = -2, sd = 1 }
type = "stage-1"
[surface]
name = "clay"
mu = { value = 0.7, sd = 0.1 }
[contact_time]
value = 5e-3
sd = 1e-3
[measurement]
velocity_sd = 0.1
nominal_spin_sd = 5
contact_time_sd = 2e-4
[model]
name = "brody"
closures = { normal = "total" }
[priors]
mu = "normal(0.7, 0.1)"
k_y = " loguniform ( 1e3 , 1e5 ) "
cor_10 = "literature:court"
[fix]
eps_slope = 0
"""


def scene_of(tmp_path: Path, text: str) -> Scene:
    (tmp_path / "t.csv").write_text(TABLE)
    (tmp_path / "t.toml").write_text(text)
    return load_scene(tmp_path / "t.csv")


def refused(tmp_path: Path, text: str) -> str:
    with pytest.raises(SceneError) as caught:
        scene_of(tmp_path, text)
    assert str(tmp_path / "t.toml") in str(caught.value)
    return str(caught.value)


def test_everything_that_can_be_said(tmp_path: Path) -> None:
    scene = scene_of(tmp_path, FULL)
    unit = 0.058 * 0.033**2
    assert scene.source == str(tmp_path / "t.toml")
    assert (scene.ball.mass, scene.ball.radius, scene.ball.inertia) == (0.058, 0.033, 3.5e-5)
    assert (scene.ball_temperature, scene.ball_temperature_sd, scene.ball_type) == (-2.0, 1.0, "stage-1")
    assert scene.ball_sd == {"mass": 0.0005, "inertia_ratio": 1e-6 / unit}
    assert (scene.surface, scene.mu, scene.contact_time) == ("clay", (0.7, 0.1), (5e-3, 1e-3))
    assert (scene.velocity_sd, scene.spin_sd, scene.contact_time_sd) == (0.1, None, 2e-4)
    assert (scene.nominal_velocity_sd, scene.nominal_spin_sd) == (0.25, 5.0)
    assert (scene.model, scene.closures) == ("brody", {"normal": "total"})
    assert scene.priors["mu"] == "normal(0.7, 0.1)" and set(scene.priors) == {"mu", "k_y", "cor_10"}
    assert scene.fix == {"eps_slope": 0.0}
    assert (scene.description, scene.citation) == ("drops on clay", "nobody (2000)")
    assert scene.assumed == ()


def test_without_a_file_every_assumption_is_a_sentence(tmp_path: Path) -> None:
    (tmp_path / "t.csv").write_text(TABLE)
    scene = load_scene(tmp_path / "t.csv")
    assert scene == dataclasses.replace(Scene(), assumed=scene.assumed)
    for word in ("no scene file", "57.6 g", "33.02 mm", "I/(M R^2) = 0.56", "friction", "contact time"):
        assert sum(word in sentence for sentence in scene.assumed) == 1, word
    assert any("0.25 m/s" in sentence for sentence in scene.assumed)
    assert any("10 rad/s" in sentence for sentence in scene.assumed)


def test_assumptions_vanish_one_by_one(tmp_path: Path) -> None:
    empty = set(scene_of(tmp_path, "").assumed)
    cases = {
        "[ball]\nmass = 0.057": "mass",
        "[ball]\nradius = 0.034": "radius",
        "[ball]\ninertia = 3e-5": "I/(M R^2)",
        "[ball]\ninertia_ratio = 0.55": "I/(M R^2)",
        "[surface]\nmu = 0.5": "friction",
        "[contact_time]\nvalue = 0.005\nsd = 0.001": "contact time",
        "[measurement]\nvelocity_sd = 0.1": "velocity",
        "[measurement]\nnominal_spin_sd = 4": "spin",
    }
    for text, word in cases.items():
        (gone,) = empty - set(scene_of(tmp_path, text).assumed)
        assert word in gone


def test_a_plain_number_has_no_spread(tmp_path: Path) -> None:
    assert scene_of(tmp_path, "[surface]\nmu = 0.5").mu == (0.5, None)
    assert scene_of(tmp_path, "[ball]\ninertia_ratio = 0.55").ball.inertia_ratio == pytest.approx(0.55, rel=1e-15)


def test_config_goes_before_the_file_beside_the_table(tmp_path: Path) -> None:
    (tmp_path / "other.toml").write_text('[model]\nname = "brody"')
    assert load_scene("wang_all", tmp_path / "other.toml").model == "brody"
    with pytest.raises(SceneError, match="cannot be opened"):
        load_scene("wang_all", tmp_path / "absent.toml")
    with pytest.raises(TableError, match="no such file"):
        load_scene(tmp_path / "absent.csv")


# Faults that the schema refuses as well as the reader.
IN_SCHEMA = [
    ("[bal]\nmass = 1", ("[bal]: unknown key", "'ball'")),
    ("[ball]\nmas = 1", ("ball.mas: unknown key", "'mass'")),
    ("[model]\nclosure = {}", ("model.closure: unknown key", "'closures'")),
    ("speed = 3", ("[speed]: unknown key", "known: air, ball, camera, columns")),
    ("ball = 3", ("ball = 3: expected a section [ball]",)),
    ("[ball]\nmass = -1", ("ball.mass = -1: expected a positive number",)),
    ("[ball]\nmass = true", ("ball.mass = true",)),
    ('[ball]\ntype = "type-5"', ('ball.type = "type-5"', "did you mean 'type-")),
    ('[ball]\ntemperature = "cold"', ("expected a number of degrees Celsius",)),
    ("[ball]\ntemperature = { value = 20, sd = 0 }", ("with a positive sd",)),
    ('[ball]\nmass = "57 g"', ('ball.mass = "57 g"',)),
    ("[ball]\nmass = { value = 0.057 }", ("ball.mass = { value = 0.057 }",)),
    ("[ball]\nmass = { value = 0.057, sd = 0 }", ("with both positive",)),
    ("[ball]\nmass = { value = 0.057, sd = 0.1, unit = 1 }", ("ball.mass",)),
    ("[ball]\ninertia = 3e-5\ninertia_ratio = 0.5", ("ball.inertia and ball.inertia_ratio are both given",)),
    ("[measurement]\nspin_sd = 1\nnominal_spin_sd = 1", ("both given",)),
    ("[measurement]\nvelocity_sd = 1\nnominal_velocity_sd = 1", ("both given",)),
    ("[measurement]\nvelocity_sd = 0.0", ("measurement.velocity_sd = 0.0",)),
    ("[contact_time]\nvalue = 0.005", ("expected both value and sd",)),
    ("[priors]\nmu = 0.5", ("priors.mu = 0.5", "normal(0.55, 0.05)")),
    ('[priors]\nmu = "normal 0.5"', ("priors.mu",)),
    ('[priors]\nmu = "normal()"', ("priors.mu",)),
    ('[priors]\nmu = "normal(0.5, x)"', ("priors.mu",)),
    ('[fix]\nmu = "0.5"', ('fix.mu = "0.5": expected a finite number',)),
    ("[model]\nname = 3", ("model.name = 3: expected a text",)),
    ("[model]\nclosures = { normal = 3 }", ("model.closures.normal = 3",)),
    ("priors = 3", ("priors = 3: expected a section of names",)),
    ("[camera]\nscal = 1", ("camera.scal: unknown key", "'scale'")),
    ("[camera]\nscale = 0", ("camera.scale = 0: expected a positive number",)),
    ("[camera]\ntilt = { value = 0 }", ("camera.tilt", "expected a number, or { value = ..., sd = ... }")),
    ("[camera]\ntilt = { value = 0, sd = 0 }", ("camera.tilt", "with a positive sd")),
    ("[camera]\nfps = -240", ("camera.fps = -240: expected a positive number",)),
    ("[measurement]\nignore = 'omega_2'", ("expected a list of texts",)),
    ("[measurement]\nignore = [3]", ("expected a list of texts",)),
]
# Faults beyond a schema: no TOML, no finite number, what no ball, court or instrument has.
BEYOND_SCHEMA = [
    ("[ball]\nmass = nan", ("ball.mass = nan",)),
    ("[ball]\nmass = 1" + 400 * "0", ("expected a positive number",)),
    ("[ball]\ntemperature = 296", ("expected -40 to 80 degrees Celsius",)),
    ("[ball]\ninertia = 1", ("[ball]", "exceeds M R^2")),
    ("[fix]\nmu = inf", ("fix.mu = inf",)),
    ("[ball]\nmass = \n", ("not TOML", "line 2")),
    ("[ball]\nmass = 57.6", ("ball.mass = 57.6: expected 1 mg to 20 kg, in kg",)),
    ("[ball]\nradius = 1e200", ("ball.radius = 1e+200: expected 0.1 mm to 0.5 m, in m",)),
    ("[ball]\nradius = { value = 0.033, sd = 1e300 }", ("ball.radius: sd = 1e+300: expected",)),
    ("[ball]\nmass = { value = 0.058, sd = 1e-300 }", ("ball.mass: sd = 1e-300: expected",)),
    ("[ball]\ninertia = 1e-300", ("ball inertia = 1e-300: expected a number from 1e-30 to 1e+06, in SI units",)),
    ("[surface]\nmu = 1e20", ("surface.mu = 1e+20: expected 1e-6 to 100",)),
    ("[contact_time]\nvalue = 5.0\nsd = 0.05", ("contact_time.value = 5: expected 1 us to 100 ms, in s",)),
    ("[measurement]\nspin_sd = 1e300", ("measurement.spin_sd = 1e+300",)),
    ("[measurement]\nnominal_velocity_sd = 1e-300", ("measurement.nominal_velocity_sd = 1e-300",)),
    ("[force]\nsd = 1e300", ("force.sd = 1e+300",)),
    ("x = " + "[" * 5000, ("not TOML",)),
    ("x = " + "9" * 5000, ("not TOML",)),
    ("[ball]\nmass = 1\nmass = 2", ("not TOML",)),
    ("\0", ("not TOML",)),
    ("[surface]\nname = 5" + "0" * 300, ("surface.name = 500",)),
    ("\n".join(f"[unknown{k}]" for k in range(5000)), ("5000 faults",)),
    # A unit that may have been meant.
    ("[ball]\nmass = 57.7", ("did you mean 57.7 g (0.0577)?",)),
    ("[ball]\nmass = { value = 57.7, sd = 0.3 }", ("did you mean 57.7 g (0.0577)?",)),
    ("[ball]\nmass = { value = 0.0577, sd = 0.3 }", ("did you mean 0.3 g (0.0003)?",)),
    (
        "[ball]\nmass = 2.7\nradius = 0.02",
        (
            "denser than any metal",
            "did you mean a mass of 2.7 g (0.0027)?",
        ),
    ),
    ("[ball]\nradius = 33", ("did you mean 33 mm (0.033)?",)),
    ("[ball]\nradius = 3.3", ("did you mean 3.3 cm (0.033)?",)),
    ("[ball]\nradius = 0.33", ("lighter than air",)),
    ("[ball]\ninertia = 350", ("did you mean 350 g cm^2 (3.5e-05)?",)),
    ("[contact_time]\nvalue = 5\nsd = 0.5", ("did you mean 5 ms (0.005)?", "did you mean 0.5 ms (0.0005)?")),
    ("[measurement]\nvelocity_sd = 20", ("did you mean 20 cm/s (0.2)?",)),
    ("[camera]\nscale = 6", ("camera.scale = 6: expected a factor of 0.2 to 5",)),
    ("[camera]\nclock = 98", ("did you mean 98 % (0.98)?",)),
    ("[camera]\ntilt = -2", ("camera.tilt = -2: expected -10 to 10 deg, in rad; did you mean -2 deg (-0.03491)?",)),
    (
        "[camera]\ntilt = { value = 0, sd = 0.3 }",
        ("sd = 0.3: expected at most 0.17; did you mean 0.3 deg (0.005236)?",),
    ),
    ("[camera]\ncourt_height = { value = 0, sd = 3 }", ("did you mean 3 mm (0.003)?",)),
    ("[camera]\ncourt_height = -2", ("camera.court_height = -2: expected -0.2 to 0.2 m", "-2 mm (-0.002)?")),
    ("[camera]\nrow_time = 15", ("camera.row_time = 15", "did you mean 15 us (1.5e-05)?")),
    ("[air]\npressure = 1013", ("air.pressure = 1013: expected 30 to 120 kPa", "did you mean 1013 hPa (1.013e+05)?")),
    ("[flight]\nlift = { value = 0, sd = 3 }", ("flight.lift: sd = 3: expected at most 2",)),
    ('[camera]\ny = "left"', ('camera.y = "left": expected "up" or "down"',)),
    ("[measurement]\nspin_sd = 2000", ("did you mean 2000 rpm (209.4)?",)),
]


@pytest.mark.parametrize(("text", "words"), IN_SCHEMA + BEYOND_SCHEMA)
def test_what_no_scene_holds_is_refused_in_few_words(tmp_path: Path, text: str, words: tuple[str, ...]) -> None:
    """Also on request."""
    message = refused(tmp_path, text)
    assert all(word in message for word in words) and len(message) < 12_000
    with pytest.raises(SceneError):
        load_scene(tmp_path / "t.csv", as_read=True)


def test_all_faults_of_a_file_at_once(tmp_path: Path) -> None:
    message = refused(tmp_path, "[ball]\nmas = 1\nradius = 0\n[fix]\nmu = true\n[contact_time]\nsd = 1e-3\n[sorce]\n")
    assert "5 faults" in message
    for word in ("ball.mas", "ball.radius", "fix.mu", "[contact_time]", "'source'"):
        assert word in message


def test_not_utf_8(tmp_path: Path) -> None:
    (tmp_path / "t.toml").write_bytes(b"# caf\xe9\n")
    with pytest.raises(SceneError, match="byte 5 is not UTF-8"):
        load_scene("wang_all", tmp_path / "t.toml")


@pytest.mark.parametrize("item", bundled_tables(), ids=lambda item: item.name)
def test_bundled_scenes(item: Any) -> None:
    jsonschema.validate(tomllib.loads(item.path.with_suffix(".toml").read_text(encoding="utf-8")), SCHEMA)
    assert load_scene(item.path).description == item.description


@pytest.mark.parametrize("name", [name for name in bundled_names() if name.startswith("wang")])
def test_scenes_of_wang(name: str) -> None:
    scene = load_scene(name)
    assert (scene.ball.mass, scene.ball.radius) == (0.0576, 0.03302)
    assert scene.ball.inertia_ratio == pytest.approx(0.56, rel=1e-15)
    assert scene.ball_sd == {}
    assert (scene.mu, scene.contact_time) == ((0.55, 0.05), (5.0e-3, 0.5e-3))
    assert (scene.velocity_sd, scene.spin_sd) == (None, None)
    assert (scene.nominal_velocity_sd, scene.nominal_spin_sd) == (0.25, 10.0)
    assert scene.model == "two-mass"
    assert scene.assumed == ()
    assert "Wang" in scene.citation and "Texas A&M" in scene.citation


def test_the_schema_is_one_and_a_field_or_the_reader_takes_each_key() -> None:
    """The reader's keys are the schema's; what no field takes is made into one."""
    jsonschema.Draft202012Validator.check_schema(SCHEMA)
    assert SCHEMA["additionalProperties"] is False
    assert all(node.get("additionalProperties") is not None for node in SCHEMA["properties"].values())
    made = {"ball.mass", "ball.radius", "ball.inertia", "ball.inertia_ratio", "ball.temperature", "surface.mu"}
    made |= {
        "air.temperature",
        "flight.drag",
        "flight.lift",
        "contact_time.value",
        "contact_time.sd",
        *(f"camera.{item.name}" for item in dataclasses.fields(Camera)),
    }
    named = {item.metadata["key"] for item in dataclasses.fields(Scene) if item.metadata}
    assert named | made == set(KINDS) and not named & made and set(SIZES) <= set(KINDS)
    assert (KINDS["surface.mu"], KINDS["fix"], KINDS["pool"]) == (Kind.QUANTITY, Kind.NUMBERS, Kind.TEXTS)


def test_schema_and_reader_refuse_the_same_files(tmp_path: Path) -> None:
    validator = jsonschema.Draft202012Validator(SCHEMA)
    assert validator.is_valid(tomllib.loads(FULL))
    for text, _ in IN_SCHEMA:
        refused(tmp_path, text)
        assert not validator.is_valid(tomllib.loads(text)), text


def test_scenes_are_frozen_and_travel_between_processes() -> None:
    scene = load_scene("wang_all")
    with pytest.raises(dataclasses.FrozenInstanceError):
        scene.model = "brody"  # type: ignore[misc]
    with pytest.raises(TypeError):
        scene.priors["mu"] = ""  # type: ignore[index]
    assert pickle.loads(pickle.dumps(scene)) == scene


def test_a_long_text_is_shortened_in_the_message(tmp_path: Path) -> None:
    message = refused(tmp_path, f'[ball]\nmass = "{"a" * 100_000}"\n{"b" * 100_000} = 1')
    assert len(message) < 3000 and message.count("characters in all") == 2


@pytest.mark.parametrize(("make", "words"), [(Path.mkdir, "directory"), (lambda p: p.symlink_to(p.name), "links")])
def test_a_scene_beside_the_table_that_is_no_file_is_not_passed_over(tmp_path: Path, make: Any, words: str) -> None:
    (tmp_path / "t.csv").write_text(TABLE)
    make(tmp_path / "t.toml")
    with pytest.raises(SceneError, match=words):
        load_scene(tmp_path / "t.csv")


def test_a_byte_order_mark_is_no_fault(tmp_path: Path) -> None:
    assert scene_of(tmp_path, "\ufeff[surface]\nmu = 0.5").mu == (0.5, None)


def test_force_records_with_a_name_too_long_for_the_system(tmp_path: Path) -> None:
    scene = scene_of(tmp_path, f'[force]\nfile = "{"a" * 5000}"')
    with pytest.raises(SceneError, match="no such file"):
        find_force([str(tmp_path / "t.csv")], load_table(tmp_path / "t.csv"), scene)


@pytest.mark.parametrize(
    ("key", "least", "most"),
    [
        ("ball.mass", 1e-6, 20.0),
        ("ball.radius", 1e-4, 0.5),
        ("ball.inertia_ratio", 0.01, 1.0),
        ("surface.mu", 1e-6, 100.0),
    ],
)
def test_the_ends_of_what_a_scene_may_hold(key, least, most):
    for value, allowed in ((least, True), (most, True), (0.97 * least, False), (1.03 * most, False)):
        assert (range_fault(key, value, None) is None) is allowed


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("[ball]\nmass = 12\nradius = 0.12", "ball.mass = 12 is unlikely: 1e-05 to 8 are usual"),
        ("[ball]\nmass = 0.05\nradius = 0.2", "less than a ball of a game has: state both mass and radius"),
        ("[ball]\ninertia_ratio = 0.9", "ball.inertia_ratio = 0.9 is unlikely"),
        ("[surface]\nmu = 55", "did you mean 55 % (0.55)?"),
        ("[measurement]\nangle_sd = 0.5", "did you mean 0.5 deg (0.008727)?"),
        ("[measurement]\nspin_sd = 600", "did you mean 600 rpm (62.83)?"),
        ("[contact_time]\nvalue = 0.08\nsd = 0.01", "contact_time.value = 0.08 is unlikely"),
    ],
)
def test_what_is_far_from_any_ball_is_asked_about(tmp_path, text, words):
    message = refused(tmp_path, text)
    assert words in message and "pass as_read=True" in message
    taken = load_scene(tmp_path / "t.csv", as_read=True)
    assert any("as_read" in sentence and words[:20] in sentence for sentence in taken.assumed)


# Mass [kg], radius [m], I/(M R^2).
BALLS = {
    "tennis": (0.0577, 0.033, 0.55), "table tennis": (2.7e-3, 0.02, 0.66), "golf": (0.0459, 0.0213, 0.4),
    "squash": (0.024, 0.02, 0.6), "basketball": (0.62, 0.12, 0.65), "football": (0.43, 0.11, 0.65),
    "volleyball": (0.27, 0.105, 0.66), "cricket": (0.16, 0.0362, 0.4), "billiards": (0.17, 0.0286, 0.4),
    "bowling": (7.2, 0.108, 0.4), "marble": (5e-3, 8e-3, 0.4), "steel bead": (2.6e-4, 2e-3, 0.4),
    "superball": (0.045, 0.0225, 0.4), "foam": (0.01, 0.035, 0.4), "steel shot": (3.3e-5, 1e-3, 0.4),
}  # fmt: skip


@pytest.mark.parametrize("name", BALLS)
def test_balls_of_games_and_laboratories_are_welcome_and_fitted_within_their_sds(tmp_path, name):
    mass, radius, ratio = BALLS[name]
    scene = scene_of(
        tmp_path,
        f"[ball]\nmass = {{ value = {mass}, sd = {0.02 * mass} }}\n"
        f"radius = {{ value = {radius}, sd = {0.01 * radius} }}\n"
        f"inertia_ratio = {{ value = {ratio}, sd = 0.01 }}\n",
    )
    assert not any("as_read" in sentence for sentence in scene.assumed)
    table = load_table("wang_zero_spin", scene=Scene())
    parameters = {item.name: item for item in build_problem(table, scene, Choices(model="grip-slip")).parameters}
    for key, value in (("ball_mass", mass), ("ball_radius", radius)):
        prior = parameters[key].prior
        assert parameters[key].free and prior.lower < 0.9 * value and prior.upper > 1.1 * value
        assert prior.quantile(np.array([0.5]))[0] == pytest.approx(value, rel=1e-6)


def test_what_a_session_of_filming_shares(tmp_path: Path) -> None:
    """Quantities about zero too, in SI."""
    place = tmp_path / "t.toml"
    place.write_text(
        "[camera]\nscale = { value = 1.0, sd = 0.01 }\nclock = 0.999\ntilt = { value = 0, sd = 0.005 }\n"
        "court_height = { value = -0.002, sd = 0.003 }\nfps = 240\nmm_per_px = 0.8\nrow_time = 1.5e-5\n"
    )
    camera = load_scene(None, place).camera
    assert camera == Camera(
        Quantity(1.0, 0.01), Quantity(0.999), Quantity(0.0, 0.005), Quantity(-0.002, 0.003), 240.0, 0.8, 1.5e-5
    )
    place.write_text("[surface]\nname = 'clay'\n")
    assert load_scene(None, place).camera is None


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("scale = 1.5", "camera.scale = 1.5 is unlikely: 0.8 to 1.25 are usual"),
        ("scale = { value = 1, sd = 1 }", "camera.scale: sd = 1 is unlikely: up to 0.2 is usual; did you mean 1 %"),
        (
            "tilt = 0.1",
            "camera.tilt = 0.1 is unlikely: -0.0524 to 0.0524 are usual; did you mean 0.1 deg (0.001745)?",
        ),
        ("tilt = { value = 0, sd = 0.1 }", "camera.tilt: sd = 0.1 is unlikely"),
        ("court_height = 0.1", "camera.court_height = 0.1 is unlikely: -0.03 to 0.03 are usual; did you mean 0.1 cm"),
        ("court_height = { value = 0, sd = 0.05 }", "camera.court_height: sd = 0.05 is unlikely"),
        ("fps = 0.5e8", "camera.fps"),
        ("mm_per_px = 0.0008", "camera.mm_per_px = 0.0008 is unlikely: 0.001 to 20 are usual; did you mean 0.0008 m"),
    ],
)
def test_an_unlikely_camera_is_asked_about(text: str, words: str, tmp_path: Path) -> None:
    assert words in refused(tmp_path, f"[camera]\n{text}")
