"""Tracks, held to NumPy's Kalman filter, SciPy's assignment, and simulated runs whose truth is known."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

import epiline as ep
from epiline._core import assignment

Floats = NDArray[np.float64]
STEP_NANOS = 100_000_000
CHI2_95, CHI2_99 = 5.991, 9.210


def detection(x_m: float, z_m: float, sigma_m: float = 0.05, **more: object) -> ep.Detection:
    """Something at the camera's height."""
    return ep.Detection(float(np.hypot(x_m, z_m)), float(np.arctan2(x_m, z_m)), sigma_m, **more)  # type: ignore[arg-type]


# ---- assignment --------------------------------------------------------------------------------


def test_assignments_cost_what_scipys_cost() -> None:
    optimize = pytest.importorskip("scipy.optimize")
    random = np.random.default_rng(0)
    for _ in range(300):
        rows, columns = random.integers(0, 13, 2)
        costs = np.round(random.uniform(-5, 15, (rows, columns)), random.integers(0, 3))
        costs[random.uniform(size=costs.shape) < 0.4] = np.inf
        miss = 9.0
        # A private column per row; SciPy needs something finite where a pair is forbidden.
        private = np.where(np.eye(rows, dtype=bool), miss, 1e6)
        padded = np.hstack([np.where(np.isinf(costs), 1e6, costs), private])
        best = padded[optimize.linear_sum_assignment(padded)].sum()
        solution = assignment(costs, miss)
        given = [column for column in solution if column is not None]
        assert len(given) == len(set(given))
        found = sum(miss if column is None else costs[row, column] for row, column in enumerate(solution))
        assert found == pytest.approx(best)


def test_the_cheapest_pair_first_would_lose_a_track() -> None:
    """Why not greedy: it takes 0–0 at 1 and leaves row 1 without a column."""
    assert assignment(np.array([[1.0, 2.0], [1.5, np.inf]]), 10.0) == [1, 0]


def test_costs_must_be_numbers() -> None:
    with pytest.raises(ValueError, match="costs"):
        assignment(np.array([[np.nan]]), 1.0)
    with pytest.raises(ValueError, match="miss_cost"):
        assignment(np.array([[1.0]]), float("inf"))


# ---- the filter --------------------------------------------------------------------------------


def kalman(seen: list[tuple[float, float, float] | None], dt_s: float, walk: float, initial: float, bearing: float):
    """Every frame's state and covariance by the textbook, from (range, bearing, sigma) or None."""
    state = covariance = None
    for one in seen:
        if state is not None:
            f = np.eye(4)
            f[0, 2] = f[1, 3] = dt_s
            block = walk**2 * np.array([[dt_s**3 / 3, dt_s**2 / 2], [dt_s**2 / 2, dt_s]])
            q = np.kron(block, np.eye(2))
            state, covariance = f @ state, f @ covariance @ f.T + q
        if one is not None:
            range_m, bearing_rad, sigma_m = one
            z = range_m * np.array([np.sin(bearing_rad), np.cos(bearing_rad)])
            turn = np.array([[np.sin(bearing_rad), np.cos(bearing_rad)], [np.cos(bearing_rad), -np.sin(bearing_rad)]]).T
            r = turn @ np.diag([sigma_m**2, (range_m * bearing) ** 2]) @ turn.T
            if state is None:
                state, covariance = np.r_[z, 0, 0], np.zeros((4, 4))
                covariance[:2, :2], covariance[2:, 2:] = r, np.eye(2) * initial**2
            else:
                h = np.eye(2, 4)
                gain = covariance @ h.T @ np.linalg.inv(h @ covariance @ h.T + r)
                state = state + gain @ (z - h @ state)
                covariance = (np.eye(4) - gain @ h) @ covariance
        yield state, covariance


