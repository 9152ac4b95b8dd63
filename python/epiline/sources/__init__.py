"""Where stereo pairs come from: image files, videos, and a rendered rig with exact truth.

:func:`open_source` understands what a person writes; every source gives :class:`Frame` objects.
"""

from .base import Frame, Image, Source
from .files import ImagePairs, SideBySideImages
from .images import read_image
from .opening import open_source
from .pairing import ImagePair, Pairing, pair_lists, pair_mixed, pair_names
from .videos import SideBySideVideo, TwoVideos

__all__ = [
    "Frame",
    "Image",
    "ImagePair",
    "ImagePairs",
    "Pairing",
    "SideBySideImages",
    "SideBySideVideo",
    "Source",
    "TwoVideos",
    "open_source",
    "pair_lists",
    "pair_mixed",
    "pair_names",
    "read_image",
]
