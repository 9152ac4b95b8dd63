"""What one could run into in a rendered frame, pixel by pixel, and which of it an obstacle finder is asked for."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from epiline._core import RectifiedGeometry
from epiline.sources.rendered import ViewTruth, nearest_supported
from epiline.sources.rendered.scene import ROOM_SIDES

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]

# Lower than this above the floor nothing stands in the way.
CLEARANCE_M = 0.03
# Pixels that make a nearest range: the rule of `nearest_supported`.
SUPPORT_PX = 8
_FLOOR, _CEILING = ROOM_SIDES.index("floor"), ROOM_SIDES.index("ceiling")
NOTHING = -1
# Columns beside something nearer that a window shows together with it, and how much nearer: a share of the depth.
BESIDE_PX, NEARER_SHARE = 4, 0.1


@dataclass(frozen=True)
class Asked:
    """An obstacle that must be found.

    Attributes
    ----------
    object_id : int
    name : str
    range_m, depth_m : float
        Euclidean and Z, of its nearest supported part that both cameras see.
    columns : (first, last)
        Of what both cameras see.
    pixels : int
        That both cameras see.
    """

    object_id: int
    name: str
    range_m: float
    depth_m: float
    columns: tuple[int, int]
    pixels: int


@dataclass(frozen=True)
class FrameTruth:
    """The left aligned image of a frame.

    Attributes
    ----------
    range_m, depth_m, lateral_m, height_m : (H, W) float64
        Euclidean distance, Z and X of what each pixel shows, and its height over the floor.
    standing : (H, W) int16
        Id of the wall or solid there, `NOTHING` on floor, ceiling and what is driven on.
    seen : (H, W) bool
        What both cameras see, within the disparities searched.
    names : tuple of str
        By id.
    solids : frozenset of int
        The ids that are asked for: walls and decoration are not.
    """

    range_m: Floats
    depth_m: Floats
    lateral_m: Floats
    height_m: Floats
    standing: NDArray[np.int16]
    seen: Flags
    names: tuple[str, ...]
    solids: frozenset[int]

    def is_clear(self, half_width_m: float, reach_m: float) -> bool:
        """Whether nothing stands in a corridor straight ahead."""
        inside = (np.abs(self.lateral_m) <= half_width_m) & (self.depth_m <= reach_m)
        return not (inside & (self.standing != NOTHING)).any()

    @cached_property
    def visible(self) -> NDArray[np.int16]:
        """`standing` where both cameras see it."""
        return np.where(self.seen, self.standing, np.int16(NOTHING))

    @cached_property
    def beside_nearer(self) -> Flags:
        """(H, W): within `BESIDE_PX` columns of something nearer by `NEARER_SHARE`."""
        padded = np.pad(self.depth_m, ((0, 0), (BESIDE_PX, BESIDE_PX)), constant_values=np.inf)
        nearest = np.lib.stride_tricks.sliding_window_view(padded, 2 * BESIDE_PX + 1, axis=1).min(axis=-1)
        return np.asarray(nearest < (1 - NEARER_SHARE) * self.depth_m, bool)

    def asked(self, *, reach_m: float, min_pixels: int, min_side_px: float) -> list[Asked]:
        """The solids within reach of which enough is seen, nearest first.

        Enough is `min_pixels`, and `min_side_px` both in the median row and in the median column, of what is not
        right beside something nearer: of a thing that shows as a sliver behind another's edge nothing is asked.
        """
        found = []
        for object_id in sorted(self.solids):
            here = self.visible == object_id
            clear = here & ~self.beside_nearer
            pixels = int(here.sum())
            if clear.sum() < max(min_pixels, 1) or min(_median_count(clear, 0), _median_count(clear, 1)) < min_side_px:
                continue
            range_m = nearest_supported(self.range_m[here], SUPPORT_PX)
            if range_m <= reach_m:
                columns = np.flatnonzero(here.any(axis=0))
                found.append(
                    Asked(
                        object_id=object_id,
                        name=self.names[object_id],
                        range_m=range_m,
                        depth_m=nearest_supported(self.depth_m[here], SUPPORT_PX),
                        columns=(int(columns[0]), int(columns[-1])),
                        pixels=pixels,
                    )
                )
        return sorted(found, key=lambda asked: asked.range_m)


def _median_count(flags: Flags, axis: int) -> float:
    counts = flags.sum(axis=axis)
    return float(np.median(counts[counts > 0]))


def frame_truth(
    view: ViewTruth,
    geometry: RectifiedGeometry,
    *,
    valid: tuple[Flags, Flags],
    num_disparities: int,
    ground: frozenset[str] = frozenset(),
) -> FrameTruth:
    """The truth of an aligned view.

    Parameters
    ----------
    view : ViewTruth
        Of the aligned left image.
    geometry : RectifiedGeometry
    valid : pair of (H, W) bool
        Pixels of the aligned left and right image that have a source.
    num_disparities : int
        Nearer than the largest of them nothing is asked for.
    ground : frozenset of str
        Solids that are driven on.
    """
    names = view.scene.names
    ids = view.object_id
    standing = (ids != _FLOOR) & (ids != _CEILING) & (view.points_world_m[..., 2] > CLEARANCE_M)
    for number, name in enumerate(names):
        if name in ground:
            standing &= ids != number
    disparity = view.disparity_px(geometry.focal_px, geometry.baseline_m, geometry.doffs_px)
    return FrameTruth(
        range_m=view.range_m,
        depth_m=view.depth_m,
        lateral_m=np.asarray(view.directions[..., 0] * view.depth_m, float),
        height_m=view.points_world_m[..., 2],
        standing=np.where(standing, ids, np.int16(NOTHING)).astype(np.int16),
        seen=valid[0] & (disparity <= num_disparities - 1) & seen_by_both(disparity, valid[1]),
        names=names,
        solids=frozenset(i for i in view.scene.obstacle_ids if names[i] not in ground),
    )


def seen_by_both(disparity_px: Floats, right_valid: Flags) -> Flags:
    """(H, W): whose partner lies inside the right image, has a source, and is not hidden by a nearer surface.

    A right pixel shows the nearest of the left pixels that fall onto it (a z-buffer of the left truth).
    """
    height, width = disparity_px.shape
    partner = np.rint(np.arange(width) - disparity_px).astype(int)
    inside = (partner >= 0) & (partner < width)
    rows = np.broadcast_to(np.arange(height)[:, None], partner.shape)
    nearest = np.full((height, width), -np.inf)
    np.maximum.at(nearest, (rows[inside], partner[inside]), disparity_px[inside])
    column = partner.clip(0, width - 1)
    hidden = nearest[rows, column] > disparity_px + 1.0
    return np.asarray(inside & right_valid[rows, column] & ~hidden, bool)
