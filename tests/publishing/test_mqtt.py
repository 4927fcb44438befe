"""MQTT through a real broker: topics, retained states, last will, TLS, and a broker that stalls, dies and returns."""

import datetime
import ipaddress
import json
import os
import re
import signal
import subprocess
import sys
import threading
from dataclasses import replace
from pathlib import Path

import jsonschema
import pytest

from gateway.core.clock import SystemClock
from gateway.core.text.wording import text
from gateway.publishing.line_schema import line_schema
from gateway.publishing.mqtt import PASSWORD, USERNAME
from gateway.publishing.sink import PublishedState, SinkError, SinkSetting, open_sink
from gateway.publishing.sink_worker import SinkWorker
from tests.testkit.waiting import TIMEOUT_S, until
from tools.mqtt_broker import PROGRAM, Broker, Listener

pytestmark = pytest.mark.skipif(PROGRAM is None, reason="needs mosquitto")
ROOT = Path(__file__).parents[2]
VALIDATOR = jsonschema.Draft202012Validator(line_schema())


@pytest.fixture
def broker(tmp_path):
    broker = Broker(tmp_path).start()
    yield broker
    broker.kill()


@pytest.fixture
def listener(broker):
    listener = Listener(broker.port)
    yield listener
    listener.close()


def begin(uri: str, positions: tuple[str, ...] = ()) -> SinkWorker:
    name, sink = open_sink(uri, SinkSetting(positions))
    worker = SinkWorker(name, sink, SystemClock())
    worker.start()
    return worker


def finish(worker: SinkWorker) -> None:
    worker.finish()
    assert worker.join(TIMEOUT_S)
    worker.discard()


def test_topics_payloads_and_retained_states(items, broker, listener) -> None:
    worker = begin(f"mqtt://127.0.0.1:{broker.port}/car/1")
    for item in items:
        worker.offer(item)
    finish(worker)
    assert (worker.snapshot().published, worker.snapshot().dropped) == (len(items) - 1, 0)
    until(lambda: listener.of("car/1/status")[-1:] == ["offline"])
    wheels = ("FL", "FR", "RL", "RR")
    revolutions = [result for wheel in wheels for result in listener.of(f"car/1/wheel/{wheel}/revolution")]
    assert len(revolutions) == len(items) - 3
    assert [result["raised"] for result in listener.of("car/1/alarm")] == [True, False]
    assert listener.of("car/1/status") == ["online", "offline"]
    state, _ = listener.of("car/1/wheel/FL/state")
    link, _ = listener.of("car/1/link/sim%3Ademo/state")
    session, _ = listener.of("car/1/session")
    for payload in (*revolutions, *listener.of("car/1/alarm"), state, link, session):
        VALIDATOR.validate(payload)
    late = Listener(broker.port)
    until(lambda: late.of("car/1/session"))
    late.close()
    remaining = {topic for topic, retained, _ in late.messages if retained and topic.startswith("car")}
    states = {f"car/1/wheel/{wheel}/state" for wheel in ("FL", "FR", "RL", "RR")}
    assert remaining == states | {"car/1/link/sim%3Ademo/state", "car/1/session", "car/1/status"}


def test_home_assistant_finds_numbers_that_are_published(items, broker, listener) -> None:
    worker = begin(f"mqtt://127.0.0.1:{broker.port}/car")
    worker.offer(items[-1])
    finish(worker)
    until(lambda: listener.of("car/status")[-1:] == ["offline"])
    topics = {topic for topic, _, _ in listener.messages if topic.startswith("homeassistant/")}
    results = {topic: listener.of(topic)[0] for topic in topics}
    assert len(results) == 4 * 8 + 4
    assert len({entity["unique_id"] for entity in results.values()}) == len(results)
    for topic, entity in results.items():
        assert re.fullmatch(r"homeassistant/(sensor|binary_sensor)/[a-zA-Z0-9_-]+/[a-zA-Z0-9_-]+/config", topic)
        assert entity["availability_topic"] == "car/status"
        state, _ = listener.of(entity["state_topic"])
        (field,) = re.findall(r"value_json\.(\w+)", entity["value_template"])
        schema = line_schema()["$defs"][state["type"]]
        assert field in schema["properties"]
        assert field in state or field == "wear_mm"
    speed = results["homeassistant/sensor/car_wheel_FL/speed_mps/config"]
    assert (speed["unit_of_measurement"], speed["device_class"], speed["state_class"]) == (
        "m/s",
        "speed",
        "measurement",
    )
    assert speed["expire_after"] == 30


