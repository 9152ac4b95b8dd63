"""One aligned pair to disparity: the smallest program. Here the pair is rendered; bring your own instead."""

import numpy as np

import epiline as ep

# A textured plane 8 pixels of disparity away.
rng = np.random.default_rng(0)
texture = rng.integers(0, 256, (120, 200), dtype=np.uint8)
left, right = texture[:, :160], texture[:, 8:168]

disparity = ep.match(left, right, num_disparities=32, block_size=9)
print(
    f"median disparity {np.nanmedian(disparity.values):.2f} px, {100 * disparity.density:.0f} % of the pixels answered"
)
