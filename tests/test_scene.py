"""Scenes: read and written without loss, limits with the unit that was meant, the first fault that
says most.
"""

import pickle
import tomllib

import msgspec
import numpy as np
import pytest
from made_tables import written
from numpy.testing import assert_array_equal

from fitball.base.columns import COLUMNS
from fitball.base.errors import InputError
from fitball.base.values import Ball
from fitball.data.bundled import descriptions, path_of_source
from fitball.data.read import load_table
from fitball.data.scene import BallSection, CameraSection, Scene, ValueWithSd, load_scene

FULL = """
contact_time = { value = 5e-3, sd = 5e-4 }
surface = { name = "clay", court = "centre", mu = { value = 0.7, sd = 0.1 } }
air = { temperature = 30, pressure = 95000, density = 1.1 }
flight = { drag = { value = 0.55, sd = 0.05 }, lift = -0.1, spin_sd = 250 }
model = { name = "two-mass+offset=grip" }
prior = { mu = "literature:clay" }
fix = { cor_10 = 0.8 }
pool = { mu = "surface" }
columns = { v_1 = "Vin [mph]" }
laboratory = { name = "Court laboratory", date = 2026-05-31 }
source = { description = "All keys" }
[ball]
mass = { value = 0.0577, sd = 0.0002 }
radius = 0.0331
inertia = { value = 3.6e-5, sd = 4e-7 }
temperature = 21
type = "type-1"
[measurement]
velocity_sd = 0.1
nominal_spin_sd = 8
gap_turn_sd = 0.02
noise = "student-t"
ignore = ["omega_2"]
flip = ["theta_1"]
[camera]
scale = { value = 1, sd = 0.01 }
clock = 0.999
tilt = { value = 0, sd = 0.005 }
court_height = { value = -0.002, sd = 0.003 }
fps = 240
mm_per_px = 0.8
y = "down"
angles = "clockwise"
court = 0.76
fold = 2
lasting = 0.0005
row_time = 1.5e-5
"""


def scene_of(tmp_path, text):
    return load_scene(None, written(tmp_path, text, "t.toml"))


def refused(make):
    """Message of each fault by its key."""
    with pytest.raises(InputError) as caught:
        make()
    assert {fault.code for fault in caught.value.faults} == {"scene"}
    assert len(str(caught.value)) < 1000
    return {fault.column: fault.message for fault in caught.value.faults}


def test_every_key_is_read_and_written_without_loss(tmp_path):
    scene = scene_of(tmp_path, FULL)
    tree = msgspec.to_builtins(scene)
    for name in ("ignore", "flip"):
        tree["measurement"][name] = [*tree["measurement"][name]]
    assert tree == tomllib.loads(FULL.replace("2026-05-31", '"2026-05-31"'))
    for form in (msgspec.toml, msgspec.json):
        assert form.decode(form.encode(scene), type=Scene) == scene
    assert pickle.loads(pickle.dumps(scene)) == scene == scene_of(tmp_path, "\ufeff" + FULL)
    assert scene.camera.scale == ValueWithSd(1.0, 0.01)
    assert scene.assumed() == ()


def test_bundled_scenes_are_read():
    for kind in ("", "tracks"):
        for name, description in descriptions(kind).items():
            scene = load_scene(path_of_source(name, kind))
            place = path_of_source(name, kind).with_suffix(".toml")
            assert scene.source["description"] == description
            assert msgspec.to_builtins(scene) == tomllib.loads(place.read_text(encoding="utf-8"))
    wang = load_scene(path_of_source("wang_all"))
    assert wang.ball_value() == Ball(0.0576, 0.03302, 0.56)
    assert wang.ball_sd() == {}
    assert wang.assumed() == ()
    assert wang.surface["mu"] == ValueWithSd(0.55, 0.05)
    assert wang.contact_time == ValueWithSd(5e-3, 5e-4)
    assert wang.measurement == {"nominal_velocity_sd": 0.25, "nominal_spin_sd": 10.0}
    assert load_scene(path_of_source("synthetic_gaps")).ball_sd() == {
        "mass": 1e-4,
        "radius": 1e-4,
        "inertia_ratio": 3e-3,
    }