def retained(broker: Broker) -> set[str]:
    late = Listener(broker.port)
    late.publish("last", b"retained")
    until(lambda: late.of("last"))
    late.close()
    return {topic for topic, is_retained, payload in late.messages if is_retained and payload}


def of_next_vehicle(state: PublishedState, elapsed_s: float) -> PublishedState:
    """A state of a motorcycle on another link."""
    wheels = [
        replace(wheel, position=name) for wheel, name in zip(state.snapshot.wheels, ("front", "rear"), strict=False)
    ]
    links = [replace(state.snapshot.links[0], link="sim:next")]
    snapshot = replace(state.snapshot, wheels=tuple(wheels), links=tuple(links), elapsed_s=elapsed_s)
    return PublishedState(state.host_ns, snapshot)


@pytest.mark.parametrize(("elapsed_s", "forgotten_links"), [(2.5, 0), (31.0, 4)])
def test_next_session_removes_wheels_and_links_that_are_gone(items, broker, elapsed_s, forgotten_links) -> None:
    others = Listener(broker.port)
    others.publish("homeassistant/sensor/lamp/power/config", b'{"availability_topic":"car/status"}')
    others.publish("homeassistant/sensor/lamp/text/config", b"[" * 5000)
    uri = f"mqtt://127.0.0.1:{broker.port}/car"
    worker = begin(uri)
    worker.offer(items[-1])
    finish(worker)
    before = retained(broker)
    assert "car/wheel/FL/state" in before
    of_links = {topic for topic in before if "/car_link_sim_3Ademo/" in topic}
    assert len(of_links) == 4

    watch = Listener(broker.port)

    def are_removed() -> bool:
        worker.offer(of_next_vehicle(items[-1], elapsed_s))
        removed = {topic for topic, _, payload in tuple(watch.messages) if not payload}
        return len(removed) >= 4 + 1 + 4 * 7 + forgotten_links

    worker = begin(uri, ("front", "rear"))
    until(are_removed)
    finish(worker)
    after = retained(broker)
    others.close()
    watch.close()
    wheels = {"car/wheel/front/state", "car/wheel/rear/state"}
    assert {topic for topic in after if topic.startswith("car/")} == wheels | {
        "car/link/sim%3Anext/state",
        "car/session",
        "car/status",
    }
    assert not [topic for topic in after if "/car_wheel_F" in topic or "/car_wheel_R" in topic]
    assert len(of_links & after) == 4 - forgotten_links
    assert {"homeassistant/sensor/lamp/power/config", "homeassistant/sensor/lamp/text/config"} <= after
    assert len([topic for topic in after if topic.startswith("homeassistant/")]) == 2 + 2 * 8 + 8 - forgotten_links


def test_discovery_can_be_switched_off(items, broker, listener) -> None:
    worker = begin(f"mqtt://127.0.0.1:{broker.port}/car?discovery=off")
    worker.offer(items[-1])
    finish(worker)
    until(lambda: listener.of("car/status")[-1:] == ["offline"])
    assert listener.of("car/session")
    assert not any(topic.startswith("homeassistant") for topic, _, _ in listener.messages)


def test_late_last_will_is_corrected(items, broker, listener) -> None:
    worker = begin(f"mqtt://127.0.0.1:{broker.port}/car")
    until(lambda: listener.of("car/status") == ["online"])
    listener.publish("car/status", b"offline")
    until(lambda: listener.of("car/status") == ["online", "offline", "online"])
    finish(worker)
    until(lambda: listener.of("car/status") == ["online", "offline", "online", "offline"])


def test_output_that_is_abandoned_is_offline(broker, listener) -> None:
    _, sink = open_sink(f"mqtt://127.0.0.1:{broker.port}/car", SinkSetting())
    sink.open(threading.Event())
    until(lambda: sink.poll() or listener.of("car/status") == ["online"])
    sink.close()
    until(lambda: listener.of("car/status") == ["online", "offline"])


