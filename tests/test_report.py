"""The report: the page is whole, self-contained and honest; its figures say what the arrays say."""

from __future__ import annotations

import math
import os
import re
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from datetime import datetime, timezone
from html.parser import HTMLParser
from pathlib import Path
from xml.etree import ElementTree

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from epiline import _pictures as pictures
from epiline.report import (
    CalibrationSection,
    FrameRecorder,
    FrameSection,
    FrameTruth,
    Provenance,
    RangeCurveSection,
    RawPair,
    RejectedView,
    RunReport,
    TruthRow,
    charts,
    encode,
    figures,
    numbers,
    reasons,
    render_html,
    write_report,
)
from epiline.report.calibration_view import baseline_sigma_m
from epiline.report.recorder import EvenSample, evenly_chosen, summarize

NAN = math.nan
WIDTH, HEIGHT = 96, 64
HOSTILE = "<script>alert('x')</script>&\"quoted\""


# ---- stand-ins for results of the core ---------------------------------------------------------


@dataclass
class Geometry:
    focal_px: float = 120.0
    baseline_m: float = 0.1
    doffs_px: float = 0.0


@dataclass
class Disparity:
    values: NDArray[np.float32]
    validity: NDArray[np.uint8]


@dataclass
class Region:
    name: str
    x: int
    y: int
    width: int
    height: int


@dataclass
class Profile:
    region: Region
    nearest_px: NDArray[np.float32]
    median_px: NDArray[np.float32]
    minimum_px: NDArray[np.float32]
    maximum_px: NDArray[np.float32]
    nearest_range_m: NDArray[np.float32] | None
    valid_share: float
    minimum: float
    maximum: float
    total: float
    range_m: float
    sigma_m: float


@dataclass
class Obstacle:
    id: int = 1
    region: str = "near"
    box: tuple[int, int, int, int] = (30, 20, 20, 30)
    range_m: float = 1.25
    sigma_m: float = 0.012
    bearing_rad: float = math.radians(-12.34)
    width_m: float = 0.4
    height_m: float = 0.7
    support: int = 321


@dataclass
class Alignment:
    median_px: float
    spread_px: float
    matches: int
    left_px: NDArray[np.float64]
    right_px: NDArray[np.float64]


@dataclass
class Camera:
    camera_matrix: NDArray[np.float64] = field(default_factory=lambda: np.diag([500.0, 501.0, 1.0]))


@dataclass
class Verdict:
    grade: str
    reasons: Sequence[str] = ()


@dataclass
class ViewResidual:
    left_rms_px: float
    right_rms_px: float


@dataclass
class Calibration:
    left: Camera = field(default_factory=Camera)
    right: Camera = field(default_factory=Camera)
    rotation: NDArray[np.float64] = field(default_factory=lambda: np.eye(3))
    translation_m: NDArray[np.float64] = field(default_factory=lambda: np.array([-0.12, 0.002, 0.001]))
    image_size: tuple[int, int] = (640, 480)
    rms_px: float = 0.09
    epipolar_error_px: float = 0.11
    covariance: NDArray[np.float64] | None = None
    sigma: dict[str, float] = field(default_factory=dict)
    views: Sequence[ViewResidual] = ()

    @property
    def baseline_m(self) -> float:
        return float(np.linalg.norm(self.translation_m))

    def range_sigma(self, z_m: float) -> float:
        return 0.001 * z_m**2 if self.covariance is not None else NAN


