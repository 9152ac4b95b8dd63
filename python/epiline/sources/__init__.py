"""Where stereo pairs come from: image files, videos, and a rendered rig with exact truth.

:func:`open_source` understands what a person writes; every source gives :class:`Frame` objects.
"""

from epiline.sources.base import Frame, Image, Source
from epiline.sources.files import ImagePairs, SideBySideImages
from epiline.sources.opening import open_source
from epiline.sources.pairing import ImagePair, Pairing, pair_lists, pair_mixed, pair_names
from epiline.sources.videos import SideBySideVideo, TwoVideos

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
]
