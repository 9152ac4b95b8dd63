//! Kernels of regions and of range: each against plain arithmetic, and every instruction level against the reference,
//! bit for bit.

use epiline::kernels::planes::{NearTile, PlaneSums, PlaneTile, TilePlane};
use epiline::kernels::range::{ENTRIES, Metres, RangeRow};
use epiline::kernels::sort::LANES;
use epiline::kernels::tile::{GatherTile, NO_VALUE, Row, SpanTile};
use epiline::kernels::windows::{OfferBin, REACH, SumColumns};
use epiline::kernels::{Kernels, Level};

struct Random(u64);

impl Random {
    fn below(&mut self, limit: u64) -> u64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 33) % limit
    }

    /// Disparities about a slanted plane, some wild, some missing.
    fn tile(&mut self, height: usize) -> Vec<Row> {
        let mut rows = vec![[NO_VALUE; LANES]; height];
        for (y, row) in rows.iter_mut().enumerate() {
            for (lane, value) in row.iter_mut().enumerate() {
                *value = match self.below(10) {
                    0 => NO_VALUE,
                    1 => self.below(65_520) as u16,
                    _ => (400 + 3 * lane as u64 + 5 * y as u64 + self.below(24)) as u16,
                };
            }
        }
        rows
    }
}

/// The same by every level; what the first gives.
fn at_all_levels<T: PartialEq + std::fmt::Debug>(of: impl Fn(&Kernels) -> T) -> T {
    let scalar = of(&Kernels::new(Level::SCALAR));
    for level in Level::available() {
        assert_eq!(of(&Kernels::new(level)), scalar, "{}", level.name());
    }
    scalar
}

#[test]
fn tiles_hold_what_has_a_value() {
    let mut random = Random(1);
    let stride = 75;
    for (height, width, left) in [(1, 1, 0), (7, 31, 44), (40, 32, 3), (300, 32, 43), (5, 17, 58)] {
        let values: Vec<u16> = (0..height * stride).map(|_| random.below(65_520) as u16).collect();
        let bits: Vec<u8> =
            (0..height * stride).map(|_| [0, 0, 128, 4, 132][random.below(5) as usize]).collect();
        let (rows, counts, sums) = at_all_levels(|kernels| {
            let mut out = (vec![[7; LANES]; height], [7; LANES], [7; LANES]);
            kernels.gather(&mut GatherTile {
                values: &values[left..],
                bits: &bits[left..],
                stride,
                width,
                harmless: 128,
                rows: &mut out.0,
                counts: &mut out.1,
                sums: &mut out.2,
            });
            out
        });
        for lane in 0..LANES {
            let has = |y: usize| lane < width && bits[y * stride + left + lane] & 127 == 0;
            let column: Vec<u16> = (0..height)
                .map(|y| if has(y) { values[y * stride + left + lane] } else { NO_VALUE })
                .collect();
            assert_eq!(rows.iter().map(|row| row[lane]).collect::<Vec<_>>(), column);
            let known: Vec<u32> = column.iter().filter(|&&v| v != NO_VALUE).map(|&v| u32::from(v)).collect();
            assert_eq!((usize::from(counts[lane]), sums[lane]), (known.len(), known.iter().sum()));
        }
    }
}

#[test]
fn spans_are_counted_with_their_rows() {
    let mut random = Random(2);
    for height in [1, 20, 333] {
        let rows = random.tile(height);
        let low: Row = std::array::from_fn(|lane| 300 + 20 * lane as u16);
        let high: Row = std::array::from_fn(|lane| if lane == 9 { 0 } else { low[lane] + 150 });
        let (counts, row_sums) = at_all_levels(|kernels| {
            let mut out = ([7; LANES], [7; LANES]);
            let (counts, row_sums) = (&mut out.0, &mut out.1);
            kernels.span(&mut SpanTile { rows: &rows, low, high, counts, row_sums });
            out
        });
        for lane in 0..LANES {
            let inside: Vec<u32> = (0..height as u32)
                .filter(|&y| (low[lane]..=high[lane]).contains(&rows[y as usize][lane]))
                .collect();
            assert_eq!((usize::from(counts[lane]), row_sums[lane]), (inside.len(), inside.iter().sum()));
        }
    }
}

