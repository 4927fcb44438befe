"""Worker processes of a campaign: those of this machine, or those of a dask scheduler."""

from __future__ import annotations

import logging
import os
import signal
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from typing import Any, Final

from gateway.errors import TreadlinkError
from gateway.worker_pool import interrupt_held_back

_CONNECT_S: Final = 10.0
_CLOSE_S: Final = 5.0
_KILL: Final = getattr(signal, "SIGKILL", signal.SIGTERM)  # Windows has the second only
DEFAULT_MEMORY_BYTES: Final = 2_000_000_000
"""Memory of a worker process, at which it is ended."""


class WorkersNotStartedError(TreadlinkError):
    """The worker processes of this machine did not start."""


@dataclass(frozen=True, slots=True)
class Workers:
    """Connected workers.

    Attributes:
        client: of dask.distributed.
        cluster: of this machine; None for an external scheduler.
    """

    client: Any
    cluster: Any

    def count(self) -> int:
        """Return the number of tasks that can run at once."""
        return sum(self.client.nthreads().values())

    def ended_for_memory(self) -> int:
        """Return how many workers of this machine have been ended because of their memory, as far as it is known."""
        nannies = self.cluster.workers.values() if self.cluster is not None else ()
        ended = [getattr(getattr(nanny, "memory_manager", None), "_last_terminated_pid", -1) for nanny in nannies]
        return sum(max(pid, 0) for pid in ended)


@contextmanager
def local_workers(count: int, memory_bytes: int) -> Iterator[Workers]:
    """Start worker processes of one thread each on this machine, and end them afterwards.

    Raises:
        WorkersNotStartedError: a process ended while it started.
    """
    import dask
    from distributed import Client, LocalCluster

    # What dask reports of ended workers, the campaign reports.
    level = logging.INFO if logging.getLogger("gateway").isEnabledFor(logging.DEBUG) else logging.CRITICAL
    logging.getLogger("distributed").setLevel(level)
    settings = {
        # The campaign itself tries a recording again, and counts.
        "distributed.scheduler.allowed-failures": 0,
        "distributed.worker.daemon": True,
        # It keeps what every worker did for an hour, 0.15 MB a recording.
        "distributed.worker.profile.enabled": False,
        "distributed.worker.preload": ["gateway.fleet.worker_signals"],
        "logging": {"distributed": logging.getLevelName(level).lower()},
        "distributed.comm.timeouts.connect": f"{_CONNECT_S:.0f}s",
    }
    with dask.config.set(settings):
        try:
            # A terminal sends Ctrl-C to all processes. One that starts inherits that it is held back.
            with interrupt_held_back():
                cluster = LocalCluster(  # type: ignore[no-untyped-call]
                    n_workers=count,
                    threads_per_worker=1,
                    processes=True,
                    memory_limit=memory_bytes,
                    dashboard_address="127.0.0.1:0",
                    silence_logs=level,
                )
        except (RuntimeError, OSError) as error:
            raise WorkersNotStartedError(
                f"the worker processes did not start: {error}",
                "Another program may have ended them, or memory is short; try again, or with a smaller --jobs.",
            ) from error
        try:
            with Client(cluster, set_as_default=False) as client:  # type: ignore[no-untyped-call]
                yield Workers(client, cluster)
        finally:
            _close(cluster)


def _close(cluster: Any) -> None:
    """End the workers; those that do not end in time have no task left, and are killed."""
    left = [nanny.pid for nanny in cluster.workers.values() if nanny.pid]
    try:
        cluster.close(timeout=_CLOSE_S)
    except TimeoutError:
        for pid in left:
            with suppress(OSError):
                os.kill(pid, _KILL)


@contextmanager
def scheduler_workers(address: str) -> Iterator[Workers]:
    """Connect to a dask scheduler.

    Raises:
        TreadlinkError: no scheduler answers at this address.
    """
    from distributed import Client

    try:
        client = Client(address, timeout=_CONNECT_S, set_as_default=False)  # type: ignore[no-untyped-call]
    except (OSError, ValueError) as error:
        raise TreadlinkError(
            f"no dask scheduler answers at '{address}'",
            "Start one with `dask scheduler`, and workers with `dask worker`.",
        ) from error
    try:
        yield Workers(client, None)
    finally:
        client.close(timeout=_CLOSE_S)  # type: ignore[no-untyped-call]
