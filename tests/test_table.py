"""Tables of impacts: states, dense errors, parts, frames, tables together."""

import numpy as np
import pytest
from made_tables import bundled, impact_table
from numpy.testing import assert_allclose, assert_array_equal

from fitball.base.columns import COLUMNS
from fitball.base.errors import InputError
from fitball.data.labels import role_of
from fitball.data.read import load_table
from fitball.data.table import join_tables, pair_of, stated_errors

GAPS = ("v_x1", "v_y1", "omega_1", "v_x2", "v_y2", "omega_2", "gap_time", "gap_path", "gap_turn")
POLAR = {
    "v_1": [10.0, 20.0],
    "theta_1": [0.3, 2.0],
    "v_x2": [5.0, np.nan],
    "omega_2": 100.0,
}


def codes(tables):
    with pytest.raises(InputError) as caught:
        join_tables(tables)
    return {fault.code: fault.column for fault in caught.value.faults}


@pytest.mark.parametrize(
    ("columns", "tangential", "spin"),
    [
        ("v_y1 omega_1 v_y2", False, True),
        ("v_x1 v_y1 v_y2", False, False),
        ("v_x1 v_y1 v_x2", True, False),
        ("v_1 theta_1 v_2", True, False),
        ("v_y1 v_x2", False, False),
        ("v_x1 v_y1 omega_2", True, True),
    ],
)
def test_what_motion_a_table_shows(columns, tangential, spin):
    table = impact_table(dict.fromkeys(columns.split(), 1.0))
    assert table.has_tangential == tangential
    assert table.has_spin == spin


def test_dense_errors_are_those_stated_in_any_order_of_columns():
    """Of the bundled film all nine sds and thirteen pairs; asked for in another order, and for some
    columns alone.
    """
    table = bundled("synthetic_gaps", GAPS)
    covariance = table.covariance(GAPS[3:])
    sds = np.stack([table.sd[name] for name in GAPS], 1)
    corr = covariance / (sds[:, :, None] * sds[:, None, :])
    assert_allclose(np.diagonal(corr, axis1=1, axis2=2), 1.0, rtol=1e-13)
    for pair, values in table.corr.items():
        i, j = (GAPS.index(name) for name in pair.split(","))
        assert_allclose(corr[:, i, j], values, rtol=1e-12)
        assert_allclose(corr[:, j, i], values, rtol=1e-12)
    assert len(table.corr) == 13
    assert np.count_nonzero(np.abs(corr[0]) > 1e-12) == 9 + 2 * 13
    selected = table.covariance(("gap_turn", "v_y2"))
    keep = [0, 1, 2, 8, 4]
    assert_allclose(selected, covariance[:, keep][:, :, keep], rtol=1e-13)


def test_errors_of_speed_and_angle_are_propagated_together_with_the_rebound():
    """By 400,000 draws of the row; a gap has no error, and nothing stated is no matrix."""
    sd = {"v_1": 0.05, "theta_1": 0.004, "v_x2": [0.06, np.nan]}
    pairs = {("v_1", "theta_1"): 0.5, ("theta_1", "v_x2"): -0.7}
    table = impact_table(POLAR, sd, pairs)
    covariance = table.covariance(["v_x2", "omega_2"])
    matrix = np.array([[1.0, 0.5, 0.0], [0.5, 1.0, -0.7], [0.0, -0.7, 1.0]]) * np.outer(
        *[[0.05, 0.004, 0.06]] * 2
    )
    v, theta, x_2 = (
        np.random.default_rng(2).multivariate_normal([10.0, 0.3, 5.0], matrix, 400_000).T
    )
    drawn = np.cov([v * np.cos(theta), v * np.sin(theta), x_2])
    assert_allclose(covariance[0][np.ix_([0, 1, 3], [0, 1, 3])], drawn, rtol=0.02, atol=2e-6)
    assert covariance.shape == (2, 5, 5)
    assert not covariance[:, [2, 4]].any()
    assert not covariance[1, 3].any()
    assert covariance[1, 0, 0] > 0.0
    assert impact_table(POLAR).covariance(["v_x2"]) is None
    assert impact_table(POLAR, {"omega_2": 1.0}).covariance(["v_x2"]) is None


def test_stated_errors_of_a_covariance_make_it_again():
    rng = np.random.default_rng(4)
    factor = rng.standard_normal((3, 4, 6))
    covariance = factor @ factor.transpose(0, 2, 1)
    columns = ("v_x2", "omega_1", "v_y1", "v_x1")
    sd, corr = stated_errors(columns, covariance)
    table = impact_table(
        {
            "v_x1": [9.0, 8.0, 7.0],
            "v_y1": 8.0,
            "omega_1": 7.0,
            "v_x2": 6.0,
        },
        sd,
    )
    again = impact_table(
        table.values,
        sd,
        {tuple(pair.split(",")): values for pair, values in corr.items()},
    ).covariance(["v_x2"])
    assert_allclose(again[:, [3, 2, 1, 0]][:, :, [3, 2, 1, 0]], covariance, rtol=1e-13)
    assert "v_x1,v_x2" in corr
    assert pair_of("gap_time", "v_x1") == "v_x1,gap_time"
    covariance[:, 2] = covariance[:, :, 2] = 0.0
    sd, corr = stated_errors(columns, covariance)
    assert np.isnan(sd["v_y1"]).all()
    assert not any("v_y1" in pair for pair in corr)