@dataclass
class Curve:
    a: float = 9.0
    b: float = -0.12
    c: float = 3.1
    d: float = -0.02
    rmse_m: float = 0.04
    r_squared: float = 0.999
    span_px: tuple[float, float] = (6.0, 60.0)

    def predict(self, disparity_px: NDArray[np.float64]) -> NDArray[np.float64]:
        return self.a * np.exp(self.b * disparity_px) + self.c * np.exp(self.d * disparity_px)

    def predict_interval(
        self, disparity_px: NDArray[np.float64], *, confidence: float = 0.95
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        return self.predict(disparity_px) - 0.1, self.predict(disparity_px) + 0.1


PROVENANCE = Provenance(
    command="epiline run scenes",
    started=datetime(2026, 11, 22, 5, 0, tzinfo=timezone.utc),
    version="0.1.0",
    simd_level="avx2",
    machine="a machine, 2 cores",
)


def profile_of(values: NDArray[np.float32], region: Region, geometry: Geometry | None) -> Profile:
    part = values[region.y : region.y + region.height, region.x : region.x + region.width]
    columns = [column[np.isfinite(column)] for column in part.T]

    def each(function: object) -> NDArray[np.float32]:
        return np.array([function(c) if c.size else NAN for c in columns], np.float32)  # type: ignore[operator]

    nearest = each(np.max)
    ranges = None if geometry is None else (geometry.focal_px * geometry.baseline_m / nearest).astype(np.float32)
    finite = part[np.isfinite(part)]
    return Profile(
        region=region,
        nearest_px=nearest,
        median_px=each(np.median),
        minimum_px=each(np.min),
        maximum_px=nearest,
        nearest_range_m=ranges,
        valid_share=finite.size / part.size,
        minimum=float(finite.min()) if finite.size else NAN,
        maximum=float(finite.max()) if finite.size else NAN,
        total=float(finite.sum()),
        range_m=NAN if ranges is None or not finite.size else float(np.nanmin(ranges)),
        sigma_m=0.01 if finite.size else NAN,
    )


def frame_of(index: int = 0, *, width: int = WIDTH, height: int = HEIGHT, answered: bool = True) -> FrameSection:
    """A slope with a nearer box and a strip without answers; noise where a photograph would be."""
    random = np.random.default_rng(index)
    values = np.tile(np.linspace(4.0, 20.0, height, dtype=np.float32)[:, None], (1, width))
    values[height // 3 : height // 2, width // 3 : width // 2] = 30.0
    validity = np.zeros((height, width), np.uint8)
    validity[:, : width // 8] = 1
    validity[: height // 8] |= 4 | 16
    if not answered:
        validity[:] = 16
    values[validity != 0] = NAN
    geometry = Geometry()
    regions = [Region("far", 0, height // 3, width, 8), Region("near", 0, 3 * height // 4, width, 12)]
    points = random.uniform(0, [width - 1, height - 1], (200, 2))
    shift = np.column_stack([np.full(200, -5.0), random.normal(0.0, 0.2, 200)])
    alignment = Alignment(0.13, 0.2, 200, points, points + shift)
    return FrameSection(
        index=index,
        name=f"frame {index}",
        left=random.integers(0, 256, (height, width, 3), np.uint8),
        right=random.integers(0, 256, (height, width), np.uint8),
        disparity=Disparity(values, validity),
        geometry=geometry,
        profiles=[profile_of(values, region, geometry) for region in regions],
        obstacles=[Obstacle(), Obstacle(id=2, range_m=3.5)] if answered else [],
        alignment=alignment,
        stage_ms={"rectify": 2.0, "match": 8.0},
    )


def report_of(*frames: FrameSection) -> RunReport:
    return RunReport(title="A run", provenance=PROVENANCE, frames=frames)


def whole_report() -> RunReport:
    """Every section there is."""
    frame = frame_of()
    raw = Alignment(3.0, 1.0, 1, np.array([[10.0, 20.0]]), np.array([[8.0, 17.0]]))
    frame = replace(
        frame,
        before=RawPair(left=frame.left, right=frame.right, alignment=raw),
        truth=FrameTruth(
            region_range_m={"near": 0.6},
            column_range_m={"near": np.full(WIDTH, 0.7)},
            column_disparity_px={"near": np.full(WIDTH, 17.0)},
            obstacle_range_m={1: 1.0},
            missed=["a pole at 6 m"],
        ),
    )
    calibration = Calibration(covariance=1e-8 * np.eye(24), views=[ViewResidual(0.1, 0.2), ViewResidual(0.05, NAN)])
    corners = [np.array([[10.0, 20.0], [30.0, 40.0]])] * 2
    return RunReport(
        title="Everything",
        provenance=PROVENANCE,
        calibration=CalibrationSection(
            calibration=calibration,
            board="chessboard",
            view_names=["left01.jpg", "left02.jpg"],
            left_px=corners,
            right_px=corners,
            rejected=[RejectedView(name="left03.jpg", reason="no board in the right photograph")],
            truth=[TruthRow(name="baseline", recovered=0.1202, truth=0.12, unit="m")],
            verdict=Verdict("usable", ("two views only",)),
        ),
        frames=[frame],
        range_curve=RangeCurveSection(
            curve=Curve(), disparity_px=np.array([6.0, 60.0]), distance_m=np.array([7.1, 0.9])
        ),
        parameters={"method": "sad", "threads": None},
        notes=["A note."],
    )


# ---- reading a page ----------------------------------------------------------------------------

VOID = {"meta", "link", "img", "br", "input"}


class Page(HTMLParser):
    """What a browser would see: tags in balance, identifiers, references, text."""

    def __init__(self, html: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.tags: list[str] = []
        self.ids: list[str] = []
        self.references: list[str] = []
        self.text: list[str] = []
        self.words_in_attributes: list[str] = []
        self.feed(html)
        self.close()
        assert self.open == [], f"left open: {self.open}"

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        if tag not in VOID:
            self.open.append(tag)
        self._attributes(attrs)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        self._attributes(attrs)

    def _attributes(self, attrs: list[tuple[str, str | None]]) -> None:
        for name, value in attrs:
            assert value is None or name not in {"src", "href"} or value.startswith(("data:", "#")), f"{name}={value}"
            if name == "id":
                self.ids.append(value or "")
            elif name in {"src", "href"} and value:
                self.references.append(value)
            else:
                self.words_in_attributes.append(value or "")

    def handle_endtag(self, tag: str) -> None:
        assert self.open, f"</{tag}> closes nothing"
        assert self.open.pop() == tag, f"</{tag}> out of place"

    def handle_data(self, data: str) -> None:
        if "style" not in self.open:
            self.text.append(data)

    @property
    def words(self) -> str:
        return re.sub(r"\s+", " ", " ".join(self.text))


def outer_svgs(html: str) -> list[str]:
    """Every outermost `<svg>` element's source."""
    found, depth, start = [], 0, 0
    for match in re.finditer(r"<svg\b|</svg>", html):
        if match.group() == "</svg>":
            depth -= 1
            if depth == 0:
                found.append(html[start : match.end()])
        else:
            if depth == 0:
                start = match.start()
            depth += 1
    assert depth == 0
    return found


def check_page(html: str) -> Page:
    """What must hold of every page."""
    page = Page(html)
    without_data = re.sub(r"data:[\w/]*[;,][\w+/=;,]*", "", html)
    assert not re.search(r"https?:|//\w|@import|url\(", without_data)
    assert "script" not in page.tags
    assert len(page.ids) == len(set(page.ids))
    assert {r[1:] for r in page.references if r.startswith("#")} <= set(page.ids)
    for name in ("nan", "inf", "-inf", "None", "Undefined"):
        pattern = rf"(?<![\w.]){re.escape(name)}(?!\w)"
        assert not re.search(pattern, page.words), f"{name} is printed"
        assert not re.search(pattern, " ".join(page.words_in_attributes)), f"{name} is in an attribute"
    for source in outer_svgs(html):
        ElementTree.fromstring(source)
    return page


# ---- the page ----------------------------------------------------------------------------------


def test_page_with_every_section_is_whole() -> None:
    page = check_page(render_html(whole_report()))
    for text in (
        "epiline run scenes", "avx2", "a machine, 2 cores", "0.1.0", "2026-11-22",
        "Calibration", "Where the board was seen", "left03.jpg", "no board in the right photograph", "two views only",
        "Recovered against true", "+0.167 %", "Before rectification.", "Range curve", "Stage times", "A note.",
        "Parameters", "not set",
        "There, but not found: a pole at 6 m", "12.3° left", "0.40 × 0.70", "+25.00 %", "100.0 frames/s",
    ):  # fmt: skip
        assert text in page.words, text
    assert {"frame-0", "calibration", "curve", "times", "parameters"} <= set(page.ids)


def test_sections_are_absent_where_there_is_nothing_to_say() -> None:
    page = check_page(render_html(RunReport(title="Nothing", provenance=PROVENANCE)))
    assert not set(page.ids)
    assert "svg" not in page.tags
    frame = replace(frame_of(), geometry=None, alignment=None, profiles=(), obstacles=(), stage_ms={})
    page = check_page(render_html(report_of(frame)))
    assert set(page.ids).isdisjoint({"calibration", "curve", "times", "parameters", "run"})
    for text in ("No obstacle was found", "No regions were asked for", "The geometry is not known", "not measured"):
        assert text in page.words
    assert "Before rectification." not in page.words
    rig = CalibrationSection(calibration=Calibration(rms_px=NAN, epipolar_error_px=NAN))
    page = check_page(render_html(RunReport(title="A rig", provenance=PROVENANCE, calibration=rig)))
    assert "this rig was read from a file" in page.words
    assert "Views not used" not in page.words


def test_a_frame_without_any_answer_prints_no_nan() -> None:
    frame = frame_of(answered=False)
    nothing = Alignment(NAN, NAN, 0, np.empty((0, 2)), np.empty((0, 2)))
    frame = replace(
        frame, alignment=nothing, obstacles=[Obstacle(range_m=NAN, sigma_m=NAN, bearing_rad=NAN, width_m=math.inf)]
    )
    page = check_page(render_html(report_of(frame, replace(frame, index=1), replace(frame, index=2))))
    assert "No column of this region has enough pixels" in page.words
    assert "no region had support in any frame" in page.words


def test_what_people_type_is_text_and_not_markup() -> None:
    report = whole_report()
    frame = report.frames[0]
    region = Region(HOSTILE, 0, 40, WIDTH, 10)
    profile = profile_of(frame.disparity.values, region, None)
    section = report.calibration
    assert section is not None
    report = replace(
        report,
        title=HOSTILE,
        subtitle=HOSTILE,
        provenance=replace(PROVENANCE, command=HOSTILE, machine=HOSTILE),
        notes=[HOSTILE],
        parameters={HOSTILE: HOSTILE},
        calibration=replace(
            section,
            view_names=[HOSTILE] * 2,
            board=HOSTILE,
            rejected=[RejectedView(name=HOSTILE, reason=HOSTILE)],
            truth=[TruthRow(name=HOSTILE, recovered=1.0, truth=1.0, unit=HOSTILE)],
            verdict=Verdict("do not use", (HOSTILE,)),
        ),
        frames=[
            replace(
                frame,
                name=HOSTILE,
                profiles=[profile],
                obstacles=[Obstacle(region=HOSTILE)],
                stage_ms={HOSTILE: 1.0},
                truth=FrameTruth(missed=[HOSTILE]),
            ),
            frame_of(1),
            frame_of(2),
        ],
    )
    html = render_html(report)
    page = check_page(html)
    assert "<script" not in html
    assert page.words.count("alert('x')") >= 15


def test_page_of_many_frames_stays_small() -> None:
    recorder = FrameRecorder(expected=40)
    for index in range(40):
        frame = frame_of(index, width=1280, height=720)
        recorder.add(replace(frame, before=RawPair(left=frame.left, right=frame.right)))
    report = replace(
        report_of(*recorder.frames), summaries=recorder.summaries, thumbnails=recorder.thumbnails, title="Forty frames"
    )
    html = render_html(report)
    page = check_page(html)
    # White noise is the worst photograph there is for JPEG; real ones take about a third.
    assert len(html) < 16e6
    assert sum(name.count("-") == 1 and name.startswith("frame-") for name in page.ids) == 8
    assert html.count("<tr") >= 40
    assert "40 8 with figures" in page.words
    every = next(part for part in html.split("<h3>") if part.startswith("Every frame"))
    assert every.split("</table>")[0].count("<tr>") == 41


def test_more_frames_than_figures_are_chosen_evenly() -> None:
    page = check_page(render_html(report_of(*(frame_of(i) for i in range(11))), max_frames=3))
    assert {name for name in page.ids if re.fullmatch(r"frame-\d+", name)} == {"frame-0", "frame-5", "frame-10"}


def test_real_pair_makes_a_page(data: Path) -> None:
    folder = data / "middlebury2014" / "Motorcycle"
    archive = np.load(folder / "gt_left.npz")
    values = archive[archive.files[0]].astype(np.float32)
    values[~np.isfinite(values)] = NAN
    left, right = (cv2.imread(str(folder / name)) for name in ("left.png", "right.png"))
    geometry = Geometry(994.978, 0.193001, 31.086)
    region = Region("middle", 0, 240, left.shape[1], 30)
    frame = replace(
        frame_of(),
        left=left,
        right=right,
        disparity=Disparity(values, np.isnan(values).astype(np.uint8)),
        geometry=geometry,
        profiles=[profile_of(values, region, geometry)],
    )
    html = render_html(report_of(frame))
    check_page(html)
    assert len(html) < 2e6


@pytest.mark.parametrize("bad", ["twice", "validity", "left", "max_frames"])
def test_impossible_reports_are_refused(bad: str) -> None:
    frame, other = frame_of(0), frame_of(1)
    if bad == "twice":
        report, message = report_of(frame, frame), "index = 0 occurs twice"
    elif bad == "validity":
        wrong = Disparity(frame.disparity.values, frame.disparity.validity[1:])
        report, message = report_of(replace(frame, disparity=wrong)), "frame 0: validity"
    elif bad == "left":
        report, message = report_of(other, replace(frame, left=frame.left[:, 1:])), "frame 0: left"
    else:
        report, message = report_of(frame), "maximum = 0"
    with pytest.raises(ValueError, match=message):
        render_html(report, max_frames=0 if bad == "max_frames" else 8)


# ---- writing -----------------------------------------------------------------------------------


def test_report_is_written_whole(tmp_path: Path) -> None:
    path = write_report(report_of(frame_of()), tmp_path / "report.html")
    check_page(path.read_text(encoding="utf-8"))
    assert os.listdir(tmp_path) == ["report.html"]
    # The usual permissions, not those of a private temporary file.
    (tmp_path / "other").touch()
    assert path.stat().st_mode == (tmp_path / "other").stat().st_mode


def test_a_name_that_is_no_utf8_is_written(tmp_path: Path) -> None:
    frame = replace(frame_of(), name=os.fsdecode(b"caf\xe9.png"))
    path = write_report(report_of(frame), tmp_path / "report.html")
    assert "caf?.png" in path.read_text(encoding="utf-8")


def test_a_failed_write_leaves_the_old_report(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "report.html"
    path.write_text("old")

    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "replace", full)
    with pytest.raises(OSError, match="No space left on device") as caught:
        write_report(report_of(), path)
    assert caught.value.filename == str(path)
    assert path.read_text() == "old"
    assert os.listdir(tmp_path) == ["report.html"]


def test_an_unwritable_place_is_named(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    for path in (tmp_path / "absent" / "report.html", tmp_path / "file" / "report.html", tmp_path):
        with pytest.raises(OSError, match="cannot be written") as caught:
            write_report(report_of(), path)
        assert str(path) in str(caught.value)


# ---- figures -----------------------------------------------------------------------------------


def texts(svg: str) -> list[tuple[float, float, str]]:
    """Position and content of every text of a drawing."""
    return [
        (float(e.get("x", "0")), float(e.get("y", "0")), e.text or "") for e in ElementTree.fromstring(svg).iter("text")
    ]


def test_colour_bar_says_the_metres_of_its_pixels() -> None:
    geometry = Geometry(focal_px=994.978, baseline_m=0.193, doffs_px=31.086)
    labels = texts(figures.colour_bar((4.0, 62.0), geometry, grey=False))
    pixels = [(x, float(t)) for x, y, t in labels if y > 40 and t != "px"]
    metres = [(x, float(t)) for x, y, t in labels if y < 40 and t not in {"m", "∞"}]
    assert len(pixels) >= 4
    assert len(metres) >= 4
    slope, offset = np.polyfit([x for x, _ in pixels], [d for _, d in pixels], 1)
    for x, depth_m in metres:
        assert 994.978 * 0.193 / (slope * x + offset + 31.086) == pytest.approx(depth_m, rel=0.005)


def test_colour_bar_reaches_infinity_only_at_zero_disparity() -> None:
    assert "∞" in figures.colour_bar((0.0, 40.0), Geometry(), grey=True)
    assert "∞" not in figures.colour_bar((1.0, 40.0), Geometry(), grey=True)
    without = figures.colour_bar((0.0, 40.0), None, grey=True)
    assert [t for _, _, t in texts(without) if t in {"m", "∞"}] == []


def test_scan_lines_show_the_median_residual_of_their_rows() -> None:
    left = np.array([[10.0, 5.0], [20.0, 8.0], [30.0, 2.0], [40.0, 95.0]])
    right = left - np.array([[3.0, 0.1], [3.0, 4.0], [3.0, -1.0], [3.0, 2.0]])
    lines = figures.scan_lines(Alignment(1.0, 1.0, 4, left, right), 100, count=4)
    assert [line.y for line in lines] == [2.0, 37.5, 62.5, 95.0]
    assert lines[0].left == (30.0, 2.0)
    assert lines[0].right == (27.0, 3.0)
    assert lines[1].left is None
    picture = figures.Picture(key="k", uri="data:,", width=200, height=100)
    drawing = ElementTree.fromstring(figures.pair_figure(picture, picture, lines, title="pair", dashed=True))
    rings = [(float(e.get("cx", "")), float(e.get("cy", ""))) for e in drawing.iter("circle")]
    # Pixel (0, 0) is centred half a unit from the drawing's corner; the right view starts after the gap.
    assert rings[0] == (30.5, 2.5)
    assert rings[1][0] > 200 + 27.5
    assert rings[1][1] == 3.5


def test_boxes_are_drawn_where_they_are() -> None:
    picture = figures.Picture(key="k", uri="data:,", width=200, height=100)
    crowd = [Obstacle(id=i, range_m=5.0 - i, box=(150, 0, 50, 40)) for i in range(3)]
    drawing = ElementTree.fromstring(figures.obstacle_figure(picture, crowd, title="obstacles"))
    nearest = [e for e in drawing.iter("rect") if e.get("class") == "obstacle nearest"]
    assert [(e.get("x"), e.get("y"), e.get("width"), e.get("height")) for e in nearest] == [("150", "0", "50", "40")]
    tags = [e for e in drawing.iter("rect") if (e.get("class") or "").startswith("tag")]
    boxes = [[float(e.get(k, "")) for k in ("x", "y", "width", "height")] for e in tags]
    assert [t for _, _, t in texts(figures.obstacle_figure(picture, crowd, title="o"))][-1] == "2 · 3.00\u00a0m"
    for i, (x, y, w, h) in enumerate(boxes):
        assert x >= 0
        assert y >= 0
        assert x + w <= 200.1
        assert y + h <= 100
        for ox, oy, ow, oh in boxes[:i]:
            assert x + w <= ox + 0.2 or ox + ow <= x + 0.2 or y + h <= oy + 0.2 or oy + oh <= y + 0.2, "labels overlap"


def test_reasons_follow_the_bits() -> None:
    validity = np.arange(256, dtype=np.uint8)
    expected = [0] + [next(i + 1 for i in range(8) if bits >> i & 1) for bits in range(1, 256)]
    assert reasons.first_reason(validity).tolist() == expected
    assert reasons.has_value(validity).tolist() == [bits in (0, 128) for bits in range(256)]
    assert [reason.bit for reason in reasons.REASONS] == [1 << i for i in range(8)]


# ---- charts ------------------------------------------------------------------------------------


def test_ticks_are_round_and_inside() -> None:
    random = np.random.default_rng(7)
    for low, span in zip(random.normal(0, 50, 200), 10.0 ** random.uniform(-4, 5, 200), strict=True):
        ticks = charts.nice_ticks((low, low + span), 5)
        assert 2 <= len(ticks) <= 12
        assert all(low - 1e-6 * span <= tick <= low + span * (1 + 1e-6) for tick in ticks)
        step = ticks[1] - ticks[0]
        mantissa = step / 10.0 ** math.floor(math.log10(step) + 1e-9)
        assert min(abs(mantissa - m) for m in (1, 2, 5, 10)) < 1e-3


def test_a_line_passes_where_the_axes_say_and_breaks_at_gaps() -> None:
    x = np.array([0.0, 1.0, 2.0, 3.0, 4.0, 5.0])
    y = np.array([10.0, 30.0, NAN, 20.0, NAN, 40.0])
    drawing = charts.line_chart(
        title="line",
        x=charts.Axis(label="x", limits=(0.0, 5.0)),
        y=charts.Axis(label="y", limits=(0.0, 50.0)),
        lines=[charts.Line(name="values", x=x, y=y, tone="c0")],
    )
    root = ElementTree.fromstring(drawing)
    plot = root.findall("svg")[0]
    left, top = float(plot.get("x", "")), float(plot.get("y", ""))
    path = next(e.get("d", "") for e in plot.iter("path") if e.get("class") == "line c0")
    assert path.count("M") == 3
    assert path.count("h0") == 2  # columns 3 and 5 stand alone: dots
    numbers_in_path = [float(n) for n in re.findall(r"-?\d+\.\d", path)]
    drawn = np.array(numbers_in_path).reshape(-1, 2) + np.array([left, top])
    ticks = [(tx, ty, float(t)) for tx, ty, t in texts(drawing) if re.fullmatch(r"\d+", t)]
    bottom = max(ty for _, ty, _ in ticks)
    across = np.polyfit(*zip(*[(tx, t) for tx, ty, t in ticks if ty == bottom], strict=True), 1)
    down = np.polyfit(*zip(*[(ty - 3.5, t) for tx, ty, t in ticks if ty != bottom], strict=True), 1)
    finite = np.isfinite(y)
    assert np.polyval(across, drawn[:, 0]) == pytest.approx(x[finite], abs=0.01)
    assert np.polyval(down, drawn[:, 1]) == pytest.approx(y[finite], abs=0.1)


def test_long_lines_are_thinned_without_losing_the_nearest() -> None:
    y = np.zeros(5000)
    y[1234] = 100.0
    drawing = charts.line_chart(
        title="long",
        x=charts.Axis(label="x", limits=(0.0, 5000.0)),
        y=charts.Axis(label="y", limits=(0.0, 100.0)),
        lines=[charts.Line(name="values", x=np.arange(5000.0), y=y, tone="c0", keep="max")],
    )
    path = next(e.get("d", "") for e in ElementTree.fromstring(drawing).iter("path") if e.get("class") == "line c0")
    assert len(path.split()) < 3 * charts.MAX_POINTS
    assert " 0.0" in path, "the peak touches the top of the plot"


def test_charts_of_nothing_say_so() -> None:
    axis = charts.Axis(label="x", limits=charts.limits_of(np.array([NAN])))
    line = charts.Line(name="none", x=np.arange(3.0), y=np.full(3, NAN), tone="c0")
    drawing = charts.line_chart(title="empty", x=axis, y=axis, lines=[line], empty="nothing here")
    assert "nothing here" in drawing
    assert "nan" not in drawing


def test_histogram_shares_add_up_even_beyond_the_frame() -> None:
    values = np.concatenate([np.full(50, -9.0), np.full(25, 0.1), np.full(25, 9.0), [NAN]])
    drawing = charts.histogram(title="h", x_label="dy, px", groups=[("all", values, "c0")], limits=(-1.0, 1.0), bins=4)
    root = ElementTree.fromstring(drawing)
    path = next(e.get("d", "") for e in root.iter("path") if e.get("class") == "area c0")
    heights = np.array([float(n) for n in re.findall(r"-?\d+\.\d", path)])[1::2]
    ticks = [(ty - 3.5, float(t)) for tx, ty, t in texts(drawing) if re.fullmatch(r"\d+", t) and tx < 56]
    share = np.polyval(np.polyfit(*zip(*ticks, strict=True), 1), heights + 26.0)
    assert share[1:-1:2] == pytest.approx([50.0, 0.0, 25.0, 25.0], abs=0.5)


# ---- pictures and numbers ----------------------------------------------------------------------


def test_pictures_follow_disparity() -> None:
    values = np.array([[NAN, 4.0, 8.0, 12.0, 100.0, -5.0]], np.float32)
    grey = pictures.grey_picture(values, limits_px=(4.0, 12.0))
    assert grey.dtype == np.uint8
    assert grey.tolist() == [[0, 40, 148, 255, 255, 40]]
    for disparity in (4.0, 6.5, 12.0):
        level = pictures.grey_picture(np.array([[disparity]], np.float32), limits_px=(4.0, 12.0))[0, 0]
        assert pictures.grey_level_disparity(float(level), (4.0, 12.0)) == pytest.approx(disparity, abs=0.05)
    colour = pictures.colour_picture(values, limits_px=(4.0, 12.0))
    turbo = cv2.applyColorMap(np.array([[20, 255]], np.uint8), cv2.COLORMAP_TURBO)[0]
    assert colour[0, 0].tolist() == list(pictures.INVALID_BGR)
    assert colour[0, 1].tolist() == turbo[0].tolist()
    assert colour[0, 3].tolist() == turbo[1].tolist()
    palette = pictures.colour_palette().astype(int)
    assert np.abs(palette[1:] - palette[0]).sum(axis=1).min() > 100, "an answer looks like none"


def test_limits_forgive_wild_matches() -> None:
    values = np.full((100, 100), 10.0, np.float32)
    values[:, :50] = 20.0
    values[0, 0] = 4000.0
    assert pictures.disparity_limits([values]) == (10.0, 20.0)
    assert pictures.disparity_limits([np.full((2, 2), NAN, np.float32)]) == (0.0, 1.0)
    with pytest.raises(ValueError, match="limits_px"):
        pictures.grey_picture(values, limits_px=(5.0, 5.0))


def test_indexed_png_is_read_back_by_opencv() -> None:
    random = np.random.default_rng(3)
    palette = random.integers(0, 256, (9, 3), np.uint8)
    indices = random.integers(0, 9, (17, 31), np.uint8)
    alpha = random.integers(0, 256, 9, np.uint8)
    read = cv2.imdecode(np.frombuffer(encode.palette_png(indices, palette), np.uint8), cv2.IMREAD_UNCHANGED)
    assert np.array_equal(read[..., :3], palette[indices])
    read = cv2.imdecode(
        np.frombuffer(encode.palette_png(indices, palette, alpha=alpha), np.uint8), cv2.IMREAD_UNCHANGED
    )
    assert np.array_equal(read, np.dstack([palette[indices], alpha[indices]]))


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        (numbers.number(1234.5678, 2), "1234.57"),
        (numbers.number(-0.001, 2), "0.00"),
        (numbers.number(-1.5, 1), "−1.5"),
        (numbers.number(123456.0, 0), "123\u202f456"),
        (numbers.number(math.inf), "–"),
        (numbers.plus_minus(1.23456, 0.0123, "m"), "1.235 ±\u00a00.012\u00a0m"),
        (numbers.plus_minus(12.3456, 1.23, "m"), "12.3 ±\u00a01.2\u00a0m"),
        (numbers.plus_minus(1.23456, 1e-9, "m"), "1.235 ±\u00a00.001\u00a0m"),
        (numbers.plus_minus(1.23456, NAN, "m"), "1.235\u00a0m"),
        (numbers.plus_minus(NAN, 0.1, "m"), "–"),
        (numbers.significant(0.000123456, 3), "0.000123"),
        (numbers.significant(-1.5e-9, 2), "−1.5·10^−9"),
        (numbers.signed_percent(0.0123), "+1.23\u00a0%"),
        (numbers.signed_percent(-0.00001), "0.00\u00a0%"),
        (numbers.signed_percent(numbers.relative_error(1.0, 0.0)), "–"),
    ],
)
def test_numbers_are_written_as_in_print(text: str, expected: str) -> None:
    assert text == expected


# ---- keeping a run -----------------------------------------------------------------------------


@pytest.mark.parametrize("maximum", [1, 2, 3, 8])
def test_even_sample_is_even_at_every_length(maximum: int) -> None:
    sample: EvenSample[int] = EvenSample(maximum)
    for i in range(200):
        before, wanted = sample.items, sample.takes_next
        sample.offer(i)
        items = sample.items
        assert wanted or items == before
        assert items[0] == 0
        assert len(items) <= maximum
        assert len(set(np.diff(items))) <= 1
        assert 2 * len(items) >= min(i + 1, maximum)


def test_evenly_chosen_spans_the_whole() -> None:
    for total in range(60):
        for maximum in range(1, 12):
            chosen = evenly_chosen(total, maximum)
            assert len(chosen) == min(total, maximum)
            assert chosen == sorted(set(chosen))
            if total and maximum > 1:
                assert (chosen[0], chosen[-1]) == (0, total - 1)
                assert max(np.diff(chosen), default=0) - min(np.diff(chosen), default=0) <= 1


def test_recorder_keeps_few_frames_and_all_figures() -> None:
    recorder = FrameRecorder(maximum=4)
    for i in range(30):
        before, wanted = [frame.index for frame in recorder.frames], recorder.takes_next
        recorder.add(frame_of(i))
        assert wanted or [frame.index for frame in recorder.frames] == before
    assert [frame.index for frame in recorder.frames] == [0, 8, 16, 24]
    assert [summary.index for summary in recorder.summaries] == list(range(30))
    assert len(recorder.thumbnails) == 30
    small = cv2.imdecode(np.frombuffer(recorder.thumbnails[3].jpeg, np.uint8), cv2.IMREAD_COLOR)
    assert small.shape[:2] == (recorder.thumbnails[3].height, recorder.thumbnails[3].width)


def test_summary_says_what_the_frame_says() -> None:
    frame = frame_of()
    frame = replace(frame, alignment=replace(frame.alignment, median_px=-0.4), stage_ms={"match": 3.0, "total": 5.0})
    summary = summarize(frame)
    assert summary.nearest_m == 1.25
    assert summary.obstacles == 2
    assert summary.alignment_px == 0.4
    assert summary.total_ms == 5.0
    assert dict(summary.stage_ms) == {"match": 3.0}
    assert summary.valid_share == pytest.approx(np.isfinite(frame.disparity.values).mean())
    assert summarize(replace(frame, stage_ms={"a": 1.0, "b": 2.5})).total_ms == 3.5


def test_baseline_sigma_is_that_of_random_rigs() -> None:
    random = np.random.default_rng(11)
    root = random.normal(0, 2e-4, (3, 3))
    covariance = np.zeros((24, 24))
    covariance[-3:, -3:] = root @ root.T
    rig = Calibration(translation_m=np.array([-0.1, 0.03, 0.02]), covariance=covariance)
    drawn = np.linalg.norm(random.multivariate_normal(rig.translation_m, root @ root.T, 200_000), axis=1)
    assert baseline_sigma_m(rig) == pytest.approx(float(drawn.std()), rel=0.01)
    assert math.isnan(baseline_sigma_m(Calibration()))
