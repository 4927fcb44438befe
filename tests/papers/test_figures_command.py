"""The command `treadlink figures` and the captions of the ring paper's figures."""

import importlib.util
import re
from pathlib import Path
from typing import Any

import pytest

from gateway.core import optional_packages
from gateway.core.errors import ConfigError, OutputError
from gateway.papers.figure_registry import all_figures, chosen, title
from gateway.papers.figure_sheet import draw_figures
from tests.testkit.commands import invoked, run
from tools import docs_paper_figures
from tools.docs_outputs import ROOT

NEEDS_PLOT = pytest.mark.skipif(
    importlib.util.find_spec("matplotlib") is None, reason="matplotlib (extra 'plot') is not installed"
)


def test_registry_has_figures_of_both_papers() -> None:
    names = set(all_figures())
    assert {f"ring-fig-{n}" for n in (7, 9, 10, *range(11, 17))} | {"ring-eq-11", "ring-trends"} <= names
    assert {f"ply-steer-fig-{n}" for n in (10, 11, 13, 14, 15)} | {"ply-steer-tables"} <= names
    assert all(len(title(draw)) > 10 for draw in all_figures().values())


def test_list_prints_names_and_titles() -> None:
    result = run("figures", "--list")
    for name, draw in all_figures().items():
        assert re.search(rf"^{name} +{re.escape(title(draw))}$", result, re.MULTILINE)


def test_unknown_figure_lists_known_figures() -> None:
    with pytest.raises(ConfigError, match="fig-99") as caught:
        chosen(("ring-fig-99",))
    assert "ring-fig-11" in caught.value.remedy


@NEEDS_PLOT
@pytest.mark.parametrize("suffix", ["svg", "png"])
def test_command_writes_files_and_replaces_none(tmp_path: Path, suffix: str) -> None:
    out = tmp_path / "new" / "figures"
    arguments = ["ring-fig-12", "--out", str(out), "--format", suffix]
    first = run("figures", *arguments)
    drawn = out / f"ring-fig-12.{suffix}"
    assert drawn.stat().st_size > 5000
    page = (out / "index.html").read_text(encoding="utf-8")
    assert f'src="ring-fig-12.{suffix}"' in page
    caption = first.split("ring-fig-12: ")[1].splitlines()[0]
    assert caption.split("'")[0] in page.replace("&#x27;", "'")
    drawn.write_bytes(b"mine")
    again = invoked("figures", *arguments)
    assert isinstance(again.exception, OutputError)
    assert "--force" in again.exception.remedy
    assert drawn.read_bytes() == b"mine"
    run("figures", *arguments, "--force")
    assert drawn.stat().st_size > 5000


@NEEDS_PLOT
def test_figure_files_are_reproducible(tmp_path: Path) -> None:
    for position in ("a", "b"):
        draw_figures(chosen(("ring-fig-11",)), tmp_path / position, suffix="svg", write=Path.write_bytes)
    first, second = ((tmp_path / position / "ring-fig-11.svg").read_bytes() for position in ("a", "b"))
    assert first == second


@NEEDS_PLOT
def test_legend_shows_dollar_signs_of_a_name(tmp_path: Path) -> None:
    def draw(figure: Any) -> str:
        """Draw a line."""
        axes = figure.subplots()
        axes.plot([0.0, 1.0], label="run$_$2 W0")
        axes.legend()
        return "A line."

    draw_figures({"line": draw}, tmp_path / "out", suffix="svg", write=Path.write_bytes)
    assert "<!-- run$_$2 W0 -->" in (tmp_path / "out" / "line.svg").read_text(encoding="utf-8")


