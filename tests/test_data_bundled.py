"""The bundled tables against the printed ones, and how names become files."""

import csv
import os
import shutil
import subprocess
import sys
from hashlib import sha256
from pathlib import Path

import numpy as np
import pytest

import fitball.data
from fitball.data.bundled import bundled_folder, bundled_names, bundled_tables, resolve_table
from fitball.data.read import load_table
from fitball.errors import TableError

# Jafri (2004), Tables 1, 3 and 5, as printed:
# theta_i, V_X1, V_Y1, V_1, omega_1, theta_r, V_X2, V_Y2, V_2, omega_2.
PRINTED = {
    "zero_spin": """
17.13 15.62 4.81 16.36 -5.34 -20.83 11.09 -4.22 11.73 239.1
22.85 15.62 6.71 17.00 2.61 -32.39 8.84 -5.76 10.55 313.2
34.47 14.49 9.95 17.59 -1.1 -45.04 7.66 -7.66 10.84 293.31
41.1 13.46 11.74 17.87 23.46 -50.33 7.25 -8.73 11.36 239.99
48.55 11.7 13.25 17.70 10.63 -55.37 6.47 -9.37 11.4 213.17
58.94 9.16 15.19 17.74 10.63 -70.42 3.87 -10.87 11.54 144.69
67.84 6.57 16.14 17.44 1.15 -76.12 2.74 -11.09 11.44 96.25""",
    "topspin": """
18.3 16.13 5.33 16.99 138.2 -23.09 10.98 -4.67 11.94 386.1
22.64 16.19 6.75 17.54 158.06 -30.54 10.36 -6.11 12.03 398.11
33.94 14.83 9.98 17.89 152.53 -40.58 9.65 -8.26 12.71 323.74
42.38 13.76 12.55 18.64 136.32 -43.33 9.67 -9.12 13.3 285.46
47.7 11.98 13.17 17.81 147.58 -51.88 7.75 -9.88 12.56 236.54
61.07 8.45 15.29 17.48 146.74 -62.41 5.51 -10.53 11.89 163.87
70.91 5.67 16.39 17.36 145.88 -67.6 4.55 -11.05 11.95 119.09""",
    "backspin": """
17.42 16.18 5.08 16.96 -168.32 -20.31 10.56 -3.91 11.26 105.5
22.44 15.95 6.59 17.26 -148.05 -28.25 9.82 -5.27 11.14 170.35
34.79 14.35 9.97 17.48 -157.58 -49.78 6 -7.09 9.29 261.54
40.48 13.8 11.78 18.15 -179.12 -58.19 5.36 -8.64 10.17 208.97
45.21 12.02 12.11 17.07 -164.57 -65.58 4.12 -9.08 9.99 175.12
58.76 9.12 15.04 17.61 -184.04 -74.78 2.81 -10.29 10.68 106.79
67.62 6.57 15.95 17.25 -165.53 -81.72 1.57 -10.84 10.98 71.43""",
}
ORDER = (
    "theta_1 [deg]", "v_x1 [m/s]", "v_y1 [m/s]", "v_1 [m/s]", "omega_1 [rad/s]",
    "theta_2 [deg]", "v_x2 [m/s]", "v_y2 [m/s]", "v_2 [m/s]", "omega_2 [rad/s]",
)  # fmt: skip
TURNED = ("theta_2 [deg]", "v_y2 [m/s]")


def printed_rows(spin: str) -> list[dict[str, str]]:
    """Rows as printed, but for the sign of what the file counts positive."""
    rows = []
    for line in PRINTED[spin].split("\n")[1:]:
        row = dict(zip(ORDER, line.split(), strict=True))
        for name in TURNED:
            assert row[name].startswith("-")
            row[name] = row[name][1:]
        rows.append(row)
    return rows


def file_rows(name: str) -> list[dict[str, str]]:
    with (bundled_folder() / name).open(encoding="utf-8", newline="") as handle:
        return list(csv.DictReader(handle))


@pytest.mark.parametrize("spin", PRINTED)
def test_printed_digits_are_kept(spin: str) -> None:
    read = file_rows(f"wang_{spin}.csv")
    assert [{name: row[name] for name in ORDER} for row in read] == printed_rows(spin)


