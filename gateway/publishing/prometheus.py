"""Live output as an endpoint that Prometheus scrapes: the last state of wheels, links and session as metrics."""

from __future__ import annotations

import socket
import threading
from collections.abc import Iterable, Iterator
from socketserver import ThreadingMixIn
from typing import Any, Final
from wsgiref.simple_server import WSGIRequestHandler, WSGIServer, make_server

from prometheus_client import CollectorRegistry, make_wsgi_app
from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, Metric
from prometheus_client.registry import Collector

from gateway.core.estimates.estimator import Status
from gateway.core.estimates.results import WheelSnapshot
from gateway.publishing.admission import HEAD_S, Admission
from gateway.publishing.payloads import JsonObject, is_current, messages
from gateway.publishing.sink import (
    Item,
    PublishedState,
    Sink,
    SinkAddress,
    SinkDownError,
    SinkSetting,
    cannot_listen,
    host_and_port,
)

_PORT: Final = 9464
_LABELS: Final = {"wheel": ("wheel",), "link": ("link",), "session": ()}
_COUNTERS: Final = frozenset({
    "revolutions", "revolutions_rejected", "samples", "samples_lost", "samples_saturated", "bytes_received", "frames",
    "frames_lost", "crc_errors", "noise_bytes", "duplicates", "reordered", "dropped",
})  # fmt: skip
_NO_NUMBERS: Final = frozenset({"type", "time_s", "wheel", "link"})


def open_prometheus(address: SinkAddress, setting: SinkSetting) -> PrometheusEndpoint:
    """Return the output of `prometheus://HOST[:PORT]`, the address at which it listens.

    Raises:
        SinkError: there is no host, or an option.
    """
    address.check_options(())
    return PrometheusEndpoint(*host_and_port(address, _PORT))


class _Handler(WSGIRequestHandler):
    """Handler of one request, which has to come within a time."""

    timeout = HEAD_S

    def log_message(self, format: str, *args: Any) -> None:
        """Log nothing: scrapes come every few seconds."""


class _Server(ThreadingMixIn, WSGIServer):
    """Server with a thread for each connection, of which there are so many at once."""

    daemon_threads = True

    def __init__(self, *arguments: Any, **options: Any) -> None:
        self._admission = Admission()
        super().__init__(*arguments, **options)

    def verify_request(self, request: Any, client_address: Any) -> bool:
        """Return whether there is room for a connection."""
        return self._admission.admit(str(client_address[0]))

    def process_request_thread(self, request: Any, client_address: Any) -> None:
        """Answer, and count the connection no more."""
        try:
            super().process_request_thread(request, client_address)
        finally:
            self._admission.release(str(client_address[0]))

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Print nothing: a client that leaves in the middle is no fault of this program."""


class _ServerOfSix(_Server):
    address_family = socket.AF_INET6


class PrometheusEndpoint(Sink):
    """Server of `/metrics`, by the client library of Prometheus."""

    def __init__(self, host: str, port: int) -> None:
        """Prepare the server."""
        self._host, self._port = host, port
        self._registry = CollectorRegistry()
        self._state = _LastState()
        self._registry.register(self._state)
        self._server: WSGIServer | None = None

    @property
    def port(self) -> int:
        """Port at which it listens, 0 before it does."""
        return 0 if self._server is None else int(self._server.server_port)

    def open(self, stop: threading.Event) -> None:
        """Listen."""
        try:
            server_class = _ServerOfSix if ":" in self._host else _Server
            self._server = make_server(self._host, self._port, make_wsgi_app(self._registry), server_class, _Handler)
        except OSError as error:
            raise SinkDownError(cannot_listen(self._host, self._port, error)) from error
        threading.Thread(target=self._server.serve_forever, name="metrics", daemon=True).start()

    def send(self, item: Item, stop: threading.Event) -> None:
        """Keep the last state, which has the last revolution of each wheel and all alarms."""
        if isinstance(item, PublishedState):
            self._state.item = item

    def close(self) -> None:
        """Stop listening."""
        server, self._server = self._server, None
        if server is not None:
            server.shutdown()
            server.server_close()


class _LastState(Collector):
    """Metrics of the last state: what is silent has no number, so that no old one looks like the present."""

    item: PublishedState | None = None

    def describe(self) -> Iterable[Metric]:
        return ()

    def collect(self) -> Iterator[Metric]:
        item = self.item
        if item is None:
            return
        metrics: dict[str, Any] = {}
        for message in messages(item):
            _add_numbers(metrics, message)
        yield from metrics.values()
        alarm = GaugeMetricFamily("treadlink_alarm", "1 while the alarm stands", labels=("subject", "name"))
        for active in item.snapshot.alarms:
            alarm.add_metric((active.position, str(active.name)), 1.0)
        yield alarm
        yield from _estimates(item.snapshot.wheels)


def _add_numbers(metrics: dict[str, Any], message: JsonObject) -> None:
    kind = message["type"]
    labels = _LABELS[kind]
    values = tuple(message[label] for label in labels)
    for field, value in message.items():
        if field in _NO_NUMBERS or not isinstance(value, bool | int | float):
            continue
        name = f"treadlink_{kind}_{field}"
        family = CounterMetricFamily if field in _COUNTERS else GaugeMetricFamily
        # What nobody measured says so.
        source = message.get(f"{field.rpartition('_')[0]}_source")
        names, of_value = (labels, values) if source is None else ((*labels, "source"), (*values, source))
        metric = metrics.setdefault(name, family(name, f"{field} of a {kind}, as in the states of JSON", labels=names))
        metric.add_metric(of_value, float(value))


def _estimates(wheels: Iterable[WheelSnapshot]) -> Iterator[Metric]:
    """Yield value and standard error of the last revolution's estimates, without the invalid and those not of now."""
    labels = ("wheel", "name")
    value = GaugeMetricFamily("treadlink_estimate", "estimate of the last revolution, unit in its name", labels=labels)
    error = GaugeMetricFamily("treadlink_estimate_std", "standard error of an estimate", labels=labels)
    valid = GaugeMetricFamily("treadlink_estimate_valid", "1 for valid, 0 for provisional", labels=labels)
    for wheel in wheels:
        for estimate in wheel.last.estimates if wheel.last is not None else ():
            if estimate.status is Status.INVALID or not is_current(wheel, estimate.name):
                continue
            key = (wheel.position, estimate.name)
            value.add_metric(key, estimate.value)
            error.add_metric(key, estimate.std)
            valid.add_metric(key, float(estimate.status is Status.VALID))
    yield from (value, error, valid)
