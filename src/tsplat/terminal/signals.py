"""Signals, made into exceptions or into bytes on a pipe that `select` can wait for."""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Callable
from types import FrameType

Handler = Callable[[int, FrameType | None], None] | signal.Handlers

_FATAL = ("SIGTERM", "SIGHUP")
_NOTED = ("SIGWINCH", "SIGTSTP", "SIGCONT")


class Signals:
    """Handlers for the time of a session.

    SIGTERM and SIGHUP raise ``SystemExit(128 + number)``, so that every ``with`` and ``finally`` runs.
    SIGWINCH, SIGTSTP and SIGCONT are noted, and wake whoever selects on ``fileno()``. Only the main
    thread may set handlers; elsewhere nothing is caught.
    """

    def __init__(self) -> None:
        self._read, self._write = os.pipe()
        os.set_blocking(self._read, False)
        os.set_blocking(self._write, False)
        self._before: dict[int, object] = {}
        self._catch(_FATAL, _exit)
        self._catch(_NOTED, _note)
        # A signal may reach any thread, one of NumPy's too; then it interrupts no `select` in the main
        # thread, and its handler waits for that. This pipe is written to at once, whatever the thread.
        if self._before:
            self._wakeup_before = signal.set_wakeup_fd(self._write, warn_on_full_buffer=False)

    def fileno(self) -> int:
        """Return a file descriptor that is readable when a signal was noted."""
        return self._read

    def noted(self) -> set[int]:
        """Return the signals noted since the last call."""
        try:
            return set(os.read(self._read, 4096))
        except BlockingIOError:
            return set()

    def ignore_fatal(self) -> None:
        """From now on nothing interrupts: the terminal is being given back."""
        self._catch(("SIGINT", *_FATAL), signal.SIG_IGN)

    def stop(self) -> None:
        """Stop this process and its group as Ctrl-Z does; returns when it is continued.

        An orphaned group is never stopped, there being nobody to continue it; this returns at once then.
        """
        caught = signal.SIGTSTP in self._before
        before = signal.signal(signal.SIGTSTP, signal.SIG_DFL) if caught else None
        os.kill(0, signal.SIGTSTP)
        if caught:
            signal.signal(signal.SIGTSTP, before)
        self.noted()

    def close(self) -> None:
        """Set the handlers of before."""
        if self._before:
            signal.set_wakeup_fd(self._wakeup_before)
        for number, handler in self._before.items():
            signal.signal(number, handler)  # type: ignore[arg-type]
        os.close(self._read)
        os.close(self._write)

    def _catch(self, names: tuple[str, ...], handler: Handler) -> None:
        if threading.current_thread() is not threading.main_thread():
            return
        for name in names:
            number = getattr(signal, name)
            # What the parent chose to ignore, as nohup does, stays ignored.
            if signal.getsignal(number) != signal.SIG_IGN:
                self._before.setdefault(number, signal.signal(number, handler))


def _note(number: int, frame: FrameType | None) -> None:
    """Do nothing: the number went through the pipe already."""


def _exit(number: int, frame: FrameType | None) -> None:  # noqa: ARG001
    raise SystemExit(128 + number)
