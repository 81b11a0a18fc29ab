"""What may go wrong on the way to a URL, each as one line: nothing else knows the errors of its libraries."""

from __future__ import annotations

import errno
import os
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from tsplat.errors import LoadError, printable, shown

if TYPE_CHECKING:
    import aiohttp

SILENCE_SECONDS = 30.0
"""How long a server may say nothing; the whole may take as long as it will."""

MOST_CHARS = 150
"""Of what a server or a library says: it may be megabytes."""

FULL = (errno.ENOSPC, errno.EDQUOT)
"""The disk here is full, which says nothing about there."""


@contextmanager
def one_line(name: str, scheme: str) -> Iterator[None]:
    """Turn what fetching raises into a `LoadError` about ``name``, but for a full disk."""
    try:
        yield
    except LoadError:
        raise
    except _raised(scheme) as error:
        if isinstance(error, OSError) and error.errno in FULL:
            raise
        raise LoadError(name, _problem(error)) from error


def _raised(scheme: str) -> tuple[type[Exception], ...]:
    from aiohttp import ClientError

    if scheme != "s3":
        return OSError, ValueError, ClientError
    from botocore.exceptions import BotoCoreError
    from botocore.exceptions import ClientError as ServiceError

    return OSError, ValueError, ClientError, BotoCoreError, ServiceError


def _problem(error: Exception) -> str:
    import aiohttp

    match error:
        case FileNotFoundError():
            return "is not there; check the address"
        case aiohttp.ClientSSLError():
            return f"the server cannot be trusted: {_distrust(error)}; check the address"
        case aiohttp.ClientConnectorDNSError():
            return "no server of this name is known; check the address and the network"
        case aiohttp.ClientConnectorError():
            number = error.os_error.errno
            reason = os.strerror(number) if number else shown(str(error.os_error), MOST_CHARS)
            return f"the server cannot be reached: {reason}; check the address and the network"
        case TimeoutError():
            return f"the server said nothing for {SILENCE_SECONDS:.0f} s; try again"
        case aiohttp.TooManyRedirects():
            return "leads from one address to the next without end; check the address"
        case aiohttp.RedirectClientError():
            return f"leads on to {shown(str(error), MOST_CHARS)}, expected http or https; check the address"
        case aiohttp.ClientResponseError():
            return f"the server answered {error.status} {shown(error.message, MOST_CHARS)}; check the address"
        case aiohttp.ClientPayloadError() | aiohttp.ClientConnectionError():
            return "the server stopped in the middle; try again"
        case aiohttp.InvalidURL() | ValueError():
            return "is no URL that can be fetched; check the address"
        case _:
            return f"cannot be fetched: {shown(str(error), MOST_CHARS)}; check the address and your credentials"


def _distrust(error: aiohttp.ClientSSLError) -> str:
    cause: object = getattr(error, "certificate_error", error.os_error)
    reason = getattr(cause, "verify_message", "") or str(getattr(cause, "reason", cause)).replace("_", " ").lower()
    return printable(reason[:MOST_CHARS])
