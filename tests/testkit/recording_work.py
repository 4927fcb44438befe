"""Work on recordings that other processes can import."""

import os
import signal
import threading

from gateway.core.errors import RecordingError

LOST = threading.Event()
"""Set when another process is lost."""


def double(order, on_position):
    """Return twice a number; its progress is that number of bytes."""
    on_position(order)
    return 2 * order


def fail_at_three(order, on_position):
    """Fail with the order 3."""
    if order == 3:
        raise RecordingError("three", "Count to two.")
    return double(order, on_position)


def die_at_three(order, on_position):
    """End this process from outside with the order 3, as the kernel does without memory."""
    if order == 3:
        os.kill(os.getpid(), signal.SIGKILL)
    return double(order, on_position)


def own_process(_order, _on_position):
    """Return the number of this process."""
    return os.getpid()


def interrupt_itself(order, _on_position):
    """Return an order after Ctrl-C."""
    os.kill(os.getpid(), signal.SIGINT)
    return order


def second_after_loss(order, _on_position):
    """Return an order, the order 2 when another process is lost."""
    assert order != 2 or LOST.wait(60.0)
    return order
