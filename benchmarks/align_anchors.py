"""Prints how well `ep.align` aligns single pairs, judged on board corners or known truth that it did not get.

    python benchmarks/align_anchors.py [DATA [PART...]]

Parts are the names of the calibration sets (bouguet, Bumblebee2, stereopi, sourishg), `scenes`, `refusals`, `drift` and
`cost`; without any, all run. Each pair of the calibration sets is aligned alone, once with the lenses that all pairs
together give and once with nothing known. The figure is the mean vertical disparity of the pair's own board corners
after alignment.
"""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
from drift_anchors import score_cost, score_drift

import epiline as ep
from epiline.benchmarking import machine_line
from epiline.evaluation import load_scenes

Array = np.ndarray


def corner_error_px(aligned: ep.PairAlignment, left_px: Array, right_px: Array) -> float:
    """Mean vertical disparity of matched raw pixels after alignment; NaN if there is no alignment."""
    if aligned.lens is None:
        return float("nan")
    rows = []
    for lens, homography, pixels in zip(aligned.lens, aligned.homographies, (left_px, right_px), strict=True):
        straight = lens.undistort(pixels)
        turned = np.column_stack([straight, np.ones(len(straight))]) @ homography.T
        rows.append(turned[:, 1] / turned[:, 2])
    return float(np.mean(np.abs(rows[0] - rows[1])))


def board_sets(data: Path) -> Iterator[tuple[str, list[Path], list[Path], ep.Chessboard]]:
    calib = data / "calib"
    square = 0.03
    for name, pattern, board in (
        ("opencv_bouguet", "{}[0-9][0-9].jpg", ep.Chessboard(columns=9, rows=6, square_m=square)),
        ("boofcv_Bumblebee2_Chess", "{}[0-9][0-9].jpg", ep.Chessboard(columns=6, rows=4, square_m=square)),
        ("stereopi/pairs", "{}_*.png", ep.Chessboard(columns=9, rows=6, square_m=square)),
        ("sourishg_2", "{}[0-9]*.jpg", ep.Chessboard(columns=9, rows=6, square_m=square)),
    ):
        left, right = (sorted((calib / name).glob(pattern.format(side))) for side in ("left", "right"))
        yield name, left, right, board


def score_boards(name: str, left: list[Path], right: list[Path], board: ep.Chessboard) -> None:
    observations = ep.find_boards(left, right, board)
    calibration = ep.calibrate(observations, held_out=False)
    views = observations.accepted
    folder = left[0].parent
    for title, lens in (("lens known", (calibration.left, calibration.right)), ("nothing known", None)):
        print(f"\n{name}, {title}")
        errors, trusted, milliseconds = [], [], []
        for view in views:
            images = [cv2.imread(str(folder / n), cv2.IMREAD_GRAYSCALE) for n in (view.name_left, view.name_right)]
            begin = time.perf_counter()
            aligned = ep.align(*images, lens=lens)
            milliseconds.append(1e3 * (time.perf_counter() - begin))
            errors.append(corner_error_px(aligned, view.left_px, view.right_px))
            trusted.append(aligned.trusted)
            print(
                f"  {view.name_left:16} corners {errors[-1]:7.3f} px  held out {aligned.epipolar_error_px:6.3f}"
                f"  sigma {aligned.sigma_px:6.3f}  {aligned.matches:5} matches  "
                f"{'trusted' if aligned.trusted else aligned.reason}"
            )
        summary(np.array(errors), np.array(trusted), milliseconds)


def summary(errors: Array, trusted: Array, milliseconds: list[float]) -> None:
    known = np.nan_to_num(errors, nan=np.inf)
    print(
        f"  => under 1 px {np.sum(known < 1)}/{len(known)}, median {np.median(known):.3f}, worst {known.max():.3f}; "
        f"trusted {trusted.sum()}, of these worst {known[trusted].max(initial=0):.3f}; "
        f"median {np.median(milliseconds):.0f} ms"
    )


