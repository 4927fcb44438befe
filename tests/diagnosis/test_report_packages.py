"""Packages and packaged files that the page of a diagnosis needs."""

import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

from gateway.core import optional_packages
from gateway.core.errors import OutputError
from gateway.diagnosis.views.html import diagnosis_html
from tests.testkit.diagnosis_data import empty

pytest.importorskip("matplotlib", reason="matplotlib (extra 'plot') is not installed")
pytest.importorskip("jinja2", reason="jinja2 (extra 'plot') is not installed")

ROOT = Path(__file__).parents[2]


@pytest.mark.parametrize("package", ["matplotlib", "jinja2"])
def test_missing_package_names_the_extra(package, monkeypatch):
    real = optional_packages.find_spec
    monkeypatch.setattr(optional_packages, "find_spec", lambda name: None if name == package else real(name))
    with pytest.raises(OutputError, match=package) as caught:
        diagnosis_html(empty())
    assert "treadlink[plot]" in caught.value.remedy


def test_views_import_no_heavy_packages():
    code = (
        "import sys\n"
        "from gateway.diagnosis.views import diagnosis_json, html, terminal\n"
        "sys.exit(str({'matplotlib', 'jinja2'} & set(sys.modules) or 0))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=ROOT, check=False)
    assert done.stderr.strip() in ("", "0")


def test_wheel_contains_template_and_style(tmp_path):
    pytest.importorskip("hatchling", reason="hatchling (extra 'dev') is not installed")
    for name in ("pyproject.toml", "hatch_build.py", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, tmp_path)
    shutil.copytree(ROOT / "gateway", tmp_path / "gateway", ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copytree(ROOT / "firmware_protocol", tmp_path / "firmware_protocol")
    done = subprocess.run(
        [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", "out"],
        capture_output=True, text=True, cwd=tmp_path, check=False, timeout=60,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    with zipfile.ZipFile(next((tmp_path / "out").glob("*.whl"))) as wheel:
        assert {
            "gateway/diagnosis/views/closure_report.html.j2",
            "gateway/core/text/pictures/result_page.html.j2",
        } <= set(wheel.namelist())
