"""Eq. 7 by sums over neighbours against the frequency domain: how far apart, and how much faster.

    python benchmarks/low_pass.py                      # 640x480 and 320x240
    python benchmarks/low_pass.py --size 1280x720 --repeat 40

Peers, all the same filter with the same periodic borders, planned and warm, float32, one thread: our own transform
("frequency", realfft), NumPy's rfft2 and irfft2, OpenCV's dft and mulSpectrums. Times are medians over repetitions of
the thread's time, measured alternately; "off" is the largest difference from float64 Fourier transforms as a share of
the full scale, over noise, a checkerboard and a staircase.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable

import cv2
import numpy as np
from numpy.typing import NDArray

import epiline as ep

Singles = NDArray[np.float32]
SIGMAS = (3.0, 6.0, 12.0, 20.0, 30.0, 45.0, 60.0)


def size_of(text: str) -> tuple[int, int]:
    width, height = text.lower().split("x")
    return int(width), int(height)


def response(width: int, height: int, sigma: float) -> NDArray[np.float64]:
    """H over the half spectrum of a real transform."""
    u, v = np.fft.rfftfreq(width, 1 / width), np.fft.fftfreq(height, 1 / height)
    return np.asarray(np.exp(-(u[None, :] ** 2 + v[:, None] ** 2) / (2 * sigma**2)))


def contestants(width: int, height: int, sigma: float) -> dict[str, Callable[[Singles], Singles]]:
    fast = ep.GaussianLowPass(width, height, sigma=sigma)
    reference = ep.GaussianLowPass(width, height, sigma=sigma, method="frequency")
    ours, its, spectrum, product, theirs = (np.empty((height, width), np.float32) for _ in range(5))
    half = response(width, height, sigma).astype(np.float32)
    # OpenCV packs the half spectrum of real rows; multiplied with a real response that is packed likewise.
    impulse = np.fft.irfft2(response(width, height, sigma), (height, width)).astype(np.float32)
    packed = cv2.dft(impulse)

    def opencv(image: Singles) -> Singles:
        cv2.mulSpectrums(cv2.dft(image, spectrum), packed, 0, product)
        return np.asarray(cv2.dft(product, theirs, cv2.DFT_INVERSE | cv2.DFT_SCALE), np.float32)

    return {
        "ours": lambda image: fast(image, out=ours),
        "frequency": lambda image: reference(image, out=its),
        "numpy rfft2": lambda image: np.fft.irfft2(np.fft.rfft2(image) * half, image.shape).astype(np.float32),
        "cv2.dft": opencv,
    }


def images(width: int, height: int) -> list[Singles]:
    rng = np.random.default_rng(1)
    rows, columns = np.indices((height, width))
    return [
        rng.choice([0.0, 1.0], (height, width)).astype(np.float32),
        ((rows + columns) % 2).astype(np.float32),
        ((columns // 40) / (width // 40)).astype(np.float32),
    ]


def main() -> None:
    parser = argparse.ArgumentParser(description="Eq. 7: sums over neighbours against Fourier transforms")
    parser.add_argument("--size", type=size_of, nargs="+", default=[(640, 480), (320, 240)], metavar="WxH")
    parser.add_argument("--repeat", type=int, default=30)
    args = parser.parse_args()
    cv2.setNumThreads(1)
    for width, height in args.size:
        scenes = images(width, height)
        print(f"{width}x{height}, {ep.simd_level()}, {args.repeat} repetitions, times faster than")
        names = [name for name in contestants(width, height, 1.0) if name != "ours"]
        print(f"{'sigma':>6} {'ms':>7} {'off':>9}  " + " ".join(f"{name:>12}" for name in names))
        for sigma in SIGMAS:
            contest = contestants(width, height, sigma)
            exact = response(width, height, sigma)
            off = 0.0
            for image in scenes:
                expected = np.fft.irfft2(np.fft.rfft2(image.astype(np.float64)) * exact, image.shape)
                for name, filtered in contest.items():
                    error = float(np.abs(filtered(image) - expected).max())
                    assert error < 1e-4, f"{name} is another filter"
                    off = max(off, error) if name == "ours" else off
            times: dict[str, list[float]] = {name: [] for name in contest}
            for _ in range(args.repeat):
                for name, filtered in contest.items():
                    begin = time.thread_time()
                    filtered(scenes[0])
                    times[name].append(time.thread_time() - begin)
            ours = float(np.median(times["ours"]))
            ratios = " ".join(f"{float(np.median(times[name])) / ours:>12.1f}" for name in names)
            print(f"{sigma:>6g} {1e3 * ours:>7.2f} {off:>9.1e}  {ratios}")


if __name__ == "__main__":
    main()