def test_the_large_table_is_the_three_small_ones() -> None:
    large = file_rows("wang_all.csv")
    small = [row for spin in PRINTED for row in file_rows(f"wang_{spin}.csv")]
    groups = [row.pop("group") for row in large]
    assert large == small
    assert groups == ["zero"] * 7 + ["topspin"] * 7 + ["backspin"] * 7


# The coefficients of restitution and V_x2/V_x1 that Tables 2, 4 and 6 of the thesis print.
RESTITUTION = {
    "zero_spin": (0.87734, 0.85842, 0.76985, 0.74361, 0.70717, 0.7156, 0.68711),
    "topspin": (0.8761726, 0.9051852, 0.8276553, 0.7266932, 0.7501898, 0.6886854, 0.6741916),
    "backspin": (0.769685, 0.799697, 0.711133, 0.733447, 0.749794, 0.684176, 0.679624),
}


@pytest.mark.parametrize("spin", PRINTED)
def test_measured_restitution_is_the_printed_one(spin: str) -> None:
    cor = load_table(f"wang_{spin}").impacts.cor
    assert cor is not None
    np.testing.assert_allclose(cor, RESTITUTION[spin], rtol=0.0, atol=1e-5)


def test_every_bundled_table_has_one_line_of_description() -> None:
    assert [item.name for item in bundled_tables()] == list(bundled_names())
    assert {"wang_all.csv", "wang_backspin.csv", "wang_topspin.csv", "wang_zero_spin.csv"} <= set(bundled_names())
    for item in bundled_tables():
        assert item.path.is_file()
        assert item.description and "\n" not in item.description


def test_ending_may_be_left_out_and_digest_is_that_of_the_file() -> None:
    table = load_table("wang_all")
    assert len(table) == 21
    assert table.name == "wang_all"
    assert table.digest == sha256((bundled_folder() / "wang_all.csv").read_bytes()).hexdigest()
    assert table.labels["group"][7] == "topspin"
    assert table.ids[20] == "backspin-7"


def test_a_path_that_exists_wins(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "wang_all.csv").write_text("v_y1,v_y2\n4,3\n5,4\n")
    monkeypatch.chdir(tmp_path)
    assert len(load_table("wang_all.csv")) == 2
    assert len(load_table("wang_all")) == 21


def test_a_folder_of_the_same_name_does_not_hide_a_table(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "wang_all").mkdir()
    monkeypatch.chdir(tmp_path)
    assert len(load_table("wang_all")) == 21
    with pytest.raises(TableError, match="is a folder"):
        load_table(tmp_path)


def test_an_unknown_name_lists_the_bundled_ones() -> None:
    with pytest.raises(TableError, match="did you mean 'wang_topspin'") as caught:
        resolve_table("wang_topsin.csv")
    for name in bundled_names():
        assert name in str(caught.value)


def test_an_installed_package_carries_its_tables(tmp_path: Path) -> None:
    """A wheel holds the tables as `fitball/_datasets`; nothing stands beside the package there."""
    package = Path(fitball.data.__file__).parents[1]
    for source in (
        *(package / f"{name}.py" for name in ("errors", "kinds", "observables", "values", "visible", "wording")),
        *(package / "data").rglob("*"),
    ):
        if source.is_file():
            target = tmp_path / "fitball" / source.relative_to(package)
            target.parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(source, target)
    (tmp_path / "fitball" / "__init__.py").touch()
    shutil.copytree(bundled_folder(), tmp_path / "fitball" / "_datasets")
    code = (
        "from fitball.data.read import load_table; from fitball.data.scene import load_scene;"
        "print(load_table('wang_all').source); print(load_scene('wang_all').source)"
    )
    environment = {**os.environ, "PYTHONPATH": str(tmp_path)}
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path, env=environment, capture_output=True, text=True, check=True
    )
    folder = tmp_path / "fitball" / "_datasets"
    assert done.stdout.splitlines() == [str(folder / "wang_all.csv"), str(folder / "wang_all.toml")]
