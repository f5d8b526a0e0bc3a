"""The page that drives a simulated robot: a pad, a map to click on, and trouble on request."""

import json
from math import isfinite
from pathlib import Path
from typing import Any

import numpy as np
from starlette.requests import Request
from starlette.responses import JSONResponse, PlainTextResponse, Response
from starlette.routing import BaseRoute, Route

from boxcal.calib.errors import CalibError
from boxcal.calib.local_page.board import Board
from boxcal.calib.local_page.server import SHARED, PageServer, events, file, files
from boxcal.calib.simulate.serve.camera import DARK_GAIN, LiveCamera
from boxcal.calib.simulate.serve.moving_robot import MovingRobot

STATIC = Path(__file__).with_name("static")
_MOST_BYTES = 2000
_BOX_PUSHED = (0.02, -0.012, 0.05)
_SLIPPED_M = 0.02


class DrivePage:
    """Routes of the page, and the state that it shows.

    Parameters
    ----------
    moving, camera
        Who is driven.
    bridge_url
        Where its topics are.
    guide_url
        A guide's page to show beside the pad; empty for none.
    """

    def __init__(self, moving: MovingRobot, camera: LiveCamera, bridge_url: str, guide_url: str) -> None:
        self._moving, self._camera = moving, camera
        self._fixed = {
            "name": moving.robot.name,
            "bridge": bridge_url,
            "guide": guide_url,
            "box": [moving.target.box.width, moving.target.box.depth],
            "size": round(moving.robot.b, 3),
        }

    def state(self) -> dict[str, Any]:
        """Return what the page shows."""
        x, y, heading = self._moving.pose.tolist()
        return {
            **self._fixed,
            "robot": {"x": round(x, 3), "y": round(y, 3), "heading": round(heading, 3), "source": "true"},
            "ahead": np.round(self._moving.ahead, 2).tolist(),
            "moving": self._moving.moving,
            "dark": self._camera.gain < 1,
        }

    def server(self, board: Board, stopped: Any, host: str, port: int) -> PageServer:
        """Return the page's server (OSError if the address cannot be had)."""
        routes: list[BaseRoute] = [
            *files(STATIC, ["robot.css", "robot.js"]),
            file(SHARED, "plan.js"),
            Route("/events", events(board, stopped)),
            Route("/drive", self._answer(self._drive), methods=["POST"]),
            Route("/go", self._answer(self._go), methods=["POST"]),
            Route("/trouble", self._answer(self._trouble), methods=["POST"]),
        ]
        return PageServer(routes, host, port)

    def _answer(self, act: Any) -> Any:
        async def answer(request: Request) -> Response:
            body = b""
            async for part in request.stream():
                body += part
                if len(body) > _MOST_BYTES:
                    return PlainTextResponse("too long\n", 413)
            try:
                act(json.loads(body))
            except CalibError as error:
                return JSONResponse({"said": str(error)}, 409)
            except (ValueError, TypeError, LookupError, RecursionError):
                return PlainTextResponse("numbers are needed\n", 400)
            return JSONResponse({"said": ""})

        return answer

    def _drive(self, asked: dict[str, Any]) -> None:
        v, w = float(asked["v"]), float(asked["w"])
        if not (isfinite(v) and isfinite(w)):
            raise ValueError
        self._moving.drive(v, w)

    def _go(self, asked: dict[str, Any]) -> None:
        x, y = float(asked["x"]), float(asked["y"])
        heading = asked.get("heading")
        towards_box = float(np.arctan2(-y, -x))
        self._moving.go_to(x, y, towards_box if heading is None else float(heading), int(asked.get("whole_turns", 0)))

    def _trouble(self, asked: dict[str, Any]) -> None:
        kind = asked["kind"]
        if kind == "box":
            self._moving.move_box(*_BOX_PUSHED)
        elif kind == "slip":
            self._moving.slip_wheel(_SLIPPED_M)
        elif kind == "dark":
            self._camera.set_gain(1.0 if self._camera.gain < 1 else DARK_GAIN)
        else:
            raise ValueError