def test_where_a_scene_comes_from(tmp_path):
    table = tmp_path / "t.csv"
    assert load_scene(table) == load_scene(None) == load_scene(table, "") == Scene()
    assert {note.code for note in Scene().assumed()} == {
        "assumed-ball",
        "no-friction",
        "no-contact-time",
        "no-velocity-noise",
        "no-spin-noise",
    }
    assert "no-velocity-noise" not in {
        note.code for note in Scene(measurement={"nominal_v_x_sd": 0.1}).assumed()
    }
    (tmp_path / "other.toml").write_text("[surface]\nmu = 0.5")
    table.with_suffix(".toml").write_text("[surface]\nmu = 0.6")
    assert load_scene(table).surface == {"mu": 0.6}
    for scene in (
        load_scene(table, tmp_path / "other.toml"),
        load_scene(str(tmp_path / "other.toml")),
    ):
        assert scene.surface == {"mu": 0.5}
    # What is beside the table and no file is not passed over.
    table.with_suffix(".toml").unlink()
    table.with_suffix(".toml").symlink_to("nowhere")
    # One that never ends is read to a limit.
    (tmp_path / "large.toml").write_text("#" * 1_000_001)
    for path in (None, tmp_path / "absent.toml", tmp_path / "large.toml", tmp_path):
        assert [*refused(lambda path=path: load_scene(table, path))] == [None]


def test_columns_that_a_scene_flips_or_ignores():
    plain = load_table("wang_topspin")
    turned = load_table(
        "wang_topspin",
        scene=Scene(measurement={"flip": ("omega_1",), "ignore": ("omega_2",)}),
    )
    assert_array_equal(turned.values["omega_1"], -plain.values["omega_1"])
    assert {*plain.values} - {*turned.values} == {"omega_2"}


def test_an_inertia_is_one_of_the_ratio():
    ball = Scene(ball=BallSection(0.05, 0.03, inertia=ValueWithSd(2.25e-5, 4.5e-7)))
    assert ball.ball_value().inertia_ratio == pytest.approx(0.5, rel=1e-15)
    assert ball.ball_sd() == {"inertia_ratio": pytest.approx(0.01, rel=1e-14)}


# What was written, the key at fault, and the unit that may have been meant.
WRONG = [
    ("[ball]\nmass = 57.7", "ball.mass", "57.7 g?"),
    ("[ball]\nmass = { value = 57.7, sd = 0.3 }", "ball.mass", "57.7 g?"),
    ("[ball]\nmass = { value = 0.0577, sd = 0.3 }", "ball.mass", "0.3 g?"),
    ("[ball]\nmass = 2.7\nradius = 0.02", "ball.mass", "2.7 g?"),
    ("[ball]\nradius = 3.3", "ball.radius", "3.3 mm or 3.3 cm?"),
    ("[ball]\ninertia = 350", "ball.inertia", "350 g cm^2?"),
    ("[contact_time]\nvalue = 5\nsd = 0.5", "contact_time", "5 ms?"),
    ("[measurement]\nnominal_spin_sd = 2000", "measurement.nominal_spin_sd", "2000 rpm?"),
    ("[camera]\ntilt = -2", "camera.tilt", "-2 deg?"),
    ("[camera]\ncourt_height = { value = 0, sd = 3 }", "camera.court_height", "3 mm or 3 cm?"),
    ("[air]\npressure = 1013", "air.pressure", "1013 hPa?"),
    ("[bal]\nmass = 1", "bal", "'ball'"),
    ("[ball]\nmas = 1", "ball.mas", "'mass'"),
    ("[measurement]\nspin = 1", "measurement.spin", "'spin_sd'"),
    ("[surface]\nfriction = 1", "surface.friction", "mu"),
    ("ball = 3", "ball", ""),
    ("prior = 3", "prior", ""),
    ("contact_time = 0.005", "contact_time", ""),
    ("[contact_time]\nvalue = 0.005", "contact_time", ""),
    ("[ball]\nmass = -1", "ball.mass", ""),
    ("[ball]\nmass = nan", "ball.mass", ""),
    ("[ball]\nmass = 1" + 400 * "0", "ball.mass", ""),
    ("[ball]\nmass = true", "ball.mass", ""),
    ('[ball]\nmass = "57 g"', "ball.mass", ""),
    ("[ball]\nmass = { value = 0.057, sd = 0 }", "ball.mass", ""),
    ("[ball]\nmass = { value = 0.057, sd = 1e-300 }", "ball.mass", ""),
    ("[ball]\nmass = { value = 0.057, sd = 0.001, unit = 1 }", "ball.mass", ""),
    ("[ball]\nradius = 0.33", "ball.mass", ""),
    ("[ball]\ninertia = 1", "ball.inertia", ""),
    ("[ball]\ninertia = 3e-5\ninertia_ratio = 0.5", "ball.inertia", ""),
    ('[ball]\ntype = "type-5"', "ball.type", "'type-"),
    ("[measurement]\nspin_sd = 1\nnominal_spin_sd = 1", "measurement.spin_sd", ""),
    ("[measurement]\nvelocity_sd = 0.0", "measurement.velocity_sd", ""),
    ("[measurement]\nignore = 'omega_2'", "measurement.ignore", ""),
    ("[measurement]\nignore = [3]", "measurement.ignore", ""),
    ("[surface]\nname = 3", "surface.name", ""),
    ("[camera]\nfps = { value = 240, sd = 1 }", "camera.fps", ""),
    ("[camera]\nfold = 2.5", "camera.fold", ""),
    ("[prior]\ncor_10 = 'normal(0.7, 0.1)'\nmu = 0.5", "prior.mu", ""),
    ("[fix]\nmu = inf", "fix.mu", ""),
    ("[model]\nclosures = { normal = 3 }", "model.closures", "name"),
    ("[ball]\nmass = \n", None, ""),
    ("x = " + "[" * 5000, None, ""),
    ("x = " + "9" * 5000, None, ""),
    (b"# caf\xe9\n", None, ""),
]


