"""Server of a page for browsers: who may open it, the page itself, and the WebSockets of those who have it open."""

from __future__ import annotations

import asyncio
import hmac
import logging
import secrets
import socket
import threading
from collections.abc import Awaitable, Callable
from contextlib import suppress
from functools import partial
from http import HTTPStatus
from ipaddress import ip_address
from typing import Any, Final
from urllib.parse import parse_qs, urlsplit

from websockets.asyncio.server import ServerConnection, serve
from websockets.datastructures import Headers
from websockets.exceptions import ConnectionClosed
from websockets.http11 import Request, Response

from gateway.core.text.page_parts import PageFile
from gateway.publishing.admission import HEAD_S, Admission

_logger = logging.getLogger(__name__)
# Strangers whose requests cannot be read, or who leave in the middle, are no fault of this program.
_STRANGERS: Final = _logger.getChild("websockets")
_STRANGERS.setLevel(logging.CRITICAL)

MOST_PAGES: Final = 20
"""Pages that may be open at once."""
_LARGEST_MESSAGE: Final = 4096
# Asyncio accepts so many connections before one of them can be sent away.
_BACKLOG: Final = 8
# A page that takes this much less than it is sent is behind.
_WRITE_BYTES: Final = 1 << 16
_STARTED_S: Final = 5.0
_ENDED_S: Final = 1.0
_LOOPBACK_NAMES: Final = ("localhost",)


class PageServer:
    """Serves a page in a thread with an event loop; only this computer can open that of a loopback address.

    Attributes:
        port: that it listens on.
        address: of the page, with its token where it listens wider than this computer.
    """

    def __init__(
        self,
        host: str,
        port: int,
        page: Callable[[], PageFile],
        talk: Callable[[ServerConnection], Awaitable[None]],
    ) -> None:
        """Take the port; port 0 lets the system choose one.

        Args:
            host: name or address to listen on.
            port: to listen on.
            page: returns the page.
            talk: speaks with a page that is open, in the event loop, until it ends or the page is closed.

        Raises:
            OSError: the port is taken, or the host is none of this computer's.
        """
        self._host, self._page_file, self._talk = host, page, talk
        self._listener: socket.socket | None = _listener(host, port)
        self.port: int = self._listener.getsockname()[1]
        self._is_local = _is_loopback(self._listener.getsockname()[0])
        self._token = "" if self._is_local else secrets.token_urlsafe(16)
        self.address = f"http://{_shown_host(host, self._listener)}:{self.port}/"
        if self._token:
            self.address += f"?token={self._token}"
        self.loop: asyncio.AbstractEventLoop | None = None
        self._thread: threading.Thread | None = None
        self._closing = asyncio.Event()
        self._pages = 0
        self._admission = Admission()

    def start(self) -> bool:
        """Start serving, after `close` again; return whether the server has come up.

        Raises:
            OSError: the port is taken meanwhile.
        """
        listener = self._listener or _listener(self._host, self.port)
        self._listener = None
        started = threading.Event()
        self._thread = threading.Thread(
            target=lambda: asyncio.run(self._serve(listener, started)), name="page", daemon=True
        )
        self._thread.start()
        return started.wait(_STARTED_S)

    def close(self) -> None:
        """Stop serving."""
        if self._listener is not None:
            self._listener.close()
            self._listener = None
        self.call(self._closing.set)
        if self._thread is not None:
            self._thread.join(_STARTED_S)
            self._thread = None

    def call(self, call: Callable[[], object]) -> None:
        """Let the event loop call something; nothing happens where it does not run."""
        loop = self.loop
        if loop is not None:
            with suppress(RuntimeError):  # it has ended
                loop.call_soon_threadsafe(call)

    async def _serve(self, listener: socket.socket, started: threading.Event) -> None:
        self._closing = asyncio.Event()
        # Such as a connection for which the system has no descriptor: asyncio tries again, and would print a traceback.
        asyncio.get_running_loop().set_exception_handler(_tell_error)
        server = await serve(
            self._visited,
            sock=listener,
            backlog=_BACKLOG,
            process_request=self._answer,
            create_connection=partial(_BoundedConnection, admission=self._admission),  # type: ignore[arg-type]  # a factory
            open_timeout=HEAD_S,
            compression=None,
            max_size=_LARGEST_MESSAGE,
            write_limit=_WRITE_BYTES,
            server_header=None,
            logger=_STRANGERS,
        )
        self.loop = asyncio.get_running_loop()
        started.set()
        await self._closing.wait()
        self.loop = None
        server.close()
        # A browser keeps connections open on which it asks for nothing: they are not waited for.
        with suppress(TimeoutError):
            async with asyncio.timeout(_ENDED_S):
                await server.wait_closed()

    def _answer(self, connection: ServerConnection, request: Request) -> Response | None:
        """Return the page or a refusal; None lets a page's WebSocket open."""
        try:
            parts = urlsplit(request.path)
            (host,) = request.headers.get_all("Host")
            name = urlsplit(f"//{host}").hostname or ""
        except ValueError:
            return connection.respond(HTTPStatus.BAD_REQUEST, "The request cannot be read.\n")
        if getattr(request, "method", "GET") != "GET":
            refused = connection.respond(HTTPStatus.METHOD_NOT_ALLOWED, "Only GET is allowed.\n")
            refused.headers["Allow"] = "GET"
            return refused
        # A name that a foreign site has pointed at this computer is refused, whatever its page asks for.
        if self._is_local and not _is_loopback(name):
            return connection.respond(HTTPStatus.FORBIDDEN, "This page is for this computer only.\n")
        token = parse_qs(parts.query).get("token", [""])[0]
        if self._token and not hmac.compare_digest(token.encode(), self._token.encode()):
            return connection.respond(
                HTTPStatus.FORBIDDEN, "Open the address that treadlink printed: its token fails.\n"
            )
        if "Upgrade" not in request.headers:
            return (
                _page_response(self._page_file()) if parts.path == "/" else connection.respond(HTTPStatus.NOT_FOUND, "")
            )
        if request.headers.get("Origin") not in (f"http://{host}", f"https://{host}"):
            return connection.respond(HTTPStatus.FORBIDDEN, "Not a page of this program.\n")
        if self._pages >= MOST_PAGES:
            return connection.respond(HTTPStatus.SERVICE_UNAVAILABLE, f"{MOST_PAGES} pages are open already.\n")
        return None

    async def _visited(self, connection: ServerConnection) -> None:
        self._pages += 1
        try:
            with suppress(ConnectionClosed):
                await self._talk(connection)
        finally:
            self._pages -= 1


