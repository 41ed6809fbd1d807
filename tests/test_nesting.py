"""Models that contain others: they predict the same at the same values, and may fit no table worse."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from samples import GRIP_SLIP, TWO_MASS, hard_sphere, problem_of

from fitball.data.read import load_table
from fitball.data.scene import load_scene
from fitball.inference import calibrate
from fitball.inference.comparison.candidates import build_candidates
from fitball.inference.comparison.compare import _status, as_container, compare, overtaken
from fitball.inference.comparison.results import Criteria
from fitball.inference.effort import Effort
from fitball.inference.point.least_squares import least_squares
from fitball.inference.point.point_fit import maximum_posterior, point_fit
from fitball.inference.problem.build import Choices, build_problem
from fitball.inference.results.results import RunStatus
from fitball.scheduling.engine import engine

BRODY = {name: GRIP_SLIP[name] for name in ("mu", "cor_10", "cor_slope", "velocity_sd", "spin_sd")}
MEAN = {name: value for name, value in TWO_MASS.items() if name != "cor_slope"}


def wang(model, **closures):
    return problem_of("wang_zero_spin.csv", model, closures=closures)


@pytest.mark.parametrize(
    ("wide", "narrow", "values"),
    [
        (("grip-slip", {}), ("brody", {}), BRODY),
        (("two-mass", {}), ("two-mass", {"cor": "mean"}), MEAN),
        (("two-mass", {"inertia": "table"}), ("two-mass", {}), TWO_MASS),
        (("two-mass", {"inertia": "table"}), ("two-mass", {"cor": "mean"}), MEAN),
    ],
)
def test_a_container_predicts_what_it_contains(wide, narrow, values):
    container, contained = wang(wide[0], **wide[1]), wang(narrow[0], **narrow[1])
    found = as_container(container, contained, values)
    assert found is not None and set(found) >= set(container.free_names)
    one, other = container.rebound(container.free_rows([found])), contained.rebound(contained.free_rows([values]))
    for name in ("v_x2", "v_y2", "omega_2"):
        np.testing.assert_allclose(getattr(one, name), getattr(other, name), rtol=1e-12)
    assert as_container(contained, container, found) is None


def test_models_that_contain_each_other_in_part_only_are_left_alone():
    default = wang("two-mass")
    for other in (
        wang("grip-slip"),
        wang("two-mass", normal="inner"),
        wang("two-mass", torsion="free"),
        wang("two-mass", offset="grip", cor="mean"),
    ):
        assert as_container(default, other, TWO_MASS | GRIP_SLIP) is None
    # Values beyond the bounds of the container are none of its.
    assert as_container(wang("grip-slip"), wang("brody"), BRODY | {"mu": 5.5}) is None
    fixed = build_problem(
        load_table("wang_zero_spin.csv"),
        load_scene("wang_zero_spin.csv"),
        Choices(model="grip-slip", fix={"e_x": 0.2}),
    )
    assert as_container(fixed, wang("brody"), BRODY) is None


def score(name, problem, values, log_likelihood=None):
    point = maximum_posterior(problem, problem.free_rows([values]))
    squares = SimpleNamespace(values=point.values)
    criteria = None if log_likelihood is None else Criteria(log_likelihood, 1, 1)
    return SimpleNamespace(
        name=name, fit=SimpleNamespace(problem=problem, point=point, least_squares=squares), criteria=criteria
    )


def test_who_fits_worse_than_what_it_contains_is_overtaken():
    brody = score("brody", wang("brody"), BRODY, -30.0)
    wide = score("grip-slip", wang("grip-slip"), GRIP_SLIP, -20.0)
    assert overtaken(wide, [brody, wide]) == overtaken(brody, [brody, wide]) == {}
    lower = replace(wide.fit.point, log_posterior=brody.fit.point.log_posterior - 50.0)
    stuck = SimpleNamespace(
        name="grip-slip", criteria=None, fit=SimpleNamespace(**{**vars(wide.fit), "point": lower})
    )
    (starts,) = overtaken(stuck, [brody, stuck]).values()
    assert starts[0]["e_x"] == 0.0 and starts[0]["mu"] == brody.fit.point.values["mu"]
    # A lower maximum of the likelihood without priors is an alarm by itself.
    wide.criteria = Criteria(-31.0, 1, 1)
    assert overtaken(wide, [brody, wide]).keys() == {"brody"}
    wide.criteria = Criteria(-30.01, 1, 1)
    assert overtaken(wide, [brody, wide]) == {}


@pytest.fixture
def stuck(monkeypatch, tmp_path):
    """Compare brody and grip-slip on a hard sphere where the search of grip-slip ends on the plateau; `heed` says
    whether it evidence beside, where it is told to.
    """
    place = SimpleNamespace(heed=True)
    problem = hard_sphere(tmp_path, "grip-slip")
    plateau = {"mu": 0.6, "e_x": -0.45, "offset": 9.1e-4, "cor_10": 0.91, "cor_slope": -0.01}
    plateau |= {"velocity_sd": 0.12, "spin_sd": 17.0}

    def ends_low(given, rng, beside=()):
        if given.model.name != "grip-slip" or (beside and place.heed):
            return point_fit(given, rng, beside)
        return least_squares(given, given.free_rows([plateau])), maximum_posterior(given, given.free_rows([plateau]))

    monkeypatch.setattr(calibrate, "point_fit", ends_low)
    monkeypatch.setattr(calibrate, "search_again", lambda _problem, squares, point, _sampled: (squares, point, ()))
    monkeypatch.setattr("fitball.inference.comparison.compare.make_folds", lambda _table, _rng: ((), []))
    monkeypatch.setattr("fitball.inference.comparison.compare.criteria", lambda _problem, _starts: None)
    candidates = build_candidates(problem.table, problem.scene, ("brody", "grip-slip"))
    effort = Effort(seed=2, max_steps=100, ensembles=2, ess=100.0, cores=1)
    place.compare = lambda: compare(problem.table, candidates, effort, engine(1), quick=True)
    return place


def test_a_model_that_lost_to_what_it_contains_is_searched_again(stuck):
    found = stuck.compare()
    assert found.by_name["grip-slip"].fit.point.log_posterior > 6.8
    assert found.notes[0].startswith("grip-slip contains brody")
    assert not any(note.startswith("ALARM") for note in found.notes)


def test_a_model_that_loses_even_so_is_an_alarm(stuck):
    stuck.heed = False
    found = stuck.compare()
    assert found.notes[0].startswith("ALARM: grip-slip contains brody")
    assert found.status is RunStatus.NOT_CONVERGED
    done = SimpleNamespace(fit=SimpleNamespace(status=RunStatus.CONVERGED), loo=SimpleNamespace(unsettled=()))
    assert _status([done, done], []) is RunStatus.CONVERGED
    assert _status([done, done], ["ALARM"]) is RunStatus.NOT_CONVERGED
