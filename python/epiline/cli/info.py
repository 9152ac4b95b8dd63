"""`epiline info`: what this build is and what the machine offers it."""

from __future__ import annotations

import argparse
import os
import platform
from pathlib import Path

from epiline._core import __version__, simd_level
from epiline.cli.console import print_json, print_table


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--json", action="store_true", help="print one JSON object")


def run(args: argparse.Namespace) -> None:
    facts: dict[str, object] = {
        "version": __version__,
        "simd_level": simd_level(),
        "cores": _cores(),
        "machine": platform.machine(),
        "system": platform.platform(),
        "python": platform.python_version(),
        "cameras": _cameras(),
    }
    if args.json:
        print_json(facts)
        return
    cameras = facts.pop("cameras")
    assert isinstance(cameras, list)
    rows = [(name.replace("_", " "), value) for name, value in facts.items()]
    rows.append(("cameras", ", ".join(c["device"] for c in cameras) or "none found"))
    print_table("epiline", ("", ""), rows)


def _cores() -> int:
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def _cameras() -> list[dict[str, str]]:
    """V4L2 devices as the kernel lists them; other systems name none without opening them."""
    devices = sorted(Path("/sys/class/video4linux").glob("video*"), key=lambda p: (len(p.name), p.name))
    found = []
    for device in devices:
        try:
            name = (device / "name").read_text().strip()
        except OSError:
            name = ""
        found.append({"device": f"/dev/{device.name}", "name": name})
    return found