class _BoundedConnection(ServerConnection):
    """A connection that is ended at once where its listener has too many, or its peer."""

    def __init__(self, *arguments: Any, admission: Admission, **options: Any) -> None:
        super().__init__(*arguments, **options)
        self._admission = admission
        self._admitted: str | None = None

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Begin the handshake, or end the connection."""
        super().connection_made(transport)
        peer = str((transport.get_extra_info("peername") or ("",))[0])
        if self._admission.admit(peer):
            self._admitted = peer
        elif isinstance(transport, asyncio.WriteTransport):
            transport.abort()

    def connection_lost(self, error: Exception | None) -> None:
        """Count the connection no more."""
        if self._admitted is not None:
            self._admission.release(self._admitted)
            self._admitted = None
        super().connection_lost(error)


def _page_response(page: PageFile) -> Response:
    headers = Headers(
        {
            "Content-Type": "text/html; charset=utf-8",
            "Content-Length": str(len(page.html)),
            "Content-Security-Policy": page.policy,
            "Referrer-Policy": "no-referrer",
            "X-Content-Type-Options": "nosniff",
            "Cache-Control": "no-store",
            "Connection": "close",
        }
    )
    return Response(HTTPStatus.OK.value, HTTPStatus.OK.phrase, headers, page.html)


def _listener(host: str, port: int) -> socket.socket:
    family = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0][0]
    return socket.create_server((host, port), family=family)


def _is_loopback(host: str) -> bool:
    """Return whether a name or address is that of this computer to itself."""
    if host in _LOOPBACK_NAMES:
        return True
    try:
        return ip_address(host).is_loopback
    except ValueError:
        return False


def _tell_error(_: asyncio.AbstractEventLoop, context: dict[str, Any]) -> None:
    _logger.warning("the page: %s: %s", context["message"], context.get("exception"))


def _shown_host(host: str, listener: socket.socket) -> str:
    """Return the host of the address that users open; for every interface the one that others reach first."""
    bound = listener.getsockname()[0]
    if ip_address(bound.partition("%")[0]).is_unspecified:
        with suppress(OSError), socket.socket(listener.family, socket.SOCK_DGRAM) as probe:
            # Connecting a datagram socket sends nothing; the address is of the range for documentation.
            probe.connect(("192.0.2.1" if listener.family == socket.AF_INET else "2001:db8::1", 9))
            host = probe.getsockname()[0]
    return f"[{host}]" if ":" in host else host
