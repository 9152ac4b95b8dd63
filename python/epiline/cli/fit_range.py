"""`epiline fit-range`: the paper's curve from a table of measured pairs."""

from __future__ import annotations

import argparse
import csv
import warnings
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from epiline._core import RangeCurve, RectifiedGeometry, Rectifier, StereoCalibration, fit_range_curve
from epiline.cli.arguments import load_rig
from epiline.cli.console import note, print_json, print_table, say


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "table", type=Path, help="CSV with a disparity (px) and a distance (m) in each row; a header is skipped"
    )
    parser.add_argument("--robust", action="store_true", help="leave out pairs that do not fit with the others")
    parser.add_argument(
        "--at", type=float, nargs="+", default=[], metavar="PX", help="also predict the distance at these disparities"
    )
    parser.add_argument("--rig", type=Path, help="compare with triangulation by this rig, distances taken as depths Z")
    parser.add_argument("--report", type=Path, metavar="HTML", help="write the curve with its points and 95 %% band")
    parser.add_argument("--json", action="store_true", help="print one JSON object")


def run(args: argparse.Namespace) -> None:
    disparity_px, distance_m = read_table(args.table)
    curve = fit_range_curve(disparity_px, distance_m, robust=args.robust)
    kept = np.ones(disparity_px.size, bool)
    kept[curve.outliers] = False
    if args.report:
        from epiline.cli.reporting import write_curve_report

        write_curve_report(args.report, curve, disparity_px[kept], distance_m[kept])
    geometry = _geometry(args.rig) if args.rig else None
    if args.json:
        print_json(_figures(curve, disparity_px, distance_m, kept, args.at, geometry))
    else:
        _print(curve, disparity_px, distance_m, kept, args.at, geometry)


def _geometry(path: Path) -> RectifiedGeometry:
    rig = load_rig(path)
    return Rectifier(rig).geometry if isinstance(rig, StereoCalibration) else rig


def _predicted(curve: RangeCurve, disparity_px: NDArray[np.float64]) -> tuple[NDArray[np.float64], ...]:
    """Distance and its 95 % bounds; outside the span too, where the caller says so."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)
        return (curve.predict(disparity_px), *curve.predict_interval(disparity_px))


def _triangulated(geometry: RectifiedGeometry, disparity_px: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.array([geometry.depth_m(float(x)) for x in disparity_px])


def _rmse(residual: NDArray[np.float64]) -> float:
    return float(np.sqrt(np.mean(residual**2)))


def _figures(
    curve: RangeCurve,
    disparity_px: NDArray[np.float64],
    distance_m: NDArray[np.float64],
    kept: NDArray[np.bool_],
    at: list[float],
    geometry: RectifiedGeometry | None,
) -> dict[str, object]:
    names = ("a", "b", "c", "d", "rmse_m", "r_squared")
    fitted = _predicted(curve, disparity_px)[0]
    figures: dict[str, object] = {
        **{name: getattr(curve, name) for name in names},
        "standard_errors": curve.standard_errors.tolist(),
        "span_px": list(curve.span_px),
        "points": len(disparity_px),
        "outliers": curve.outliers.tolist(),
        "residual_m": (distance_m - fitted).tolist(),
    }
    if at:
        asked = np.array(at)
        figures["predictions"] = [
            {"disparity_px": x, "distance_m": z, "low_m": low, "high_m": high, "inside_span": inside}
            for x, z, low, high, inside in zip(
                at, *(v.tolist() for v in _predicted(curve, asked)), _inside(curve, asked).tolist(), strict=True
            )
        ]
    if geometry is not None:
        by_rig = distance_m - _triangulated(geometry, disparity_px)
        figures["triangulation"] = {"rmse_m": _rmse(by_rig[kept]), "residual_m": by_rig.tolist()}
    return figures


def _inside(curve: RangeCurve, disparity_px: NDArray[np.float64]) -> NDArray[np.bool_]:
    low, high = curve.span_px
    return (disparity_px >= low) & (disparity_px <= high)


def _print(
    curve: RangeCurve,
    disparity_px: NDArray[np.float64],
    distance_m: NDArray[np.float64],
    kept: NDArray[np.bool_],
    at: list[float],
    geometry: RectifiedGeometry | None,
) -> None:
    say(f"distance = {curve.a:.6g} e^({curve.b:.6g} x) + {curve.c:.6g} e^({curve.d:.6g} x)   x: disparity, px")
    errors = ", ".join(f"{name} {error:.2g}" for name, error in zip("abcd", curve.standard_errors, strict=True))
    say(f"standard errors: {errors}")
    say(
        f"rmse {curve.rmse_m:.4g} m, R² {curve.r_squared:.6f}, "
        f"fitted over {curve.span_px[0]:g} to {curve.span_px[1]:g} px"
    )
    if curve.outliers.size:
        say(f"left out as outliers: {curve.outliers.size} of {disparity_px.size} pairs")
    fitted, low, high = _predicted(curve, disparity_px)
    columns = ["disparity px", "measured m", "curve m", "residual m", "95 % interval m"]
    rows: list[list[str]] = [
        [f"{x:g}", f"{y:.3f}", f"{z:.3f}", f"{y - z:+.3f}" + ("" if use else " *"), f"{a:.3f} to {b:.3f}"]
        for x, y, z, use, a, b in zip(disparity_px, distance_m, fitted, kept, low, high, strict=True)
    ]
    if geometry is not None:
        depth_m = _triangulated(geometry, disparity_px)
        columns += ["triangulated m", "residual m"]
        for row, y, z in zip(rows, distance_m, depth_m, strict=True):
            row += [f"{z:.3f}", f"{y - z:+.3f}"]
    print_table("", columns, rows)
    if geometry is not None:
        by_rig = _rmse((distance_m - depth_m)[kept])
        say(f"rmse of triangulation {by_rig:.4g} m, of the curve {curve.rmse_m:.4g} m, same pairs")
    if at:
        asked = np.array(at)
        inside = _inside(curve, asked)
        for x in asked[~inside]:
            span = f"{curve.span_px[0]:g} to {curve.span_px[1]:g} px"
            note(f"warning: {x:g} px lies outside the fitted span, {span}: the curve is a guess there")
        predicted = zip(asked, *_predicted(curve, asked), inside, strict=True)
        print_table(
            "",
            ("disparity px", "distance m", "95 % interval m"),
            [(f"{x:g}" + ("" if i else " !"), f"{z:.3f}", f"{a:.3f} to {b:.3f}") for x, z, a, b, i in predicted],
        )


def read_table(path: Path) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The first two columns of a CSV file as disparities (px) and distances (m)."""
    pairs: list[tuple[float, float]] = []
    with path.open(newline="", encoding="utf-8-sig") as file:
        sample = file.read(4096)
        file.seek(0)
        delimiter = max(",;\t ", key=sample.count) if sample else ","
        for number, row in enumerate(csv.reader(file, delimiter=delimiter, skipinitialspace=True), start=1):
            cells = [cell.strip() for cell in row if cell.strip()]
            if not cells or cells[0].startswith("#"):
                continue
            try:
                disparity_px, distance_m = (float(cell) for cell in cells[:2])
            except ValueError:
                if not pairs:
                    continue
                raise ValueError(f"{path}, line {number}: expected two numbers, got {','.join(row)!r}") from None
            pairs.append((disparity_px, distance_m))
    if not pairs:
        raise ValueError(f"{path}: no row with a disparity and a distance")
    table = np.array(pairs)
    return table[:, 0], table[:, 1]
