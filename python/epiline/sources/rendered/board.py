"""How the chessboard is held in front of the rig: many poses, each wholly inside both images."""

from __future__ import annotations

import numpy as np

from epiline.sources.rendered.camera import Floats, RigTruth, rotation_xyz
from epiline.sources.rendered.scene import Board

# Where in the image the board's middle goes, shares of its width and height; the first ones already span the image.
_PLACES = (
    (0.50, 0.50), (0.24, 0.26), (0.76, 0.74), (0.76, 0.26), (0.24, 0.74), (0.50, 0.20), (0.50, 0.80),
    (0.20, 0.50), (0.80, 0.50), (0.38, 0.36), (0.62, 0.64), (0.62, 0.36), (0.38, 0.64),
)  # fmt: skip
_MARGIN_PX = 4.0
_ATTEMPTS = 200


def board_poses(rig: RigTruth, board: Board, count: int, rng: np.random.Generator) -> list[Floats]:
    """Poses (4, 4), left camera from board: tilted up to 38°, near and far, all over the image.

    Raises ValueError where no pose keeps the whole card inside both images.
    """
    return [_pose(rig, board, i, rng) for i in range(count)]


def _pose(rig: RigTruth, board: Board, index: int, rng: np.random.Generator) -> Floats:
    x0, x1, y0, y1 = board.card_m
    middle = np.array([(x0 + x1) / 2, (y0 + y1) / 2, 0.0])
    width, height = rig.image_size
    # Share of the image's width that the card takes when held straight: every third view is a near one.
    share = (0.62, 0.44, 0.52)[index % 3] * rng.uniform(0.92, 1.08)
    distance = max((x1 - x0) * rig.left.fx / (share * width), (y1 - y0) * rig.left.fy / (share * 1.1 * height))
    # Tilt directions go round by the golden angle, so that any number of views spreads evenly.
    toward = index * np.pi * (3 - np.sqrt(5)) + rng.uniform(-0.2, 0.2)
    tilt = np.deg2rad(rng.uniform(16, 38)) if index else np.deg2rad(4.0)
    rotation = _about((np.cos(toward), np.sin(toward)), tilt) @ rotation_xyz(0, 0, np.deg2rad(rng.uniform(-14, 14)))
    place = np.array(_PLACES[index % len(_PLACES)])
    corners = np.array([[x, y, 0.0] for x in (x0, x1) for y in (y0, y1)])
    for _ in range(_ATTEMPTS):
        ray = rig.left.rays(place * [width - 1, height - 1])
        pose = np.eye(4)
        pose[:3, :3] = rotation
        pose[:3, 3] = ray * distance - rotation @ middle
        seen = corners @ rotation.T + pose[:3, 3]
        if _inside(rig.left.project(seen), rig.image_size) and _inside(
            rig.right.project(rig.right_from_left(seen)), rig.image_size
        ):
            return pose
        place += 0.06 * (0.5 - place)
        distance *= 1.015
    raise ValueError(
        f"a board of {board.columns}x{board.rows} corners of {board.square_m} m does not fit into both images"
    )


def _inside(pixels: Floats, size: tuple[int, int]) -> bool:
    limit = np.array(size) - 1 - _MARGIN_PX
    return bool(((pixels >= _MARGIN_PX) & (pixels <= limit)).all())


def _about(axis_xy: tuple[float, float], angle_rad: float) -> Floats:
    """The rotation about an axis in the image plane (Rodrigues)."""
    x, y = axis_xy
    cross = np.array([[0, 0, y], [0, 0, -x], [-y, x, 0]])
    return np.asarray(np.eye(3) + np.sin(angle_rad) * cross + (1 - np.cos(angle_rad)) * cross @ cross, float)
