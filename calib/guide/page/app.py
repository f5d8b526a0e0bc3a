"""The page's server: its files, its state, the camera's image, the report, and what the page may ask for."""

from pathlib import Path

from starlette.requests import Request
from starlette.responses import FileResponse, PlainTextResponse, RedirectResponse, Response
from starlette.routing import BaseRoute, Route

from boxcal.calib.guide.session import Session
from boxcal.calib.local_page.board import Board
from boxcal.calib.local_page.server import SHARED, PageServer, events, file, files

STATIC = Path(__file__).with_name("static")
_REPORT_POLICY = "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; img-src data: blob:"


def page_server(session: Session, board: Board, host: str, port: int) -> PageServer:
    """Return the server of a session's page (OSError if the address cannot be had)."""

    async def picture(_: Request) -> Response:
        seen = session.progress.outlook.seen
        return Response(status_code=404) if seen is None else Response(seen.jpeg, media_type="image/jpeg")

    async def report(_: Request) -> Response:
        path = session.options.out / session.options.robot / "report.html"
        if not session.progress.full.written or not path.is_file():
            return PlainTextResponse("There is no report yet.\n", 404)
        return FileResponse(path, headers={"content-security-policy": _REPORT_POLICY})

    async def no_slash(_: Request) -> Response:
        return RedirectResponse("report/")

    async def ask(request: Request) -> Response:
        what = request.path_params["what"]
        if what not in {"calibrate", "again", "camera"}:
            return PlainTextResponse("Only calibrate, again and camera can be asked for.\n", 404)
        session.request(what, request.query_params.get("topic", ""))
        return Response(status_code=202)

    routes: list[BaseRoute] = [
        *files(STATIC, ["guide.css", "guide.js"]),
        file(SHARED, "plan.js"),
        Route("/events", events(board, session.stopped)),
        Route("/picture.jpg", picture),
        Route("/report", no_slash),
        Route("/report/", report),
        Route("/ask/{what}", ask, methods=["POST"]),
    ]
    return PageServer(routes, host, port)
