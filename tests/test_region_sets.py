"""Named sets of regions in TOML files, and their graphs as pictures."""

from __future__ import annotations

import math
import re
import xml.etree.ElementTree as ET
from pathlib import Path

import cv2
import numpy as np
import pytest

import epiline as ep

TEXT = """
[camera]
height_m = 0.6
pitch_deg = 10

[regions]
bands = "paper"

[[regions.corridor]]
name = "ahead"
x = 10
y = 100
width = 120
height = 30
range_m = [0.5, inf]

[[regions.corridor]]
name = "left half"
shares = [0, 0.5, 0.5, 0.25]
disparities = [3, 20]

[[regions.corridor]]
name = "kerbs"
height_m = [0.04, 0.3]
range_m = [1.0, 3.0]
lateral_m = [-0.5, 0.5]
"""


@pytest.fixture
def geometry() -> ep.RectifiedGeometry:
    return ep.RectifiedGeometry(width=320, height=240, focal_px=260, cx_px=161, cy_px=118, baseline_m=0.12)


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "regions.toml"
    path.write_text(TEXT)
    return path


def test_sets_are_placed_in_pixels_shares_and_metres(file: Path, geometry: ep.RectifiedGeometry) -> None:
    ahead, half, kerbs = ep.read_regions(file, "corridor", geometry=geometry)
    assert ahead == ep.Region("ahead", x=10, y=100, width=120, height=30, range_m=(0.5, math.inf))
    assert half == ep.Region("left half", x=0, y=120, width=160, height=60, disparities=(3, 20))
    slab = ep.Slab(height_m=(0.04, 0.3), range_m=(1, 3), lateral_m=(-0.5, 0.5))
    camera = ep.CameraOverGround(0.6, pitch_rad=math.radians(10))
    assert kerbs == ep.Region.in_space("kerbs", slab, camera, geometry)
    assert (kerbs.slab, kerbs.camera) == (slab, camera)
    assert ep.read_regions(file, "bands", image_size=(320, 240)) == ep.paper_regions(320, 240)
    # A camera that was measured counts more than what the file says.
    higher = ep.CameraOverGround(1.5)
    assert ep.read_regions(file, "corridor", geometry=geometry, camera=higher)[2].camera == higher


def test_a_slab_is_where_its_corners_are_seen(geometry: ep.RectifiedGeometry) -> None:
    """A slab that is nearly a point, by the pinhole equations written out."""
    pitch, roll, height = 0.25, -0.1, 0.8
    x, y, z = 0.3, 0.1, 2.0
    up = -np.array([math.cos(pitch) * math.sin(roll), math.cos(pitch) * math.cos(roll), math.sin(pitch)])
    right = np.array([math.cos(roll), -math.sin(roll), 0])
    point = np.array([x, y, z])
    above, aside, away = height + up @ point, right @ point, np.linalg.norm(point)
    small = 1e-4
    slab = ep.Slab(
        height_m=(above - small, above + small),
        range_m=(away - small, away + small),
        lateral_m=(aside - small, aside + small),
    )
    camera = ep.CameraOverGround(height, pitch_rad=pitch, roll_rad=roll)
    region = ep.Region.in_space("point", slab, camera, geometry)
    column, row, disparity = 161 + 260 * x / z, 118 + 260 * y / z, 260 * 0.12 / z
    assert region.x <= round(column) < region.x + region.width <= round(column) + 3
    assert region.y <= round(row) < region.y + region.height <= round(row) + 3
    assert region.disparities is not None
    first, count = region.disparities
    assert first <= disparity <= first + count - 1
    assert count <= 5


@pytest.mark.parametrize(
    ("old", "new", "complaint"),
    [
        ("x = 10", "x = -10", "set 'corridor': region 1 'ahead': x = -10 is not a whole number of pixels"),
        ("x = 10", "x = true", "x = True is not a whole number"),
        ("x = 10", "", "region 1 'ahead': must have exactly one of"),
        ("x = 10", "x = 10\nshares = [0, 0, 1, 1]", "must have exactly one of"),
        ("x = 10", "x = 10\nwight = 3", "wight is unknown"),
        ("[0, 0.5, 0.5, 0.25]", "[0, 0.5, 0.5]", "shares = [0, 0.5, 0.5] are not four numbers"),
        ("[0, 0.5, 0.5, 0.25]", "[0, 0.9, 0.5, 0.25]", "y + height = 0.9 + 0.25 of region 'left half'"),
        ("[3, 20]", "[3, -1]", "disparities = [3, -1]"),
        ("[0.04, 0.3]", "[0.3, 0.04]", "region 3 'kerbs': height_m = (0.3, 0.04) m"),
        ("[0.04, 0.3]", "[nan, 0.04]", "height_m = [nan, 0.04] are not two numbers of metres"),
        ("[0.04, 0.3]", "[8, 9]", "no pixel sees it"),
        ("height_m = 0.6", "height_m = -1", "camera: camera height_m = -1 m"),
        ("pitch_deg = 10", "pitch = 10", "camera.pitch is unknown"),
        ("pitch_deg = 10", "pitch_deg = 'down'", "camera.pitch_deg = 'down' is not a number of degrees"),
        ('name = "kerbs"', 'name = "ahead"', "there is already a region 'ahead'"),
        ('name = "kerbs"', "name = 3", "region 3: must be a table with a name"),
        ('bands = "paper"', "bands = 4", "set 'bands' = 4: must be a list of regions"),
        ("[camera]", "[camera", "regions.toml"),
    ],
)
def test_mistakes_are_named(file: Path, geometry: ep.RectifiedGeometry, old: str, new: str, complaint: str) -> None:
    assert old in TEXT
    file.write_text(TEXT.replace(old, new, 1))
    with pytest.raises(ValueError, match=re.escape(complaint)) as caught:
        ep.read_regions(file, "corridor", geometry=geometry)
    assert "regions.toml" in str(caught.value)


