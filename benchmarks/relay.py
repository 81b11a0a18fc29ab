"""A link made slow: bytes between two sockets on this machine arrive late and no faster than a rate."""

from __future__ import annotations

import contextlib
import queue
import socket
import threading
import time
from types import TracebackType

CHUNK = 1460
"""Bytes sent at a time: one packet."""

QUEUE = 64 << 10
"""Bytes that the link holds before it takes no more; the sender then waits, as before a full router."""


class Relay:
    """Listens on a port of loopback and passes every connection on to another.

    Parameters
    ----------
    port : int
        Where to pass them on.
    rate : float
        Bytes a second, each way.
    delay : float
        Seconds that a byte is under way, each way.
    """

    def __init__(self, port: int, rate: float, delay: float) -> None:
        self._target, self._rate, self._delay = port, rate, delay
        self._listener = _small(socket.socket())
        self._listener.bind(("127.0.0.1", 0))
        self._listener.listen()
        self.port: int = self._listener.getsockname()[1]
        self._flowing = threading.Event()
        self._flowing.set()

    def __enter__(self) -> Relay:
        threading.Thread(target=self._accept, daemon=True).start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._listener.close()

    def stall(self, seconds: float) -> None:
        """Let nothing through for a while; returns at once."""
        self._flowing.clear()
        threading.Timer(seconds, self._flowing.set).start()

    def wait_until_flowing(self) -> None:
        """Wait for the end of a stall."""
        self._flowing.wait()

    def _accept(self) -> None:
        with contextlib.suppress(OSError):  # closed
            while True:
                near, _ = self._listener.accept()
                far = _small(socket.socket())
                far.connect(("127.0.0.1", self._target))
                for source, sink in ((near, far), (far, near)):
                    _Direction(source, sink, self._rate, self._delay, self._flowing).start()


def _small(end: socket.socket) -> socket.socket:
    # The kernel's own buffers would be a link of their own.
    for option in (socket.SO_RCVBUF, socket.SO_SNDBUF):
        end.setsockopt(socket.SOL_SOCKET, option, 16 << 10)
    end.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    return end


class _Direction:
    """One way of a connection: one thread fills the link's queue, one empties it, one delivers late."""

    def __init__(
        self, source: socket.socket, sink: socket.socket, rate: float, delay: float, flowing: threading.Event
    ) -> None:
        self._source, self._sink, self._rate, self._delay, self._flowing = source, sink, rate, delay, flowing
        self._room = threading.Semaphore(QUEUE // CHUNK)
        self._queue: queue.SimpleQueue[tuple[float, bytes]] = queue.SimpleQueue()
        self._under_way: queue.SimpleQueue[tuple[float, bytes]] = queue.SimpleQueue()

    def start(self) -> None:
        for job in (self._fill, self._transmit, self._deliver):
            threading.Thread(target=job, daemon=True).start()

    def _fill(self) -> None:
        packet = b"more"
        while packet:
            try:
                packet = self._source.recv(CHUNK)
            except OSError:
                packet = b""
            self._room.acquire()
            self._queue.put((time.perf_counter(), packet))

    def _transmit(self) -> None:
        packet, free = b"more", 0.0
        while packet:
            entered, packet = self._queue.get()
            free = max(free, entered) + len(packet) / self._rate
            _sleep_until(free)
            if not self._flowing.is_set():
                self._flowing.wait()
                free = time.perf_counter()
            self._room.release()
            self._under_way.put((free + self._delay, packet))

    def _deliver(self) -> None:
        packet = b"more"
        while packet:
            moment, packet = self._under_way.get()
            _sleep_until(moment)
            with contextlib.suppress(OSError):  # the other side has gone
                if packet:
                    self._sink.sendall(packet)
                else:
                    self._sink.shutdown(socket.SHUT_WR)


def _sleep_until(moment: float) -> None:
    time.sleep(max(0.0, moment - time.perf_counter()))
