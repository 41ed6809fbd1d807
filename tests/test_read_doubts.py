"""What impacts can be: what is allowed, doubted, turned, and refused with what may be meant."""

import numpy as np
import pandas as pd
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from support import misread
from support.impact_rows import HEAD, ROWS, codes, written

import fitball
from fitball.base.errors import InputError
from fitball.data.check import check
from fitball.data.load import load_data

POSSIBLE = {
    "a ball bounces back": ("3,10,-500,-3,4,-200", ""),
    "strong topspin speeds a ball up": ("10,2,600,12,1.5,400", ""),
    "a shell stores what a solid ball could not": ("12,5,0,9,4,346", ""),
    "the spin of a shell is worth as much as it gains": ("10,2,600,12,1.5,538", ""),
    # Kharaz, Gorham and Salman (2001): alumina spheres on glass, as printed; a table-tennis ball.
    "alumina": (
        "0.6434,3.8466,0,0.4327,3.8081,225.8",
        "mass = 2.618e-4\nradius = 2.5e-3\ninertia_ratio = 0.4",
    ),
    "table tennis": ("8,3,0,2.56,2.5,408", "mass = 2.7e-3\nradius = 0.02\ninertia_ratio = 0.6666"),
}


@pytest.mark.parametrize("name", POSSIBLE)
def test_what_balls_can_do_is_no_fault(tmp_path, name):
    row, ball = POSSIBLE[name]
    path = written(tmp_path, HEAD, row, row)
    if ball:
        with pytest.raises(InputError) as caught:
            fitball.load_table(path)
        assert [fault.code for fault in caught.value.faults] == ["energy", "energy"]
        path.with_suffix(".toml").write_text(f"[ball]\n{ball}\n", encoding="utf-8")
    assert codes(fitball.load_table(path)) == ["repeated-rows"]


@pytest.mark.parametrize(
    ("sd", "scene", "fault"),
    [
        ("0.05", "", False),
        ("0.002", "", True),
        ("", "", False),
        ("", "v_y_sd = 0.003", True),
        ("", "nominal_v_y_sd = 0.003", True),
        ("", "velocity_sd = 0.003", True),
    ],
)
def test_noise_decides_what_is_too_fast(tmp_path, sd, scene, fault):
    """0.82 after 0.80 m/s: within the stated, known or expected noise (0.25 m/s), or beyond five
    sd.
    """
    cells, head = (f",{sd}", "v_y1,v_y1_sd,v_y2,v_y2_sd") if sd else ("", "v_y1,v_y2")
    path = written(
        tmp_path,
        head,
        *(f"{v_y1}{cells},{v_y2}{cells}" for v_y1, v_y2 in ((0.8, 0.82), (5, 4), (6, 4.7))),
    )
    (tmp_path / "t.toml").write_text(f"[measurement]\n{scene}\n" if scene else "", encoding="utf-8")
    if not fault:
        assert fitball.load_table(path).notices == ()
        return
    with pytest.raises(InputError) as caught:
        fitball.load_table(path)
    assert [(fault.code, fault.row, fault.column) for fault in caught.value.faults] == [
        ("restitution", 1, "v_y2")
    ]


def simulated(rows, sd=0.3, seed=5):
    rng = np.random.default_rng(seed)
    speed = rng.uniform(5.0, 35.0, rows)
    angle = np.radians(rng.uniform(15.0, 70.0, rows))
    state = speed * np.cos(angle), speed * np.sin(angle), rng.uniform(-200.0, 300.0, rows)
    after = misread.bounce(*state, misread.TENNIS, (0.6, 0.1, 2e-3, 0.78, -0.012))
    noise = rng.normal(size=(3, rows)) * [[sd], [sd], [10.0]]
    return pd.DataFrame(dict(zip(HEAD.split(","), (*state, *(after + noise)), strict=True)))


