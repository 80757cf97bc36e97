"""The server of the page: on this computer only, under an address with a random token."""

from __future__ import annotations

import contextlib
import gc
import os
import secrets
import socket
import sys
import tempfile
import threading
import webbrowser
from collections.abc import Callable
from typing import Any

from rodgen.errors import InputFileError

__all__ = ["prepare", "serve"]

_OF_CLIENTS = ("aiohttp", "requests", "tornado", "websocket")
"""What the library of web sockets imports where it can, for clients and for other servers: a fifth of a start."""


def serve(
    page: Callable[[], Callable[[], Any]],
    *,
    port: int = 0,
    browser: bool = True,
    said: Callable[[str], object] = print,
) -> None:
    """Show a page until Ctrl-C.

    Parameters
    ----------
    page : callable
        Imports what the page needs, while the browser starts; returns what makes the page, which is called for each
        window.
    port : int, optional
        Of 127.0.0.1; 0 is any that is free.
    browser : bool, optional
        Whether to open the browser.
    said : callable, optional
        Called with the address. Who asks there before the page is ready waits.

    Raises
    ------
    InputFileError
        When the port is taken.
    """
    import uvicorn  # a missing library is reported before the browser is opened

    listening = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    with contextlib.closing(listening):
        if sys.platform != "win32":  # where it would let two servers share a port
            listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            listening.bind(("127.0.0.1", port))
            listening.listen()
        except OSError as error:
            found = f"{port}, which cannot be used ({error.strerror})"
            raise InputFileError("command line", "--port", found, "another port, or none for any") from None
        port = listening.getsockname()[1]
        token = secrets.token_urlsafe(24)
        address = f"http://127.0.0.1:{port}/{token}/"
        try:
            said(address)
            if browser:  # its start may take seconds
                threading.Thread(target=webbrowser.open, args=(address,), daemon=True).start()
            prepare()
            config = uvicorn.Config(
                application(page(), token, port, _begun),
                log_level="error",
                access_log=False,
                server_header=False,
                ws_max_size=4_000_000,
                timeout_graceful_shutdown=2,
            )
            uvicorn.Server(config).run(sockets=[listening])
        except KeyboardInterrupt as error:
            if type(error) is not KeyboardInterrupt:  # a signal that ends the process, not Ctrl-C
                raise


def _begun() -> None:
    gc.freeze()  # no collection looks at what is there from the start
    gc.enable()


def prepare() -> None:
    """Import NiceGUI, configured to keep nothing and to leave the folders of the user alone.

    Until the page is served nothing is collected as garbage: there is next to none among what is imported.
    """
    os.environ.setdefault("NICEGUI_STORAGE_PATH", os.path.join(tempfile.gettempdir(), "rodgen-nicegui"))
    gc.disable()
    hidden = [name for name in _OF_CLIENTS if name not in sys.modules]
    for name in hidden:  # whoever imports it now is told that there is none
        sys.modules[name] = None  # type: ignore[assignment]
    try:
        import nicegui  # noqa: F401
    finally:
        for name in hidden:
            del sys.modules[name]


def application(
    page: Callable[[], Any], token: str, port: int, begun: Callable[[], object] = lambda: None
) -> Any:
    """Return the ASGI application of a page, guarded."""
    from fastapi import FastAPI
    from nicegui import app as pages
    from nicegui import ui

    from rodgen.workbench.guard import Guard

    outer = FastAPI(docs_url=None, redoc_url=None, openapi_url=None)
    pages.on_startup(begun)
    ui.run_with(
        outer,
        root=page,
        title="rodgen",
        dark=None,
        language="en-US",
        mount_path=f"/{token}",
        tailwind=False,
        show_welcome_message=False,
        binding_refresh_interval=None,
        reconnect_timeout=30.0,
        favicon="📐",
        gzip_middleware_factory=None,  # it would take half a second, on the way from this computer to itself
    )
    return Guard(outer, token, port)
