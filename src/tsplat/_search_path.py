"""Where Python looks for modules: never in the folder that a person happens to stand in.

A scene may come with a ``numpy.py`` beside it. Nothing is imported here but what Python has imported already.
"""

import os
import sys

PACKAGE_FOLDER = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))
"""Where this package was found; what lies beside it was trusted by whoever put it there."""


def ignore_current_folder() -> None:
    """Let this process import nothing from the current folder, and be told nothing by what lies there."""
    sys.path[:] = safe_path()
    # Numba takes settings from a .numba_config.yaml there, wherever it can read one.
    sys.modules["yaml"] = None  # type: ignore[assignment]  # Python's way to say that there is none
    import warnings

    warnings.filterwarnings("ignore", "A Numba config file is found")


def safe_path() -> list[str]:
    """Return the folders of ``sys.path``, absolute, without the current one unless Python or tsplat is there."""
    found = []
    try:
        here = os.getcwd()
    except OSError:  # it was removed
        here = os.devnull
    for entry in sys.path:
        if os.path.isabs(entry) and (not _same(entry, here) or _is_installed(entry)):
            found.append(entry)
    return found if PACKAGE_FOLDER in found else [*found, PACKAGE_FOLDER]


def _is_installed(entry: str) -> bool:
    """Tell whether Python itself, its packages or this package are in a folder."""
    packages: list[str] = getattr(sys.modules.get("site"), "getsitepackages", list)()
    library = os.path.dirname(os.path.abspath(os.__file__))
    inside = os.path.abspath(entry) == library or os.path.abspath(entry).startswith(library + os.sep)
    return inside or any(_same(entry, place) for place in (*packages, PACKAGE_FOLDER))


def _same(one: str, other: str) -> bool:
    return os.path.normcase(os.path.realpath(one)) == os.path.normcase(os.path.realpath(other))
