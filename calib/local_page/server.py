"""A small web server for one local page: its files, its state as a stream of events, and who may look.

Bound to 127.0.0.1 it answers only to names of this machine, so that no page from elsewhere can reach it by a name that
it resolves to 127.0.0.1; bound to other addresses it asks for a token. Requests that change something must come from
the page.
"""

import asyncio
import hmac
import secrets
import socket
import threading
from collections.abc import AsyncIterator, Awaitable, Callable, Sequence
from pathlib import Path
from typing import Any

import uvicorn
from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import FileResponse, PlainTextResponse, Response, StreamingResponse
from starlette.routing import BaseRoute, Route
from starlette.types import ASGIApp, Receive, Scope, Send

from boxcal.calib.local_page.board import Board

SHARED = Path(__file__).with_name("static")
"""Files that several pages use."""
LOCAL = ("127.0.0.1", "localhost", "::1")
_EVERY_S, _ALIVE_S = 0.08, 10.0
MOST_READERS = 16
"""Pages that may be open at once."""
_HEADERS = (
    (b"cache-control", b"no-store"),
    (
        b"content-security-policy",
        b"default-src 'self'; img-src 'self' data: blob:; frame-src http:; form-action 'self'; "
        b"frame-ancestors 'self' http://127.0.0.1:* http://localhost:*",
    ),
    (b"x-content-type-options", b"nosniff"),
    (b"referrer-policy", b"no-referrer"),
)
Handler = Callable[[Request], Awaitable[Response]]


class Guarded:
    """Lets in only who may look, and puts headers on every answer.

    Parameters
    ----------
    app
        What answers those who may.
    token
        What others must know; empty if only this machine may look.
    port
        Of the page: browsers send a host's cookies to all its ports, so that each page's has a name of its own.
    """

    def __init__(self, app: ASGIApp, token: str, port: int) -> None:
        self._app, self._token = app, token
        self._cookie = f"boxcal_token_{port}"

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer a request, or refuse it."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        request = Request(scope)
        refusal, cookie = self._refusal(request)

        async def with_headers(message: Any) -> None:
            if message["type"] == "http.response.start":
                own = {name.lower() for name, _ in message["headers"]}
                message["headers"] = [*message["headers"], *(h for h in _HEADERS if h[0] not in own)]
                if cookie:
                    message["headers"].append((b"set-cookie", cookie))
            await send(message)

        answer: ASGIApp = PlainTextResponse(refusal, 403) if refusal else self._app
        await answer(scope, receive, with_headers)

    def _refusal(self, request: Request) -> tuple[str, bytes]:
        """Return why a request is refused (empty if it is not), and the cookie to set (empty for none)."""
        name = _host_of(request.headers.get("host", ""))
        if not self._token and name not in LOCAL:
            return "This page is for this machine only; start it with --host to look at it from elsewhere.\n", b""
        origin = request.headers.get("origin")
        if request.method not in {"GET", "HEAD"} and (
            request.headers.get("x-boxcal") != "page"
            or (origin is not None and origin.partition("://")[2] != request.headers.get("host"))
        ):
            return "Requests that change something must come from the page.\n", b""
        if not self._token:
            return "", b""
        given = request.query_params.get("token")
        if given is not None and hmac.compare_digest(given.encode(), self._token.encode()):
            return "", f"{self._cookie}={self._token}; HttpOnly; SameSite=Strict; Path=/".encode()
        kept = request.cookies.get(self._cookie, "")
        if hmac.compare_digest(kept.encode(), self._token.encode()):
            return "", b""
        return "Open the address that the terminal shows, with its token.\n", b""


def _host_of(header: str) -> str:
    """Return the name in a Host header, without its port."""
    if header.startswith("["):
        return header[1:].partition("]")[0]
    return header.partition(":")[0]


def events(board: Board, stopped: threading.Event) -> Handler:
    """Return what streams a board's state to a page, the newest only."""
    readers = 0

    async def stream() -> AsyncIterator[str]:
        nonlocal readers
        readers += 1
        try:
            seen, silent = -1, 0.0
            while not stopped.is_set():
                number, text = board.newest()
                if number != seen:
                    seen, silent = number, 0.0
                    yield f"id: {number}\ndata: {text}\n\n"
                elif silent >= _ALIVE_S:
                    silent = 0.0
                    yield ": still here\n\n"
                await asyncio.sleep(_EVERY_S)
                silent += _EVERY_S
        finally:
            readers -= 1

    async def answer(_: Request) -> Response:
        if readers >= MOST_READERS:
            return PlainTextResponse(f"{MOST_READERS} pages are open already\n", 503)
        return StreamingResponse(stream(), media_type="text/event-stream")

    return answer


def file(folder: Path, name: str, path: str = "") -> BaseRoute:
    """Return the route to a file of a folder, at its name or another path."""

    async def answer(_: Request) -> Response:
        return FileResponse(folder / name)

    return Route(path or f"/{name}", answer)


def files(folder: Path, names: Sequence[str]) -> list[BaseRoute]:
    """Return routes to some files of a folder, and to its ``index.html`` at the root."""
    return [file(folder, "index.html", "/"), *(file(folder, name) for name in names)]


class PageServer:
    """One page's server, in a thread of its own.

    Parameters
    ----------
    routes
        What it answers.
    host, port
        Where it listens; port 0 takes any that is free.

    Raises
    ------
    OSError
        If the address cannot be had.
    """

    def __init__(self, routes: Sequence[BaseRoute], host: str, port: int) -> None:
        self.token = "" if host in LOCAL else secrets.token_urlsafe(16)
        family = socket.AF_INET6 if ":" in host else socket.AF_INET
        self._socket = socket.socket(family, socket.SOCK_STREAM)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            self._socket.bind((host, port))
        except OSError:
            self._socket.close()
            raise
        self.port = int(self._socket.getsockname()[1])
        name = f"[{host}]" if ":" in host else host
        if host in {"0.0.0.0", "::"}:  # noqa: S104  asked for by the user, and then with a token
            name = socket.gethostname()
        self.url = f"http://{name}:{self.port}/" + (f"?token={self.token}" if self.token else "")
        app = Guarded(Starlette(routes=list(routes)), self.token, self.port)
        config = uvicorn.Config(
            app,
            log_level="error",
            access_log=False,
            timeout_keep_alive=30,
            timeout_graceful_shutdown=1,
            limit_concurrency=64,
            http="h11",  # bounds the length of what a request says before its body
            ws="none",
            lifespan="off",
            server_header=False,
        )
        self._server = uvicorn.Server(config)
        self._thread = threading.Thread(target=self._run, name="page", daemon=True)

    def start(self) -> None:
        """Begin to answer."""
        self._socket.listen(64)
        self._thread.start()

    def stop(self) -> None:
        """Stop answering; open streams end."""
        self._server.should_exit = True
        if self._thread.is_alive():
            self._thread.join(5)
        self._socket.close()

    def _run(self) -> None:
        asyncio.run(self._server.serve(sockets=[self._socket]))