def test_a_track_is_the_textbooks_kalman_filter() -> None:
    random = np.random.default_rng(1)
    seen: list[tuple[float, float, float] | None] = []
    for k in range(30):
        x, z = -2 + 0.1 * k, 12 - 0.15 * k
        noisy = (np.hypot(x, z) + random.normal(0, 0.05), np.arctan2(x, z) + random.normal(0, 0.003), 0.05)
        # Missed once, as a dropped frame or a hidden obstacle would be.
        seen.append(None if k == 12 else noisy)
    tracker = ep.Tracker(velocity_walk_mps=1.5, initial_velocity_mps=4.0, bearing_sigma_rad=0.004, extent_share=0.0)
    expected = kalman(seen, 0.1, 1.5, 4.0, 0.004)
    for k, (one, (state, covariance)) in enumerate(zip(seen, expected, strict=True)):
        (track,) = tracker.update([] if one is None else [ep.Detection(*one)], k * STEP_NANOS)
        np.testing.assert_allclose([*track.position_m, *track.velocity_mps], state, atol=1e-9)
        np.testing.assert_allclose(track.covariance, covariance, atol=1e-9)
        assert track.misses == (k == 12)
    assert track.hits == 29
    assert track.age_s == pytest.approx(2.9)


def simulate(seed: int, walk: float, initial: float, bearing: float, frames: int = 40) -> tuple[list, Floats]:
    """A run drawn from the tracker's own model: detections and true states, with range sigmas as stereo's."""
    random = np.random.default_rng(seed)
    dt = STEP_NANOS * 1e-9
    state = np.r_[random.uniform(-4, 4), random.uniform(15, 25), random.normal(0, initial, 2)]
    block = walk**2 * np.array([[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]])
    root = np.linalg.cholesky(np.kron(block, np.eye(2)))
    f = np.eye(4)
    f[0, 2] = f[1, 3] = dt
    seen, states = [], []
    for _ in range(frames):
        range_m, angle = np.hypot(*state[:2]), np.arctan2(state[0], state[1])
        sigma = 0.002 * range_m**2
        noisy_range, noisy_angle = range_m + random.normal(0, sigma), angle + random.normal(0, bearing)
        if noisy_range < 1 or abs(noisy_angle) > 1.2:
            break
        seen.append(ep.Detection(noisy_range, noisy_angle, sigma))
        states.append(state)
        state = f @ state + root @ random.normal(size=4)
    return seen, np.array(states)


def test_surprises_and_errors_are_as_large_as_their_sigmas() -> None:
    """NIS and NEES over 120 runs: 95 % inside the chi-square quantile, means inside their 95 % bounds."""
    walk, initial, bearing = 1.0, 2.0, 0.005
    surprises: list[float] = []
    errors: list[float] = []
    for seed in range(120):
        seen, states = simulate(seed, walk, initial, bearing)
        # A gate that lets everything through: what it cuts off would flatter the statistics.
        tracker = ep.Tracker(
            velocity_walk_mps=walk,
            initial_velocity_mps=initial,
            bearing_sigma_rad=bearing,
            extent_share=0.0,
            gate_probability=1 - 1e-9,
        )
        for k, (one, state) in enumerate(zip(seen, states, strict=True)):
            (track,) = tracker.update([one], k * STEP_NANOS)
            error = np.r_[track.position_m, track.velocity_mps] - state
            errors.append(float(error @ np.linalg.solve(track.covariance, error)))
            if k:
                surprises.append(track.surprise)
    assert len(surprises) > 3500
    assert np.mean(surprises) == pytest.approx(2, abs=1.96 * 2 / np.sqrt(len(surprises)) * 1.5)
    assert np.mean(np.array(surprises) < CHI2_95) == pytest.approx(0.95, abs=0.01)
    # A run's errors hang together: its mean counts, not each.
    assert np.mean(errors) == pytest.approx(4, abs=0.25)
    assert np.mean(np.array(errors) < 9.488) == pytest.approx(0.95, abs=0.015)


