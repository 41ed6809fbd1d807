"""Slips of Appendices C and D: each reproduces what it claims, from a list drawn up beforehand, and mends nothing."""

from __future__ import annotations

import numpy as np
import pytest

from fitball.data.published import thesis_table
from fitball.errors import TableError
from fitball.inference.thesis.published_cases import C1, C2, INCH, INERTIA, case_parameters, printed_model
from fitball.thesis import appendices, slips
from fitball.thesis.appendices import CODES, Clause, filled_in, outputs, row_inputs
from fitball.thesis.slips import by_chance, candidates
from fitball.values import impacts

ERRATA = thesis_table("errata")
ROWS = appendices.recompute(appendices.with_corrected_inputs(thesis_table("appendix_c"), ERRATA))


@pytest.fixture(scope="module")
def cells():
    return slips.recomputed()


def row_of(place):
    table, case = place.split("-")
    return ROWS[(ROWS["table"] == table) & (ROWS["case"] == int(case))].iloc[0].to_dict()


def test_worksheets_of_one_mind_are_the_model():
    for row in ROWS.to_dict("records"):
        found = outputs(dict.fromkeys(CODES, row_inputs(row)))
        for name in appendices.COLUMNS:
            assert found[name] == pytest.approx(row[name], rel=1e-11), (row["table"], row["case"], name)


def test_every_slip_does_what_it_says(cells):
    found = slips.check(cells)
    assert found.holds, found.finding
    tangential = cells["column"].isin(slips.TANGENTIAL) & cells["table"].str.startswith("C")
    assert (cells[tangential]["residual"] < appendices.REPRODUCED).all()
    left = "C1-5, C2-3, C4-5, C4-7, C7-7, C8-7, C9-3, C10-5, C13-3, C15-7, C16-4, C16-5, C16-7, C17-3"
    assert ", ".join(slips.unexplained()) == left
    assert found.finding.endswith(f"14 rows stay unexplained: {left}.")


def test_every_cell_blamed_on_an_input_says_which(cells):
    """`slip` and `other input` on a velocity or a spin are claims that a recomputation must carry."""
    blamed = ERRATA[ERRATA["kind"].isin(("slip", "other input")) & ERRATA["column"].isin(slips.TANGENTIAL)]
    blamed = blamed[blamed["table"].str.match(r"C\d")]
    assert len(blamed) > 30
    assert (blamed["slip"] != "").all()
    assert set(zip(blamed["table"], blamed["column"], strict=True)) <= set(
        zip(cells["table"], cells["column"], strict=True)
    )
    assert (ERRATA[ERRATA["kind"] == "unexplained"]["slip"] == "").all()


def test_unexplained_rows_are_those_beyond_their_rounding():
    off = appendices.reproduce().exceptions
    off = off[(off["kind"] == "unexplained") & off["column"].isin(slips.TANGENTIAL)]
    assert {f"{row.table}-{row.case}" for row in off.itertuples()} == set(slips.unexplained())


def test_slips_mend_nothing():
    """Rows, counts and rankings see the inputs as printed or mended, never those of a slip."""
    printed = thesis_table("appendix_c")
    without = ERRATA[ERRATA["slip"] == ""]
    mended = appendices.with_corrected_inputs(printed, without)
    assert mended.equals(appendices.with_corrected_inputs(printed, ERRATA))
    wrong = ROWS[(ROWS["table"] == "C11") & (ROWS["case"] == 4)]
    assert abs(float(wrong["v_x2_error"].iloc[0])) > 1.0


def model_outputs(row, changes, offset_scale=1.0, **incident):
    """`v_x2` and `omega_2` of model `thesis` with its own parameters changed: another way to the same slip."""
    values = case_parameters(row["mass_ratio"], row["k_y [lb/in]"], row["i1_over_i"], row["c_y [lb s/in]"])
    offset = (C1 * row["v_y1 [m/s]"] + C2) * INCH * offset_scale
    values |= {"eps_slope": 0.0, "eps_10": offset} | changes
    start = {"v_x1": row["v_x1 [m/s]"]} | incident
    rebound = printed_model().rebound(
        values, impacts(start["v_x1"], row["v_y1 [m/s]"], row["omega_1 [rad/s]"], row["cor"])
    )
    return float(rebound.v_x2[0]), float(rebound.omega_2[0])


def by_model(place):
    """The slip of a row through the model's parameters.

    While rolling the normal force, and with it the vertical velocity, comes in only as a factor of the offset.
    """
    row = row_of(place)
    mass_radius2 = case_parameters("3/4", 90, 0.634)["ball_mass"] * (1.25 * INCH) ** 2
    made = {
        "C3-4": lambda: model_outputs(row, {"inertia_ratio": case_parameters("1/2", 72, 0.353)["inertia_ratio"]}),
        "C5-5": lambda: model_outputs(row, {}, 11.74 / 13.25),
        "C6-1": lambda: model_outputs(row, {}, 11.74 / 15.19),
        "C6-7": lambda: model_outputs(
            row, {"ball_radius": 1.25 * INCH, "inertia_ratio": 0.000342 * INERTIA / mass_radius2}
        ),
        "C11-4": lambda: model_outputs(row, {"mass_ratio": 0.5}),
        "C11-5": lambda: model_outputs(row, {}, v_x1=12.63),
        "C18-7": lambda: model_outputs(row, {}, 16.39 / 11.78),
    }
    return made[place]()


