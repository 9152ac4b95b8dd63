"""Grey, equalisation and the low-pass filter against OpenCV, NumPy and SciPy."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
import scipy.fft

import epiline as ep


def test_grey_of_every_colour_is_opencv() -> None:
    channel = np.arange(256, dtype=np.uint8)
    for blue in range(0, 256, 5):
        colours = np.empty((256, 256, 3), np.uint8)
        colours[..., 0], colours[..., 1], colours[..., 2] = blue, channel[:, None], channel
        np.testing.assert_array_equal(ep.grey(colours), cv2.cvtColor(colours, cv2.COLOR_BGR2GRAY))


def test_grey_of_grey_is_a_copy() -> None:
    image = np.arange(12, dtype=np.uint8).reshape(3, 4)
    grey = ep.grey(image)
    np.testing.assert_array_equal(grey, image)
    grey[0, 0] = 99
    assert image[0, 0] == 0


def equation_3(image: np.ndarray) -> np.ndarray:
    share = np.bincount(image.ravel(), minlength=256) / image.size
    return np.floor(255 * np.cumsum(share) + 0.5)[image].astype(np.uint8)


@pytest.mark.parametrize("shape", [(1, 1), (7, 31), (120, 160)])
@pytest.mark.parametrize("spread", [3, 20, 60])
def test_equalize_is_equation_3(shape: tuple[int, int], spread: float) -> None:
    random = np.random.default_rng(2)
    image = np.clip(random.normal(100, spread, shape), 0, 255).astype(np.uint8)
    np.testing.assert_array_equal(ep.equalize(image), equation_3(image))


def test_equalize_differs_from_opencv_only_by_the_darkest_level() -> None:
    random = np.random.default_rng(3)
    image = random.integers(40, 200, (90, 110)).astype(np.uint8)
    darkest = (image == image.min()).sum()
    # OpenCV leaves the darkest level's pixels out of count and total; put back, its values are ours.
    opencv = cv2.equalizeHist(image).astype(float)
    restored = (opencv / 255 * (image.size - darkest) + darkest) * 255 / image.size
    assert np.abs(restored - ep.equalize(image)).max() <= 1.0
    assert opencv.min() == 0
    assert ep.equalize(image).min() == round(255 * darkest / image.size)


@pytest.mark.parametrize("shape", [(1, 1), (1, 9), (7, 1), (2, 2), (33, 50)])
@pytest.mark.parametrize("cap", [1, 31, 63])
def test_xsobel_is_the_clipped_derivative(shape: tuple[int, int], cap: int) -> None:
    image = np.random.default_rng(6).integers(0, 256, shape).astype(np.uint8)
    sobel = cv2.Sobel(image, cv2.CV_16S, 1, 0, ksize=3, borderType=cv2.BORDER_REFLECT_101)
    np.testing.assert_array_equal(ep.xsobel(image, cap=cap), np.clip(sobel, -cap, cap) + cap)


@pytest.mark.parametrize("cap", [-1, 0, 64, 300])
def test_xsobel_names_a_bad_cap(cap: int) -> None:
    with pytest.raises(ValueError, match=f"cap = {cap}"):
        ep.xsobel(np.zeros((4, 4), np.uint8), cap=cap)


@pytest.mark.parametrize("shape", [(1, 1), (1, 40), (37, 1), (48, 64), (51, 64), (48, 63), (101, 97)])
@pytest.mark.parametrize("sigma", [0.5, 4.0, 30.0])
def test_low_pass_is_equation_7(shape: tuple[int, int], sigma: float) -> None:
    random = np.random.default_rng(5)
    image = random.uniform(0, 64, shape).astype(np.float32)
    v, u = (np.arange(n) - n // 2 for n in shape)
    H = np.exp(-(u[None, :] ** 2 + v[:, None] ** 2) / (2 * sigma**2))
    spectrum = scipy.fft.fftshift(scipy.fft.fft2(image.astype(np.float64)))
    expected = scipy.fft.ifft2(scipy.fft.ifftshift(spectrum * H)).real
    exact = ep.gaussian_low_pass(image, sigma=sigma, method="frequency")
    np.testing.assert_allclose(exact, expected, atol=64 * 4 * np.finfo(np.float32).eps)
    np.testing.assert_allclose(ep.gaussian_low_pass(image, sigma=sigma), expected, atol=64 * 1e-4)


@pytest.mark.parametrize("shape", [(480, 640), (240, 320)])
@pytest.mark.parametrize("sigma", [3.0, 8.0, 21.0, 45.0])
def test_fast_low_pass_is_equation_7_to_a_ten_thousandth(shape: tuple[int, int], sigma: float) -> None:
    random = np.random.default_rng(int(sigma))
    v, u = (np.arange(n) - n // 2 for n in shape)
    H = np.exp(-(u[None, :] ** 2 + v[:, None] ** 2) / (2 * sigma**2))
    for image in (random.choice([0.0, 1.0], shape), np.indices(shape).sum(axis=0) % 2, random.uniform(0, 1, shape)):
        expected = scipy.fft.ifft2(scipy.fft.fft2(image) * scipy.fft.ifftshift(H)).real
        ours = ep.gaussian_low_pass(image.astype(np.float32), sigma=sigma)
        np.testing.assert_allclose(ours, expected, atol=1e-4)


def test_low_pass_continues_periodically_and_keeps_the_mean() -> None:
    image = np.zeros((32, 48), np.float32)
    image[10, 0] = 1
    blurred = ep.gaussian_low_pass(image, sigma=6.0)
    np.testing.assert_allclose(blurred[10, 1], blurred[10, -1], rtol=1e-5)
    np.testing.assert_allclose(blurred.mean(), image.mean(), rtol=1e-5)


@pytest.mark.parametrize("sigma", [0.0, -1.0, np.nan, np.inf])
def test_low_pass_refuses_a_sigma_that_is_none(sigma: float) -> None:
    with pytest.raises(ValueError, match=r"sigma = .* frequency samples"):
        ep.gaussian_low_pass(np.zeros((4, 4), np.float32), sigma=sigma)
    with pytest.raises(ValueError, match="method = 'fast'"):
        ep.gaussian_low_pass(np.zeros((4, 4), np.float32), sigma=1.0, method="fast")  # type: ignore[arg-type]


def test_low_pass_names_the_pixel_that_is_not_finite() -> None:
    image = np.zeros((4, 5), np.float32)
    image[1, 3] = np.nan
    with pytest.raises(ValueError, match=r"NaN at \(3, 1\)"):
        ep.gaussian_low_pass(image, sigma=2.0)


@pytest.mark.parametrize(
    "wrong", [np.zeros((4, 4)), np.zeros((4, 4, 4), np.uint8), np.zeros(4, np.uint8), np.zeros((0, 3), np.uint8)]
)
def test_wrong_arrays_are_refused(wrong: np.ndarray) -> None:
    for operation in (ep.grey, ep.equalize):
        with pytest.raises(ValueError, match="image"):
            operation(wrong)
    with pytest.raises(ValueError, match="image"):
        ep.gaussian_low_pass(wrong, sigma=1.0)  # type: ignore[arg-type]
