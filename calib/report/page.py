"""A self-contained HTML page: nothing in it is fetched, and no text in it is run."""

import base64
import hashlib
import json
from collections.abc import Mapping
from datetime import datetime
from functools import cache
from importlib import resources
from typing import Any

from boxcal.calib.errors import CalibError

ROWS = 30
"""Rows that a long table shows at once; buttons turn its pages, sorting and filtering look at all."""
_ESCAPED = str.maketrans({"<": "\\u003c", ">": "\\u003e", "&": "\\u0026"})


def page(template: str, *, scripts: tuple[str, ...], data: Mapping[str, Any], **content: Any) -> bytes:
    """Return a page.

    The policy in its head allows the page's own script and style by their hashes and forbids every connection, so that
    even markup that slipped into a text could neither run nor report anywhere.

    Parameters
    ----------
    template
        File name in ``templates``.
    scripts
        File names in ``static``, run in this order as one script.
    data
        What the script draws, as JSON; finite numbers only.
    content
        What the template shows; all text is escaped.

    Raises
    ------
    CalibError
        If the extra ``report`` is not installed.
    """
    environment = _environment()
    css = _static("style.css")
    js = "\n".join(_static(name) for name in scripts)
    policy = (
        f"default-src 'none'; script-src '{_hash(js)}'; style-src '{_hash(css)}'; img-src data:; base-uri 'none'; "
        "form-action 'none'"
    )
    text: str = environment.get_template(template).render(css=css, js=js, policy=policy, data=embedded(data), **content)
    return text.encode()


@cache
def _environment() -> Any:
    """Return jinja2's environment, which keeps compiled templates: those of a fleet's pages are compiled once."""
    try:
        import jinja2  # noqa: PLC0415  an extra: only who asks for a report needs it
    except ImportError as error:
        raise CalibError("the report needs jinja2", remedy="install it with: pip install 'boxcal[report]'") from error
    return jinja2.Environment(
        loader=jinja2.PackageLoader("boxcal.calib.report"),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        auto_reload=False,
    )


@cache
def _static(name: str) -> str:
    return (resources.files("boxcal.calib.report") / "static" / name).read_text(encoding="utf-8")


def readable_time(created: str) -> str:
    """Return a time in ISO 8601 as people read it; what is none comes back as it is."""
    try:
        moment = datetime.fromisoformat(created)
    except ValueError:
        return created
    return moment.strftime("%Y-%m-%d %H:%M") + (f" {moment.tzname()}" if moment.tzinfo else "")


def embedded(data: Mapping[str, Any]) -> str:
    """Return JSON, all in ASCII, that may stand inside a script element whatever texts it holds."""
    return json.dumps(data, separators=(",", ":"), allow_nan=False).translate(_ESCAPED)


def _hash(text: str) -> str:
    return "sha256-" + base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()
