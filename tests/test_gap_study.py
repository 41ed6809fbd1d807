"""The study of films with gaps between the flights: a small one, its prediction to first order, and its verdict."""

import copy

import numpy as np
import pytest
import synthetic_gaps as films
from validation import gaps as study
from validation.command import main

# The first is of 21 rows, with all controls and verdicts.
NUMBERS = (0, 5, 6, 7, 9)


@pytest.fixture(scope="module")
def made():
    """Five films, fitted."""
    return [study.replicate(1, number) for number in NUMBERS]


def fits(made, name):
    return [row for one in made for row in one if row["fit"] == name]


def test_intervals_of_five_films_contain_the_truth_and_are_as_wide_as_first_order_says(made):
    sound = fits(made, study.FITTED)
    assert len(sound) == 5 and not any(row["failed"] for one in made for row in one)
    found = [item for row in sound for item in row["found"].values()]
    assert sum(item["inside"][1] for item in found) >= 0.85 * len(found)
    assert 0.25 * len(found) < sum(item["inside"][0] for item in found) < 0.75 * len(found)
    ratios = [item["sd"] / item["expected"] for item in found]
    assert min(ratios) > 0.7 and max(ratios) < 1.5 and np.median(ratios) == pytest.approx(1.0, abs=0.1)
    # Of the stiffness, as a share: gaps that are three times worse are 21 rows' second case.
    assert sound[0]["found"]["k_y"]["sd"] < 0.06
    assert [sound[0]["verdicts"][name] for name in ("k_y", "k_theta")] == ["identified", "identified"]


@pytest.mark.parametrize("name", [study.HEIGHT, study.PRESSED])
def test_a_wrong_height_and_a_gap_that_ends_at_release_miss_k_y_as_predicted(made, name):
    (row,) = fits(made, name)
    found, (bias, share) = row["found"]["k_y"], row["predicted"]["k_y"]
    assert bias > 4.0 and share < 0.05 and not found["inside"][1]
    right = fits(made, study.FITTED)[0]["found"]["k_y"]["z"]
    assert found["z"] == pytest.approx(bias + right, abs=0.3 * bias + 1.0)


def test_without_covariances_less_is_promised_than_is_kept(made):
    for row in fits(made, study.ALONE):
        shares = {key: row["predicted"][key][1] for key in row["found"]}
        assert shares["court_height"] < 0.92 and shares["k_y"] < 0.94
        assert all(abs(row["predicted"][key][0]) < 1e-9 for key in shares)


def test_first_order_has_the_derivatives_of_the_camera_and_of_the_bounce():
    film = study.made_film(21, 1.0, np.random.default_rng(3))
    own = len(films.INCIDENT)
    moved = study.pictured(film, court_height=1e-3) - study.pictured(film)
    lower = study._higher(film, 1e-3)
    for place, name in enumerate(films.SCATTER):
        np.testing.assert_allclose(moved[:, own + place], -lower.get(name, 0.0), atol=1e-12)
    # A scale that is too small by a thousandth shows lengths and speeds that are larger.
    clear = study.pictured(film, scale=1e-3) / study.pictured(film)
    assert np.all(clear[:, :own] == 1.0) and np.median(clear[:, own + 4]) < 1.0
    right = study.FirstOrder.from_film(film, film.errors)
    worse = study.FirstOrder.from_film(film, 9.0 * film.errors)
    assert all(worse.sds[name] > right.sds[name] for name in right.names)
    assert right.width(right) == pytest.approx(dict.fromkeys(right.names, 1.0))
    held = study.FirstOrder.from_film(film, film.errors, ("court_height",))
    assert "court_height" not in held.names and held.sds["k_y"] < right.sds["k_y"]


