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


@pytest.fixture(scope="session")
def rendered(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A small rendered rig as files: `boards/`, `drive/` and the `rig.yaml` calibrated from the boards."""
    import epiline as ep
    from epiline.sinks.pictures import write_picture
    from epiline.sources.rendered import RenderedRig

    folder = tmp_path_factory.mktemp("rendered")
    rig = RenderedRig(seed=3, size=(320, 240))
    for name in ("boards", "drive"):
        (folder / name).mkdir()
    for i, view in enumerate(rig.board_views(9, 6, 0.04, 8)):
        write_picture(folder / "boards" / f"left{i:02}.png", view.left)
        write_picture(folder / "boards" / f"right{i:02}.png", view.right)
    for frame in rig.frames(2):
        write_picture(folder / "drive" / f"left{frame.seq:02}.png", frame.left)
        write_picture(folder / "drive" / f"right{frame.seq:02}.png", frame.right)
    names = [sorted((folder / "boards").glob(f"{side}*.png")) for side in ("left", "right")]
    board = ep.Chessboard(columns=9, rows=6, square_m=0.04)
    ep.calibrate(ep.find_boards(*names, board)).save(folder / "rig.yaml")
    return folder
