"""Files appear whole or not at all."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TypeAlias

StrPath: TypeAlias = str | os.PathLike[str]


def write_atomically(path: StrPath, content: bytes) -> None:
    """Writes a file under a temporary name in its folder, then renames it.

    Raises
    ------
    OSError
        The folder does not exist or cannot be written; the message names the path asked for.
    """
    target = Path(path)
    temporary = target.with_name(f".{target.name}.{os.getpid()}.tmp")
    try:
        try:
            temporary.write_bytes(content)
            temporary.replace(target)
        except BaseException:
            if temporary.parent.is_dir():
                temporary.unlink(missing_ok=True)
            raise
    except OSError as error:
        # The temporary name means nothing to the caller.
        raise type(error)(error.errno, f"cannot be written: {error.strerror}", str(target)) from error
