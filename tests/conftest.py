"""Where tests find the real photographs, and what they say when there are none."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent


@pytest.fixture(scope="session")
def data() -> Path:
    """The folder of real stereo data; skips, saying so, where it is absent."""
    folder = Path(os.environ.get("EPILINE_DATA", ROOT / ".." / "shared" / "data")).resolve()
    if not (folder / "manifest.json").is_file():
        pytest.skip(f"no real data at {folder}; set EPILINE_DATA")
    return folder
