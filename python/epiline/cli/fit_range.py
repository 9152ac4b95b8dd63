"""`epiline fit-range`: the paper's curve from a table of measured pairs."""

from __future__ import annotations

import argparse
import csv
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from epiline._core import fit_range_curve
from epiline.cli.console import print_json, print_table, say


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "table", type=Path, help="CSV with a disparity (px) and a distance (m) in each row; a header is skipped"
    )
    parser.add_argument("--report", type=Path, metavar="HTML", help="write the curve with its points and 95 %% band")
    parser.add_argument("--json", action="store_true", help="print one JSON object")


def run(args: argparse.Namespace) -> None:
    disparity_px, distance_m = read_table(args.table)
    curve = fit_range_curve(disparity_px, distance_m)
    if args.report:
        from epiline.cli.reporting import write_curve_report

        write_curve_report(args.report, curve, disparity_px, distance_m)
    residual_m = distance_m - curve.predict(disparity_px)
    if args.json:
        span = list(curve.span_px)
        figures = {name: getattr(curve, name) for name in ("a", "b", "c", "d", "rmse_m", "r_squared")}
        print_json({**figures, "span_px": span, "points": len(disparity_px), "residual_m": residual_m.tolist()})
        return
    say(f"distance = {curve.a:.6g} e^({curve.b:.6g} x) + {curve.c:.6g} e^({curve.d:.6g} x)   x: disparity, px")
    say(
        f"rmse {curve.rmse_m:.4g} m, R² {curve.r_squared:.6f}, "
        f"fitted over {curve.span_px[0]:g} to {curve.span_px[1]:g} px"
    )
    low, high = curve.predict_interval(disparity_px)
    rows = [
        (f"{x:g}", f"{z:.3f}", f"{z - r:.3f}", f"{r:+.3f}", f"{a:.3f} to {b:.3f}")
        for x, z, r, a, b in zip(disparity_px, distance_m, residual_m, low, high, strict=True)
    ]
    print_table("", ("disparity px", "measured m", "curve m", "residual m", "95 % interval m"), rows)


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