def score_turned_scenes(data: Path) -> None:
    """Scenes of the ground-truth table, both cameras turned by up to 2 degrees: judged on the true disparities."""
    print("\nrectified scenes, cameras turned, nothing known")
    random = np.random.default_rng(0)
    errors, trusted, milliseconds = [], [], []
    for scene in load_scenes(data):
        images = [scene.left, scene.right]
        height, width = images[0].shape[:2]
        K = np.array([[1.2 * width, 0, width / 2], [0, 1.2 * width, height / 2], [0, 0, 1]])
        H = [K @ cv2.Rodrigues(np.radians(random.uniform(-2, 2, 3)))[0] @ np.linalg.inv(K) for _ in images]
        photographs = [
            cv2.warpPerspective(i, h, (width, height), flags=cv2.INTER_CUBIC) for i, h in zip(images, H, strict=True)
        ]
        truth = scene.truth
        y, x = np.nonzero(np.isfinite(truth) & scene.non_occluded)
        seen = np.column_stack([x, y]).astype(float), np.column_stack([x - truth[y, x], y]).astype(float)
        raw = [cv2.perspectiveTransform(points[:, None], h)[:, 0] for points, h in zip(seen, H, strict=True)]
        begin = time.perf_counter()
        aligned = ep.align(*photographs)
        milliseconds.append(1e3 * (time.perf_counter() - begin))
        errors.append(corner_error_px(aligned, *raw))
        trusted.append(aligned.trusted)
        print(
            f"  {scene.name:28} truth {errors[-1]:7.3f} px  held out {aligned.epipolar_error_px:6.3f}"
            f"  sigma {aligned.sigma_px:6.3f}  {'trusted' if aligned.trusted else aligned.reason}"
        )
    summary(np.array(errors), np.array(trusted), milliseconds)


def score_refusals(data: Path) -> None:
    """Real pairs made hopeless: none may be trusted."""
    print("\nmade hopeless, nothing known")
    scenes = list(load_scenes(data))
    counts: dict[str, list[bool]] = {}
    for scene, other in zip(scenes, scenes[13:] + scenes[:13], strict=True):
        left, right = (ep.grey(np.ascontiguousarray(i)) for i in (scene.left, scene.right))
        size = left.shape[::-1]
        K = np.array([[1.2 * size[0], 0, size[0] / 2], [0, 1.2 * size[0], size[1] / 2], [0, 0, 1]])
        turn = K @ cv2.Rodrigues(np.radians((0.5, 1.5, -0.7)))[0] @ np.linalg.inv(K)
        plane = np.array([[1.01, 0.02, -20.0], [0.002, 1.0, 2.0], [3e-5, 1e-5, 1.0]])
        stranger = cv2.resize(ep.grey(np.ascontiguousarray(other.right)), size)
        for name, pair in {
            "swapped": (right, left),
            "mirrored": (left, np.ascontiguousarray(right[:, ::-1])),
            "unrelated": (left, stranger),
            "identical": (left, left),
            "turned": (left, cv2.warpPerspective(left, turn, size)),
            "plane": (left, cv2.warpPerspective(left, plane, size)),
        }.items():
            aligned = ep.align(*pair)
            counts.setdefault(name, []).append(aligned.trusted)
            if aligned.trusted:
                print(f"  {scene.name} {name}: {aligned}")
    for name, trusted in counts.items():
        print(f"  {name:12} trusted {sum(trusted)} of {len(trusted)}")


def main() -> None:
    data = Path(sys.argv[1] if len(sys.argv) > 1 else os.environ.get("EPILINE_DATA", "../shared/data"))
    wanted = sys.argv[2:]
    print(machine_line("one pair at a time", (1,)))
    for name, left, right, board in board_sets(data):
        if not wanted or any(w in name for w in wanted):
            score_boards(name, left, right, board)
    if not wanted or "scenes" in wanted:
        score_turned_scenes(data)
    if not wanted or "refusals" in wanted:
        score_refusals(data)
    if not wanted or "drift" in wanted:
        score_drift(data)
    if not wanted or "cost" in wanted:
        score_cost(data)


if __name__ == "__main__":
    main()