def test_twenty_thousand_impacts_are_read_though_noise_lifts_some_above_their_bounds():
    frame = simulated(20_000)
    frame = frame[frame["v_y2"] > 0.0]
    assert (frame["v_y2"] > frame["v_y1"]).sum() > 50
    table = fitball.load_table(frame)
    assert len(table) == len(frame)
    assert table.notices == ()


@pytest.mark.parametrize(
    ("exchanged", "factors"),
    [
        ("v_x1 v_y2 omega_1 v_x2 v_y1 omega_2", {}),
        ("v_x2 v_y2 omega_2 v_x1 v_y1 omega_1", {}),
        (HEAD.replace(",", " "), {"v_x2": 3.6}),
        (HEAD.replace(",", " "), {"omega_2": 30.0 / np.pi}),
    ],
)
def test_swapped_columns_and_wrong_units_are_refused_with_what_may_be_meant(exchanged, factors):
    frame = simulated(40, 0.1).set_axis(exchanged.split(), axis="columns")
    with pytest.raises(InputError) as caught:
        load_data(
            frame.assign(**{name: frame[name] * factor for name, factor in factors.items()}),
            None,
            False,
        )
    assert {fault.code for fault in caught.value.faults} <= {"restitution", "energy", "misread"}
    # Nobody measures one component of two in another unit.
    assert bool(caught.value.hints) == ("v_x2" not in factors)


def test_faults_that_no_reading_mends_bring_no_hint():
    frame = simulated(30, 0.1)
    frame.loc[3, "v_y2"] = 40.0
    with pytest.raises(InputError) as caught:
        fitball.load_table(frame)
    assert caught.value.hints == ()
    assert {fault.row for fault in caught.value.faults} == {4}


def test_slow_impacts_swapped_are_found_together():
    """Each is within the expected noise of 0.25 m/s."""
    slow = {
        "v_y1": np.round(0.8 * np.linspace(1.0, 4.0, 20), 2),
        "v_y2": np.round(np.linspace(1.0, 4.0, 20), 2),
    }
    with pytest.raises(InputError) as caught:
        load_data(slow, None, False)
    assert [fault.code for fault in caught.value.faults] == ["misread"]


@pytest.mark.parametrize(
    ("head", "rows", "name"),
    [
        ("v_x1,v_y1,v_x2,v_y2", ("10,6,7,-4", "10,6,8,-5"), "v_y2"),
        ("v_1,theta_1,v_y2", ("10,-30,4", "10,-40,5"), "theta_1"),
        ("v_x1,v_y1,v_2,theta_2", ("10,6,8,-30", "10,6,9,-35"), "theta_2"),
    ],
)
def test_what_is_counted_downward_is_turned_once(tmp_path, head, rows, name):
    up = fitball.load_table(written(tmp_path, head, *(row.replace("-", "") for row in rows)))
    down = fitball.load_table(written(tmp_path, head, *rows))
    assert_array_equal(down.values[name], up.values[name])
    assert codes(down) == ["turned"]
    assert codes(up) == []


def test_flips_turn_values_and_correlations():
    rows = {
        name: [float(row.split(",")[k]) for row in ROWS] for k, name in enumerate(HEAD.split(","))
    }
    rows |= {f"{name}_sd": [0.1] * 4 for name in ("v_x2", "v_y2", "omega_2")}
    rows |= {"corr(v_y2,v_x2)": [0.5] * 4, "corr(omega_2,v_x2)": [0.2] * 4}
    straight = fitball.load_table(rows)
    turned = fitball.load_table(rows, flip="omega_2,v_x2")
    assert_array_equal(turned.values["omega_2"], -straight.values["omega_2"])
    assert {pair: values[0] for pair, values in straight.corr.items()} == {
        "v_x2,v_y2": 0.5,
        "v_x2,omega_2": 0.2,
    }
    assert {pair: values[0] for pair, values in turned.corr.items()} == {
        "v_x2,v_y2": -0.5,
        "v_x2,omega_2": 0.2,
    }
    down = fitball.load_table(rows | {"v_y2": [-v_y2 for v_y2 in rows["v_y2"]]})
    assert down.corr["v_x2,v_y2"][0] == -0.5
    assert down.values["v_y2"][0] == 4.2
    normal = fitball.load_table(
        {"v_1": [17, 18], "theta_1": [73, 63], "v_y2": [4, 5]},
        flip=["theta_1"],
    )
    assert_allclose(normal.values["theta_1"], np.radians([17, 27]))
    for name in misread.SPEEDS + misread.SPINS:
        if name not in ("v_y1", "v_y2"):
            assert_array_equal(
                fitball.load_table(rows, flip=name).values[name],
                -np.array(rows[name]),
            )


