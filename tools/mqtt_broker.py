"""A real MQTT broker as a child process on a free port of this computer, and a client that listens to it."""

import contextlib
import json
import os
import shutil
import signal
import socket
import subprocess
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any, Self

import paho.mqtt.client as paho
from paho.mqtt.enums import CallbackAPIVersion

PROGRAM = shutil.which("mosquitto", path=f"{os.environ.get('PATH', '')}:/usr/sbin:/usr/local/sbin")
TIMEOUT_S = 20.0
_LISTENER_KEEPALIVE_S = 3600


def free_port() -> int:
    """Return a port of this computer that nobody listens to."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        return int(free.getsockname()[1])


class Broker:
    """Mosquitto with its settings in a folder; it may be stopped, resumed, killed and started again."""

    def __init__(self, folder: Path, settings: str = "allow_anonymous true") -> None:
        """Write the settings to a folder and choose a port."""
        self.port = free_port()
        self._settings = folder / "mosquitto.conf"
        self._settings.write_text(f"user root\nlistener {self.port} 127.0.0.1\n{settings}\n")
        self._process: subprocess.Popen[str] | None = None

    def start(self) -> Self:
        """Start, and return when it accepts connections."""
        assert PROGRAM is not None
        self._process = subprocess.Popen(
            [PROGRAM, "-c", str(self._settings)], stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True
        )
        assert self._process.stderr is not None
        lines = []
        for line in self._process.stderr:
            lines.append(line)
            if line.rstrip().endswith("running"):
                return self
        raise AssertionError("".join(lines))

    def signal(self, number: int) -> None:
        """Send a signal, such as SIGSTOP."""
        assert self._process is not None
        self._process.send_signal(number)

    def stop(self) -> None:
        """End it as its service does, which tells its clients, and wait until it has ended."""
        process = self._process
        assert process is not None
        # Mosquitto forgets a signal that comes before its loop begins.
        while process.poll() is None:
            process.terminate()
            with contextlib.suppress(subprocess.TimeoutExpired):
                process.communicate(timeout=1.0)
        assert process.returncode == 0, "it was killed"
        self._process = None

    def kill(self) -> None:
        """End it as a power cut does."""
        if self._process is not None:
            self._process.kill()
            self._process.send_signal(signal.SIGCONT)
            self._process.communicate()
            self._process = None


class Listener:
    """A client that collects every message with its topic and whether it was retained."""

    def __init__(self, port: int, topics: str = "#", keep: Callable[[bytes], bytes] = bytes) -> None:
        """Subscribe to topics; `keep` returns what to keep of a payload."""
        self.messages: list[tuple[str, bool, bytes]] = []
        self._subscribed = threading.Event()
        self._client = paho.Client(CallbackAPIVersion.VERSION2, protocol=paho.MQTTv5)
        self._client.on_connect = lambda client, *_: client.subscribe(topics, 1)
        self._client.on_subscribe = lambda *_: self._subscribed.set()
        self._client.on_message = lambda _, __, message: self.messages.append(
            (message.topic, message.retain, keep(message.payload))
        )
        self._client.reconnect_delay_set(1, 1)
        # A broker that is frozen must not cost the subscriber its connection, and with it messages.
        self._client.connect("127.0.0.1", port, keepalive=_LISTENER_KEEPALIVE_S)
        self._client.loop_start()
        assert self._subscribed.wait(TIMEOUT_S)

    def of(self, topic: str) -> list[Any]:
        """Return the JSON payloads of a topic; plain text as text."""
        results = [payload for name, _, payload in tuple(self.messages) if name == topic]
        return [json.loads(payload) if payload[:1] == b"{" else payload.decode() for payload in results]

    def publish(self, topic: str, payload: bytes) -> None:
        """Publish a retained message."""
        self._client.publish(topic, payload, 1, retain=True)

    def close(self) -> None:
        """Disconnect."""
        self._client.disconnect()
        self._client.loop_stop()
