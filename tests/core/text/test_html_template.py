"""Pages show names that turn text around, or control a terminal that prints the page, as escapes."""

import pytest

pytest.importorskip("jinja2")

from gateway.core.text.html_template import html_template


def test_text_is_escaped_once_and_for_all_pages(tmp_path, monkeypatch):
    (tmp_path / "pages_of_a_test").mkdir()
    (tmp_path / "pages_of_a_test" / "__init__.py").touch()
    (tmp_path / "pages_of_a_test" / "p.html.j2").write_text("{{ name }}|{{ name | upper }}|{{ own }}|{{ number }}")
    monkeypatch.syspath_prepend(tmp_path)
    from markupsafe import Markup

    name = "<b>\u202e\x1b[2J\u200b"
    page = html_template("pages_of_a_test", "p.html.j2").render(name=name, own=Markup("<i>\u202e"), number=1.5)
    assert page.split("|")[0] == r"&lt;b&gt;\u202e\x1b[2J\u200b"
    assert page.split("|")[1].isprintable()
    assert page.split("|")[2:] == ["<i>\u202e", "1.5"]
