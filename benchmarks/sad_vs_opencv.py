"""Speed of epiline's SAD matcher against OpenCV's StereoBM: one run, one thread each, answers compared.

    python benchmarks/sad_vs_opencv.py                    # table
    python benchmarks/sad_vs_opencv.py --csv out.csv      # and a file
    python benchmarks/sad_vs_opencv.py --record           # and benchmarks/record/<cpu>/<date>.csv

Repetitions of the two alternate, so that whatever else the machine does meets both; the ratio is the median of the
repetitions' ratios. Time is that of the thread, so that the waiting on a busy machine is not counted.

"equal" is the share of answers that are the same number: without tests, of the interior, where both look at the same
pixels; with tests, of the interior pixels that both answer (OpenCV's left-right check compares winners only, so the two
reject different pixels). With tests, both have uniqueness 10, texture 10, left-right 1 and speckle 100 within 2 px.
"""

from __future__ import annotations

import argparse
import csv
import datetime
import json
import os
import platform
import re
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import cv2
import numpy as np

ROOT = Path(__file__).resolve().parent.parent
SIZES = ((640, 480, 64), (1280, 720, 128))
WINDOWS = (9, 15, 21)
LEVELS = ("scalar", "avx2", "avx512", "neon")
COLUMNS = (
    "level", "width", "height", "disparities", "window", "tests", "ratio", "ratio_low", "ratio_high",
    "opencv_ms", "epiline_ms", "equal", "opencv_density", "epiline_density",
)  # fmt: skip


def photographs(width: int, height: int) -> tuple[np.ndarray, np.ndarray, str]:
    """A real pair at the size asked for, or a synthetic one where the real data is absent."""
    data = Path(os.environ.get("EPILINE_DATA", ROOT / ".." / "shared" / "data"))
    name = "middlebury2014/Motorcycle"
    if (data / "manifest.json").is_file():
        entry = json.loads((data / "manifest.json").read_text())[name]
        paths = [str(data / name / entry[side]) for side in ("left", "right")]
        left, right = (cv2.imread(path, cv2.IMREAD_GRAYSCALE) for path in paths)
        left, right = (cv2.resize(image, (width, height), interpolation=cv2.INTER_AREA) for image in (left, right))
        return left, right, name
    noise = np.random.default_rng(0).integers(0, 256, (height, width + 200), np.uint8)
    scene = cv2.GaussianBlur(noise, (5, 5), 1.2)
    rows, columns = np.mgrid[0:height, 0:width].astype(np.float32)
    disparity = 4 + 50 * rows / height
    left = np.ascontiguousarray(scene[:, :width])
    return left, cv2.remap(left, columns + disparity, rows, cv2.INTER_LINEAR), "synthetic slope"


def stereo_bm(disparities: int, window: int, tests: bool) -> cv2.StereoBM:
    matcher = cv2.StereoBM.create(disparities, window)
    matcher.setPreFilterType(cv2.StereoBM_PREFILTER_XSOBEL)
    matcher.setPreFilterCap(31)
    matcher.setUniquenessRatio(10 if tests else 0)
    matcher.setTextureThreshold(10 if tests else 0)
    matcher.setDisp12MaxDiff(1 if tests else -1)
    matcher.setSpeckleWindowSize(100 if tests else 0)
    matcher.setSpeckleRange(32)
    return matcher


def epiline_matcher(disparities: int, window: int, tests: bool) -> Any:
    from epiline import StereoMatcher

    strict = {"uniqueness_ratio": 10, "texture_threshold": 10, "left_right_max_diff": 1, "speckle_size": 100}
    return StereoMatcher(num_disparities=disparities, block_size=window, threads=1, **(strict if tests else {}))