def test_the_gate_follows_sigma() -> None:
    """The same jump of 0.6 m is another thing 3 m away, and the same thing 20 m away."""
    for z_m, sigma_m, is_same in ((3.0, 0.02, False), (20.0, 0.6, True)):
        tracker = ep.Tracker(velocity_walk_mps=0.5, initial_velocity_mps=0.5)
        for k in range(20):
            (track,) = tracker.update([detection(0, z_m, sigma_m)], k * STEP_NANOS)
        after = tracker.update([detection(0, z_m + 0.6, sigma_m)], 20 * STEP_NANOS)
        assert (len(after) == 1) is is_same
        assert after[0].id == track.id
        assert (after[0].misses == 0) is is_same


# ---- frames ------------------------------------------------------------------------------------


def test_things_that_cross_keep_their_ids() -> None:
    tracker = ep.Tracker()
    ids = []
    for k in range(41):
        t = 0.1 * k
        # Walking past each other, 0.5 m apart at the closest; handed over in either order.
        pair = [detection(-2 + t, 6.0), detection(2 - t, 6.5)]
        tracks = tracker.update(pair if k % 2 else pair[::-1], k * STEP_NANOS)
        of = {track.obstacle: track.id for track in tracks}
        ids.append((of[0], of[1]) if k % 2 else (of[1], of[0]))
    assert set(ids) == {ids[0]}
    for track in tracks:
        assert abs(track.velocity_mps[0]) == pytest.approx(1, abs=0.1)
        assert track.velocity_mps[1] == pytest.approx(0, abs=0.15)
        assert track.confirmed


def test_the_same_frames_give_the_same_tracks() -> None:
    random = np.random.default_rng(5)
    frames = [
        [detection(*random.uniform([-5, 3], [5, 20]), random.uniform(0.02, 0.5)) for _ in range(random.integers(0, 12))]
        for _ in range(60)
    ]
    runs = []
    for _ in range(2):
        tracker = ep.Tracker()
        runs.append([[repr(t) for t in tracker.update(f, k * STEP_NANOS)] for k, f in enumerate(frames)])
    assert runs[0] == runs[1]


def test_a_mismatch_of_one_frame_is_never_confirmed() -> None:
    random = np.random.default_rng(2)
    tracker = ep.Tracker()
    for k in range(200):
        stray = detection(random.uniform(-20, 20), random.uniform(4, 60), 0.05)
        tracks = tracker.update([detection(0, 5), stray], k * STEP_NANOS)
        assert [t.id for t in tracks if t.confirmed] == ([0] if k >= 2 else [])


def test_confirmation_is_k_of_n_and_ends_after_misses() -> None:
    tracker = ep.Tracker(confirm_hits=3, confirm_window=5, max_misses=2)
    pattern = [True, False, True, False, True, False, False, False]
    states = []
    for k, is_seen in enumerate(pattern):
        tracks = tracker.update([detection(0, 5)] if is_seen else [], k * STEP_NANOS)
        states.append(tracks[0].confirmed if tracks else None)
    assert states == [False, False, False, False, True, True, True, None]
    # Two of five cannot become three of five after a third miss.
    tracker = ep.Tracker(confirm_hits=3, confirm_window=5)
    alive = [len(tracker.update([detection(0, 5)] if k < 2 else [], k * STEP_NANOS)) for k in range(6)]
    assert alive == [1, 1, 1, 1, 0, 0]