@pytest.mark.parametrize(("text", "key", "hint"), WRONG)
def test_what_no_scene_holds_is_refused_at_its_key_with_what_may_be_meant(
    tmp_path,
    text,
    key,
    hint,
):
    ((faulty, message),) = refused(lambda: scene_of(tmp_path, text)).items()
    assert faulty == key
    assert hint in message if hint else "did you mean" not in message


def test_every_fault_is_named_at_once(tmp_path):
    text = "[bal]\nmass = 1\n[ball]\nmas = 1\nmass = 57.7\n[surface]\nmu = '0.5'"
    assert [*refused(lambda: scene_of(tmp_path, text))] == [
        "bal",
        "ball.mas",
        "ball.mass",
        "surface.mu",
    ]


@pytest.mark.parametrize(
    ("parts", "key"),
    [
        ({"ball": BallSection(mass=ValueWithSd(0.0577, -0.1))}, "ball.mass"),
        ({"measurement": {"velocty_sd": 1.0}}, "measurement.velocty_sd"),
        ({"camera": CameraSection(scale=50.0)}, "camera.scale"),
    ],
)
def test_a_scene_made_in_python_has_the_same_limits(parts, key):
    assert [*refused(lambda: Scene(**parts))] == [key]


def test_sections_of_a_scene_made_in_python_may_be_dicts():
    scene = Scene(
        ball={"mass": {"value": 0.0577, "sd": 0.0002}},
        camera={"fps": 240.0, "tilt": {"value": 0.0, "sd": 0.005}},
        surface={"mu": {"value": 0.7, "sd": 0.1}},
    )
    assert scene == Scene(
        ball=BallSection(mass=ValueWithSd(0.0577, 0.0002)),
        camera=CameraSection(fps=240.0, tilt=ValueWithSd(0.0, 0.005)),
        surface={"mu": ValueWithSd(0.7, 0.1)},
    )
    assert [*refused(lambda: Scene(camera={"fold": 1.5}))] == ["camera.fold"]
    assert [*refused(lambda: Scene(camera={"frames": 240.0}))] == ["camera.frames"]


def test_every_noise_of_the_registry_may_be_held_or_nominal():
    for column in COLUMNS.values():
        if column.noise:
            middle = float(np.sqrt(column.noise.lower * column.noise.upper))
            for prefix in ("", "nominal_"):
                assert Scene(measurement={prefix + column.noise.name: middle}).measurement