@pytest.mark.parametrize("place", ["C3-4", "C5-5", "C6-1", "C6-7", "C11-4", "C11-5", "C18-7"])
def test_the_model_itself_gives_the_slip(cells, place):
    table, case = place.split("-")
    mine = cells[(cells["table"] == table) & (cells["row"] == case)].set_index("column")["recomputed"]
    v_x2, omega_2 = by_model(place)
    assert v_x2 == pytest.approx(mine["v_x2"], rel=1e-11)
    assert omega_2 == pytest.approx(mine["omega_2"], rel=1e-11)


@pytest.mark.parametrize(
    ("place", "slip", "fault"),
    [
        ("C11", "all: mass_ratio=3/4", "C11 row 4, v_x2 with 'all: mass_ratio=3/4': residual"),
        ("C8", "spin: c_y=0.03811", "an input that is on no list of candidates"),
        ("C18", "rolling: v_y1=16.14", "C18 row 6 7, omega_2 with 'rolling: v_y1=16.14': residual"),
        ("D2", "transition: radius=1.3", "D2 row 22.85, v_x2 with 'transition: radius=1.3': residual"),
        ("D6", "velocity: k_y=80.1", "an input that is on no list of candidates"),
    ],
)
def test_a_wrong_slip_is_noticed(monkeypatch, place, slip, fault):
    inputs = ERRATA["kind"] == "input"
    errata = ERRATA[inputs | (ERRATA["table"] == place)].copy()
    errata.loc[(errata["table"] == place) & (errata["kind"] == "slip"), "slip"] = slip
    monkeypatch.setattr(slips, "thesis_table", lambda name: errata if name == "errata" else thesis_table(name))
    assert any(fault in item for item in slips.faults(slips.recomputed()))


def test_a_residual_that_is_not_the_stated_one_is_noticed(monkeypatch, cells):
    changed = cells.copy()
    chosen = (changed["table"] == "C6") & (changed["row"] == "7") & (changed["column"] == "v_x2")
    changed.loc[chosen, "stated"] += 0.002
    assert slips.faults(cells) == []
    (fault,) = slips.faults(changed)
    assert fault.startswith("C6 row 7, v_x2 with 'all: radius=1.25 inertia=0.000342': residual 0.0293, stated 0.031")


def test_a_slip_that_chance_explains_as_well_is_noticed(cells):
    """What V_y1 = 11.74 gives on one table alone another of its 46 candidates would give too."""
    alone = cells[cells["table"] != "C6"]
    assert "rolling: v_y1=11.74: 0.46 fits by chance" in slips.faults(alone)
    assert not slips.check(alone).holds


def test_chance_is_calibrated():
    """Where no slip was made, a fit with p fits by chance is found on about a share p of the printed values."""
    row = row_of("C12-5")
    clauses = slips.parse("rolling: v_y1=11.74", "here")
    found = candidates(row, ROWS, clauses)
    (drawn,) = found.lists
    own, true = row_inputs(row), row["omega_2"]
    given = np.array([outputs(filled_in(own, [Clause(("rolling",), item)]))["omega_2"] for item in drawn])
    given = np.unique(np.round(given[np.abs(given - true) > 1e-6], 6))
    passed = []
    for shift in np.linspace(-0.01, 0.01, 41):
        printed = true * (1.0 + shift)
        deviation = np.abs(given / printed - 1.0)
        passed.append(np.sum(deviation <= 0.02) * deviation.min() / 0.02)
    for level in (0.1, 0.3):
        assert level / 4.0 < np.mean(np.array(passed) <= level) < 2.0 * level + 0.1
    # And the function counts what was counted here by hand.
    row["omega_2 [rad/s]"] = true
    mine = by_chance(row, found, ["omega_2"])
    expected = np.abs(outputs(filled_in(own, clauses))["omega_2"] / true - 1.0) * 100.0
    near = np.sum(np.abs(given / true - 1.0) <= 0.02) + 1
    assert mine.expected == pytest.approx(near * expected / 2.0, rel=1e-4)


@pytest.mark.parametrize(
    ("slip", "said"),
    [
        ("spim: k_y=80", "'spim: k_y=80' names no worksheet of Appendix B"),
        ("k_y=80", "names no worksheet"),
        ("spin: k=80", "k: no input of Appendix B"),
        ("spin: k_y=eighty", "k_y: 'eighty' is no number"),
        ("all: mass_ratio=1/0", "'1/0' is no number"),
    ],
)
def test_a_slip_that_cannot_be_read_is_named(slip, said):
    with pytest.raises(TableError, match="C9 4") as caught:
        slips.parse(slip, "errata, C9 4")
    assert said in str(caught.value)


def test_worksheets_may_differ_one_by_one():
    """A later clause goes before an earlier one, and leaves other worksheets alone."""
    own = row_inputs(row_of("C2-7"))
    made = filled_in(own, slips.parse("velocity spin: k_y=80; spin: k_y=72 radius=1.25", "here"))
    assert [made[code]["k_y"] for code in CODES] == [80.0, 72.0, 90.0, 90.0, 90.0]
    assert made["spin"]["radius"] == 1.25
    assert made["velocity"]["radius"] == pytest.approx(1.3)
