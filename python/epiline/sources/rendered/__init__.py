"""A rendered stereo rig with exact truth: calibration, disparity, range and obstacles.

Two cameras with lens distortion drive through a textured room, and photograph a chessboard. A small ray-caster of
ours in NumPy: no download, no camera, and every number of the answer is known.
"""

from .camera import BrownCamera, RigTruth, default_rig, world_from_optical
from .path import CameraPath, Waypoint, drive_ahead
from .photograph import Sensor
from .raycast import Tracer
from .rig import BoardView, RenderedFrame, RenderedFrames, RenderedRig
from .scene import Board, Box, Lamp, Pole, Room, Scene, studio, workshop
from .textures import Material
from .truth import (
    ObstacleTruth,
    ViewTruth,
    column_nearest,
    nearest_supported,
    seen_by_right,
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
    "true_depth",
    "true_raw",
    "true_view",
    "workshop",
    "world_from_optical",
]