def test_dropped_repeated_and_backward_stamps() -> None:
    tracker = ep.Tracker(max_gap_s=0.5)
    assert tracker.continuity is None
    velocity_mps = 2.0
    stamps = [0, 1, 2, 3, 5, 6, 9]
    for k in stamps:
        (track,) = tracker.update([detection(0, 20 - velocity_mps * 0.1 * k)], k * STEP_NANOS)
    assert tracker.continuity == "advanced"
    assert track.velocity_mps[1] == pytest.approx(-velocity_mps, abs=0.1)
    assert track.hits == len(stamps)
    (again,) = tracker.update([detection(3, 4)], 9 * STEP_NANOS)
    assert tracker.continuity == "repeated"
    assert again == track
    (fresh,) = tracker.update([detection(0, 18)], 8 * STEP_NANOS)
    assert tracker.continuity == "backward"
    assert (fresh.id, fresh.hits, fresh.age_s) == (track.id + 1, 1, 0)
    (later,) = tracker.update([detection(0, 18)], 14 * STEP_NANOS)
    assert tracker.continuity == "gap"
    assert later.id == fresh.id + 1
    # The ends of the clock are no more than far apart.
    tracker.update([detection(0, 18)], -(2**63))
    assert tracker.continuity == "backward"
    tracker.update([detection(0, 18)], 2**63 - 1)
    assert tracker.continuity == "gap"


def test_parts_of_one_thing_are_one_track() -> None:
    """A car that falls into two boxes side by side, or is found in two regions, stays one."""
    tracker = ep.Tracker()
    whole = detection(0, 8, 0.1, width_m=1.8, support=900, box=(100, 80, 90, 60))
    for k in range(6):
        tracks = tracker.update([whole], k * STEP_NANOS)
    left = detection(-0.4, 8, 0.1, width_m=1.0, support=500, box=(100, 80, 50, 60))
    right = detection(0.55, 8.05, 0.1, width_m=0.7, support=300, box=(155, 80, 35, 60))
    lower = detection(0.1, 8.1, 0.1, width_m=1.5, support=200, box=(105, 142, 70, 20))
    tracks = tracker.update([lower, right, left], 6 * STEP_NANOS)
    assert [t.id for t in tracks] == [0]
    assert tracks[0].misses == 0
    tracks = tracker.update([whole], 7 * STEP_NANOS)
    assert [t.id for t in tracks] == [0]


def test_two_that_merge_for_a_moment_come_out_as_they_were() -> None:
    tracker = ep.Tracker()
    for k in range(10):
        first, second = (detection(x, 8, 0.1, width_m=0.5) for x in (-0.6, 0.6))
        tracker.update([first, second], k * STEP_NANOS)
    for k in range(10, 13):
        tracks = tracker.update([detection(-0.5, 8, 0.1, width_m=1.7)], k * STEP_NANOS)
        assert [t.id for t in tracks] == [0, 1]
    for k in range(13, 16):
        tracks = tracker.update([second, first], k * STEP_NANOS)
    assert {t.id: t.obstacle for t in tracks} == {0: 1, 1: 0}


def test_with_the_cameras_motion_velocities_are_over_the_ground() -> None:
    """A camera that drives 1 m and turns 0.02 rad to the right a frame past something that stands still."""
    still, heading, camera = np.array([2.0, 40.0]), 0.0, np.zeros(2)
    tracker = ep.Tracker(velocity_walk_mps=0.3)
    motion = None
    for k in range(25):
        cos, sin = np.cos(heading), np.sin(heading)
        seen = np.array([[cos, -sin], [sin, cos]]) @ (still - camera)
        (track,) = tracker.update([detection(*seen)], k * STEP_NANOS, ego_motion=motion or (0, 0, 0))
        motion = (0.0, 1.0, 0.02)
        camera = camera + np.array([np.sin(heading), np.cos(heading)])
        heading += 0.02
    assert track.hits == 25
    assert np.hypot(*track.velocity_mps) < 0.1
    np.testing.assert_allclose(track.position_m, seen, atol=0.02)


