"""Every error this package raises on purpose.

* TsplatError                  base; the command line catches this and nothing else
  * LoadError (ValueError)     a file that cannot be read as a splat scene or a camera set
    * CorruptFileError         recognised, but its contents contradict themselves
  * SceneError (ValueError)    arrays that do not form a scene
  * CameraError (ValueError)   numbers that do not form a camera
  * OptionError (ValueError)   an option that has no such value, or is not offered here
  * SaveError (OSError)        a picture or a scene that could not be written
  * TerminalError (OSError)    no terminal to draw on, or it went away

`LoadWarning` says that something in a file was dropped or mended, `SaveWarning` that a file lacks something of the
scene it was written from.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from itertools import islice
from pathlib import Path

_NAMES: dict[str, str] = {}
"""What to call temporary files and folders, whose names mean nothing to a person."""


@contextmanager
def calling(names: Mapping[str, str]) -> Iterator[None]:
    """Let errors and warnings about these places, made meanwhile, call them by these names.

    Parameters
    ----------
    names : mapping of str to str
        From beginnings of paths, the longest first, that no one else uses.
    """
    _NAMES.update(names)
    try:
        yield
    finally:
        for place in names:
            del _NAMES[place]


def _called(text: str) -> str:
    for place, name in tuple(_NAMES.items()):
        text = text.replace(place, name)
    return text


def printable(name: str) -> str:
    """Return a file's name without the escape sequences that it may hold; on a terminal they would act."""
    return "".join(c if c.isprintable() else repr(c)[1:-1] for c in name)


SHOWN_CHARS = 60
"""Of a value in a message; a stranger's may fill a screen, or memory."""


def shown(value: object, most: int = SHOWN_CHARS) -> str:
    """Return a value of a stranger, or a caller, for a message: one printable line of at most ``most`` characters.

    No more of it is looked at than that, so it may be as large and as deep as it likes.
    """
    text = _shown(value, most)
    if len(text) <= most and not (isinstance(value, (str, bytes)) and len(value) > most):
        return text
    return f"{text[: most - 4]}...{text[-1]}"  # closed as it was opened


def _shown(value: object, most: int) -> str:
    match value:
        case str() | bytes():
            return ascii(value[:most])
        case dict():
            pairs = islice(value.items(), most)
            return f"{{{', '.join(f'{_inside(key, most)}: {_inside(each, most)}' for key, each in pairs)}}}"
        case list():
            return f"[{', '.join(_inside(each, most) for each in islice(value, most))}]"
        case tuple():
            return f"({', '.join(_inside(each, most) for each in islice(value, most))})"
        case int() if value.bit_length() > 4 * most:
            return f"<int of {value.bit_length()} bits>"
        case None | int() | float() | complex():
            return ascii(value)
    shape = getattr(value, "shape", None)
    if shape == ():  # a number of NumPy's
        return ascii(str(value)[:most])[1:-1]
    return f"<{type(value).__name__}{'' if shape is None else f' of shape {shape}'}>"


def _inside(value: object, most: int) -> str:
    """Return the same of what is in a list, without what is in that."""
    return f"<{type(value).__name__}>" if isinstance(value, (list, tuple, dict)) and value else _shown(value, most)


class LoadWarning(UserWarning):
    """Something in a file was dropped or mended while loading it; the text says what and how many."""

    def __init__(self, text: str) -> None:
        super().__init__(printable(_called(text)))


class SaveWarning(UserWarning):
    """A file lacks something of the scene that was saved; the text says what and how much."""


class TsplatError(Exception):
    """Base of every error raised on purpose; its text is one line, fit to be shown to a person."""

    def __init__(self, text: str) -> None:
        super().__init__(printable(text.replace("\n", " ")))


class LoadError(TsplatError, ValueError):
    """A file cannot be read as what it was asked to be.

    Parameters
    ----------
    path : str or Path
        The file; a URL stays a str.
    problem : str
        What is wrong with which field, what was expected, and what to do about it.
    offset : int, optional
        Byte at which the problem lies.
    """

    def __init__(self, path: str | Path, problem: str, offset: int | None = None) -> None:
        called = _called(str(path))
        name = printable(called)
        where = name if offset is None else f"{name}: at byte {offset}"
        problem = _called(problem)
        super().__init__(f"{where}: {problem}")
        self.path = called if "://" in called else Path(called)
        self.problem, self.offset = problem, offset

    def __reduce__(self) -> tuple[type[LoadError], tuple[str | Path, str, int | None]]:
        return type(self), (self.path, self.problem, self.offset)


class CorruptFileError(LoadError):
    """The format was recognised, but the contents contradict it or end early."""


class SceneError(TsplatError, ValueError):
    """Arrays do not form a scene: a shape, a dtype or a range is wrong."""


class CameraError(TsplatError, ValueError):
    """Numbers do not form a camera: a size, an angle or a direction is impossible."""


class OptionError(TsplatError, ValueError):
    """An option has a value it cannot take."""


class SaveError(TsplatError, OSError):
    """A file could not be written; nothing half-written is left behind."""


class TerminalError(TsplatError, OSError):
    """There is no terminal to draw on, or it stopped answering."""
