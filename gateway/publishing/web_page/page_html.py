"""The live page."""

from functools import lru_cache

from gateway.core.text.page_parts import PageFile, joined_page, page_part


@lru_cache(maxsize=1)
def page_file() -> PageFile:
    """Return the page."""
    styles = [page_part("uPlot.min.css"), page_part("page.css", __package__)]
    scripts = [page_part("uPlot.iife.min.js"), page_part("pictures.js"), page_part("page.js", __package__)]
    return joined_page("page.html", __package__, (*styles, *scripts))