def test_some_of_the_rows():
    table = impact_table(
        POLAR,
        {"v_1": [0.1, 0.2]},
        {("v_1", "theta_1"): [0.3, 0.4]},
        labels={"surface": ("clay", "grass")},
    )
    rows = table.take(np.array([1]))
    assert len(rows) == 1
    assert rows.labels == {"id": ("2",), "surface": ("grass",)}
    assert rows.values["v_1"].item() == 20.0
    assert rows.sd["v_1"].item() == 0.2
    assert rows.corr["v_1,theta_1"].item() == 0.4


@pytest.mark.parametrize(
    "name",
    ["synthetic_gaps", "wang_all", "synthetic_drop", "synthetic_court"],
)
def test_a_frame_read_again_is_the_table_to_the_last_digit(name, tmp_path):
    """In memory and through a file; what the file states is what the bundled text says."""
    table = load_table(name)
    table.to_frame().to_csv(tmp_path / "t.csv")
    for back in (load_table(table.to_frame()), load_table(tmp_path / "t.csv")):
        assert back.labels == table.labels
        for field in ("values", "sd", "corr"):
            written = getattr(table, field)
            read = getattr(back, field)
            assert [*written] == [*read]
            for column, numbers in written.items():
                assert_array_equal(read[column], numbers)
    if name == "synthetic_gaps":
        plain = bundled(name, GAPS)
        assert_allclose(
            table.covariance(GAPS[3:]),
            plain.covariance(GAPS[3:]),
            rtol=1e-12,
            atol=1e-18,
        )


def test_tables_together():
    sd = {"v_x2": [0.1, np.nan], "v_1": 0.1}
    pair = {("v_1", "v_x2"): 0.5}
    first = impact_table(
        POLAR,
        sd,
        pair,
        name="one",
        labels={"surface": ("Hard court", "clay")},
        read=({"n": "1"},),
    )
    short = {"v_1": 12.0, "theta_1": 0.2, "v_y2": 4.0}
    second = impact_table(
        short,
        {"v_1": 0.1},
        name="other",
        labels={"surface": ("hard  Court",)},
        read=({"n": "2"},),
    )
    both = join_tables([first, second])
    assert both.labels["id"] == ("one:1", "one:2", "other:1")
    assert both.labels["table"] == (
        "one",
        "one",
        "other",
    )
    assert both.labels["surface"] == ("Hard court", "clay", "Hard court")
    assert [*both.values] == ["v_1", "theta_1", "v_x2", "v_y2", "omega_2"]
    assert len(both.read) == 2
    assert_array_equal(both.values["v_x2"], [5.0, np.nan, np.nan])
    assert_array_equal(both.sd["v_x2"], [0.1, np.nan, np.nan])
    assert_array_equal(both.values["v_y2"], [np.nan, np.nan, 4.0])
    # Correlations that one table lacks are none.
    assert both.corr["v_1,v_x2"].tolist() == [0.5, 0.5, 0.0]
    assert [note.code for note in both.notices] == ["column-in-some"] * 3
    assert join_tables([first]) is first


@pytest.mark.parametrize(
    ("other", "code", "column"),
    [
        (
            impact_table({"v_x1": 1.0, "v_y1": 1.0, "v_x2": 1.0}, {"v_x2": 0.1}, name="b"),
            "incident-columns-differ",
            None,
        ),
        (
            impact_table(POLAR | {"omega_1": 1.0}, {"v_x2": 0.1}, name="b"),
            "incident-columns-differ",
            None,
        ),
        (
            impact_table({"v_1": 1.0, "theta_1": 1.0, "v_2": 1.0, "theta_2": 1.0}, name="b"),
            "rebound-columns-differ",
            None,
        ),
        (impact_table(POLAR, name="b"), "stated-in-some", "v_x2"),
        (impact_table(POLAR, {"v_x2": 0.1, "v_1": 0.1}, name="b"), "stated-in-some", "v_1"),
        (impact_table(POLAR, {"v_x2": 0.1}, name="a"), "same-table-twice", None),
        (
            impact_table(POLAR, {"v_x2": 0.1}, name="b", read=({"sha256": "0f", "source": "x"},)),
            "same-table-twice",
            None,
        ),
    ],
)
def test_tables_that_do_not_belong_together(other, code, column):
    first = impact_table(POLAR, {"v_x2": 0.1}, name="a", read=({"sha256": "0f", "source": "y"},))
    assert codes([first, other]) == {code: column}

    sheets = [
        impact_table(POLAR, name=n, read=({"sha256": "0f", "source": f"book.xlsx#{n}"},))
        for n in "ab"
    ]
    assert len(join_tables(sheets)) == 4


def test_roles_of_labels():
    names = ("Surface", "court_type", "Ball no", "location", "session", "table", "operator")
    assert [role_of(name) for name in names] == [
        "surface",
        "surface",
        "ball",
        "place",
        "session",
        "table",
        "",
    ]


def test_what_columns_need():
    """Vertical columns need no motion along the court; times and gaps need a model with a time
    axis.
    """
    along = {"v_x2", "theta_2", "omega_2"}
    gaps = {"gap_time", "gap_path", "gap_turn"}
    needs = {
        kind: {name for name, column in COLUMNS.items() if getattr(column, kind)}
        for kind in ("tangential", "timed")
    }
    assert needs == {"tangential": along | gaps - {"gap_time"}, "timed": gaps | {"contact_time"}}
    assert {name for name, column in COLUMNS.items() if column.gap} == gaps