def test_what_a_set_needs_is_said(file: Path, geometry: ep.RectifiedGeometry, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"several sets of regions; choose one of bands, corridor"):
        ep.read_regions(file)
    with pytest.raises(ValueError, match="no set of regions 'corridors'"):
        ep.read_regions(file, "corridors")
    with pytest.raises(ValueError, match="'left half': needs the image's size"):
        ep.read_regions(file, "corridor")
    with pytest.raises(ValueError, match="'kerbs': needs the geometry of a rig"):
        ep.read_regions(file, "corridor", image_size=(320, 240))
    file.write_text(TEXT.replace("[camera]", "[other]"))
    with pytest.raises(ValueError, match=r"'kerbs': needs a \[camera\]"):
        ep.read_regions(file, "corridor", geometry=geometry)
    with pytest.raises(FileNotFoundError):
        ep.read_region_sets(tmp_path / "none.toml")
    file.write_text("")
    with pytest.raises(ValueError, match=r"has no \[regions\]"):
        ep.read_region_sets(file)


# ---- pictures ----------------------------------------------------------------------------------


@pytest.fixture
def profile(geometry: ep.RectifiedGeometry) -> ep.RegionProfile:
    """A step from 8 to 20 px with a gap of unknown columns, 100 to 139."""
    raw = np.full((240, 320), 8 * 16, np.uint16)
    raw[:, 160:] = 20 * 16
    validity = np.zeros((240, 320), np.uint8)
    validity[:, 100:140] = 16
    disparity = ep.DisparityMap(raw, validity, num_disparities=32)
    return ep.profile(disparity, [ep.Region("a < b", x=0, y=50, width=320, height=30)], geometry=geometry)[0]


@pytest.mark.parametrize("quantity", ["disparity", "range"])
def test_svg_profiles_stand_alone_and_leave_gaps(profile: ep.RegionProfile, tmp_path: Path, quantity: str) -> None:
    path = tmp_path / "p.svg"
    ep.write_profile(profile, path, quantity=quantity)  # type: ignore[arg-type]
    root = ET.fromstring(path.read_text())
    space = "{http://www.w3.org/2000/svg}"
    assert root.tag == f"{space}svg"
    texts = [element.text for element in root.iter(f"{space}text")]
    assert "column, px" in texts
    assert ("disparity, px" if quantity == "disparity" else "range, m") in texts
    assert "var(" not in path.read_text(), "colours of a page that is not there"
    nearest = next(e for e in root.iter(f"{space}path") if e.get("class") in ("line c0", "line c2")).get("d")
    assert nearest is not None
    assert nearest.count("M") == 2, "two stretches with a gap between them"


def test_png_profiles_show_the_step_and_the_gap(profile: ep.RegionProfile, tmp_path: Path) -> None:
    path = tmp_path / "p.png"
    ep.write_profile(profile, path)
    picture = cv2.imread(str(path))
    assert picture is not None
    assert picture.shape == (360, 960, 3)
    blue = (np.abs(picture.astype(int) - (210, 105, 23)).sum(axis=2) < 60)[45:305, 80:936]
    columns = np.flatnonzero(blue.any(axis=0)) / 856 * 320
    assert not ((columns > 102) & (columns < 138)).any(), "unknown columns are a gap"
    rows = np.array([np.flatnonzero(blue[:, int(x / 320 * 856)]).mean() for x in (50, 150, 250)])
    assert rows[0] == pytest.approx(rows[1], abs=2)
    assert rows[2] < rows[0] - 100, "nearer is higher"
    ep.write_profile(profile, path, quantity="range")
    assert cv2.imread(str(path)) is not None


def test_profiles_refuse_what_they_cannot_draw(profile: ep.RegionProfile, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"'\.gif' is no format"):
        ep.write_profile(profile, tmp_path / "p.gif")
    with pytest.raises(ValueError, match="quantity = 'depth'"):
        ep.write_profile(profile, tmp_path / "p.svg", quantity="depth")  # type: ignore[arg-type]
    flat = ep.DisparityMap(np.zeros((10, 10), np.uint16), np.ones((10, 10), np.uint8))
    empty = ep.profile(flat, [ep.Region("nothing", x=0, y=0, width=1, height=10)])[0]
    with pytest.raises(ValueError, match="'nothing' was read without geometry"):
        ep.write_profile(empty, tmp_path / "p.svg", quantity="range")
    for suffix in ("svg", "png"):
        ep.write_profile(empty, tmp_path / f"p.{suffix}")
    with pytest.raises(OSError, match="none"):
        ep.write_profile(profile, tmp_path / "none" / "p.svg")