#[test]
fn sums_over_a_plane_are_those_of_least_squares() {
    let mut random = Random(3);
    for (height, step, least_px) in [(1, 1, f32::NEG_INFINITY), (50, 1, 30.0), (90, 4, f32::NEG_INFINITY)] {
        let rows = random.tile(height);
        let plane = TilePlane { at_origin: 25.7, per_lane: 3.0 / 16.0, per_row: 5.0 / 16.0 };
        let (first_row, tolerance_px) = (-13.0, 0.75);
        let sums = at_all_levels(|kernels| {
            let mut sums = PlaneSums::default();
            let at_first = TilePlane { at_origin: plane.at_origin + 13.0 * plane.per_row, ..plane };
            kernels.plane(&mut PlaneTile {
                rows: &rows,
                step,
                first_row,
                plane: at_first,
                tolerance_px,
                least_px,
                sums: &mut sums,
            });
            sums
        });
        let mut pixels = 0;
        for lane in 0..LANES {
            let mut expected = [0.0_f64; 7];
            for i in (step / 2..height).step_by(step) {
                let at = f64::from(plane.at_origin) + 3.0 / 16.0 * lane as f64 + 5.0 / 16.0 * i as f64;
                let r = f64::from(rows[i][lane]) / 16.0 - at;
                if rows[i][lane] == NO_VALUE || r.abs() > 0.75 || at < f64::from(least_px) {
                    continue;
                }
                pixels += 1;
                let (y, w) = (i as f64 - 13.0, (1.0 - (r / 0.75).powi(2)).powi(2));
                for (sum, term) in expected.iter_mut().zip([1.0, r, w, w * r, w * y, w * y * y, w * y * r]) {
                    *sum += term;
                }
            }
            let PlaneSums { count, r, w, wr, wy, wyy, wyr } = &sums;
            for (got, expected) in [count, r, w, wr, wy, wyy, wyr].into_iter().zip(expected) {
                let got = f64::from(got[lane]);
                assert!(
                    (got - expected).abs() <= 1e-3 * (1.0 + expected.abs()),
                    "{got} instead of {expected}"
                );
            }
        }
        assert!(pixels > 10, "{pixels} pixels near the plane");
    }
}

#[test]
fn near_pixels_are_those_of_the_equation() {
    let mut random = Random(4);
    let rows = random.tile(40);
    let plane = TilePlane { at_origin: 25.7, per_lane: 3.0 / 16.0, per_row: 5.0 / 16.0 };
    let column_terms: [f32; LANES] = std::array::from_fn(|lane| 1.0 + (lane as f32 / 40.0).powi(2));
    for (below, least_px, nearness) in [(0.0, -1.0, 0.0), (3.0, 31.0, 700.0), (-2.0, -1.0, 900.0)] {
        let masks = at_all_levels(|kernels| {
            let mut masks = vec![7; rows.len()];
            kernels.near(&mut NearTile {
                rows: &rows,
                first_row: 2.0,
                below,
                plane,
                tolerance_px: 0.75,
                least_px,
                doffs_px: -0.5,
                column_terms: &column_terms,
                v: (-0.2, 0.01),
                nearness,
                masks: &mut masks,
            });
            masks
        });
        let mut near = 0;
        for (y, row) in rows.iter().enumerate() {
            for lane in 0..LANES {
                let at = |row: f64| 25.7 + 3.0 / 16.0 * lane as f64 + 5.0 / 16.0 * row;
                let (own, place) = (y as f64 + 2.0, y as f64 + 2.0 + f64::from(below));
                let r = f64::from(row[lane]) / 16.0 - at(own);
                let ray_squared = f64::from(column_terms[lane]) + (-0.2 + 0.01 * place).powi(2);
                let distance = at(place) - 0.5;
                // What rounding may decide either way is not asked.
                let margins = [
                    0.75 - r.abs(),
                    at(place) - f64::from(least_px),
                    distance.powi(2) / ray_squared - f64::from(nearness),
                ];
                if margins.iter().any(|margin| margin.abs() < 1e-3) {
                    continue;
                }
                let expected = row[lane] != NO_VALUE && margins.iter().all(|&margin| margin > 0.0);
                assert_eq!(masks[y] >> lane & 1 == 1, expected, "lane {lane} of row {y}");
                near += usize::from(expected);
            }
        }
        assert!(near > 20, "{near} near pixels");
    }
}

#[test]
fn neighbouring_columns_are_added_up() {
    let mut random = Random(5);
    for width in [1, 30, 64, 321] {
        let counts: Vec<u16> = (0..width + 2 * REACH).map(|_| random.below(16_385) as u16).collect();
        let sums = at_all_levels(|kernels| {
            let mut sums = vec![7; width];
            kernels.sum_columns(&mut SumColumns { counts: &counts, sums: &mut sums });
            sums
        });
        let expected: Vec<u32> =
            counts.windows(2 * REACH + 1).map(|window| window.iter().map(|&n| u32::from(n)).sum()).collect();
        assert_eq!(sums, expected);
    }
}