def test_correlations_that_no_errors_can_have_are_faults_of_their_rows():
    """Of ((1, r, r), (r, 1, -r), (r, -r, 1)) the smallest eigenvalue is 1 - 2 r: no pair is above 1
    here.
    """
    rows = {
        "v_x1": [9, 9.5, 10],
        "v_y1": [6, 7, 8],
        "v_x2": [6, 7, 7],
        "v_y2": [4, 5, 6],
        "omega_2": [200, 210, 220],
    }
    rows |= {name: [0.1] * 3 for name in ("v_x2_sd", "v_y2_sd", "omega_2_sd")}
    size = np.array([0.4, 0.9, 0.5])
    rows |= {"corr(v_x2,v_y2)": size, "corr(v_x2,omega_2)": size, "corr(v_y2,omega_2)": -size}
    with pytest.raises(InputError) as caught:
        fitball.load_table(rows)
    assert [(fault.code, fault.row) for fault in caught.value.faults] == [
        ("impossible-correlations", 2)
    ]
    assert fitball.load_table(rows, ignore="corr").corr == {}
    assert {*fitball.load_table(rows, ignore="omega_2").corr} == {"v_x2,v_y2"}
    bare = fitball.load_table(rows, ignore=("v_x2_sd", "v_y2_sd"))
    assert {*bare.sd} == {"omega_2"}
    assert bare.corr == {}


def test_limits_themselves_are_allowed(tmp_path):
    rows = ("1000,0.001,1e5,0.001,0.1", "-1000,1000,-1e5,1,100")
    assert (
        len(
            fitball.load_table(written(tmp_path, "v_x1,v_y1,omega_1,v_y2,contact_time [ms]", *rows))
        )
        == 2
    )


def test_rows_that_repeat_others_are_noted():
    frame = simulated(12, 0.2)
    assert codes(fitball.load_table(pd.concat([frame] * 5))) == ["repeated-rows"]
    assert codes(fitball.load_table(frame)) == []
    # Coarse heights repeat by chance.
    assert codes(fitball.load_table({"v_y1": [7.05] * 6, "v_y2": [5.2, 5.3] * 3})) == []


def test_doubts_are_refused_or_noted():
    """Spins of the other sign, alone and behind a good table."""
    good = simulated(30, 0.1, 1)
    good.attrs["name"] = "good"
    wrong = misread.times(-1, *misread.SPINS)(simulated(30, 0.1))
    wrong = pd.DataFrame(wrong)
    wrong.attrs["name"] = "wrong"
    with pytest.raises(InputError) as caught:
        load_data([good, wrong], None, False)
    assert caught.value.code == "misread"
    assert caught.value.source == "wrong"
    assert caught.value.hints
    assert "misread" in codes(load_data([good, wrong], None, True)[0])
    assert (
        load_data([wrong], None, False, flip=("omega_1", "omega_2"))[0].notices[0].code == "flipped"
    )
    assert check(wrong, None, False).failed
    assert not check(wrong, None, True).failed
    assert len(check(wrong, None, True).frames["doubts"]) > 0
    assert check(wrong, None, True).notes == ()
