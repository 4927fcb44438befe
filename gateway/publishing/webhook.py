"""Live output of alarms as HTTP requests: each change of an alarm is posted as JSON until the server has judged it."""

from __future__ import annotations

import http.client
import os
import threading
from typing import Final
from urllib.error import HTTPError, URLError
from urllib.parse import quote, urlsplit
from urllib.request import HTTPRedirectHandler, Request, build_opener

from gateway import __version__
from gateway.publishing.payloads import alarm, encoded
from gateway.publishing.sink import (
    REFUSED_FOR_GOOD,
    Item,
    PublishedAlarm,
    Refusals,
    Sink,
    SinkAddress,
    SinkDownError,
    SinkError,
    SinkSetting,
)

TOKEN: Final = "TREADLINK_WEBHOOK_TOKEN"
"""Environment variable with a token, sent as `Authorization: Bearer`."""
_TIMEOUT_S: Final = 5.0
_UNQUOTED: Final = "/?%:@!$&'()*+,;="


def open_webhook(address: SinkAddress, setting: SinkSetting) -> Webhook:
    """Return the output of `webhook:https://HOST/PATH`; the query belongs to the receiver.

    Raises:
        SinkError: the rest is no address of a web server, or has a password in it.
    """
    url = address.uri.partition(":")[2]
    parts = urlsplit(url)
    if parts.scheme not in ("http", "https") or not parts.hostname:
        raise SinkError(f"'{address.name}' has no address of a web server", "Write webhook:https://HOST/PATH.")
    if "@" in parts.netloc:
        raise SinkError(
            f"'{address.name}' has a user name or password in its address, where others can read it",
            f"Set the environment variable {TOKEN}.",
        )
    # HTTP takes neither spaces nor letters beyond ASCII; what is quoted stays so.
    path, query = (quote(part, safe=_UNQUOTED) for part in (parts.path, parts.query))
    return Webhook(parts._replace(path=path, query=query).geturl(), os.environ.get(TOKEN, ""))


class Webhook(Sink):
    """Posts what is said of alarms; revolutions and states are left out."""

    def __init__(self, url: str, token: str = "") -> None:
        """Prepare requests to a URL."""
        self._url = url
        self._headers = {"Content-Type": "application/json", "User-Agent": f"treadlink/{__version__}"}
        if token:
            self._headers["Authorization"] = f"Bearer {token}"
        # A redirected request would lose its content, and could take the token to another server.
        self._opener = build_opener(_NoRedirect)
        self._item: PublishedAlarm | None = None
        self._is_posted = False
        self._refusals = Refusals()

    def open(self, stop: threading.Event) -> None:
        """Post the alarm that was refused: without one, a server that is away is noticed by the next alarm."""
        if self._item is not None:
            self._post(self._item, stop)
            self._is_posted = True

    def send(self, item: Item, stop: threading.Event) -> None:
        """Post an alarm that was raised, acknowledged or is over, and wait for the answer.

        Raises:
            SinkDownError: the server does not answer, or takes no alarm.
        """
        self._refusals.check()
        if not isinstance(item, PublishedAlarm):
            return
        if item is not self._item:
            self._item, self._is_posted = item, False
        if not self._is_posted:
            self._post(item, stop)
        self._item = None

    def poll(self) -> None:
        """Say which alarms the server has refused."""
        self._refusals.check()

    def flush(self, stop: threading.Event) -> int:
        """Return, with `stop` set, how many refused alarms are not said yet."""
        if not stop.is_set():
            self._refusals.check()
        return self._refusals.count

    def _post(self, item: PublishedAlarm, stop: threading.Event) -> None:
        if stop.is_set():
            raise SinkDownError("the session has ended")
        request = Request(self._url, encoded(alarm(item)), self._headers, method="POST")
        try:
            with self._opener.open(request, timeout=_TIMEOUT_S):
                return
        except HTTPError as error:
            error.close()
            if error.code in REFUSED_FOR_GOOD:
                self._refusals.add(f"{error.code} {error.reason}", 1)
                return
            remedy = f"; set {TOKEN}" if error.code in (401, 403) else ""
            raise SinkDownError(f"the server refuses: {error.code} {error.reason}{remedy}") from error
        except (URLError, http.client.HTTPException, OSError) as error:
            cause = getattr(error, "reason", error)
            raise SinkDownError(f"the server does not answer: {cause}") from error


class _NoRedirect(HTTPRedirectHandler):
    def redirect_request(self, *_: object) -> None:
        """Return nothing, so that a redirection is a refusal with its status."""
