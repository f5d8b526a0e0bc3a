"""Makes the helper modules of this folder importable, and skips where the extra live is not installed."""

import sys
from pathlib import Path

import pytest

for name in ("foxglove", "starlette", "uvicorn", "websockets"):
    pytest.importorskip(name, reason="the extra live is not installed")

sys.path.insert(0, str(Path(__file__).parent))
sys.path.insert(0, str(Path(__file__).parent.parent / "report"))
