"""The rules of the house that a machine can check."""

from __future__ import annotations

import re
import subprocess
import sys
import zipfile
from pathlib import Path

import numba
import pytest
import size

ROOT = Path(__file__).resolve().parent.parent
HEAVY = ("numba", "scipy", "pandas", "matplotlib", "lmfit", "emcee", "h5py")


def python(code, *, cwd=ROOT, env=None):
    return subprocess.run([sys.executable, "-c", code], cwd=cwd, env=env, capture_output=True, text=True, check=False)


def test_the_house_grows_by_decision_only():
    totals = size.totals()
    assert totals.keys() == size.CEILINGS.keys()
    above = {what: found for what, found in totals.items() if found > size.CEILINGS[what]}
    assert not above, (
        f"more than the ceilings of scripts/size.py: {above}; CONTRIBUTING.md says how growth is decided"
    )


def test_lines_are_counted_by_what_they_are():
    head = '"""Two\nlines."""\n\nimport ast\nfrom x import (\n    y,\n)\n\n'
    text = head + '# why\ndef f():\n    """Doc."""\n    return "#"\n'
    assert size.kinds_of(text) == {"docstrings": 3, "blank": 2, "imports": 4, "comments": 1, "code": 2}


def test_help_imports_nothing_heavy():
    code = (
        "import sys\nfrom fitball.cli.main import main\n"
        "try:\n    main(['--help'])\nexcept SystemExit:\n    pass\n"
        f"print('HEAVY', [name for name in {HEAVY!r} if name in sys.modules])"
    )
    done = python(code)
    assert "HEAVY []" in done.stdout, done.stdout + done.stderr


def test_a_fit_loads_none_of_what_its_packages_import_and_it_does_not_use():
    done = python(
        "import sys\nimport fitball.api\nimport fitball.inference.sampling.array_stats\n"
        "from fitball.environment import HEAVY\n"
        "print('LOADED', [name for name in (*HEAVY, 'arviz_stats', 'xarray') if name in sys.modules])"
    )
    assert "LOADED []" in done.stdout, done.stdout + done.stderr


def test_what_was_not_loaded_is_there_when_it_is_used_and_for_others():
    done = python(
        "import sys\nimport fitball.api\nimport fitball.inference.sampling.array_stats\n"
        "import lmfit\nfrom lmfit import jsonutils, minimizer\n"
        "print('WAITS', isinstance(1, jsonutils.DataFrame), 'pandas' in sys.modules)\n"
        "print('NORM', minimizer.norm_dist.pdf(0.0), minimizer.isnull(float('nan')))\n"
        "import pandas, scipy.stats, arviz_stats.utils\n"
        "print('REAL', isinstance(pandas.DataFrame(), jsonutils.DataFrame), scipy.stats.norm.cdf(0.0))\n"
        "print('WHOLE', arviz_stats.utils.xr.Dataset.__name__)"
    )
    assert "WAITS False False\nNORM 0.398942" in done.stdout, done.stdout + done.stderr
    assert "REAL True 0.5\nWHOLE Dataset" in done.stdout, done.stdout + done.stderr


def test_where_other_threads_run_nothing_stands_in():
    done = python(
        "import sys, threading\nrest = threading.Event()\nother = threading.Thread(target=rest.wait)\nother.start()\n"
        "import fitball.api\nimport lmfit\nprint('LOADED', 'scipy.stats' in sys.modules)\nrest.set()\nother.join()"
    )
    assert "LOADED True" in done.stdout, done.stdout + done.stderr


def test_public_names_resolve():
    import fitball

    for name in fitball.__all__:
        assert getattr(fitball, name) is not None
    with pytest.raises(AttributeError, match="has no attribute 'nothing'"):
        getattr(fitball, "nothing")  # noqa: B009 - the attribute is what is tested


