"""Access check of a live view: only pages of its own address, which has a token.

A browser lets any page open a WebSocket to this machine and read what it sends. viser has no check
of its own, so its server is started with one, for the page and for the WebSocket.
"""

from __future__ import annotations

import importlib
import logging
import secrets
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from http import HTTPStatus
from typing import Any, Final
from urllib.parse import urlsplit

_ONE: Final = threading.Lock()
# the user need not know of refused and broken connections
_SILENT: Final = logging.Logger("bowstring.view", logging.CRITICAL + 1)


def refusal(token: str, path: str, host: str | None, origin: str | None) -> str:
    """Why a request is refused; empty if it is not.

    Parameters
    ----------
    token : str
        First part of the path that is wanted.
    path : str
        Path of the request, with its query.
    host, origin : str or None
        Headers of the request. Only browsers send an origin: that of the page with the request.
    """
    given = path.partition("?")[0].strip("/").partition("/")[0]
    if not secrets.compare_digest(given.encode(), token.encode()):
        return "The address has no valid token; open the one that Bowstring printed."
    if origin is not None and (host is None or urlsplit(origin).netloc != host):
        return "This page may not see the view."
    return ""


@contextmanager
def only_with(token: str) -> Iterator[list[object]]:
    """Context manager in which viser starts a server that shows itself below a token alone.

    Yields
    ------
    guarded : list
        Addresses of the servers that were started with this check: empty if none was.
    """
    # brought by viser, of which nothing is loaded without the extra
    server: Any = importlib.import_module("websockets.asyncio.server")

    plain, guarded = server.serve, list[object]()

    def serve(*given: Any, process_request: Callable[..., Any], **settings: Any) -> Any:
        guarded.append(given[1:])

        def check(connection: Any, request: Any) -> Any:
            headers = request.headers
            why = refusal(token, request.path, headers.get("Host"), headers.get("Origin"))
            if why:
                return connection.respond(HTTPStatus.FORBIDDEN, f"{why}\n")
            inside = "/" + request.path.lstrip("/")[len(token) :].lstrip("/")
            return process_request(connection, replace(request, path=inside))

        return plain(*given, process_request=check, logger=_SILENT, **settings)

    with _ONE:
        server.serve = serve
        try:
            yield guarded
        finally:
            server.serve = plain
