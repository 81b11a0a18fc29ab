"""A web server on this machine that behaves as well or as badly as a test asks."""

from __future__ import annotations

import sys
import threading
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from types import TracebackType
from typing import Any, Self


class _QuietServer(ThreadingHTTPServer):
    daemon_threads = True

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Say nothing of clients that hang up, on a stderr that a test may be looking at."""
        if not isinstance(sys.exception(), ConnectionError):
            super().handle_error(request, client_address)


class Server:
    """Serves ``files``; the first folder of an address says how.

    ``plain``; ``endless``, without Content-Length; ``cut``, half of it; ``hanging``, half of it and then silence;
    ``packed``, announced as gzip; ``forever``, again and again; ``drip``, a byte at a time; ``boast``, with a
    Content-Length of a petabyte; ``302``, on to the address in the file; any other number, an error; ``scold``, an
    error whose reason is the file.

    Attributes
    ----------
    files : dict of str to bytes
        Contents by path, without the first folder.
    asked : list of str
        Paths that were asked for.
    """

    def __init__(self, files: dict[str, bytes]) -> None:
        self.files, self.asked = files, list[str]()
        self.silent, self._over = threading.Event(), threading.Event()
        outer = self

        class Handler(BaseHTTPRequestHandler):
            protocol_version = "HTTP/1.1"

            def do_GET(self) -> None:
                outer.answer(self)

            def log_message(self, *_: object) -> None:
                pass

        self._server = _QuietServer(("127.0.0.1", 0), Handler)
        self.port = self._server.server_address[1]
        self._thread = threading.Thread(target=self._server.serve_forever, args=(0.02,))

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._over.set()
        self._server.shutdown()
        self._server.server_close()
        self._thread.join()

    def url(self, how: str, path: str) -> str:
        return f"http://127.0.0.1:{self.port}/{how}/{path}"

    def answer(self, request: BaseHTTPRequestHandler) -> None:
        how, _, path = request.path.partition("?")[0].removeprefix("/").partition("/")
        self.asked.append(path)
        content = self.files.get(path)
        reason = (content or b"").decode("latin-1") if how == "scold" else None
        status = 404 if content is None else int(how) if how.isdigit() else 500 if reason else 200
        request.send_response(status, reason)
        content = content or b""
        if how == "302":
            request.send_header("Location", content.decode())
            content = b""
        if how == "packed":
            request.send_header("Content-Encoding", "gzip")
        if how in ("endless", "forever", "drip"):
            request.send_header("Connection", "close")
        else:
            request.send_header("Content-Length", str(10**15 if how == "boast" else len(content)))
        request.end_headers()
        for part in self._parts(how, content):
            request.wfile.write(part)
            request.wfile.flush()
        request.close_connection = how in ("endless", "cut", "hanging", "forever", "drip", "boast")

    def _parts(self, how: str, content: bytes) -> Iterator[bytes]:
        if how != "drip":
            yield content[: len(content) // 2] if how in ("cut", "hanging") else content
        if how in ("hanging", "boast"):
            self.silent.set()
            self._over.wait()
        while how == "forever" and not self._over.is_set():
            yield content
        for byte in content if how == "drip" else b"":
            if self._over.wait(0.01):
                return
            yield bytes([byte])