def compare(width: int, height: int, disparities: int, window: int, tests: bool, repeats: int) -> dict[str, Any]:
    left, right, _ = photographs(width, height)
    theirs, ours = stereo_bm(disparities, window, tests), epiline_matcher(disparities, window, tests)
    out = ours(left, right)
    reference = theirs.compute(left, right)
    times = np.empty((repeats, 2))
    for repeat in range(repeats):
        start = time.thread_time()
        theirs.compute(left, right)
        middle = time.thread_time()
        ours(left, right, out=out)
        times[repeat] = middle - start, time.thread_time() - middle
    radius = window // 2
    interior = np.s_[radius : height - radius, disparities - 1 + radius : width - radius]
    answer, reference = out.to_opencv()[interior], reference[interior]
    both = (answer >= 0) & (reference >= 0) if tests else np.ones_like(answer, bool)
    low, ratio, high = np.percentile(times[:, 0] / times[:, 1], (25, 50, 75))
    opencv_ms, epiline_ms = 1e3 * np.median(times, axis=0)
    return {
        "width": width,
        "height": height,
        "disparities": disparities,
        "window": window,
        "tests": int(tests),
        "ratio": round(ratio, 2),
        "ratio_low": round(low, 2),
        "ratio_high": round(high, 2),
        "opencv_ms": round(opencv_ms, 3),
        "epiline_ms": round(epiline_ms, 3),
        "equal": round(float((answer == reference)[both].mean()), 6),
        "opencv_density": round(float((reference >= 0).mean()), 4),
        "epiline_density": round(float((answer >= 0).mean()), 4),
    }


def worker(repeats: int) -> None:
    """Measures at the level this process was started with; a line of JSON for each row."""
    from epiline import simd_level

    cv2.setNumThreads(1)
    for size in SIZES:
        for window in WINDOWS:
            for tests in (False, True):
                row = {"level": simd_level(), **compare(*size, window, tests, repeats)}
                print(json.dumps(row), flush=True)


def cpu_name() -> str:
    info = Path("/proc/cpuinfo")
    found = re.search(r"model name\s*:\s*(.+)", info.read_text()) if info.is_file() else None
    return found.group(1).strip() if found else platform.processor() or platform.machine()


def commit() -> str:
    git = subprocess.run(["git", "-C", ROOT, "describe", "--always", "--dirty"], capture_output=True, text=True)
    return git.stdout.strip() or "unknown"


def write_csv(path: Path, rows: list[dict[str, Any]]) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("w", newline="") as file:
        file.write(f"# {cpu_name()}; {datetime.date.today()}; epiline {commit()}; OpenCV {cv2.__version__}; ")
        file.write(f"{photographs(64, 64)[2]}; one thread each\n")
        writer = csv.DictWriter(file, COLUMNS)
        writer.writeheader()
        writer.writerows(rows)
    print(f"wrote {path}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--levels", nargs="+", choices=LEVELS, help="default: scalar and all this processor has")
    parser.add_argument("--repeats", type=int, default=21, help="repetitions per row (21)")
    parser.add_argument("--csv", type=Path, help="also write the table here")
    parser.add_argument("--record", action="store_true", help="also write it under benchmarks/record")
    parser.add_argument("--worker", action="store_true", help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.worker:
        worker(arguments.repeats)
        return

    print(f"{cpu_name()}; epiline {commit()}; OpenCV {cv2.__version__} StereoBM; {photographs(64, 64)[2]}; one thread")
    header = f"{'level':8}{'size':>14}{'window':>8}{'tests':>7}{'times faster':>22}"
    print(f"{header}{'OpenCV ms':>11}{'ours ms':>9}{'equal':>10}")
    rows: list[dict[str, Any]] = []
    for level in arguments.levels or LEVELS:
        # The level is chosen when the library is loaded, hence a process for each.
        command = [sys.executable, __file__, "--worker", "--repeats", str(arguments.repeats)]
        environment = {**os.environ, "EPILINE_SIMD": level}
        with subprocess.Popen(command, env=environment, stdout=subprocess.PIPE, text=True) as process:
            assert process.stdout is not None
            for line in process.stdout:
                row = json.loads(line)
                if row["level"] != level:  # this processor lacks it
                    process.terminate()
                    break
                rows.append(row)
                size = f"{row['width']}x{row['height']}x{row['disparities']}"
                spread = f"{row['ratio']:.2f} ({row['ratio_low']:.2f}-{row['ratio_high']:.2f})"
                print(
                    f"{level:8}{size:>14}{row['window']:>8}{'all' if row['tests'] else 'none':>7}{spread:>22}"
                    f"{row['opencv_ms']:>11.2f}{row['epiline_ms']:>9.2f}{100 * row['equal']:>9.3f}%"
                )
    if arguments.csv:
        write_csv(arguments.csv, rows)
    if arguments.record:
        folder = re.sub(r"[^a-z0-9]+", "-", cpu_name().lower()).strip("-")
        write_csv(ROOT / "benchmarks" / "record" / folder / f"{datetime.date.today()}.csv", rows)
    broken = [row for row in rows if not row["tests"] and row["equal"] < 1]
    if broken:
        sys.exit(f"{len(broken)} rows differ from OpenCV's answer without tests")


if __name__ == "__main__":
    main()
