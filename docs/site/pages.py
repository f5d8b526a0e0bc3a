"""Pages of the documentation that are made when it is built: README and its like, and one page a room of the code."""

import ast
import re
from pathlib import Path
from typing import Any

from mkdocs.structure.files import File, Files

ROOT = Path(__file__).resolve().parents[2]
ROOMS = ("target", "detect", "calib")
TAKEN = {
    "README.md": "index.md",
    "CHANGELOG.md": "changelog.md",
    "CONTRIBUTING.md": "contributing.md",
    "SECURITY.md": "security.md",
}
"""Pages that stand in the project's folder, and what they are called in the documentation."""


def on_files(files: Files, config: Any) -> Files:
    """Add the pages that do not lie in docs/."""
    for name, page in TAKEN.items():
        files.append(File.generated(config, page, content=_taken((ROOT / name).read_text())))
    packages = [init.parent for room in ROOMS for init in sorted((ROOT / room).rglob("__init__.py"))]
    for package in packages:
        files.append(File.generated(config, _page(package), content=_room(package)))
    files.append(File.generated(config, "rooms/index.md", content=_index(packages)))
    config.nav[-1]["Inside"][1] = {
        "Rooms": ["rooms/index.md", *({_name(package): _page(package)} for package in packages)]
    }
    return files


def _taken(text: str) -> str:
    """Return a page of the project's folder with its links as they are from docs/; other files become plain names."""
    text = re.sub(r"\]\(docs/([^)]+)\)", r"](\1)", text)
    for name, page in TAKEN.items():
        text = text.replace(f"]({name})", f"]({page})")
    return re.sub(r"\[([^\]]+)\]\((printables|schemas|LICENSE)[^)]*\)", r"`\2`", text)


def _name(package: Path) -> str:
    return ".".join(("boxcal", *package.relative_to(ROOT).parts))


def _page(package: Path) -> str:
    return f"rooms/{_name(package)}.md"


def _summary(module: Path) -> str:
    return (ast.get_docstring(ast.parse(module.read_text())) or "").partition("\n")[0]


def _index(packages: list[Path]) -> str:
    rows = "".join(
        f"| [`{_name(package)}`]({_name(package)}.md) | {_summary(package / '__init__.py')} |\n" for package in packages
    )
    return (
        "# Rooms\n\nEvery folder of the code and what lives there. Imports run `boxcal.target <- boxcal.detect <- "
        f"boxcal.calib`.\n\n| folder | what lives there |\n|---|---|\n{rows}"
    )


def _room(package: Path) -> str:
    modules = [m for m in sorted(package.glob("*.py")) if m.name != "__init__.py"]
    parts = [f"# {_name(package)}\n\n{_summary(package / '__init__.py')}\n"]
    parts += [
        f"## {m.stem}\n\n::: {_name(package)}.{m.stem}\n    options:\n      show_root_heading: false\n" for m in modules
    ]
    return "\n".join(parts)
