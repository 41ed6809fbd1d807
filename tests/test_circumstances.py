"""What a certificate carries beside numbers: laboratory, operator, instrument, date, court, ball temperature."""

from __future__ import annotations

import json

import numpy as np
import pytest

import fitball
from fitball.data.read import load_table
from fitball.data.scene import load_scene
from fitball.data.table import joined
from fitball.errors import SceneError, TableError
from fitball.inference.results.source import Circumstances
from fitball.report.fit.circumstances import circumstance_line

HEAD = "v_1 [m/s],theta_1 [deg],v_2 [m/s],theta_2 [deg]"
ROWS = ("30.1,16.0,20.1,19.4", "29.9,16.1,19.9,19.8", "30.2,15.9,20.0,19.3", "30.0,16.0,20.3,19.6")
SCENE = """
[laboratory]
name = "Test & Co"
operator = "A. Nother"
instrument = "Camera 7"
date = 2026-05-31

[surface]
name = "acrylic"
court = "Court 3"

[ball]
temperature = 21.5
"""


def table_with(tmp_path, name, cells, head=HEAD, rows=ROWS):
    lines = [f"{head},{name}", *(f"{row},{cell}" for row, cell in zip(rows, cells, strict=True))]
    path = tmp_path / "court.csv"
    path.write_text("\n".join(lines), encoding="utf-8")
    return path


@pytest.mark.parametrize(
    ("name", "cells", "celsius"),
    [
        ("Ball temp (C)", ("26", "26.5", "", "25"), (26.0, 26.5, np.nan, 25.0)),
        ("ball_temperature [degC]", ("-3", "0", "1", "nan"), (-3.0, 0.0, 1.0, np.nan)),
        ("Ball Temperature [°F]", ("68", "77", "32", "50"), (20.0, 25.0, 0.0, 10.0)),
        ("ball_temp (K)", ("293.15", "300", "273.15", "NA"), (20.0, 26.85, 0.0, np.nan)),
    ],
)
def test_a_column_of_ball_temperatures_is_read_in_its_unit(tmp_path, name, cells, celsius):
    table = load_table(table_with(tmp_path, name, cells))
    assert table.ball_temperature == pytest.approx(celsius, nan_ok=True, abs=1e-9)
    assert not table.labels
    assert "ball_temperature is printed in the certificate and not used in the fit" in table.remarks
    again = load_table(table.to_frame(), name="court")
    assert np.array_equal(again.ball_temperature, table.ball_temperature, equal_nan=True)


def test_decimal_commas_and_a_name_given_by_the_user(tmp_path):
    path = tmp_path / "court.csv"
    cells = [row.replace(",", ";").replace(".", ",") for row in ROWS]
    lines = [HEAD.replace(",", ";") + ";Kugel", *(f"{row};26,{k}" for k, row in enumerate(cells))]
    path.write_text("\n".join(lines), encoding="utf-8")
    table = load_table(path, columns={"ball_temperature": "Kugel [C]"})
    assert table.ball_temperature.tolist() == [26.0, 26.1, 26.2, 26.3]


def test_another_temperature_stays_a_label(tmp_path):
    table = load_table(table_with(tmp_path, "temperature", ("20", "20", "20", "20")))
    assert table.ball_temperature is None and table.labels["temperature"] == ("20",) * 4


@pytest.mark.parametrize(
    ("name", "cell", "words"),
    [
        ("ball_temperature", "warm", "row 2.*read 'warm'; expected a temperature of -40 to 80 degC"),
        ("ball_temperature", "293", "row 2.*read '293'; expected a temperature"),
        ("ball_temperature [m/s]", "20", r"read unit '\[m/s\]'; expected degC, degF or K"),
    ],
)
def test_what_is_no_temperature_is_a_fault(tmp_path, name, cell, words):
    with pytest.raises(TableError, match=words):
        load_table(table_with(tmp_path, name, ("20", cell, "20", "20")))


def test_tables_together_have_the_temperatures_of_those_that_have_them(tmp_path):
    warm = load_table(table_with(tmp_path, "ball_temperature", ("20", "21", "22", "23")))
    bare = load_table(table_with(tmp_path, "id", ("a", "b", "c", "d")), name="other")
    assert joined([bare, warm]).ball_temperature[4:].tolist() == [20.0, 21.0, 22.0, 23.0]
    assert np.isnan(joined([bare, warm]).ball_temperature[:4]).all()


def test_the_scene_says_who_measured_where_and_when(tmp_path):
    path = tmp_path / "court.toml"
    path.write_text(SCENE, encoding="utf-8")
    scene = load_scene(None, path)
    said = (scene.laboratory, scene.operator, scene.instrument, scene.date, scene.court, scene.surface)
    assert said == ("Test & Co", "A. Nother", "Camera 7", "2026-05-31", "Court 3", "acrylic")
    path.write_text(SCENE.replace("2026-05-31", '"2026-05-30 to 2026-06-01"'), encoding="utf-8")
    assert load_scene(None, path).date == "2026-05-30 to 2026-06-01"


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("2026-05-31", '"31.5.2026"', "laboratory.date.*expected a date such as 2026-05-31"),
        ("2026-05-31", '"2026-06-01 to 2026-05-30"', "laboratory.date.*expected a date"),
        ("2026-05-31", "2026-05-31T10:00:00", "laboratory.date.*expected a date"),
        ("operator", "oprator", "laboratory.oprator: unknown key; did you mean 'operator'"),
        ('"Court 3"', "3", "surface.court = 3: expected a text in quotes"),
    ],
)
def test_faults_of_these_keys_are_named(tmp_path, old, new, words):
    path = tmp_path / "court.toml"
    path.write_text(SCENE.replace(old, new), encoding="utf-8")
    with pytest.raises(SceneError, match=words):
        load_scene(None, path)


def test_a_fit_and_its_file_carry_them(tmp_path):
    table_with(tmp_path, "ball_temperature", ("26", "", "25.5", "27"))
    (tmp_path / "court.toml").write_text(SCENE, encoding="utf-8")
    fit = fitball.calibrate(tmp_path / "court.csv", model="grip-slip", point_only=True)
    wanted = Circumstances(
        "Test & Co", "A. Nother", "Camera 7", "2026-05-31", "Court 3", "acrylic", (25.5, 27.0), 21.5
    )
    assert fit.source.circumstances == wanted
    fit.save(tmp_path / "fit", figures=False)
    saved = fitball.load_fit(tmp_path / "fit")
    assert saved.source.circumstances == wanted
    assert json.loads((tmp_path / "fit" / "fit.json").read_text())["source"]["circumstances"]["court"] == "Court 3"
    assert saved.table.ball_temperature == pytest.approx([26.0, np.nan, 25.5, 27.0], nan_ok=True)
    assert saved.problem.scene.laboratory == "Test & Co"
    page = (tmp_path / "fit" / "report.html").read_text(encoding="utf-8").replace("\u00a0", " ")
    assert (
        "Laboratory: Test &amp; Co; operator: A. Nother" in page
        and "surface: acrylic; ball temperature: 25.5" in page
    )
    assert circumstance_line(saved).count(";") == 6


def test_a_surface_that_all_rows_share_is_that_of_the_certificate():
    rows = {"v_y1": [5.0, 6.0, 7.0], "v_y2": [3.9, 4.6, 5.3]}
    for labels, said in ((["clay"] * 3, "clay"), (["clay", "clay", "hard"], None)):
        fit = fitball.calibrate({**rows, "surface": labels}, "grip-slip", point_only=True, cores=1)
        assert fit.source.circumstances.surface == said