def test_stalled_broker_loses_nothing(items, broker, listener) -> None:
    worker = begin(f"mqtt://127.0.0.1:{broker.port}/car")
    worker.offer(items[0])
    until(lambda: listener.of(f"car/wheel/{items[0].result.position}/revolution"))
    broker.signal(signal.SIGSTOP)
    for item in items[1:-1]:
        worker.offer(item)
    until(lambda: worker.snapshot().state == "stalled")
    assert worker.snapshot().waiting > 0
    assert worker.snapshot().published <= 22
    broker.signal(signal.SIGCONT)
    finish(worker)
    until(lambda: listener.of("car/status")[-1] == "offline")
    indices = [(result["wheel"], result["index"]) for topic, _, payload in listener.messages
               if topic.endswith("/revolution") for result in [json.loads(payload)]]  # fmt: skip
    assert len(set(indices)) == len(items) - 3
    assert (worker.snapshot().published, worker.snapshot().dropped) == (len(items) - 1, 0)


def test_killed_broker_is_reached_again(items, broker) -> None:
    name, sink = open_sink(f"mqtt://127.0.0.1:{broker.port}/car", SinkSetting())
    is_allowed = threading.Event()
    is_allowed.set()
    really_open = sink.open
    sink.open = lambda stop: (is_allowed.wait(TIMEOUT_S), really_open(stop))
    worker = SinkWorker(name, sink, SystemClock())
    worker.start()
    worker.offer(items[0])
    until(lambda: worker.snapshot().published == 1)
    until(lambda: not sink._window)
    broker.kill()
    for item in items[1:-1]:
        worker.offer(item)
    until(lambda: worker.snapshot().state == "down")
    assert worker.snapshot().note["error"] in ("connection refused", "the connection to the broker is lost")
    is_allowed.clear()
    until(lambda: worker.snapshot().state == "down")
    broker.start()
    listener = Listener(broker.port)
    is_allowed.set()
    finish(worker)
    until(lambda: listener.of("car/status")[-1:] == ["offline"])
    listener.close()
    revolutions = [json.loads(payload) for topic, _, payload in listener.messages if topic.endswith("/revolution")]
    assert len({(revolution["wheel"], revolution["index"]) for revolution in revolutions}) == len(items) - 4, (
        "all but the first"
    )
    assert (worker.snapshot().published, worker.snapshot().dropped) == (len(items) - 1, 0)


def test_broker_that_never_returns_is_left_at_the_end(items, broker) -> None:
    worker = begin(f"mqtt://127.0.0.1:{broker.port}/car")
    until(lambda: worker.snapshot().state == "up")
    broker.signal(signal.SIGSTOP)
    for item in items[:40]:
        worker.offer(item)
    until(lambda: worker.snapshot().state == "stalled")
    worker.abandon()
    assert worker.join(TIMEOUT_S)
    worker.discard()
    assert worker.snapshot().published + worker.snapshot().dropped == 40
    assert worker.snapshot().dropped >= 39, "what the broker has not confirmed is not published"


def test_killed_gateway_leaves_its_last_will(broker, listener) -> None:
    process = subprocess.Popen(
        [sys.executable, "-m", "gateway.core.cli", "live", "sim:lab", "--plain", "--publish", f"mqtt://127.0.0.1:{broker.port}"],
        stdout=subprocess.DEVNULL, cwd=ROOT,
    )  # fmt: skip
    until(lambda: listener.of("treadlink/status") == ["online"], 60)
    process.kill()
    process.wait()
    until(lambda: listener.of("treadlink/status") == ["online", "offline"])


def test_refused_credentials_are_named_and_right_ones_work(items, tmp_path, monkeypatch) -> None:
    passwords = tmp_path / "passwords"
    passwords.write_text("car:secret\n")
    subprocess.run(["mosquitto_passwd", "-U", str(passwords)], check=True)
    broker = Broker(tmp_path, f"allow_anonymous false\npassword_file {passwords}").start()
    try:
        worker = begin(f"mqtt://127.0.0.1:{broker.port}/car")
        until(lambda: worker.snapshot().state == "down")
        assert worker.snapshot().note["error"] == "the broker refuses: not authorized"
        worker.abandon()
        monkeypatch.setenv(USERNAME, "car")
        monkeypatch.setenv(PASSWORD, "secret")
        worker = begin(f"mqtt://127.0.0.1:{broker.port}/car")
        worker.offer(items[0])
        finish(worker)
        assert worker.snapshot().published == 1
    finally:
        broker.kill()


