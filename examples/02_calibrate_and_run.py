"""Board photographs to a rig, then pairs to obstacles. The rendered rig stands in for two cameras."""

import math

import epiline as ep
from epiline.sources.rendered import RenderedRig

rendered = RenderedRig(seed=1, size=(320, 240))
board = ep.Chessboard(columns=9, rows=6, square_m=0.04)
views = list(rendered.board_views(board.columns, board.rows, board.square_m, count=8))
observations = ep.find_boards([v.left for v in views], [v.right for v in views], board)
rig = ep.calibrate(observations)
print(f"baseline {1e3 * rig.baseline_m:.2f} mm (truth {1e3 * rendered.truth.baseline_m:.2f} mm)")
print(f"held-out epipolar error {rig.epipolar_error_px:.3f} px")

matcher = ep.StereoMatcher(num_disparities=48, block_size=9, left_right_max_diff=1, uniqueness_ratio=10)
pipeline = ep.Pipeline(rig, matcher=matcher)
for frame in rendered.frames(2):
    for obstacle in pipeline.process(frame.left, frame.right).obstacles:
        bearing = math.degrees(obstacle.bearing_rad)
        print(f"frame {frame.seq}: {obstacle.range_m:.2f} ± {obstacle.sigma_m:.2f} m at {bearing:+.0f}°")
