"""Is the sigma of a region's nearest range honest, and the range free of bias? Rendered rooms with exact truth.

    python benchmarks/region_sigma.py                     # 10 rooms with even seeds, 10 with odd ones: minutes
    python benchmarks/region_sigma.py --rooms 4 --preset accurate

Each room holds six boxes of random size, place and turn, some corner-on, with noise and a tenth less light in the right
camera; each of its three views is read in twelve random regions in metres (layers over the floor, 0.6 to 9 m away). The
calibration is the true one, so that what is judged is matching and reading. Truth is the nearest range that 30 true
pixels of the slab agree on, as both cameras see it. Left out are regions where 10 or 300 pixels, or 6 cm more on all
sides, would tell another surface: what counts as an obstacle, and what a face of the slab cuts, is not asked here.
"other surface" counts answers more than 5 % off.
"""

from __future__ import annotations

import argparse
import math

import numpy as np
from numpy.typing import NDArray

import epiline as ep
from epiline.sources.rendered import Box, Lamp, RenderedRig, Room, Scene, nearest_supported, seen_by_right, true_aligned
from epiline.sources.rendered.camera import world_from_optical
from epiline.sources.rendered.scene import CARDBOARD, CRATE, GREEN, RED, STEEL

Floats = NDArray[np.float64]
MATERIALS = (RED, CARDBOARD, CRATE, GREEN, STEEL)
VIEWS, REGIONS = 3, 12
FAR_M = 6.0
MARGINS_M = (0.0, 0.06)


def room(seed: int, rng: np.random.Generator) -> Scene:
    boxes = []
    for number in range(6):
        height_m = rng.uniform(0.7, 1.6)
        place = (rng.uniform(1.2, 7.5), rng.uniform(-2.2, 2.2), height_m / 2)
        size = (rng.uniform(0.3, 1), rng.uniform(0.3, 1), height_m)
        boxes.append(Box(f"box {number}", place, size, MATERIALS[number % 5], yaw_rad=rng.uniform(-0.8, 0.8)))
    lamps = (Lamp((1.2, 0.9, 2.7)), Lamp((4.8, -0.9, 2.7)), Lamp((8.6, 0.6, 2.7)))
    return Scene(Room((-3.0, 11.0), (-3.0, 3.0), 3.0), tuple(boxes), lamps, ambient=0.62, seed=seed)


def true_calibration(rig: RenderedRig) -> ep.StereoCalibration:
    left, right = (
        ep.CameraModel(camera.camera_matrix, camera.distortion, width=camera.width, height=camera.height)
        for camera in (rig.truth.left, rig.truth.right)
    )
    return ep.StereoCalibration(left, right, rig.truth.rotation, rig.truth.translation_m)


def random_slabs(rng: np.random.Generator) -> list[ep.Slab]:
    slabs = []
    for _ in range(REGIONS):
        low, middle, half = rng.uniform(0.12, 0.3), rng.uniform(-1.3, 1.3), rng.uniform(0.2, 1.0)
        layer = (low, low + rng.uniform(0.2, 1.2))
        slabs.append(ep.Slab(height_m=layer, range_m=(0.6, 9.0), lateral_m=(middle - half, middle + half)))
    return slabs


def inside(slab: ep.Slab, axes: tuple[Floats, ...], margin_m: float) -> NDArray[np.bool_]:
    """Which pixels see a point of the slab, made larger on all sides."""
    limits = (slab.height_m, slab.range_m, slab.lateral_m)
    parts = [(v > low - margin_m) & (v < high + margin_m) for v, (low, high) in zip(axes, limits, strict=True)]
    return np.asarray(np.all(parts, axis=0))


def measure(seed: int, preset: str) -> list[tuple[float, float, float]]:
    """(range, sigma, true range), m, of every region of a room that can be judged."""
    rng = np.random.default_rng(1000 + seed)
    rig = RenderedRig(seed=seed, scene=room(seed, rng))
    rectifier = ep.Rectifier(true_calibration(rig))
    geometry = rectifier.geometry
    matcher = ep.StereoMatcher(preset=preset, num_disparities=112)  # type: ignore[arg-type]
    found = []
    for number in range(VIEWS):
        pose = world_from_optical((rng.uniform(-1, 0.3), rng.uniform(-0.4, 0.4), 0.5), rng.uniform(-0.15, 0.15))
        pair = rectifier(*rig.photograph(pose, number=number))
        disparity = matcher(pair.left, pair.right, left_valid=pair.left_valid, right_valid=pair.right_valid)
        up = geometry.aligned_from_left @ pose[:3, :3].T @ [0.0, 0.0, 1.0]
        camera = ep.CameraOverGround(pose[2, 3], pitch_rad=math.asin(-up[2]), roll_rad=math.atan2(-up[0], -up[1]))
        right = np.array([math.cos(camera.roll_rad), -math.sin(camera.roll_rad), 0.0])
        view = true_aligned(rig.tracer, pose, geometry)
        points = view.directions * view.depth_m[..., None]
        axes = (camera.height_m + points @ up, view.range_m, points @ right)
        seen = seen_by_right(view, rig.truth, pose) & pair.left_valid
        for slab in random_slabs(rng):
            region = ep.Region.in_space("slab", slab, camera, geometry)
            profile = ep.profile(disparity, [region], geometry=geometry)[0]
            seen_in = {
                margin_m: np.where(inside(slab, axes, margin_m) & seen, view.range_m, np.nan) for margin_m in MARGINS_M
            }
            few, truth, many = (nearest_supported(seen_in[0.0], count) for count in (10, 30, 300))
            around = min(nearest_supported(ranges, 30) for ranges in seen_in.values())
            if many <= 1.03 * min(few, around) and truth < FAR_M and np.isfinite(profile.range_m):
                found.append((profile.range_m, profile.sigma_m, truth))
    return found


def report(name: str, rows: Floats) -> None:
    off = (rows[:, 0] - rows[:, 2]) / rows[:, 2]
    in_sigmas = np.abs(rows[:, 0] - rows[:, 2]) / rows[:, 1]
    near = np.abs(off) < 0.05
    print(
        f"{name:<11} {len(rows):>7} {100 * np.median(off):>+9.2f} {100 * off[near].mean():>+9.2f} "
        f"{100 * (in_sigmas < 1).mean():>9.1f} {100 * (in_sigmas < 2).mean():>9.1f} {(~near).sum():>14}"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description="Honesty of regions' sigma")
    parser.add_argument("--rooms", type=int, default=10, help="of each half")
    parser.add_argument("--preset", default="fast", choices=("fast", "balanced", "accurate"))
    args = parser.parse_args()
    rooms = [measure(seed, args.preset) for seed in range(2 * args.rooms)]
    halves = {"even rooms": rooms[::2], "odd rooms": rooms[1::2], "all": rooms}
    print(f"{args.preset}, {2 * args.rooms} rooms, ranges up to {FAR_M:g} m")
    print(
        f"{'':<11} {'regions':>7} {'median %':>9} {'mean %':>9} {'1 sigma %':>9} {'2 sigma %':>9} {'other surface':>14}"
    )
    for name, part in halves.items():
        report(name, np.array([row for found in part for row in found]))


if __name__ == "__main__":
    main()
