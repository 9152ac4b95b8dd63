"""Who imports whom, held to the tables of ARCHITECTURE.md."""

from __future__ import annotations

import ast
import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
CORE = ROOT / "crates" / "epiline" / "src"
PACKAGE = ROOT / "python" / "epiline"


def table(heading: str) -> dict[str, set[str]]:
    """The `room <- rooms` lines of the code block under a heading."""
    page = (ROOT / "ARCHITECTURE.md").read_text()
    block = page.split(f"## {heading}", 1)[1].split("```")[1]
    rows = (line.split("<-") for line in block.strip().splitlines())
    return {room.strip(): set(allowed.split()) for room, allowed in rows}


def rooms(folder: Path, suffix: str) -> set[str]:
    names = {p.name.removesuffix(suffix) for p in folder.iterdir() if p.suffix == suffix or p.is_dir()}
    return {n for n in names if not n.startswith("__")}


def rust_imports(room: str) -> set[str]:
    """Rooms that a room's own code names as `crate::room`; tests inside a file may look anywhere."""
    files = [*CORE.glob(f"{room}.rs"), *(CORE / room).rglob("*.rs")]
    found: set[str] = set()
    for file in files:
        code = file.read_text().split("#[cfg(test)]\nmod tests", 1)[0]
        code = re.sub(r"//.*", "", code)
        found |= set(re.findall(r"\bcrate::(\w+)", code))
        for group in re.findall(r"\bcrate::\{(.*?)\};", code, re.S):
            flat = re.sub(r"\{[^{}]*\}", "", group)
            found |= {re.split(r"::|\s", part.strip())[0] for part in flat.split(",") if part.strip()}
    # `crate::Error` and `crate::Result` are the error room's, re-exported.
    return {"error" if name in {"Error", "Result"} else name for name in found} - {room}


def python_imports(room: str) -> set[str]:
    files = [*PACKAGE.glob(f"{room}.py"), *(PACKAGE / room).rglob("*.py")]
    found: set[str] = set()
    for file in files:
        for node in ast.walk(ast.parse(file.read_text())):
            names: list[str] = []
            if isinstance(node, ast.Import):
                names = [alias.name for alias in node.names]
            elif isinstance(node, ast.ImportFrom) and node.module:
                assert node.level == 0, f"{file}: relative import; write it out"
                names = [f"{node.module}.{alias.name}" for alias in node.names]
            found |= {parts[1] for name in names if (parts := name.split("."))[0] == "epiline" and len(parts) > 1}
    return found - {room}


@pytest.mark.parametrize("room", sorted(table("Who may import whom: Rust")))
def test_rust_room_imports_only_what_the_table_allows(room: str) -> None:
    allowed = table("Who may import whom: Rust")[room]
    assert rust_imports(room) <= allowed


@pytest.mark.parametrize("room", sorted(table("Who may import whom: Python")))
def test_python_room_imports_only_what_the_table_allows(room: str) -> None:
    allowed = table("Who may import whom: Python")[room]
    assert python_imports(room) <= allowed


def test_every_room_is_in_the_tables() -> None:
    assert rooms(CORE, ".rs") - {"lib"} == set(table("Who may import whom: Rust"))
    assert rooms(PACKAGE, ".py") == set(table("Who may import whom: Python")) - {"_core"}


def test_the_checker_sees_imports() -> None:
    """The rules above would pass on anything if the scan found nothing."""
    assert {"error", "image"} <= rust_imports("matching")
    assert {"_core", "targets"} <= python_imports("_operations")


def test_importing_epiline_loads_numpy_and_nothing_heavier() -> None:
    heavy = "cv2", "rich", "jinja2", "scipy", "matplotlib", "http", "asyncio"
    code = "import sys, numpy; before = set(sys.modules); import epiline; new = set(sys.modules) - before;"
    code += f"print([m for m in new if m.split('.')[0] in {heavy!r}])"
    loaded = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    assert loaded.strip() == "[]"
