"""Equation 6: distance = a e^(bx) + c e^(dx), from measured pairs of disparity and distance."""

import numpy as np

import epiline as ep

distance_m = np.array([0.5, 0.8, 1.0, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0])
disparity_px = 60.0 / distance_m + np.random.default_rng(0).normal(0, 0.2, distance_m.size)

curve = ep.fit_range_curve(disparity_px, distance_m)
print(f"distance = {curve.a:.3g} e^({curve.b:.3g} x) + {curve.c:.3g} e^({curve.d:.3g} x)")
low, high = curve.predict_interval([40.0])
print(f"at 40 px: {curve.predict([40.0])[0]:.3f} m, 95 % between {low[0]:.3f} and {high[0]:.3f} m")
