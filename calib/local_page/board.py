"""The newest state, for any number of readers: slow ones miss states, nobody waits for them."""

import json
import threading
from typing import Any


class Board:
    """Holds one state, as JSON, with a number that grows with every change."""

    def __init__(self) -> None:
        self._changed = threading.Condition()
        self._text, self._number = "{}", 0

    def put(self, state: dict[str, Any]) -> None:
        """Replace the state; the same as before is no change."""
        text = json.dumps(state, allow_nan=False, separators=(",", ":"))
        with self._changed:
            if text != self._text:
                self._text, self._number = text, self._number + 1
                self._changed.notify_all()

    def newest(self) -> tuple[int, str]:
        """Return the number and the text of the state."""
        with self._changed:
            return self._number, self._text