def test_a_camera_that_drives_past_things_that_stand_knows_its_speed() -> None:
    """40 things along a street, three that drive; 1.2 m a frame, all that is seen noisy and some of it strays."""
    random = np.random.default_rng(4)
    street = np.stack([random.choice([-4, 4], 40) + random.normal(0, 0.6, 40), random.uniform(5, 90, 40)], axis=-1)
    sizes = random.uniform([0.3, 0.8], [2.0, 2.5], (40, 2))
    tracker = ep.Tracker(scene_stands_still=True, initial_velocity_mps=2.0)
    for k in range(30):
        seen = []
        for (x, z), (width, height) in zip(street - [0, 1.2 * k], sizes, strict=True):
            if 4 < z < 35 and random.uniform() < 0.85:
                sigma = 0.001 * z**2
                seen.append(
                    detection(x, z + random.normal(0, sigma), sigma, width_m=width, height_m=height, box=(0, 0, 0, 0))
                )
        seen += [detection(random.uniform(-6, 6), random.uniform(5, 35), 0.1, width_m=1, height_m=1) for _ in range(3)]
        tracks = tracker.update(seen, k * STEP_NANOS)
        if k >= 15:
            known = [t for t in tracks if t.confirmed and t.hits >= 6 and t.misses == 0]
            speeds = [np.hypot(*track.velocity_mps) for track in known]
            assert len(known) >= 5
            # Of 12 m/s that everything comes nearer with.
            assert np.median(speeds) < 1.2, k
    assert np.median([track.velocity_mps[1] for track in known]) == pytest.approx(0, abs=1.0)


# ---- the interface -----------------------------------------------------------------------------


def test_obstacles_are_detections() -> None:
    geometry = ep.RectifiedGeometry(width=320, height=240, focal_px=300, cx_px=159.5, cy_px=119.5, baseline_m=0.12)
    raw = np.zeros((240, 320), np.uint16)
    raw[60:200, 100:180] = 16 * 12
    (obstacle,) = ep.find_obstacles(ep.DisparityMap(raw, np.where(raw, 0, 16).astype(np.uint8)), geometry)
    (track,) = ep.Tracker(extent_share=0.0).update([obstacle], 0)
    assert track.range_m == pytest.approx(obstacle.range_m)
    assert track.sigma_m == pytest.approx(obstacle.sigma_m, rel=1e-3)
    assert track.bearing_rad == pytest.approx(obstacle.bearing_rad)
    assert track.position_m[1] == pytest.approx(obstacle.depth_m)
    assert track.box == obstacle.box
    assert not track.confirmed


@pytest.mark.parametrize(
    ("parameters", "message"),
    [
        ({"velocity_walk_mps": 0.0}, "velocity_walk_mps = 0 m/s"),
        ({"initial_velocity_mps": float("inf")}, "initial_velocity_mps = inf m/s"),
        ({"bearing_sigma_rad": float("nan")}, "bearing_sigma_rad = NaN rad"),
        ({"extent_share": 1.5}, "extent_share = 1.5"),
        ({"gate_probability": 1.0}, "gate_probability = 1"),
        ({"confirm_window": 33}, "confirm_window = 33 frames"),
        ({"confirm_hits": 6}, "confirm_hits = 6 frames: must be 1 to confirm_window, 5"),
        ({"max_misses": -1}, "max_misses = -1"),
        ({"max_gap_s": 0.0}, "max_gap_s = 0 s"),
    ],
)
def test_parameters_out_of_range_are_named(parameters: dict[str, float], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        ep.Tracker(**parameters)  # type: ignore[arg-type]


def test_what_cannot_be_is_refused_and_changes_nothing() -> None:
    for arguments in ((0.0, 0, 0.1), (np.nan, 0, 0.1), (5, 1.6, 0.1), (5, 0, 0.0), (5, 0, np.inf)):
        with pytest.raises(ValueError, match=r"(range|depth|sigma)_m|bearing_rad"):
            ep.Detection(*arguments)
    tracker = ep.Tracker()
    (before,) = tracker.update([detection(0, 5)], 0)
    with pytest.raises(ValueError, match="forward_m = NaN m"):
        tracker.update([], STEP_NANOS, ego_motion=(0, float("nan"), 0))
    with pytest.raises(TypeError):
        tracker.update([(1, 2)], STEP_NANOS)  # type: ignore[list-item]
    (after,) = tracker.update([detection(0, 5)], STEP_NANOS)
    assert (after.id, after.hits) == (before.id, 2)