def test_layers():
    done = subprocess.run(
        [str(Path(sys.executable).with_name("lint-imports"))], cwd=ROOT, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout


def test_other_rooms_ask_a_model_what_it_can_do_and_not_of_what_class_it_is():
    """What a model can do it says by its face: `models.model`."""
    asked = re.compile(r"\b(TwoMassModel|GripSlipModel|ImpulseModel)\b|isinstance\([^)]*\w+Model\b")
    for file in sorted((ROOT / "fitball").rglob("*.py")):
        if "models" not in file.relative_to(ROOT / "fitball").parts[:1]:
            assert not asked.search(file.read_text(encoding="utf-8")), file


def test_tables_and_numbers_of_the_pages_are_current():
    from readme import MARKED, blocks, pages, updated

    content, seen = blocks(), set()
    for page in pages():
        text = page.read_text(encoding="utf-8")
        assert updated(text, content) == text, page
        seen |= {found["name"] for found in MARKED.finditer(text)}
        # No mark that is not met by its end.
        assert text.count("written by scripts/readme.py -->") == len(MARKED.findall(text)), page
    assert seen == set(content)


def test_wheel_carries_tables_scenes_schemas_and_template(tmp_path):
    done = subprocess.run(
        [sys.executable, "-m", "pip", "wheel", "--quiet", "--no-deps", "--no-build-isolation",
         "--disable-pip-version-check", "--wheel-dir", str(tmp_path), str(ROOT)],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    (wheel,) = tmp_path.glob("*.whl")
    names = set(zipfile.ZipFile(wheel).namelist())
    for needed in (
        "fitball/_datasets/wang_zero_spin.csv",
        "fitball/_datasets/wang_all.toml",
        "fitball/data/scene.schema.json",
        "fitball/report/fit.schema.json",
        "fitball/report/references.bib",
        "fitball/exports/parameters.schema.json",
        "fitball/report/templates/page.css",
        "fitball/py.typed",
    ):
        assert needed in names
    # Installed elsewhere, without the checkout, the bundled tables are found.
    place = tmp_path / "installed"
    zipfile.ZipFile(wheel).extractall(place)
    code = (
        "import sys\nsys.path.insert(0, '.')\nimport fitball\n"
        "print(fitball.__file__, len(fitball.load_table('wang_all.csv')))"
    )
    found = subprocess.run(
        [sys.executable, "-c", code], cwd=place, capture_output=True, text=True, check=False, env={"PATH": ""}
    )
    assert str(place) in found.stdout, found.stderr
    assert found.stdout.strip().endswith(" 21")


def test_no_path_of_a_machine_in_the_project():
    forbidden = re.compile(r"/(home|root|tmp|work)/[a-z]")
    for folder in ("fitball", "datasets", "docs", "scripts", "tests"):
        for file in (ROOT / folder).rglob("*"):
            if file.suffix in (".py", ".toml", ".csv", ".md", ".json", ".j2") and file != Path(__file__):
                assert not forbidden.search(file.read_text(encoding="utf-8")), file


def test_the_compile_cache_expires_when_a_called_kernel_changes(tmp_path):
    """Numba's own stamp covers the caller's file only; ours covers every kernel."""
    import shutil

    shutil.copytree(ROOT / "fitball", tmp_path / "fitball", ignore=shutil.ignore_patterns("__pycache__"))
    (tmp_path / "fitball" / "models" / "toy.py").write_text(
        "from fitball.models.kernels.compiled import compiled\nfrom fitball.models.kernels.dual import sin\n"
        "@compiled\ndef toy(x):\n    return sin(x)\n"
    )
    code = (
        "import sys\nsys.path.insert(0, '.')\nfrom fitball.models.toy import toy\n"
        "from fitball.environment import when_compiling\ntold = []\nwhen_compiling(told.append)\n"
        "print(toy(0.5), *(one and one.kernel for one in told))"
    )
    env = {"PATH": "", "NUMBA_CACHE_DIR": str(tmp_path / "cache"), "NUMBA_NUM_THREADS": "1"}
    first = python(code, cwd=tmp_path, env=env)
    callee = tmp_path / "fitball" / "models" / "kernels" / "dual.py"
    text = callee.read_text(encoding="utf-8")
    line = "return carry(math.sin(x.real), x,"
    assert line in text
    callee.write_text(text.replace(line, line.replace("math.sin", "0.5 * math.sin")), encoding="utf-8")
    second = python(code, cwd=tmp_path, env=env)
    (value, *known), (other_value, *stale) = first.stdout.split(), second.stdout.split()
    assert float(value) == pytest.approx(2.0 * float(other_value)), first.stderr + second.stderr
    # What is compiled is told, and that it is done; what comes from disk is not.
    assert known == stale == ["toy", "None"]
    assert python(code, cwd=tmp_path, env=env).stdout.split()[1:] == []
    other = python("import fitball.models.kernels.bounce as b; print(len(b.bounce_batch._cache._cache_file.stamp))")
    assert int(other.stdout) > 10
    assert numba.__version__