def test_residuals_scatter_as_first_order_says():
    """Three hundred films of the same impacts: what is measured less what the bounce gives for measured incidence."""
    film = study.made_film(21, 1.0, np.random.default_rng(3))
    rng, exact, own = np.random.default_rng(4), study.pictured(film), len(films.INCIDENT)
    scatter = {name: film.truth[study.NOISE_OF[name]] for name in films.SCATTER}
    white = np.linalg.inv(np.linalg.cholesky(study.FirstOrder.from_film(film, film.errors).rest))
    found = []
    for _ in range(300):
        values, _errors = films.film(film.impacts, film.own, film.camera, scatter, rng)
        off = dict(zip(films.INCIDENT, (values - exact)[:, :own].T, strict=True))
        found.append(np.einsum("kij,kj->ki", white, (values - study.pictured(film, **off))[:, own:]))
    squares = np.concatenate(found).T @ np.concatenate(found) / (300 * 21)
    assert np.abs(squares - np.eye(6)).max() < 5.0 * np.sqrt(2.0 / (300 * 21))


def test_shares_that_hold_by_bias_and_width():
    assert study.held_share(0.0) == pytest.approx(0.95)
    assert study.held_share(0.0, 0.5) == pytest.approx(0.6729, abs=1e-4)
    assert study.held_share(1.959964) == pytest.approx(0.5, abs=1e-4)
    assert study.held_share(-3.0) == pytest.approx(study.held_share(3.0)) and study.held_share(8.0) < 1e-6


def counted(films_in_all=80, inside=(0.5, 0.95), ratio=1.0, control=0.0, promised=0.0):
    """Records of films of which so many intervals contain the truth, and of controls."""

    def found(share, k):
        hit = [bool(k < level * films_in_all) for level in share]
        return {name: {"z": 0.0, "sd": ratio, "expected": 1.0, "inside": hit} for name in study.COUNTED}

    records = []
    for k in range(films_in_all):
        case = k % len(study.CASES)
        order = (k * 37) % films_in_all
        row = {"case": case, "fit": study.FITTED, "failed": "", "found": found(inside, order)}
        row["verdicts"] = dict.fromkeys(study.COUNTED, "identified")
        wrong = {"case": case, "fit": study.PRESSED, "failed": "", "found": found((control, control), order)}
        wrong["predicted"] = dict.fromkeys(study.COUNTED, (5.0, promised))
        records.append([row, wrong])
    return records


def twisted(records, slope):
    """Those with a control that loses the twist: its fits shift by so much of what is predicted."""
    made = copy.deepcopy(records)
    for k, one in enumerate(made):
        row = {**copy.deepcopy(one[0]), "fit": study.TWIST}
        row["predicted"] = dict.fromkeys(study.COUNTED, (k % 5 - 2.0, 0.8))
        for name, item in row["found"].items():
            item["z"] = slope * row["predicted"][name][0] + 0.05 * ((k * 7) % 3 - 1.0)
        one.append(row)
    return made


def test_the_verdict_asks_for_coverage_widths_verdicts_and_controls_that_fail_as_predicted():
    def holds(records):
        return study.judge(records, 1).content["holds"]

    good = counted()
    assert holds(good)
    assert not holds(counted(inside=(0.5, 0.8))) and not holds(counted(inside=(0.75, 0.95)))
    assert not holds(counted(ratio=1.3))
    # A control that holds, and one that fails less or more than it should.
    assert not holds(counted(control=0.95, promised=0.95)) and not holds(counted(control=0.0, promised=0.6))
    unsure, failing = copy.deepcopy(good), copy.deepcopy(good)
    for one in unsure:
        one[0]["verdicts"]["k_y"] = "prior-dominated"
    for one in failing[:10]:
        one[0]["failed"] = "no maximum"
    assert not holds(unsure) and not holds(failing)
    # A lost twist moves the fits, as it should and not the other way round.
    assert holds(twisted(good, 0.5)) and not holds(twisted(good, 0.0)) and not holds(twisted(good, -0.5))
    assert not holds(twisted(good, 1.4))
    text = study.judge(good, 1).text
    assert "press-in left out" in text and "k_y" in text and "identified 80" in text


def test_a_number_of_films_that_cannot_be_is_refused(capsys):
    assert main(["--gaps", "--replicates", "0"]) == 2
    assert "replicates = 0" in capsys.readouterr().err
