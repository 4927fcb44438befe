"""Sources whose bytes are read, and their arrival noted, however long what is read takes to be worked on."""

from __future__ import annotations

import queue
import threading
from collections.abc import Iterator

from gateway.core.links.source import LinkItem, WrappedSource


class ReadAheadSource(WrappedSource):
    """A source that a thread of its own reads, without a limit.

    A reader that works between two reads leaves bytes in the buffers of the system: they arrive late by their times,
    and a hub whose link is full drops frames.
    """

    def items(self, stop: threading.Event) -> Iterator[LinkItem]:
        """Yield the items of the source; what its thread raises is raised here. Closing the generator closes it."""
        waiting: queue.SimpleQueue[LinkItem | BaseException | None] = queue.SimpleQueue()

        def read() -> None:
            try:
                for item in self._source.items(stop):
                    waiting.put(item)
            except BaseException as error:
                waiting.put(error)
            else:
                waiting.put(None)

        thread = threading.Thread(target=read, name=f"read {self.link}", daemon=True)
        thread.start()
        try:
            while (item := waiting.get()) is not None:
                if isinstance(item, BaseException):
                    raise item
                yield item
        finally:
            self.close()
            thread.join()
