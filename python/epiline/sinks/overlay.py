"""What a frame's result looks like: tracks on the left view, and the scan from above beside it."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import TypeAlias

import cv2
import numpy as np
from numpy.typing import NDArray

from epiline._core import Scan, Track

Image: TypeAlias = NDArray[np.uint8]
Colour: TypeAlias = tuple[int, int, int]
Floats: TypeAlias = NDArray[np.float64]
ToPixels: TypeAlias = Callable[[Floats, Floats], NDArray[np.int32]]

_FREE, _UNKNOWN, _OUTSIDE, _OBSTACLE = (96, 150, 70), (70, 66, 66), (38, 35, 35), (70, 80, 250)
_RINGS, _INK = (120, 116, 116), (235, 235, 235)
_FONT, _TEXT_SCALE = cv2.FONT_HERSHEY_SIMPLEX, 0.38
_SECONDS_AHEAD = 1.0
"""An arrow ends where its track will be then."""
_SIGMAS = 2.0
"""Size of a track's ellipse."""


def picture_of(left: Image, tracks: Sequence[Track], scan: Scan | None, *, caption: str = "") -> Image:
    """The left view with its confirmed tracks, and beside it, if there is a scan, the view from above.

    Parameters
    ----------
    left : (H, W) or (H, W, 3) uint8
        The aligned left image; three channels are blue, green, red.
    tracks : sequence of Track
        Those not confirmed, and those not seen in this frame, are left out.
    scan : Scan or None
        Green is free, grey unknown, red an obstacle.
    caption : str
        Written into the upper left corner.

    Returns
    -------
    (H, W', 3) uint8
    """
    picture: Image = np.repeat(left[:, :, None], 3, axis=2) if left.ndim == 2 else left.copy()
    seen = sorted((track for track in tracks if track.confirmed and not track.misses), key=lambda track: track.range_m)
    for track in reversed(seen):
        x, y, width, height = track.box
        cv2.rectangle(picture, (x, y), (x + width - 1, y + height - 1), colour_of(track.id), 2)
    labels = _Labels(picture)
    for track in seen:
        labels.put(track)
    if caption:
        _write(picture, caption, (8, 18), _INK)
    if scan is not None:
        picture = np.hstack([picture, top_view(scan, seen, side_px=picture.shape[0])])
    return picture


def colour_of(identity: int) -> Colour:
    """A colour that stays with a track; neighbouring ids are far apart in hue."""
    hue = int(identity * 0.618034 * 180) % 180
    bgr = cv2.cvtColor(np.array([[[hue, 190, 255]]], np.uint8), cv2.COLOR_HSV2BGR)[0, 0]
    return int(bgr[0]), int(bgr[1]), int(bgr[2])


class _Labels:
    """Id, range with sigma, and speed of tracks, the nearest first; what finds no place is left out."""

    def __init__(self, picture: Image) -> None:
        self._picture = picture
        self._taken: list[tuple[int, int, int, int]] = []

    def put(self, track: Track) -> None:
        """Above its box, below it, or else inside."""
        right_mps, forward_mps = track.velocity_mps
        text = f"{track.id}: {track.range_m:.1f}+-{track.sigma_m:.2f}m {math.hypot(right_mps, forward_mps):.1f}m/s"
        (width, height), _ = cv2.getTextSize(text, _FONT, _TEXT_SCALE, 1)
        rows, columns = self._picture.shape[:2]
        x = max(0, min(track.box[0], columns - width))
        top, bottom = track.box[1], track.box[1] + track.box[3]
        for y in (top - 5, bottom + height + 5, top + height + 5):
            if height <= y < rows and self._is_free(x, y - height, width, height):
                self._taken.append((x, y - height, width, height))
                _write(self._picture, text, (x, y), colour_of(track.id))
                return

    def _is_free(self, x: int, y: int, width: int, height: int) -> bool:
        return not any(
            x < left + wide and left < x + width and y < top + high + 2 and top < y + height + 2
            for left, top, wide, high in self._taken
        )


def _write(picture: Image, text: str, at: tuple[int, int], colour: Colour) -> None:
    cv2.putText(picture, text, at, _FONT, _TEXT_SCALE, (0, 0, 0), 3, cv2.LINE_AA)
    cv2.putText(picture, text, at, _FONT, _TEXT_SCALE, colour, 1, cv2.LINE_AA)


