"""Parts of self-contained pages: scripts, styles, and the policy that allows those scripts alone."""

from base64 import b64encode
from collections.abc import Iterable, Sequence
from hashlib import sha256
from importlib import resources
from typing import Final, NamedTuple

_PICTURES: Final = "gateway.core.text.pictures"


class Part(NamedTuple):
    """A file of a page.

    Attributes:
        element: `script` or `style`.
        text: its content.
    """

    element: str
    text: str

    def html(self) -> str:
        """Return it as an element."""
        return f"<{self.element}>{self.text}</{self.element}>"


class PageFile(NamedTuple):
    """A page that is served, and the policy that allows its own scripts and this server only."""

    html: bytes
    policy: str


def page_part(name: str, package: str = _PICTURES) -> Part:
    """Return a script or a style sheet of a package, by default of those that pages share."""
    text = resources.files(package).joinpath(name).read_text(encoding="utf-8")
    return Part("script" if name.endswith(".js") else "style", text)


def plot_licence() -> str:
    """Return the licence of uPlot, which a page that contains it must contain too."""
    return resources.files(_PICTURES).joinpath("uPlot.LICENSE").read_text(encoding="utf-8")


def script_policy(parts: Iterable[Part]) -> str:
    """Return the content policy of a page: no resource but its styles and these scripts."""
    hashes = [
        f"'sha256-{b64encode(sha256(part.text.encode()).digest()).decode()}'"
        for part in parts
        if part.element == "script"
    ]
    scripts = f"script-src {' '.join(hashes)}; " if hashes else ""
    return f"default-src 'none'; {scripts}style-src 'unsafe-inline'; img-src data:"


def joined_page(name: str, package: str, parts: Sequence[Part]) -> PageFile:
    """Return a page of a package as one file: its markup with styles, scripts and the licence of the plots."""
    html = resources.files(package).joinpath(name).read_text(encoding="utf-8")
    html = html.replace("LICENCE OF THE PLOTS", plot_licence())
    for marker, element in (("<!-- STYLES -->", "style"), ("<!-- SCRIPTS -->", "script")):
        html = html.replace(marker, "\n".join(part.html() for part in parts if part.element == element))
    server_policy = "connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
    return PageFile(html.encode(), f"{script_policy(parts)}; {server_policy}")
