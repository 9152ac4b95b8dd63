"""Ranges against NumPy and OpenCV, the range curve against SciPy."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import stats
from scipy.optimize import curve_fit, least_squares

import epiline as ep

Floats = NDArray[np.float64]


@pytest.fixture
def geometry() -> ep.RectifiedGeometry:
    return ep.RectifiedGeometry(width=53, height=31, focal_px=412.5, cx_px=25.3, cy_px=14.8, baseline_m=0.117)


@pytest.fixture
def disparity() -> ep.DisparityMap:
    rng = np.random.default_rng(3)
    raw = rng.integers(1, 64 * 16, (31, 53)).astype(np.uint16)
    validity = np.where(rng.random((31, 53)) < 0.3, 1 << rng.integers(0, 7, (31, 53)), 0).astype(np.uint8)
    return ep.DisparityMap(raw, validity, num_disparities=64)


def test_depth_and_range_are_what_opencv_reprojects_to(
    geometry: ep.RectifiedGeometry, disparity: ep.DisparityMap
) -> None:
    result = ep.to_range(disparity, geometry, disparity_sigma_px=0.2)
    valid = disparity.validity == 0
    points = cv2.reprojectImageTo3D(disparity.raw.astype(np.float32) / 16, geometry.Q.astype(np.float32))[valid]
    assert result.depth_m.dtype == np.float32
    np.testing.assert_allclose(result.depth_m[valid], points[:, 2], rtol=2e-6)
    np.testing.assert_allclose(result.range_m[valid], np.linalg.norm(points, axis=1), rtol=2e-6)
    np.testing.assert_allclose(result.points(), points, rtol=2e-5, atol=1e-6)
    z = points[:, 2].astype(np.float64)
    sigma_m = z**2 * 0.2 / (412.5 * 0.117) * np.linalg.norm(points, axis=1) / z
    np.testing.assert_allclose(result.sigma_m[valid], sigma_m, rtol=1e-5)
    for image in (result.depth_m, result.range_m, result.sigma_m):
        assert np.isnan(image[~valid]).all()
    np.testing.assert_array_equal(result.validity, disparity.validity)


def test_points_carry_the_colour_of_their_pixel(geometry: ep.RectifiedGeometry, disparity: ep.DisparityMap) -> None:
    rng = np.random.default_rng(5)
    bgr = rng.integers(0, 256, (31, 53, 3), dtype=np.uint8)
    valid = disparity.validity == 0
    points = ep.to_range(disparity, geometry).points(bgr)
    assert points.shape == (valid.sum(), 6)
    np.testing.assert_array_equal(points[:, 3:], bgr[valid][:, ::-1])
    grey = ep.to_range(disparity, geometry).points(bgr[:, :, 0])
    np.testing.assert_array_equal(grey[:, 3:], np.repeat(bgr[valid][:, :1], 3, axis=1))
    with pytest.raises(ValueError, match=r"\(31, 53, 3\)"):
        ep.to_range(disparity, geometry).points(bgr[1:])
    with pytest.raises(ValueError, match="uint8"):
        ep.to_range(disparity, geometry).points(bgr.astype(np.float32))


def test_the_calibrations_uncertainty_adds_to_sigma(disparity: ep.DisparityMap) -> None:
    with pytest.raises(ValueError, match="53x31"):
        ep.to_range(
            disparity,
            ep.RectifiedGeometry(width=52, height=31, focal_px=400, cx_px=25, cy_px=15, baseline_m=0.1),
        )
    whole = ep.RectifiedGeometry(width=53, height=31, focal_px=400, cx_px=25, cy_px=15, baseline_m=0.1)
    with pytest.raises(ValueError, match="disparity_sigma_px = -1 px"):
        ep.to_range(disparity, whole, disparity_sigma_px=-1)


def test_sigma_by_confidence_is_the_equation_with_each_pixels_own() -> None:
    rng = np.random.default_rng(8)
    raw = np.full((60, 80), 20 * 16, np.uint16)
    raw[:, 40:] = rng.integers(100, 600, (60, 40))
    validity = np.where(rng.random((60, 80)) < 0.05, 4, 0).astype(np.uint8)
    disparity = ep.DisparityMap(raw, validity, num_disparities=64)
    geometry = ep.RectifiedGeometry(width=80, height=60, focal_px=412.5, cx_px=39.3, cy_px=28.8, baseline_m=0.117)
    result = ep.to_range(disparity, geometry)
    known = validity == 0
    fb, z = 412.5 * 0.117, result.depth_m.astype(np.float64)
    with np.errstate(invalid="ignore"):
        sigma_px = result.sigma_m / (result.range_m / z) * fb / z**2
    confidence = disparity.confidence
    assert np.isfinite(result.sigma_m[known]).all()
    assert np.isnan(result.sigma_m[~known]).all()
    # One value for each confidence, smaller for larger ones; full confidence and none as documented.
    levels = np.unique(confidence[known])
    mean = np.array([sigma_px[known & (confidence == level)].mean() for level in levels])
    spread = np.array([np.ptp(sigma_px[known & (confidence == level)]) for level in levels])
    assert levels.size > 20
    assert (spread < 1e-5 * mean).all()
    assert (np.diff(mean) < 0).all()
    assert 0.15 * (1 - 1e-6) <= mean[-1] < 0.5 < mean[0] <= 1.95 * (1 + 1e-6)
    np.testing.assert_array_equal(result.range_m, ep.to_range(disparity, geometry, disparity_sigma_px=0.2).range_m)


def test_useful_depth_is_where_the_ranges_sigma_reaches_its_share() -> None:
    geometry = ep.RectifiedGeometry(width=640, height=480, focal_px=500, cx_px=320, cy_px=240, baseline_m=0.12)
    assert ep.useful_depth_m(geometry, 0.1) == pytest.approx(0.1 * 500 * 0.12 / 0.25)
    assert ep.useful_depth_m(geometry, 0.1, disparity_sigma_px=0.5) == pytest.approx(0.1 * 500 * 0.12 / 0.5)
    assert ep.useful_depth_m(geometry, 0.1, disparity_sigma_px=0) == np.inf
    for bad in (0.0, -1.0, np.nan):
        with pytest.raises(ValueError, match="share = "):
            ep.useful_depth_m(geometry, bad)
    with pytest.raises(ValueError, match="disparity_sigma_px = -1 px"):
        ep.useful_depth_m(geometry, 0.1, disparity_sigma_px=-1)


# ---- the curve of eq. 6 ------------------------------------------------------------------------


def curve(p: Floats, x: Floats) -> Floats:
    return np.asarray(p[0] * np.exp(p[1] * x) + p[2] * np.exp(p[3] * x))


def tables(count: int, seed: int) -> list[tuple[Floats, Floats]]:
    """Noisy tables: two exponentials of either sign, 1/x as a real rig gives, a single exponential."""
    rng = np.random.default_rng(seed)
    found = []
    for kind in range(count):
        n = int(rng.integers(6, 40))
        x = np.sort(rng.uniform(1, 60, n)) if kind % 2 else np.linspace(3, 45, n)
        if kind % 4 == 0:
            p = [rng.uniform(1, 8), -rng.uniform(0.02, 0.5), rng.uniform(0.3, 4), -rng.uniform(0.001, 0.05)]
            y = curve(np.array(p), x)
        elif kind % 4 == 1:
            y = rng.uniform(10, 60) / x
        elif kind % 4 == 2:
            y = rng.uniform(1, 5) * np.exp(-rng.uniform(0.02, 0.1) * x)
        else:
            p = [rng.uniform(2, 8), -rng.uniform(0.02, 0.3), -rng.uniform(0.3, 2), -rng.uniform(0.001, 0.05)]
            y = curve(np.array(p), x)
        found.append((x, y + rng.normal(0, rng.choice([1e-3, 0.01, 0.05, 0.2]), n)))
    return found


def best_of_scipy(x: Floats, y: Floats, starts: int, rng: np.random.Generator) -> float:
    def residual(p: Floats) -> Floats:
        r = curve(p, x) - y
        return np.where(np.isfinite(r), r, 1e150)

    def jacobian(p: Floats) -> Floats:
        e, g = np.exp(p[1] * x), np.exp(p[3] * x)
        return np.nan_to_num(np.stack([e, p[0] * x * e, g, p[2] * x * g], axis=1), posinf=1e150, neginf=-1e150)

    best = np.inf
    with np.errstate(all="ignore"):
        for _ in range(starts):
            start = rng.normal(0, [5, 0.3, 5, 0.3])
            fit = least_squares(
                residual, start, jacobian, method="lm", xtol=1e-15, ftol=1e-15, gtol=1e-15, max_nfev=1000
            )
            best = min(best, float(np.sum(residual(fit.x) ** 2)))
    return best


def test_no_start_of_scipy_finds_a_smaller_sum_of_squares() -> None:
    rng = np.random.default_rng(11)
    for x, y in tables(30, seed=2026):
        ours = ep.fit_range_curve(x, y)
        with np.errstate(under="ignore"):
            squares = np.sum((curve(np.array([ours.a, ours.b, ours.c, ours.d]), x) - y) ** 2)
        assert squares <= best_of_scipy(x, y, starts=20, rng=rng) * (1 + 1e-9)
        assert ours.rmse_m == pytest.approx(np.sqrt(squares / x.size))
        assert ours.r_squared == pytest.approx(1 - squares / np.sum((y - y.mean()) ** 2))
        assert ours.span_px == (x.min(), x.max())


def test_errors_and_intervals_are_those_of_scipys_covariance() -> None:
    rng = np.random.default_rng(4)
    x = np.linspace(4, 50, 24)
    truth = np.array([6.0, -0.19, 2.0, -0.015])
    y = curve(truth, x) + rng.normal(0, 0.02, x.size)
    ours = ep.fit_range_curve(x, y)

    def model(x: Floats, a: float, b: float, c: float, d: float) -> Floats:
        return curve(np.array([a, b, c, d]), x)

    best, covariance = curve_fit(model, x, y, p0=truth)
    np.testing.assert_allclose([ours.a, ours.b, ours.c, ours.d], best, rtol=1e-5)
    np.testing.assert_allclose(ours.covariance, covariance, rtol=2e-3, atol=1e-12)
    np.testing.assert_allclose(ours.standard_errors, np.sqrt(np.diag(covariance)), rtol=1e-3)
    at = np.array([[5.0, 17.0], [33.0, 48.0]])
    e, g = np.exp(best[1] * at), np.exp(best[3] * at)
    gradient = np.stack([e, best[0] * at * e, g, best[2] * at * g], axis=-1)
    variance = np.sum((y - model(x, *best)) ** 2) / 20 + np.einsum("...i,ij,...j", gradient, covariance, gradient)
    for confidence in (0.5, 0.95, 0.999):
        half = stats.t.ppf(0.5 + confidence / 2, 20) * np.sqrt(variance)
        low, high = ours.predict_interval(at, confidence=confidence)
        assert low.shape == high.shape == (2, 2)
        np.testing.assert_allclose(high - low, 2 * half, rtol=2e-3)
        np.testing.assert_allclose((low + high) / 2, ours.predict(at), rtol=1e-9)


def test_students_t_is_scipys() -> None:
    """The half-width of an interval far from all uncertainty but the residual's is t times the residual's sigma."""
    for n in (5, 6, 9, 30, 103):
        x = np.linspace(2, 40, n)
        y = 5 * np.exp(-0.1 * x) + np.where(np.arange(n) % 2, 1e-3, -1e-3)
        ours = ep.fit_range_curve(x, y)
        widths = [np.ptp(ours.predict_interval(20.0, confidence=c)) for c in (0.3, 0.9, 0.99, 0.9999)]
        ratios = stats.t.ppf(0.5 + np.array([0.3, 0.9, 0.99, 0.9999]) / 2, n - 4)
        np.testing.assert_allclose(np.array(widths) / widths[0], ratios / ratios[0], rtol=1e-8)


def test_predictions_keep_the_shape_of_their_argument() -> None:
    x = np.linspace(2, 40, 12)
    ours = ep.fit_range_curve(x.tolist(), (5 * np.exp(-0.1 * x) + 1).tolist())
    assert ours.predict(7.0).shape == ()
    assert float(ours.predict(7.0)) == pytest.approx(5 * np.exp(-0.7) + 1)
    assert ours.predict(np.full((2, 3, 4), 5.0)[:, ::2]).shape == (2, 2, 4)


def test_outside_the_fitted_span_a_prediction_warns() -> None:
    x = np.linspace(2, 40, 12)
    ours = ep.fit_range_curve(x, 5 * np.exp(-0.1 * x) + 1)
    ours.predict(ours.span_px)
    for outside in (1.9, 41.0, [3.0, 50.0, 60.0]):
        first = next(v for v in np.atleast_1d(outside) if not 2 <= v <= 40)
        with pytest.warns(UserWarning, match=f"disparity_px = {first:g} px: .* fitted to 2 to 40 px"):
            ours.predict(outside)
        with pytest.warns(UserWarning, match="fitted to 2 to 40 px"):
            ours.predict_interval(outside)


def contaminated(rng: np.random.Generator, count: int, wrong: int) -> tuple[Floats, Floats, NDArray[np.int64]]:
    """A curve with noise of 2 cm, and some distances off by half a metre or more; not at the ends of the span."""
    x = np.linspace(4, 50, count)
    p = [rng.uniform(2, 8), -rng.uniform(0.05, 0.3), rng.uniform(0.5, 3), -rng.uniform(0.005, 0.03)]
    y = curve(np.array(p), x) + rng.normal(0, 0.02, count)
    places = np.sort(rng.choice(np.arange(3, count - 3), wrong, replace=False))
    y[places] += rng.choice([-1, 1], wrong) * rng.uniform(0.5, 3, wrong)
    return x, y, places


def test_a_robust_fit_names_the_outliers_and_is_the_fit_of_the_rest() -> None:
    rng = np.random.default_rng(6)
    exact = 0
    for _ in range(40):
        x, y, wrong = contaminated(rng, 24, int(rng.integers(1, 5)))
        ours = ep.fit_range_curve(x, y, robust=True)
        assert set(wrong) <= set(ours.outliers.tolist())
        exact += ours.outliers.size == wrong.size
        kept = np.setdiff1d(np.arange(x.size), ours.outliers)
        rest = ep.fit_range_curve(x[kept], y[kept])
        assert (ours.a, ours.b, ours.c, ours.d) == (rest.a, rest.b, rest.c, rest.d)
        assert ours.samples == kept.size
        assert ours.rmse_m < 0.03
    assert exact >= 32


def test_a_robust_fit_of_good_data_is_the_plain_fit() -> None:
    rng = np.random.default_rng(9)
    same = 0
    for _ in range(40):
        x, y, _ = contaminated(rng, 24, 0)
        plain, robust = ep.fit_range_curve(x, y), ep.fit_range_curve(x, y, robust=True)
        same += robust.outliers.size == 0 and (plain.a, plain.d) == (robust.a, robust.d)
        assert robust.outliers.size <= 3
    assert same >= 32
    exact = np.linspace(3, 40, 12)
    assert ep.fit_range_curve(exact, 5 * np.exp(-0.1 * exact) + 1, robust=True).outliers.size == 0


@pytest.mark.parametrize(
    ("x", "y", "error", "message"),
    [
        ([1, 2, 3, 4], [1, 2, 3, 4], ValueError, "4 given, at least 5"),
        ([1, 2, 3, 4, 5], [1, 2, 3, 4], ValueError, "4 values"),
        ([1, 2, np.inf, 4, 5], [1, 2, 3, 4, 5], ValueError, "disparity_px = inf px"),
        ([1, 2, 3, 4, 5], [1, 2, np.nan, 4, 5], ValueError, "distance_m = NaN m"),
        ([3, 3, 3, 3, 3], [1, 2, 3, 4, 5], ep.Error, "all disparities are equal"),
        ([3, 3, 4, 4, 5], [1, 2, 3, 4, 5], ep.Error, "3 different disparities"),
        (["a"], [1], ValueError, "disparity_px: expected numbers"),
    ],
)
def test_tables_that_cannot_be_fitted(x: object, y: object, error: type[Exception], message: str) -> None:
    with pytest.raises(error, match=message):
        ep.fit_range_curve(x, y)  # type: ignore[arg-type]
