"""One pixel in shared memory and one in a file, for the time of a question: does the terminal find them?

Both ways send a picture without sending it, but only a terminal on the same machine, that may read what is
ours and lives in the same container, gets it. So it is tried. Source: the kitty graphics protocol,
"the transmission medium".
"""

from __future__ import annotations

import contextlib
import os
from base64 import b64encode
from collections.abc import Mapping
from types import TracebackType

from tsplat.terminal.questions import Question, is_remote, prints_graphics, transport_question

_PIXEL = bytes(3)
_MARK = "tty-graphics-protocol"
"""Terminals read no other file in the temporary folders than those with this in their names."""


class Trials:
    """Makes what the questions are about; a context manager that removes it, if the terminal did not."""

    def __init__(self, environment: Mapping[str, str]) -> None:
        self.questions: list[Question] = []
        self._exit = contextlib.ExitStack()
        self._wanted = not (is_remote(environment) or prints_graphics(environment))

    def __enter__(self) -> Trials:
        if self._wanted:
            for transport, make in (("shared", self._shared), ("file", self._file)):
                with contextlib.suppress(OSError, ImportError):  # no room or no such thing: not asked, not used
                    self.questions.append(transport_question(transport, b64encode(make().encode())))
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._exit.close()

    def _shared(self) -> str:
        # Not multiprocessing.shared_memory: it starts a process that removes what the terminal removed.
        import _posixshmem  # CPython's own, on every POSIX system

        name = f"/tsplat-{os.urandom(8).hex()}"
        descriptor = _posixshmem.shm_open(name, os.O_CREAT | os.O_EXCL | os.O_RDWR, 0o600)
        self._exit.callback(_without, _posixshmem.shm_unlink, name)
        with open(descriptor, "wb", buffering=0) as memory:
            os.ftruncate(descriptor, len(_PIXEL))
            memory.write(_PIXEL)
        return name

    def _file(self) -> str:
        import tempfile  # 4 ms that a terminal far away does not need

        descriptor, path = tempfile.mkstemp(prefix=f"tsplat-{_MARK}-")
        self._exit.callback(_without, os.unlink, path)
        with open(descriptor, "wb", buffering=0) as file:
            file.write(_PIXEL)
        return path


def _without(remove: object, name: str) -> None:
    with contextlib.suppress(FileNotFoundError):  # the terminal took it away, as the protocol says
        remove(name)  # type: ignore[operator]
