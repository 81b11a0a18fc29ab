"""A streamed SOG at a URL: its lod-meta.json comes at once, what this names when it is asked for."""

from __future__ import annotations

from contextlib import AbstractContextManager
from functools import partial

from tsplat.io.remote import Fetched, Progress, url_beside
from tsplat.io.sog_beside import Beside
from tsplat.io.sources import GETTING, fetch_by, legible, place_in
from tsplat.temporary import TemporaryFolder


class Stream:
    """A temporary folder that fills with the files of a scene, and goes when nobody holds this any more.

    Parameters
    ----------
    url : str
        Of the lod-meta.json.
    fetched : callable
        Hears of the bytes of all files together.

    Attributes
    ----------
    meta : Path
        The lod-meta.json, which is here.

    Raises
    ------
    LoadError
        It cannot be fetched.
    """

    getting = GETTING

    def __init__(self, url: str, fetched: Fetched) -> None:
        self._url = url
        with legible(url):
            self._folder = TemporaryFolder()
        self.meta = place_in(self._folder.name, url)
        with self.legible():
            fetch = fetch_by(url, fetched)
            fetch(url, self.meta, lambda _: None)
            self._beside = Beside(self.meta.parent, partial(url_beside, url), fetch)

    def bring(self, name: str, progress: Progress) -> None:
        """Fetch a file, and the planes that it names."""
        self._beside.bring_scene(name, progress)

    def legible(self) -> AbstractContextManager[None]:
        """See `tsplat.io.sources.legible`."""
        return legible(self._url, self._folder.name)
