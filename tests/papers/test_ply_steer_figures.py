"""The ply steer paper's figures and their captions."""

import re

import pytest

from gateway.papers.ply_steer_figures import figures

pytest.importorskip("matplotlib", reason="matplotlib (extra 'plot') is not installed")


@pytest.mark.parametrize("name", list(figures()))
def test_figure_draws_and_caption_has_numbers(name: str) -> None:
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure()
    caption = figures()[name](figure)
    FigureCanvasAgg(figure).draw()
    assert figure.axes
    assert all(axes.lines or axes.tables for axes in figure.axes)
    assert caption.endswith(".")

    assert re.search(r"\d", caption)
    assert "nan" not in caption


def caption(name: str) -> str:
    from matplotlib.figure import Figure

    return figures()["ply-steer-" + name](Figure())


def test_captions_report_the_papers_phenomena() -> None:
    assert re.search(r"in one direction it has one extremum .* in the other two extrema", caption("fig-2"))
    odd = re.search(r"odd share (\d\.\d+)", caption("fig-10"))
    assert odd
    assert float(odd[1]) > 0.999
    left_out = re.search(r"within (\d+\.\d) % rms", caption("tables"))
    assert left_out
    assert float(left_out[1]) <= 4.0


def test_laminate_figure_compares_stated_plies_with_the_peak() -> None:
    search_result = re.search(r"is (\d\.\d+) to (\d\.\d+) of it", caption("laminate"))
    assert search_result
    assert 0.8 < float(search_result[1]) <= float(search_result[2]) < 1.0


def test_slope_ahead_follows_the_pressure_and_the_peak_does_not() -> None:
    search_result = re.search(r"\((\d\.\d+), peak\).* has a trend \((\d\.\d+)\)", caption("fig-14"))
    assert search_result
    assert abs(float(search_result[1]) - 1.0) < 0.05
    assert float(search_result[2]) > 1.25
