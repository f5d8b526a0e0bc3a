"""Outcomes of a study's drives kept in a file, so that a long study can be made in parts and continued.

Lines of JSON, one a drive. They are of the code that made them: whoever changes it begins a new file.
"""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any


class KeptRuns:
    """Outcomes by key; with a file, those in it are not made again."""

    def __init__(self, path: Path | None) -> None:
        self._path = path
        self._known: dict[tuple[Any, ...], dict[str, Any]] = {}
        if path is not None and path.exists():
            for text in path.read_text().splitlines():
                key, outcome = json.loads(text)
                self._known[tuple(key)] = outcome

    def outcome(self, key: tuple[Any, ...], make: Callable[[], dict[str, Any]]) -> dict[str, Any]:
        """Return the outcome of a key: as it is known, or made and added to the file."""
        if key not in self._known:
            self._known[key] = make()
            if self._path is not None:
                with self._path.open("a") as file:
                    file.write(json.dumps([key, self._known[key]]) + "\n")
        return self._known[key]
