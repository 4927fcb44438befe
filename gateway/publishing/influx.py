"""Live output as InfluxDB line protocol, to a file or to a server by HTTP (API of version 2 and 3).

A point is a revolution, a change of an alarm, or a state of a wheel, a link or the session. What the server has not
confirmed is sent again, unless it refused the content; a point of the same time and tags replaces the one before, so
that repetition is harmless.
"""

from __future__ import annotations

import os
import threading
from collections.abc import Iterator, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any, Final
from urllib.parse import unquote, urlsplit

import urllib3
from influxdb_client import InfluxDBClient, Point
from influxdb_client.client.write_api import SYNCHRONOUS
from influxdb_client.rest import ApiException

from gateway.publishing.payloads import messages
from gateway.publishing.sink import (
    REFUSED_FOR_GOOD,
    Item,
    PublishedAlarm,
    PublishedRevolution,
    PublishedState,
    Refusals,
    Sink,
    SinkAddress,
    SinkDownError,
    SinkError,
    SinkSetting,
    host_and_port,
    missing_newline,
)

TOKEN: Final = "TREADLINK_INFLUX_TOKEN"
"""Environment variable with the token of the server."""
_PORT: Final = 8086
_TIMEOUT_MS: Final = 2000
# Items that are sent together at most; otherwise they go with the state, once a second.
_MOST_ITEMS: Final = 256
_TAGS: Final = ("wheel", "link", "subject", "name")
_NO_FIELDS: Final = frozenset({"type", "time_s", *_TAGS})


def open_influx(address: SinkAddress, setting: SinkSetting) -> InfluxFile | InfluxServer:
    """Return the output of `influx:PATH`, `influx://HOST[:PORT]/BUCKET` or `influxs://`.

    Raises:
        SinkError: the file exists or its folder does not, or host or bucket is missing.
    """
    parts = urlsplit(address.uri)
    if not parts.netloc:
        if address.scheme == "influxs":
            raise SinkError(f"'{address.uri}' has no host", "Write influxs://HOST:PORT/BUCKET?org=ORG.")
        return _opened_file(address)
    address.check_options({"org"})
    host, port = host_and_port(address, _PORT)
    bucket = unquote(parts.path).strip("/")
    if not bucket:
        raise SinkError(f"'{address.name}' names no bucket", f"Write {address.scheme}://HOST:PORT/BUCKET?org=ORG.")
    scheme = "https" if address.scheme == "influxs" else "http"
    url_host = f"[{host}]" if ":" in host else host
    return InfluxServer(f"{scheme}://{url_host}:{port}", bucket, address.options.get("org", ""), os.environ)


def _opened_file(address: SinkAddress) -> InfluxFile:
    address.check_options({"append"})
    path = Path(address.target)
    if path.is_dir() or not path.parent.is_dir():
        raise SinkError(f"cannot publish to '{path}': not a file in an existing folder", "Create the folder first.")
    if path.exists() and address.options.get("append") != "yes":
        raise SinkError(f"'{path}' exists", f"Give a new file, or add to it with 'influx:{path}?append=yes'.")
    return InfluxFile(path)


def lines(item: Item) -> Iterator[str]:
    """Yield the points of an item as lines, with times in ns since 1970.

    Numbers are floats, so that a field never changes its type; texts, such as the status of an estimate, are fields.
    """
    for message in messages(item):
        point = Point(f"treadlink_{message['type']}").time(item.host_ns)
        for tag in _TAGS:
            if tag in message:
                point.tag(tag, message[tag])
        for name, value in _fields(message):
            point.field(name, value)
        line: str = point.to_line_protocol()
        if line:
            yield line


def _fields(message: Mapping[str, Any]) -> Iterator[tuple[str, float | bool | str]]:
    for name, value in message.items():
        if name in _NO_FIELDS:
            continue
        if isinstance(value, bool | str):
            yield name, value
        elif isinstance(value, int | float):
            yield name, float(value)
        elif name == "alarms":
            yield name, float(len(value))


class InfluxFile(Sink):
    """Appends lines to a file, which `influx write` and Telegraf read."""

    def __init__(self, path: Path) -> None:
        """Prepare the output."""
        self._path = path
        self._unwritten = b""
        self._item: Item | None = None

    def open(self, stop: threading.Event) -> None:
        """Check that the file can be written, and end half a line."""
        self._append(b"")
        if self._item is None:
            self._append(missing_newline(self._path))

    def send(self, item: Item, stop: threading.Event) -> None:
        """Write the lines of an item; after a full disk, from the byte at which it was full."""
        if item is not self._item:
            self._unwritten, self._item = self._unwritten + "".join(f"{line}\n" for line in lines(item)).encode(), item
        self._append(self._unwritten)
        self._item = None

    def _append(self, data: bytes) -> None:
        try:
            with self._path.open("ab", buffering=0) as file:
                while data:
                    written = file.write(data) or 0
                    data = self._unwritten = data[written:]
        except OSError as error:
            raise SinkDownError(error.strerror or str(error)) from error


class InfluxServer(Sink):
    """Writes to a bucket of a server, once a second and whenever enough waits."""

    def __init__(self, url: str, bucket: str, org: str, environment: Mapping[str, str]) -> None:
        """Prepare the client; `environment` holds the token."""
        self._bucket, self._org = bucket, org
        self._url, self._token = url, environment.get(TOKEN, "")
        self._client: InfluxDBClient | None = None
        self._lines: list[str] = []
        # Revolutions and alarms whose lines wait.
        self._waiting = 0
        self._item: Item | None = None
        self._refusals = Refusals()

    def open(self, stop: threading.Event) -> None:
        """Prepare the connection; a server that is away is noticed by what waits for it."""
        self._client = InfluxDBClient(self._url, self._token, timeout=_TIMEOUT_MS, org=self._org, retries=False)
        self._write()

    def send(self, item: Item, stop: threading.Event) -> None:
        """Take the lines of an item, and send them when a second is over or enough wait."""
        self._refusals.check()
        if item is not self._item:
            self._lines += lines(item)
            self._waiting += isinstance(item, PublishedRevolution | PublishedAlarm)
            self._item = item
        if isinstance(item, PublishedState) or self._waiting >= _MOST_ITEMS:
            self._write()
        self._item = None

    def poll(self) -> None:
        """Say what the server has refused."""
        self._refusals.check()

    def flush(self, stop: threading.Event) -> int:
        """Send what waits, and return how many revolutions and alarms the server has not confirmed."""
        with suppress(SinkDownError):
            self._write()
        if not stop.is_set():
            self._refusals.check()
        return self._waiting + self._refusals.count

    def close(self) -> None:
        """Close the connection; what waits is kept."""
        client, self._client = self._client, None
        if client is not None:
            client.close()

    def _write(self) -> None:
        if not self._lines:
            return
        if self._client is None:
            raise SinkDownError("not connected")
        try:
            api = self._client.write_api(write_options=SYNCHRONOUS)
            api.write(self._bucket, self._org, "\n".join(self._lines))
        except ApiException as error:
            cause = f"{error.status} {error.reason}{_remedy(error.status)}"
            if error.status not in REFUSED_FOR_GOOD:
                raise SinkDownError(f"the server refuses: {cause}") from error
            self._refusals.add(cause, self._waiting)
        except (urllib3.exceptions.HTTPError, OSError) as error:
            raise SinkDownError("the server does not answer") from error
        self._lines.clear()
        self._waiting = 0


def _remedy(status: int | None) -> str:
    if status in (401, 403):
        return f"; set {TOKEN} to a token that may write"
    return "; check bucket and org" if status == 404 else ""