def test_missing_matplotlib_names_the_extra(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(optional_packages, "find_spec", lambda _name: None)
    with pytest.raises(OutputError) as caught:
        draw_figures(chosen(("ring-fig-12",)), tmp_path / "out", suffix="png", write=Path.write_bytes)
    assert "treadlink[plot]" in caught.value.remedy
    assert not (tmp_path / "out").exists()


@pytest.fixture(scope="module")
def drawings() -> dict[str, tuple[Any, str]]:
    """Return the figures of the ring and what their drawing says, by name."""
    pytest.importorskip("matplotlib", reason="matplotlib (extra 'plot') is not installed")
    from matplotlib.figure import Figure

    figures = {name: (Figure(), draw) for name, draw in all_figures().items() if name.startswith("ring-")}
    return {name: (figure, draw(figure)) for name, (figure, draw) in figures.items()}


@pytest.fixture(scope="module")
def captions(drawings: dict[str, tuple[Any, str]]) -> dict[str, str]:
    return {name: caption for name, (_, caption) in drawings.items()}


def test_axes_have_labels_with_units(drawings: dict[str, tuple[Any, str]]) -> None:
    for name, (figure, _) in drawings.items():
        assert figure.axes[-1].get_xlabel(), name
        first = figure.axes[0]
        shared = first.get_shared_y_axes()
        assert all(axes.get_ylabel() or shared.joined(axes, first) for axes in figure.axes), name
        assert figure.axes[0].get_legend() is not None, name


def test_fig_11_reports_good_fit_with_wrong_numbers(captions: dict[str, str]) -> None:
    residual = re.search(r"with a residual of (\d+) %", captions["ring-fig-11"])
    assert residual
    assert int(residual[1]) < 8
    search_result = re.search(r"are ([\d., ]+) of the true", captions["ring-fig-11"])
    assert search_result
    cw, ts = (float(search_result[1].split(", ")[i]) for i in (1, 3))
    assert cw < 0.75
    assert ts > 1.8


def test_captions_report_what_is_reproduced(captions: dict[str, str]) -> None:
    for name in ("ring-fig-7", "ring-fig-9", "ring-fig-10", "ring-fig-11", "ring-fig-12", "ring-fig-13"):
        assert captions[name].startswith("Reproduced")
    for name in ("ring-fig-14", "ring-fig-15", "ring-fig-16"):
        assert captions[name].startswith("Not reproduced")
        assert "Reproduced by Eq. 28 (right)" in captions[name]


def test_fig_13_bending_falls_with_wear(captions: dict[str, str]) -> None:
    search_result = re.search(r"means of Eq. 28: ([\d., ]+), times", captions["ring-fig-13"])
    assert search_result
    means = [float(mean) for mean in search_result[1].split(", ")]
    assert means == sorted(means, reverse=True)
    assert means[2] < 0.5 * means[0]
    weak = re.search(r"stays within ([\d.]+) %", captions["ring-fig-13"])
    assert weak
    assert float(weak[1]) < 2.0


def test_fig_7_has_its_power_on_integer_orders(captions: dict[str, str]) -> None:
    shares = [float(share) for share in re.findall(r"([\d.]+) ± [\d.]+ % at", captions["ring-fig-7"])]
    assert len(shares) == 3
    assert shares == sorted(shares)
    assert 99.9 < shares[0] < 99.99


def test_fig_9_forces_vanish_at_different_orders(captions: dict[str, str]) -> None:
    search_result = re.search(
        r"π / θr = ([\d.]+); the pressure of the exact ring at ([\d.]+)\.", captions["ring-fig-9"]
    )
    assert search_result
    assert float(search_result[1]) == pytest.approx(13.1, abs=0.1)
    assert float(search_result[2]) == pytest.approx(14.1, abs=0.1)


def test_fig_10_gives_each_number_its_orders(captions: dict[str, str]) -> None:
    text = captions["ring-fig-10"]
    assert "Bs at n = 9 to 30, Cw at n = 5 to 8, Rs at n = 1 to 4" in text
    assert "Bs 18, Cw 8, Rs 6, Ts 4" in text


def test_trends_caption_names_what_decides(captions: dict[str, str]) -> None:
    search_result = re.search(
        r"has exponent ([-+\d.]+) where the width is constant, ([-+\d.]+) where", captions["ring-trends"]
    )
    assert search_result
    assert abs(float(search_result[1])) < 0.02
    assert float(search_result[2]) > 0.3


QUOTED = {
    "ring-fig-7": ("99.938", "99.999"),
    "ring-fig-9": ("13.1", "14.1"),
    "ring-fig-10": ("n = 9 to 30", "46 %"),
    "ring-fig-11": ("6 %", "0.78, 0.63, 1.08, 2.21"),
    "ring-fig-12": ("17 m/s² rms of 1588 m/s²",),
    "ring-fig-13": ("2.34, 1.36, 0.72",),
    "ring-fig-14": ("slope -0.28, r -0.53", "exponent 3.8"),
    "ring-fig-15": ("r +0.35",),
    "ring-fig-16": ("r -0.29",),
    "ring-eq-11": (
        "1.6 %",
        "14 %",
        "-0.88",
        "4.9 %",
        "41 %",
        "28 N m",
        "1.13 and +0.47",
        "1.55 and -1.30",
        "0.75 and +3.51",
    ),
}
"""Figures that docs/evidence/ring-paper-figures.md quotes from the captions."""


@NEEDS_PLOT
def test_docs_quote_what_the_captions_say(captions: dict[str, str]) -> None:
    for name, quotes in QUOTED.items():
        for quote in quotes:
            assert quote in captions[name], name


@NEEDS_PLOT
def test_eq_11_caption_lists_the_bias_at_each_load(captions: dict[str, str]) -> None:
    assert "2000 N: 1.13 and +0.47; 5000 N: 1.55 and -1.30; 8000 N: 0.75 and +3.51" in captions["ring-eq-11"]


def test_docs_show_every_figure_of_the_ring_paper() -> None:
    page = (ROOT / "docs" / "evidence" / "ring-paper-figures.md").read_text("utf-8")
    for name in docs_paper_figures.names():
        assert f"(../figures/{name}.svg)" in page
        assert (docs_paper_figures.FOLDER / f"{name}.svg").is_file()
