"""Files at a URL, fetched by fsspec, which is imported when the first one is asked for."""

from __future__ import annotations

import re
import threading
from collections.abc import Callable, Coroutine
from concurrent.futures import wait
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import parse_qsl, quote

from tsplat.errors import LoadError, shown
from tsplat.io.arrival import Watch
from tsplat.io.candidates import SUFFIXES
from tsplat.io.remote_errors import SILENCE_SECONDS, one_line

if TYPE_CHECKING:
    from asyncio import AbstractEventLoop

SCHEMES = ("http", "https", "s3")

TELL_SECONDS = 0.1
"""How often it is told how much has come."""

FAREWELL_SECONDS = 1.0
"""How long a download that nobody wants any more may take to end."""

_SCHEME = re.compile(r"([a-z][a-z0-9+.-]+)://", re.IGNORECASE)
_BEHIND_PATH = re.compile("[?#]")
_FILENAME = re.compile(r"""filename="?([^";]+)""")

Progress = Callable[[float], None]
Fetched = Callable[[int, int | None], None]
"""Hears how many bytes have come, and of how many, where that is known."""


def is_url(text: str) -> bool:
    """Tell whether a text is a URL, of whatever kind, and no path."""
    return _SCHEME.match(text) is not None


def shown_url(url: str) -> str:
    """Return a URL as a person may see it and a name may be taken from it: up to its path, without a password."""
    scheme, _, rest = url.partition("://")
    if not _is_s3(url):
        rest = _BEHIND_PATH.split(rest, maxsplit=1)[0]
    host, slash, path = rest.partition("/")
    return f"{scheme}://{host.rpartition('@')[2]}{slash}{path}"


def name_in_query(url: str) -> str | None:
    """Return the name of a scene that stands behind the path of a URL, as scripts that hand out files have it."""
    for _, value in parse_qsl("" if _is_s3(url) else url.partition("?")[2].partition("#")[0]):
        filename = _FILENAME.search(value)  # what a signed address asks the server to call the file
        name = (filename[1] if filename else value).rpartition("/")[2]
        if name.lower().removesuffix(".gz").endswith(SUFFIXES):
            return name
    return None


def url_beside(url: str, name: str) -> str:
    """Return the URL of a file that is named relative to another one."""
    if _is_s3(url):
        return f"{url.rpartition('/')[0]}/{name}"
    return f"{_BEHIND_PATH.split(url, maxsplit=1)[0].rpartition('/')[0]}/{quote(name)}"


class Remote:
    """The way to where a URL leads; one connection serves several files.

    Parameters
    ----------
    url : str
        Any file there.
    fetched : callable
        Hears of the bytes of all files together; of a size only while the first one comes.

    Raises
    ------
    LoadError
        It is of no kind that is fetched here, or what fetches it is not installed.
    """

    def __init__(self, url: str, fetched: Fetched) -> None:
        self._scheme = url.partition("://")[0].lower()
        if self._scheme not in SCHEMES:
            kind = f"is of kind {shown(self._scheme)}, expected {', '.join(SCHEMES)} or a path"
            problem = f"{kind}; fetch it yourself first"
            raise LoadError(shown_url(url), problem)
        try:
            self._files = _file_system(self._scheme)
        except ImportError as error:
            missing = error.name or "s3fs"  # fsspec gives no name for what it needs in turn
            problem = f'needs {missing}, which is not installed; pip install "tsplat[remote]"'
            raise LoadError(shown_url(url), problem) from error
        self._fetched, self._first, self._before = fetched, True, 0

    def fetch(self, url: str, place: Path, progress: Progress) -> None:
        """Write the file at a URL to a place, or only its first bytes where these are of no scene.

        Raises
        ------
        LoadError
            It cannot be fetched, or not all of it.
        OSError
            There is no room for it.
        """
        from fsspec.callbacks import Callback

        come, watch = Callback(), Watch(place)

        def tell() -> bool:
            self._fetched(self._before + come.value, come.size if self._first else None)
            if come.size:
                progress(min(1.0, come.value / come.size))
            return watch.goes_on(come.value, come.size)

        with one_line(shown_url(url), self._scheme):
            _wait_for(self._files._get_file(url, str(place), callback=come), self._files.loop, tell)
        self._fetched(self._before + come.value, come.size if self._first else None)
        progress(1.0)
        self._before, self._first = self._before + come.value, False


def _wait_for(job: Coroutine[Any, Any, object], loop: AbstractEventLoop, tell: Callable[[], bool]) -> None:
    """Wait for what is done on fsspec's thread; end it where ``tell`` says no, or this ends, by Ctrl-C say."""
    from asyncio import run_coroutine_threadsafe  # nobody else needs it

    ended = threading.Event()

    async def run() -> None:
        try:
            await job
        finally:
            ended.set()

    future = run_coroutine_threadsafe(run(), loop)
    try:
        while not wait([future], TELL_SECONDS).done:
            if not tell():
                return
        future.result()
    finally:
        future.cancel()
        ended.wait(FAREWELL_SECONDS)


def _file_system(scheme: str) -> Any:
    import fsspec

    if scheme == "s3":
        # Several requests at a time would keep hundreds of megabytes in memory.
        return fsspec.filesystem("s3", max_concurrency=1)
    import aiohttp

    timeout = aiohttp.ClientTimeout(total=None, sock_connect=SILENCE_SECONDS, sock_read=SILENCE_SECONDS)
    # What a server packs for the way stays packed: it is unpacked later, within limits.
    client = {"timeout": timeout, "auto_decompress": False, "trust_env": True}
    return fsspec.filesystem(
        scheme, client_kwargs=client, headers={"Accept-Encoding": "identity"}, skip_instance_cache=True
    )


def _is_s3(url: str) -> bool:
    return url.lower().startswith("s3:")  # where ? and # may be part of a name
