"""The rendered rig: two cameras in a world of ours, of which everything is known."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace

import numpy as np

from epiline.sources.base import Frame, Image, Source
from epiline.sources.rendered.board import board_poses
from epiline.sources.rendered.camera import Floats, RigTruth, default_rig, world_from_optical
from epiline.sources.rendered.path import CameraPath, drive_ahead
from epiline.sources.rendered.photograph import Lens, Sensor, render
from epiline.sources.rendered.raycast import Tracer
from epiline.sources.rendered.scene import Board, Scene, studio, workshop

_MIN_SIDE_PX, _MAX_SIDE_PX = 32, 4096
# Streams of random numbers that must not share their numbers.
_SCENE_NOISE, _BOARD_NOISE, _BOARD_POSES = 1, 2, 3


@dataclass(frozen=True)
class RenderedFrame(Frame):
    """A frame and where it was taken.

    Attributes
    ----------
    world_from_left : (4, 4) float64
        Pose of the raw left camera.
    """

    world_from_left: Floats


@dataclass(frozen=True)
class BoardView:
    """A photograph of the chessboard by both cameras, and the truth of it.

    Attributes
    ----------
    left, right : (H, W, 3) uint8
        The images.
    left_px, right_px : (N, 2) float64
        Where the inner corners are, row by row.
    board_m : (N, 3) float64
        The same corners in the board's frame.
    left_from_board : (4, 4) float64
        Pose of the board.
    """

    left: Image
    right: Image
    left_px: Floats
    right_px: Floats
    board_m: Floats
    left_from_board: Floats


class RenderedRig:
    """A stereo rig in a rendered world.

    Parameters
    ----------
    seed : int
        Textures, noise and board poses; the same seed gives the same pixels.
    size : (width, height)
        Of both images, pixels; the lenses scale with the width.
    scene : Scene, optional
        The world; a workshop with boxes and poles if not given.
    path : CameraPath, optional
        The drive; a gentle one through the workshop if not given.
    truth : RigTruth, optional
        The cameras; `default_rig` of the size if not given.
    left_sensor, right_sensor : Sensor
        Noise, blur and exposure; the right camera exposes a tenth less.

    Attributes
    ----------
    truth : RigTruth
        What a calibration should find.
    scene : Scene
        What stands in the world.
    tracer : Tracer
        The scene made ready for rays: pass it to `true_depth` instead of the scene to save the preparation.
    """

    def __init__(
        self,
        *,
        seed: int = 0,
        size: tuple[int, int] = (640, 480),
        scene: Scene | None = None,
        path: CameraPath | None = None,
        truth: RigTruth | None = None,
        left_sensor: Sensor | None = None,
        right_sensor: Sensor | None = None,
    ) -> None:
        if not all(_MIN_SIDE_PX <= side <= _MAX_SIDE_PX for side in size):
            raise ValueError(f"size is {size[0]}x{size[1]} px: each side is {_MIN_SIDE_PX} to {_MAX_SIDE_PX} px")
        self.seed = seed
        self.truth = default_rig(*size) if truth is None else truth
        if self.truth.image_size != tuple(size):
            raise ValueError(f"size is {size}, the cameras given have {self.truth.image_size}")
        self.scene = workshop(seed) if scene is None else scene
        self.path = drive_ahead() if path is None else path
        self.left_sensor = Sensor() if left_sensor is None else left_sensor
        self.right_sensor = replace(self.left_sensor, gain=0.9) if right_sensor is None else right_sensor
        self.tracer = Tracer(self.scene)
        self._lenses = Lens(self.truth.left), Lens(self.truth.right)

    def frames(self, count: int) -> RenderedFrames:
        """A source of `count` frames, spread evenly in time over the path."""
        return RenderedFrames(self, count)

    def photograph(self, world_from_left: Floats, *, number: int = 0) -> tuple[Image, Image]:
        """Left and right image (H, W, 3) uint8 from a pose; `number` picks the noise."""
        return self._pair(self.tracer, world_from_left, (_SCENE_NOISE, number))

    def board_views(
        self, board_columns: int = 9, board_rows: int = 6, square_m: float = 0.04, count: int = 18
    ) -> Iterator[BoardView]:
        """Photographs of a chessboard of `board_columns` x `board_rows` inner corners, one after the other.

        Raises ValueError for a board without corners or one that does not fit into both images.
        """
        if board_columns < 2 or board_rows < 2 or not (np.isfinite(square_m) and square_m > 0):
            raise ValueError(f"a board of {board_columns}x{board_rows} corners of {square_m} m is none")
        # The rig stands level at the middle of the studio's floor plan.
        world_from_left = world_from_optical((0.0, 0.0, 15.0 * square_m * max(board_columns, board_rows) / 6), 0.0)
        flat = Board(board_columns, board_rows, square_m, np.eye(4))
        poses = board_poses(self.truth, flat, count, np.random.default_rng([self.seed, _BOARD_POSES]))
        return self._photograph_boards(flat, world_from_left, poses)

    def _photograph_boards(self, flat: Board, world_from_left: Floats, poses: list[Floats]) -> Iterator[BoardView]:
        corners = flat.corners_m
        for number, left_from_board in enumerate(poses):
            board = replace(flat, world_from_board=world_from_left @ left_from_board)
            left, right = self._pair(Tracer(studio(board, self.seed)), world_from_left, (_BOARD_NOISE, number))
            seen = corners @ left_from_board[:3, :3].T + left_from_board[:3, 3]
            yield BoardView(
                left,
                right,
                self.truth.left.project(seen),
                self.truth.right.project(self.truth.right_from_left(seen)),
                corners,
                left_from_board,
            )

    def _pair(self, tracer: Tracer, world_from_left: Floats, stream: tuple[int, int]) -> tuple[Image, Image]:
        poses = world_from_left, world_from_left @ self.truth.left_from_right
        sensors = self.left_sensor, self.right_sensor

        def one(side: int) -> Image:
            radiance = render(tracer, self._lenses[side], poses[side])
            return sensors[side].expose(radiance, np.random.default_rng([self.seed, *stream, side]))

        # NumPy lets go of the interpreter in its loops: two threads take little more than half the time.
        with ThreadPoolExecutor(2) as pool:
            left, right = pool.map(one, (0, 1))
        return left, right


class RenderedFrames(Source):
    """The rendered rig's drive as a source; every frame is a :class:`RenderedFrame`."""

    def __init__(self, rig: RenderedRig, count: int) -> None:
        if count < 1:
            raise ValueError(f"count is {count}: at least 1 frame")
        self.rig = rig
        self._count = count

    @property
    def size(self) -> tuple[int, int]:
        return self.rig.truth.image_size

    @property
    def length(self) -> int:
        return self._count

    def __iter__(self) -> Iterator[RenderedFrame]:
        for seq in range(self._count):
            elapsed_s = self.rig.path.duration_s * seq / max(self._count - 1, 1)
            pose = self.rig.path.world_from_left(elapsed_s)
            left, right = self.rig.photograph(pose, number=seq)
            stamp = round(elapsed_s * 1e9)
            yield RenderedFrame(left, right, seq, stamp, stamp, f"demo {seq}", pose)