def test_revolutions_that_permissions_forbid_count_as_dropped(items, tmp_path) -> None:
    permissions = tmp_path / "permissions"
    permissions.write_text("topic readwrite car/status\ntopic write car/alarm\n")
    broker = Broker(tmp_path, f"allow_anonymous true\nacl_file {permissions}").start()
    try:
        worker = begin(f"mqtt://127.0.0.1:{broker.port}/car")
        for item in items[:-1]:
            worker.offer(item)
        finish(worker)
    finally:
        broker.kill()
    assert (worker.snapshot().published, worker.snapshot().dropped) == (2, len(items) - 3)
    assert text(worker.snapshot().note) == "the receiver refuses items: not authorized"
    assert worker.is_left


def write_certificates(folder: Path) -> None:
    """Write an authority, and certificates of the broker and a client that it has signed."""
    from cryptography import x509
    from cryptography.hazmat.primitives import hashes, serialization
    from cryptography.hazmat.primitives.asymmetric import ec
    from cryptography.x509.oid import NameOID

    now = datetime.datetime(2026, 1, 1, tzinfo=datetime.UTC)

    def key_usage(*, signs_others: bool) -> x509.KeyUsage:
        # Python 3.13 rejects a certificate that may sign others without being an authority.
        return x509.KeyUsage(True, False, False, False, False, signs_others, signs_others, False, False)

    def make(name: str, issuer=None):
        key = ec.generate_private_key(ec.SECP256R1())
        subject = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, name)])
        issuer_name, issuer_key = (subject, key) if issuer is None else issuer
        certificate = (
            x509.CertificateBuilder()
            .subject_name(subject)
            .issuer_name(issuer_name)
            .public_key(key.public_key())
            .serial_number(x509.random_serial_number())
            .not_valid_before(now)
            .not_valid_after(now + datetime.timedelta(days=36500))
            .add_extension(x509.BasicConstraints(ca=issuer is None, path_length=None), critical=True)
            .add_extension(x509.SubjectAlternativeName([x509.IPAddress(ipaddress.ip_address("127.0.0.1"))]), False)
            .add_extension(x509.AuthorityKeyIdentifier.from_issuer_public_key(issuer_key.public_key()), False)
            .add_extension(x509.SubjectKeyIdentifier.from_public_key(key.public_key()), False)
            .add_extension(key_usage(signs_others=issuer is None), True)
            .sign(issuer_key, hashes.SHA256())
        )
        (folder / f"{name}.pem").write_bytes(certificate.public_bytes(serialization.Encoding.PEM))
        (folder / f"{name}.key").write_bytes(
            key.private_bytes(
                serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8, serialization.NoEncryption()
            )
        )
        return subject, key

    authority = make("ca")
    make("broker", authority)
    make("client", authority)


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="needs FIFOs")
@pytest.mark.parametrize("name", ["ca", "cert", "key"])
def test_a_certificate_that_is_a_fifo_is_refused(tmp_path, name) -> None:
    os.mkfifo(tmp_path / "fifo")
    others = f"&cert={tmp_path}" if name == "key" else ""
    with pytest.raises(SinkError, match="not a file"):
        open_sink(f"mqtts://127.0.0.1/car?{name}={tmp_path}/fifo{others}", SinkSetting())


def test_tls_verifies_both_ends(items, tmp_path) -> None:
    pytest.importorskip("cryptography")
    write_certificates(tmp_path)
    broker = Broker(
        tmp_path,
        f"cafile {tmp_path}/ca.pem\ncertfile {tmp_path}/broker.pem\nkeyfile {tmp_path}/broker.key\n"
        "require_certificate true\nuse_identity_as_username true\nallow_anonymous false",
    ).start()
    address = f"mqtts://127.0.0.1:{broker.port}/car"
    try:
        stranger = begin(address)
        until(lambda: stranger.snapshot().state == "down")
        assert "certificate is not trusted" in stranger.snapshot().note["error"]
        stranger.abandon()
        worker = begin(f"{address}?ca={tmp_path}/ca.pem&cert={tmp_path}/client.pem&key={tmp_path}/client.key")
        worker.offer(items[0])
        finish(worker)
        assert (worker.snapshot().published, worker.snapshot().dropped) == (1, 0)
    finally:
        broker.kill()
