"""A broker that states lengths that it should not."""

import socket
import threading

import pytest

from gateway.publishing.mqtt import MqttSink
from gateway.publishing.sink import SinkDownError, SinkSetting

MAXIMUM_PACKET_SIZE = b"\x27\x00\x01\x00\x00"  # property 39: 65536
CONNACK = b"\x20\x03\x00\x00\x00"


@pytest.mark.parametrize("before", [b"", CONNACK])
@pytest.mark.parametrize("length", [b"\xff\xff\xff\x7f", b"\x81\x80\x04"])  # 268,435,455 and 65,537 bytes
def test_packet_above_the_maximum_ends_the_connection(before: bytes, length: bytes) -> None:
    server = socket.create_server(("127.0.0.1", 0))
    connect: list[bytes] = []

    def broker() -> None:
        connection, _ = server.accept()
        with connection:
            connect.append(connection.recv(1000))
            try:
                connection.sendall(before + b"\x30" + length)
                for _ in range(64):
                    connection.sendall(bytes(1 << 16))
            except OSError:
                return

    thread = threading.Thread(target=broker, daemon=True)
    thread.start()
    port = server.getsockname()[1]
    sink = MqttSink(
        "127.0.0.1", port, "t", keepalive_s=10, discovery=None, tls=None, setting=SinkSetting(), environment={}
    )
    stop = threading.Event()

    def use() -> None:
        sink.open(stop)
        while True:
            sink.poll()

    with pytest.raises(SinkDownError):
        use()
    assert sink._client._in_packet["packet"] == b""
    sink.close()
    sink._client._sock_close()
    thread.join(20.0)
    server.close()
    assert not thread.is_alive()
    assert MAXIMUM_PACKET_SIZE in connect[0]
