"""Found corners kept in a file, so that thousands of photographs need be looked at only once."""

from __future__ import annotations

import json
import os
import threading
import time
from pathlib import Path
from typing import Any

import numpy as np

from epiline.targets.boards import Board
from epiline.targets.photograph import Look, Photograph

_FORMAT = "epiline corners 1"
# How photographs are looked at; raised when the same photograph would give other corners.
_WAY_OF_LOOKING = 2
# Between two writes while photographs are being looked at: what a broken run loses at most.
_WRITE_EVERY_SECONDS = 10.0


class CornerCache:
    """Looks by path, size and time of change of the photograph, the board, and the refinement window.

    A photograph that was changed, or another board, is looked at anew. The file is written under a temporary name
    and renamed, every few seconds and at the end, so that a run that is broken off goes on where it was.

    Parameters
    ----------
    path : path-like
        Need not exist.
    board : Chessboard or Charuco
    half_window : int or None

    Raises
    ------
    OSError
        The file is there and is no such cache: it is not overwritten.
    """

    def __init__(self, path: str | os.PathLike[str], board: Board, half_window: int | None) -> None:
        self._path = Path(path)
        self._what = f"{board!r} window {half_window} way {_WAY_OF_LOOKING}"
        self._lock = threading.Lock()
        self._written = time.monotonic()
        self._changed = False
        self._looks: dict[str, Any] = {}
        if self._path.exists():
            self._looks = self._read()

    def get(self, photograph: Photograph) -> Look | None:
        """What was found in this photograph before; None if that is not known."""
        key = self._key(photograph)
        with self._lock:
            kept = None if key is None else self._looks.get(key)
        try:
            return None if kept is None else Look.from_json(kept)
        except (KeyError, TypeError, ValueError):
            return None

    def put(self, photograph: Photograph, look: Look) -> None:
        """Keeps what was found, and now and then the file; what is no readable file is not kept."""
        key = self._key(photograph)
        if key is None or look.size is None:
            return
        kept = look.as_json()
        with self._lock:
            self._looks[key] = kept
            self._changed = True
            if time.monotonic() - self._written > _WRITE_EVERY_SECONDS:
                self._write()

    def flush(self) -> None:
        """Writes the file if anything is new."""
        with self._lock:
            if self._changed:
                self._write()

    def _key(self, photograph: Photograph) -> str | None:
        if isinstance(photograph, np.ndarray):
            return None
        try:
            state = os.stat(photograph)
        except OSError:
            return None
        return f"{Path(photograph).resolve()}|{state.st_size}|{state.st_mtime_ns}|{self._what}"

    def _read(self) -> dict[str, Any]:
        try:
            content = json.loads(self._path.read_bytes())
            if content["format"] != _FORMAT:
                raise ValueError
            return dict(content["looks"])
        except (ValueError, KeyError, TypeError):
            raise OSError(f"{self._path}: is there and is no cache of corners; name another file") from None

    def _write(self) -> None:
        from epiline._files import write_atomically

        content = {"format": _FORMAT, "looks": self._looks}
        write_atomically(self._path, json.dumps(content, allow_nan=False, separators=(",", ":")).encode())
        self._written, self._changed = time.monotonic(), False