#[test]
fn windows_are_taken_from_near_to_far() {
    let mut random = Random(6);
    let (width, bins, support) = (83, 24, 30);
    // In every third column a surface whose near tail grows from bin to bin.
    let mut pixel = |bin: usize, x: usize| {
        let tail = if x.is_multiple_of(3) { 2.0 * 1.4_f64.powi((bins + 2 - bin) as i32) } else { 0.0 };
        (tail as u32).min(10_000) + random.below(28) as u32 / if x.is_multiple_of(3) { 9 } else { 1 }
    };
    let pixels: Vec<Vec<u32>> =
        (0..bins + 3).map(|bin| (0..width).map(|x| pixel(bin, x)).collect()).collect();
    let zeros = vec![0; width];
    let of =
        |bin: isize| usize::try_from(bin).ok().and_then(|bin| pixels.get(bin)).unwrap_or(&zeros).as_slice();
    let (first, taken, full, mean) = at_all_levels(|kernels| {
        let mut out = (vec![0; width], vec![0; width], vec![0; width], vec![0.0; width]);
        for bin in (1..bins as isize).rev() {
            kernels.offer(&mut OfferBin {
                pixels: [of(bin + 1), of(bin), of(bin - 1), of(bin - 2)],
                bin: bin as u32,
                support,
                first: &mut out.0,
                taken: &mut out.1,
                full: &mut out.2,
                mean: &mut out.3,
            });
        }
        out
    });
    let mut moves = [0; 3];
    for x in 0..width {
        let full_of = |bin: isize| of(bin)[x] + of(bin - 1)[x];
        let Some(nearest) = (1..bins as isize).rev().find(|&bin| full_of(bin) >= support) else {
            assert_eq!(full[x], 0);
            continue;
        };
        let mut best = nearest;
        while best > 1
            && nearest - best < 2
            && full_of(best - 1) >= support
            && 4 * full_of(best - 1) > 5 * full_of(best)
        {
            best -= 1;
        }
        moves[(nearest - best) as usize] += 1;
        assert_eq!(
            (first[x] as isize, taken[x] as isize, full[x]),
            (nearest, best, full_of(best)),
            "column {x}"
        );
        let around: Vec<isize> = (best - 2..=best + 1).collect();
        let all: u32 = around.iter().map(|&bin| of(bin)[x]).sum();
        let moment: f64 = around.iter().map(|&bin| bin as f64 * f64::from(of(bin)[x])).sum();
        assert!((f64::from(mean[x]) - moment / f64::from(all)).abs() < 1e-4, "column {x}");
    }
    assert!(
        moves[0] > 5 && moves[1] > 0 && moves[2] > 5,
        "columns by how often their window moved on: {moves:?}"
    );
}

#[test]
fn metres_are_looked_up_and_laid_along_the_ray() {
    let mut random = Random(7);
    let mut table: Vec<Metres> = (0..ENTRIES).map(|entry| [1e4 / entry as f32, 0.1 * entry as f32]).collect();
    table[0] = [f32::NAN; 2];
    let table = table.as_slice().try_into().expect("all entries");
    for width in [1, 63, 64, 65, 321] {
        let raws: Vec<u16> =
            (0..width).map(|_| [0, 65_519, random.below(2048) as u16][random.below(3) as usize]).collect();
        let bits: Vec<u8> = (0..width).map(|_| [0, 128, 4, 130][random.below(4) as usize]).collect();
        let column_terms: Vec<f32> = (0..width).map(|x| 1.0 + (x as f32 / 100.0).powi(2)).collect();
        let bit_patterns = at_all_levels(|kernels| {
            let mut out = [vec![7.0_f32; width], vec![7.0; width], vec![7.0; width]];
            let [depth, range, sigma] = &mut out;
            kernels.range(&mut RangeRow {
                raws: &raws,
                bits: &bits,
                harmless: 128,
                table,
                column_terms: &column_terms,
                row_term: 0.37,
                depth,
                range,
                sigma,
            });
            out.map(|plane| {
                plane.iter().map(|v| if v.is_nan() { 0 } else { v.to_bits() }).collect::<Vec<_>>()
            })
        });
        for x in 0..width {
            let expected = if bits[x] & 127 == 0 {
                let [depth, sigma] = table[usize::from(raws[x]) + 1];
                let ray = (column_terms[x] + 0.37).sqrt();
                [depth, depth * ray, sigma * ray].map(f32::to_bits)
            } else {
                [0; 3]
            };
            assert_eq!(
                [0, 1, 2].map(|plane: usize| bit_patterns[plane][x]),
                expected,
                "pixel {x} of {width}"
            );
        }
    }
}
