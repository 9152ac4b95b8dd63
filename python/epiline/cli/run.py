"""`epiline run`: the continuous process. Pairs in, ranges and obstacles out, a line per frame."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from epiline._core import (
    FrameResult,
    Pipeline,
    RectifiedGeometry,
    StereoCalibration,
    StereoMatcher,
    alignment_error,
    default_disparities,
)
from epiline.cli.arguments import add_matcher_arguments, load_rig, matcher_from, positive, whole
from epiline.cli.configuration import (
    Configuration,
    ground_prior,
    read_configuration,
    robot_from_camera,
    scanner,
    tracker,
)
from epiline.cli.console import print_table, progress, say

if TYPE_CHECKING:
    from epiline.sinks.video import PictureSink
    from epiline.sources import Frame

_DEFAULT_FPS = 10.0


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "source", nargs="+", metavar="SOURCE", help="a folder of pairs, two folders, globs or videos, sbs:VIDEO, demo:"
    )
    parser.add_argument("--rig", type=Path, required=True, help="rig file, or calib.txt of an aligned sequence")
    parser.add_argument(
        "--config", type=Path, metavar="TOML", help="a table for each stage, and regions; options given here win"
    )
    parser.add_argument("--jsonl", metavar="FILE", help="write a JSON line per frame; - is standard output")
    parser.add_argument("--json", dest="jsonl", action="store_const", const="-", help="the same as --jsonl -")
    parser.add_argument("--report", type=Path, metavar="HTML", help="write a page with maps, profiles and obstacles")
    parser.add_argument("--pictures", type=Path, metavar="DIR", help="write a picture per frame: tracks, and the scan")
    parser.add_argument("--video", type=Path, metavar="FILE", help="the same pictures as a video: .mp4, .avi or .mkv")
    parser.add_argument(
        "--fps",
        type=positive,
        metavar="F",
        help=f"frames per second, instead of the source's time stamps; without either {_DEFAULT_FPS:g}",
    )
    parser.add_argument("--limit", type=whole(1), metavar="N", help="stop after N frames")
    parser.add_argument("--equalize", action="store_true", default=None, help="equalise histograms first (eq. 3)")
    parser.add_argument(
        "--camera-height", type=positive, metavar="M", help="of the camera over the floor, if it is known"
    )
    parser.add_argument("--max-range", type=positive, metavar="M", help="look for obstacles and scan up to this range")
    add_matcher_arguments(parser)


def run(args: argparse.Namespace) -> None:
    from epiline.sources import open_source

    config = read_configuration(args.config) if args.config else Configuration()
    rig = load_rig(args.rig)
    to_stdout = args.jsonl == "-"
    with ExitStack() as stack:
        source = stack.enter_context(open_source(args.source))
        length = source.length if args.limit is None else min(args.limit, source.length or args.limit)
        matcher = make_matcher(args, config, rig, source.size[0])
        pipeline = make_pipeline(args, config, rig, matcher)
        sink = _open_sink(args.jsonl, stack)
        recorder = _Recorder(args.report, length, rig, matcher) if args.report else None
        pictures = _open_pictures(args, stack)
        clock = _Clock(args.fps)
        rows: list[tuple[object, ...]] = []
        advance = stack.enter_context(progress("running", length))
        for count, frame in enumerate(source, start=1):
            result = pipeline.process(frame.left, frame.right, stamp_nanos=clock.stamp_nanos(frame))
            if sink:
                sink.write(frame, result)
            if recorder:
                recorder.add(frame, result)
            if pictures:
                _draw(pictures, frame, result)
            if not to_stdout:
                rows.append(_row(frame, result))
            advance()
            if count == args.limit:
                break
    if rows:
        bands = [region.name for region in pipeline.regions]
        heads = ("frame", "dy px", "valid %", *(f"{b} m" for b in bands), "obstacles", "tracks", "nearest", "ms")
        print_table("", heads, rows)
    if recorder:
        recorder.write()
    if not to_stdout:
        for written in filter(None, (args.report, args.pictures, args.video)):
            say(f"wrote {written}")


def make_matcher(
    args: argparse.Namespace, config: Configuration, rig: StereoCalibration | RectifiedGeometry, width: int
) -> StereoMatcher:
    """The matcher of the configuration over the options' and, by default, a pipeline's own."""
    if "preset" in config.matcher:
        return StereoMatcher(**{"num_disparities": default_disparities(width), **config.matcher})
    matcher = matcher_from(args, width, default=Pipeline(rig).matcher_parameters)
    return StereoMatcher(**{**matcher.parameters, **config.matcher})


def make_pipeline(
    args: argparse.Namespace, config: Configuration, rig: StereoCalibration | RectifiedGeometry, matcher: StereoMatcher
) -> Pipeline:
    """The pipeline of the options over the configuration over the defaults."""
    settings: dict[str, Any] = dict(config.pipeline)
    if args.equalize is not None:
        settings["equalize"] = args.equalize
    if args.max_range is not None:
        settings["max_range_m"] = args.max_range
        config = replace(config, scan={**config.scan, "max_range_m": args.max_range})
    if args.camera_height is not None:
        config = replace(config, mounting={**config.mounting, "height_m": args.camera_height})
    return Pipeline(
        rig,
        matcher=matcher,
        regions=config.regions_for(rig),
        ground=config.ground.get("enabled", True),
        mounting=ground_prior(config),
        robot_from_camera=robot_from_camera(config),
        scanner=scanner(config),
        tracker=tracker(config),
        **settings,
    )


def _open_sink(path: str | None, stack: ExitStack) -> Any:
    from epiline.sinks.jsonl import JsonLines

    if path is None:
        return None
    return JsonLines(sys.stdout) if path == "-" else stack.enter_context(JsonLines.open(Path(path)))


def _open_pictures(args: argparse.Namespace, stack: ExitStack) -> Sequence[PictureSink]:
    from epiline.sinks.video import PictureFolder, VideoFile

    sinks: list[PictureSink] = []
    if args.pictures:
        sinks.append(PictureFolder(args.pictures))
    if args.video:
        sinks.append(stack.enter_context(VideoFile.open(args.video, args.fps or _DEFAULT_FPS)))
    return sinks


def _draw(sinks: Sequence[PictureSink], frame: Frame, result: FrameResult) -> None:
    from epiline.sinks.overlay import picture_of

    picture = picture_of(result.pair.left, result.tracks, result.scan, caption=frame.name)
    for sink in sinks:
        sink.add(frame.name, picture)


class _Clock:
    """Stamps frames: as their source does, or else evenly."""

    def __init__(self, frames_per_second: float | None) -> None:
        self._step_nanos = round(1e9 / (frames_per_second or _DEFAULT_FPS))
        self._even = frames_per_second is not None

    def stamp_nanos(self, frame: Frame) -> int:
        if frame.left_stamp_nanos is None or self._even:
            return frame.seq * self._step_nanos
        return frame.left_stamp_nanos


def _row(frame: Frame, result: FrameResult) -> tuple[object, ...]:
    nearest = min((o for o in result.obstacles), key=lambda o: o.range_m, default=None)
    alignment = "-" if result.alignment is None else f"{result.alignment.median_px:.2f}"
    return (
        frame.name,
        alignment,
        f"{100 * result.disparity.density:.1f}",
        *(f"{p.range_m:.2f} ± {p.sigma_m:.2f}" if p.range_m == p.range_m else "-" for p in result.profiles),
        len(result.obstacles),
        sum(track.confirmed for track in result.tracks),
        "-" if nearest is None else f"{nearest.range_m:.2f} ± {nearest.sigma_m:.2f} m",
        f"{sum(v for k, v in result.stage_ms.items() if k != 'total'):.1f}",
    )


class _Recorder:
    """Keeps of the run what its report shows."""

    def __init__(self, path: Path, expected: int | None, rig: object, matcher: StereoMatcher) -> None:
        from epiline.report import FrameRecorder

        if not path.resolve().parent.is_dir():
            raise FileNotFoundError(2, "the folder of the report does not exist", str(path.parent))
        self._path, self._rig, self._parameters = path, rig, matcher.parameters
        self._frames = FrameRecorder(expected=expected)

    def add(self, frame: Frame, result: FrameResult) -> None:
        from epiline.report import FrameSection, RawPair

        before = None
        # Pairs that came aligned have no picture of before; only frames that get figures pay for its residual.
        if isinstance(self._rig, StereoCalibration) and self._frames.takes_next:
            residual = alignment_error(frame.left, frame.right)
            before = RawPair(left=frame.left, right=frame.right, alignment=residual)
        self._frames.add(FrameSection.from_result(result, index=frame.seq, name=frame.name, before=before))

    def write(self) -> None:
        from epiline.cli.reporting import write_run_report

        write_run_report(self._path, self._frames, self._rig, self._parameters)