def top_view(scan: Scan, tracks: Sequence[Track], *, side_px: int) -> Image:
    """The floor from above, the camera at the middle of the lower edge, ahead is up.

    Parameters
    ----------
    scan : Scan
        Angles count from straight up, counter-clockwise.
    tracks : sequence of Track
        Drawn as ellipses of two standard deviations, with an arrow to where they will be in a second. They are in the
        camera's frame: with a camera that is turned on its robot they stand turned against the scan.
    side_px : int
        Height of the picture; it is three quarters as wide.

    Returns
    -------
    (side_px, W, 3) uint8
    """
    width = 3 * side_px // 4
    view = np.full((side_px, width, 3), _OUTSIDE, np.uint8)
    px_per_m = (side_px - 24) / scan.max_range_m
    foot = np.array([width / 2, side_px - 12.0])

    def at(angle_rad: Floats, range_m: Floats) -> NDArray[np.int32]:
        off = np.stack([-np.sin(angle_rad), -np.cos(angle_rad)], axis=-1) * range_m[..., None]
        return np.rint(foot + px_per_m * off).astype(np.int32)

    angles = np.asarray(scan.angle_rad, np.float64)
    if angles.size:
        whole = np.full(angles.shape, scan.max_range_m)
        cv2.fillPoly(view, [np.vstack([np.rint(foot).astype(np.int32)[None], at(angles, whole)])], _UNKNOWN)
    _draw_free(view, at, scan)
    _draw_rings(view, foot, px_per_m, scan.max_range_m)
    nearest = np.asarray(scan.nearest_m, np.float64)
    seen = np.isfinite(nearest)
    for x, y in at(angles[seen], nearest[seen]):
        cv2.circle(view, (int(x), int(y)), 1, _OBSTACLE, -1)
    for track in tracks:
        _draw_track(view, track, foot, px_per_m)
    return view


def _draw_free(view: Image, at: ToPixels, scan: Scan) -> None:
    angles = np.asarray(scan.angle_rad, np.float64)
    begin, end = (np.asarray(values, np.float64) for values in (scan.free_from_m, scan.free_to_m))
    free = np.isfinite(begin) & np.isfinite(end)
    # A wedge per direction: half a step to either side.
    half = 0.5 * np.gradient(angles) if angles.size > 1 else np.zeros_like(angles)
    for i in np.flatnonzero(free):
        edges = np.array([angles[i] - half[i], angles[i] + half[i]])
        corners = np.vstack([at(edges, np.full(2, begin[i])), at(edges[::-1], np.full(2, end[i]))])
        cv2.fillPoly(view, [corners], _FREE)


def _draw_rings(view: Image, foot: Floats, px_per_m: float, max_range_m: float) -> None:
    step = 10.0 ** math.floor(math.log10(max_range_m))
    step = next(s for s in (step / 5, step / 2, step, step * 2) if max_range_m / s <= 6)
    centre = (int(foot[0]), int(foot[1]))
    for k in range(1, int(max_range_m / step + 1e-6) + 1):
        radius = round(k * step * px_per_m)
        cv2.ellipse(view, centre, (radius, radius), 0, 180, 360, _RINGS, 1, cv2.LINE_AA)
        _write(view, f"{k * step:g} m", (centre[0] + 3, centre[1] - radius - 3), _RINGS)


def _draw_track(view: Image, track: Track, foot: Floats, px_per_m: float) -> None:
    colour = colour_of(track.id)

    def at(position_m: Floats) -> tuple[int, int]:
        x, y = np.rint(foot + px_per_m * np.array([position_m[0], -position_m[1]])).astype(int)
        return int(x), int(y)

    position, velocity = np.array(track.position_m), np.array(track.velocity_mps)
    values, vectors = np.linalg.eigh(np.asarray(track.covariance)[:2, :2])
    axes = np.maximum(1, np.rint(_SIGMAS * px_per_m * np.sqrt(np.maximum(values, 0)))).astype(int)
    # Down the picture is against z.
    angle = math.degrees(math.atan2(-vectors[1, 0], vectors[0, 0]))
    cv2.ellipse(view, at(position), (int(axes[0]), int(axes[1])), angle, 0, 360, colour, 1, cv2.LINE_AA)
    cv2.arrowedLine(view, at(position), at(position + _SECONDS_AHEAD * velocity), colour, 1, cv2.LINE_AA)
    x, y = at(position)
    _write(view, str(track.id), (x + 5, y - 3), colour)
