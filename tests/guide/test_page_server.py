"""The local page's server: who may look, who may ask, and readers that are slow, many or asleep."""

import json
import threading
import time
from collections.abc import Iterator
from http.client import HTTPConnection

import pytest
from live_messages import until
from starlette.requests import Request
from starlette.responses import PlainTextResponse, Response
from starlette.routing import Route

from boxcal.calib.local_page.board import Board
from boxcal.calib.local_page.server import MOST_READERS, PageServer, events


def _server(host: str, board: Board, stopped: threading.Event) -> PageServer:
    async def done(_: Request) -> Response:
        return PlainTextResponse("done")

    routes = [Route("/", done), Route("/events", events(board, stopped)), Route("/do", done, methods=["POST"])]
    return PageServer(routes, host, 0)


@pytest.fixture(params=["127.0.0.1", "0.0.0.0"])
def served(request: pytest.FixtureRequest) -> Iterator[tuple[PageServer, Board]]:
    board, stopped = Board(), threading.Event()
    server = _server(request.param, board, stopped)
    server.start()
    yield server, board
    stopped.set()
    server.stop()


class Asked:
    """One request and its answer; a stream stays open until it is closed."""

    def __init__(self, server: PageServer, path: str = "/", method: str = "GET", **headers: str) -> None:
        self._connection = HTTPConnection("127.0.0.1", server.port, timeout=10)
        self._connection.putrequest(method, path, skip_host="host" in headers)
        for name, value in headers.items():
            self._connection.putheader(name.replace("_", "-"), value)
        self._connection.endheaders()
        self.answer = self._connection.getresponse()
        self.status = self.answer.status
        if self.answer.getheader("content-type", "").partition(";")[0] != "text/event-stream":
            self.answer.read()
            self.close()

    def header(self, name: str) -> str:
        return self.answer.getheader(name) or ""

    def next(self) -> dict[str, object]:
        """The next state of a stream."""
        while True:
            line = self.answer.readline()
            if line.startswith(b"data: "):
                found: dict[str, object] = json.loads(line[6:])
                return found

    def close(self) -> None:
        self.answer.close()
        self._connection.close()


def _asked(server: PageServer, path: str = "/", method: str = "GET", **headers: str) -> Asked:
    return Asked(server, path, method, **headers)


def _cookie(server: PageServer) -> str:
    return f"boxcal_token_{server.port}={server.token}"


def _stream(server: PageServer) -> Asked:
    return Asked(server, "/events", cookie=_cookie(server))


def test_only_this_machine_looks_at_a_page_bound_to_it_and_others_need_the_token(
    served: tuple[PageServer, Board],
) -> None:
    server, _ = served
    if not server.token:
        assert _asked(server).status == 200
        assert _asked(server, host="localhost:1").status == 200
        for elsewhere in ("evil.example", "evil.example:80", "[2001:db8::1]:80", "127.0.0.1.evil.example"):
            assert _asked(server, host=elsewhere).status == 403, elsewhere
        assert "token" not in server.url
        return
    assert len(server.token) >= 20
    assert server.url.endswith(f"?token={server.token}")
    assert _asked(server).status == 403
    assert _asked(server, "/?token=wrong").status == 403
    first = _asked(server, f"/?token={server.token}")
    cookie = first.header("set-cookie")
    assert first.status == 200
    assert "HttpOnly" in cookie
    assert "SameSite=Strict" in cookie
    assert _asked(server, cookie=cookie.partition(";")[0]).status == 200
    assert _asked(server, cookie=f"boxcal_token_{server.port}=wrong").status == 403
    odd = f"a/b=of another program; {_cookie(server)}; c"
    assert _asked(server, cookie=odd).status == 200, "cookies of other pages of this host are no matter"


def test_what_changes_something_must_come_from_the_page(served: tuple[PageServer, Board]) -> None:
    server, _ = served
    token = {"cookie": _cookie(server)}
    here = f"127.0.0.1:{server.port}"
    assert _asked(server, "/do", "POST", **token).status == 403
    assert _asked(server, "/do", "POST", x_boxcal="page", origin="http://evil.example", **token).status == 403
    assert _asked(server, "/do", "POST", x_boxcal="page", origin=f"http://{here}", **token).status == 200
    assert _asked(server, "/do", "POST", x_boxcal="page", **token).status == 200


def test_answers_allow_nothing_from_elsewhere(served: tuple[PageServer, Board]) -> None:
    server, _ = served
    policy = _asked(server, f"/?token={server.token}").header("content-security-policy")
    assert "default-src 'self'" in policy


def test_two_browsers_see_the_same_and_a_slow_one_misses_states_instead_of_queueing_them(
    served: tuple[PageServer, Board],
) -> None:
    server, board = served
    board.put({"n": 0})
    fast, slow = _stream(server), _stream(server)
    assert fast.next() == slow.next() == {"n": 0}
    for n in range(1, 200):
        board.put({"n": n})
        time.sleep(0.002)
    seen = []
    while not seen or seen[-1] != {"n": 199}:
        seen.append(fast.next())
    assert len(seen) < 60
    assert slow.next()["n"] in range(1, 200)
    fast.close()
    slow.close()


def test_a_state_that_stays_the_same_is_sent_once() -> None:
    board = Board()
    board.put({"a": 1})
    before = board.newest()
    board.put({"a": 1})
    assert board.newest() == before
    with pytest.raises(ValueError, match="JSON"):
        board.put({"a": float("nan")})


def test_pages_that_are_left_open_or_closed_do_not_add_up(served: tuple[PageServer, Board]) -> None:
    server, board = served
    board.put({"n": 0})
    streams = [_stream(server) for _ in range(MOST_READERS)]
    for stream in streams:
        stream.next()
    assert _stream(server).status == 503
    for stream in streams:
        stream.close()

    def again() -> bool:
        board.put({"t": time.monotonic()})  # a write is how a server notices that nobody reads
        stream = _stream(server)
        stream.close()
        return stream.status == 200

    until(again)
