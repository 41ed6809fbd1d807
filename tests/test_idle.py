"""What a scene states and a verb does not use is said, with its section and key."""

import re

import msgspec
import pytest
from support.fit_by_hand import table_of

import fitball
from fitball.data.scene import CameraSection

DROPS = {"v_y1": [7.0, 7.1, 7.0, 6.9], "v_y2": [5.2, 5.25, 5.19, 5.12]}
FALLS = {"drop_height [cm]": [254.0, 250.0, 254.0], "rebound_height [cm]": [140.0, 138.0, 141.0]}
KEY = re.compile(r"\[\w+\](?: (?!of\b|and\b)\w+)?")


def idle_of(notes):
    """The keys that notes call not used."""
    texts = [note.text for note in notes if note.code == "scene-not-used"]
    return {key for text in texts for key in KEY.findall(text)}


OBLIQUE = {
    name: column.tolist() for name, column in table_of(8).items() if name.startswith(("v", "o"))
}
AIR = {"air": {"density": 1.1}, "flight": {"drag": 0.6}}
CASES = {
    "air of speeds along the court": (OBLIQUE, AIR, {"[air] density", "[flight] drag"}),
    "air of a drop test": (DROPS, AIR, set()),
    "air of heights": (FALLS, AIR, set()),
    "lift": (
        FALLS,
        {"flight": {"lift": 0.1, "spin_sd": 9.0}},
        {"[flight] lift", "[flight] spin_sd"},
    ),
    "camera of a film": (
        OBLIQUE,
        {"camera": {"fps": 240.0, "y": "down", "scale": {"value": 1.0, "sd": 0.01}}},
        {"[camera] fps", "[camera] y"},
    ),
}
OF_FITS = {
    "friction of drops": (DROPS, {"surface": {"mu": 0.6}}, {"[surface] mu"}),
    "spin that was not measured": (
        DROPS,
        {"measurement": {"spin_sd": 9.0}},
        {"[measurement] spin_sd"},
    ),
    "noise that counts": (DROPS, {"measurement": {"v_y_sd": 0.1, "velocity_sd": 0.1}}, set()),
    "stiffness": (
        OBLIQUE,
        {"prior": {"k_theta": "normal(100, 10)", "mu": "normal(0.6, 0.1)"}},
        {"[prior] k_theta"},
    ),
    "held": (OBLIQUE, {"fix": {"mass_ratio": 0.8, "e_x": 0.0}}, {"[fix] mass_ratio"}),
    "contact time": (OBLIQUE, {"contact_time": {"value": 5e-3, "sd": 1e-3}}, {"[contact_time]"}),
}


@pytest.mark.parametrize("case", CASES)
def test_check_and_fit_say_what_they_do_not_use(case):
    columns, stated, idle = CASES[case]
    scene = msgspec.convert(stated, fitball.Scene)
    assert idle_of(fitball.check(columns, scene=scene).notes) == idle
    fit = fitball.calibrate(columns, scene=scene, model="grip-slip", point_only=True, cores=1)
    assert idle_of(fit.notes) == idle


@pytest.mark.parametrize("case", OF_FITS)
def test_fits_say_what_their_model_does_not_use(case):
    columns, stated, idle = OF_FITS[case]
    scene = msgspec.convert(stated, fitball.Scene)
    assert not idle_of(fitball.check(columns, scene=scene).notes)
    fit = fitball.calibrate(columns, scene=scene, model="grip-slip", point_only=True, cores=1)
    assert idle_of(fit.notes) == idle


def test_compare_says_what_none_of_its_models_uses():
    stated = {"prior": {"e_x": "normal(0, 0.3)"}, "model": {"name": "two-mass"}, **AIR}
    options = {"scene": msgspec.convert(stated, fitball.Scene), "cores": 1}
    compared = fitball.compare(OBLIQUE, models="brody,grip-slip", **options)
    assert idle_of(compared.notes) == {"[air] density", "[flight] drag", "[model] name"}


def test_a_film_says_what_it_does_not_use_and_hands_on_what_fits_use():
    camera = {"fps": 180.0, "mm_per_px": 1.0, "fold": 2}
    scene = fitball.load_scene(None, "datasets/tracks/table_tennis_topspin.toml")
    section = msgspec.convert(camera, CameraSection)
    stated = msgspec.structs.replace(scene, camera=section)
    film = fitball.track("table_tennis_topspin", scene=stated)
    assert idle_of(film.notes) == {"[camera] mm_per_px", "[camera] fold"}
    of_impacts = film.scene.camera
    assert (of_impacts.fps, of_impacts.mm_per_px, of_impacts.fold) == (None, None, 1)
    assert of_impacts.scale.sd == 0.01
    # Predictions of drop heights need the drag, so that it stays.
    assert idle_of(fitball.check(film.impacts, scene=film.scene).notes) == {"[flight] drag"}
