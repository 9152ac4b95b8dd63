"""A rendered stereo rig with exact truth: calibration, disparity, range and obstacles.

Two cameras with lens distortion drive through a textured room, and photograph a chessboard. A small ray-caster of
ours in NumPy: no download, no camera, and every number of the answer is known.
"""

from epiline.sources.rendered.camera import BrownCamera, RigTruth, default_rig, world_from_optical
from epiline.sources.rendered.path import CameraPath, Waypoint, drive_ahead
from epiline.sources.rendered.photograph import Sensor
from epiline.sources.rendered.raycast import Tracer
from epiline.sources.rendered.rig import BoardView, RenderedFrame, RenderedFrames, RenderedRig
from epiline.sources.rendered.scene import Board, Box, Lamp, Pole, Room, Scene, studio, workshop
from epiline.sources.rendered.textures import Material
from epiline.sources.rendered.truth import (
    ObstacleTruth,
    ViewTruth,
    column_nearest,
    nearest_supported,
    seen_by_right,
    true_aligned,
    true_depth,
    true_raw,
    true_view,
)

__all__ = [
    "Board",
    "BoardView",
    "Box",
    "BrownCamera",
    "CameraPath",
    "Lamp",
    "Material",
    "ObstacleTruth",
    "Pole",
    "RenderedFrame",
    "RenderedFrames",
    "RenderedRig",
    "RigTruth",
    "Room",
    "Scene",
    "Sensor",
    "Tracer",
    "ViewTruth",
    "Waypoint",
    "column_nearest",
    "default_rig",
    "drive_ahead",
    "nearest_supported",
    "seen_by_right",
    "studio",
    "true_aligned",
    "true_depth",
    "true_raw",
    "true_view",
    "workshop",
    "world_from_optical",
]
