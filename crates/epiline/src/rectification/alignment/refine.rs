//! Sub-pixel position of a left patch in the right image, by least squares.

use nalgebra::{Cholesky, Const, SMatrix, SVector};

use super::patch::{AREA, HALF, SIDE};
use crate::image::ImageRef;

/// Farthest the refined position may lie from the whole pixel it started from, pixels.
const MAX_SHIFT_PX: f32 = 2.0;
/// Neighbours, in each direction, that interpolation combines.
const TAPS: usize = 6;
/// Room a patch needs on every side: its half, half of the neighbours and the farthest shift.
pub(super) const MARGIN: usize = HALF + TAPS / 2 + MAX_SHIFT_PX as usize;

const MAX_ITERATIONS: usize = 10;
const CONVERGED_PX: f32 = 0.005;
/// Least share of the right patch's variance that the left patch must explain.
const MIN_EXPLAINED: f32 = 0.8;
/// Largest standard deviation of the row, from the fit's own residuals, pixels.
const MAX_SIGMA_Y_PX: f32 = 0.15;

/// Unknowns of the fit, in the order of the model's columns.
const X: usize = 0;
const Y: usize = 1;
const GAIN: usize = 2;
const UNKNOWNS: usize = 6;

type Normal = SMatrix<f32, UNKNOWNS, UNKNOWNS>;
type Unknowns = SVector<f32, UNKNOWNS>;

/// A left patch `T`, ready to be located in the right image.
///
/// The right patch is modelled as
/// `R(x, y) = gain·T(x, y) + offset + shift_x·Tx + shift_y·Ty + (slope_x·x + slope_y·y)·Tx`
/// with `Tx, Ty` the derivatives of `T`: gain and offset absorb a difference of exposure, the slopes the change of
/// disparity across a slanted surface. The system depends on `T` alone and is factorised once (inverse composition,
/// Baker & Matthews, 2004).
struct Template {
    columns: [[f32; AREA]; UNKNOWNS],
    normal: Cholesky<f32, Const<UNKNOWNS>>,
}

impl Template {
    fn around(left: ImageRef<'_, u8>, x: usize, y: usize) -> Option<Self> {
        let mut columns = [[0f32; AREA]; UNKNOWNS];
        let [tx, ty, gain, offset, slope_x, slope_y] = &mut columns;
        for i in 0..AREA {
            let (dx, dy) = ((i % SIDE) as f32 - HALF as f32, (i / SIDE) as f32 - HALF as f32);
            let (x, y) = (x + i % SIDE - HALF, y + i / SIDE - HALF);
            let level = |x, y| f32::from(left.at(x, y));
            tx[i] = 0.5 * (level(x + 1, y) - level(x - 1, y));
            ty[i] = 0.5 * (level(x, y + 1) - level(x, y - 1));
            gain[i] = level(x, y);
            offset[i] = 1.0;
            slope_x[i] = dx * tx[i] / HALF as f32;
            slope_y[i] = dy * tx[i] / HALF as f32;
        }
        // Keeps gain and offset apart in single precision.
        let mean = gain.iter().sum::<f32>() / AREA as f32;
        gain.iter_mut().for_each(|level| *level -= mean);
        let mut normal = Normal::zeros();
        for i in 0..UNKNOWNS {
            for j in 0..=i {
                normal[(i, j)] = dot(&columns[i], &columns[j]);
                normal[(j, i)] = normal[(i, j)];
            }
        }
        Some(Self { normal: normal.cholesky()?, columns })
    }

    fn project(&self, patch: &[f32; AREA]) -> Unknowns {
        Unknowns::from_fn(|i, _| dot(&self.columns[i], patch))
    }
}

/// Where in the right image the patch around the left pixel `(x, y)` lies, starting from the right pixel `start`;
/// both at least [`MARGIN`] inside. `None` if it does not settle nearby, fits badly or leaves the row uncertain.
pub(super) fn locate(
    left: ImageRef<'_, u8>,
    [x, y]: [usize; 2],
    right: ImageRef<'_, u8>,
    start: [usize; 2],
) -> Option<[f64; 2]> {
    let template = Template::around(left, x, y)?;
    let mut shift = [0f32; 2];
    for _ in 0..MAX_ITERATIONS {
        let patch = interpolate(right, start, shift);
        let projected = template.project(&patch);
        let fit = template.normal.solve(&projected);
        if fit[GAIN] <= 0.1 {
            return None;
        }
        let step = [fit[X] / fit[GAIN], fit[Y] / fit[GAIN]];
        shift = [shift[0] - step[0], shift[1] - step[1]];
        // Written so that NaN leaves too.
        if !shift.iter().all(|s| s.abs() < MAX_SHIFT_PX) {
            return None;
        }
        if step[0].hypot(step[1]) < CONVERGED_PX {
            return template
                .is_trustworthy(&patch, &projected, &fit)
                .then(|| [0, 1].map(|axis| start[axis] as f64 + f64::from(shift[axis])));
        }
    }
    None
}

impl Template {
    fn is_trustworthy(&self, patch: &[f32; AREA], projected: &Unknowns, fit: &Unknowns) -> bool {
        let mean = patch.iter().sum::<f32>() / AREA as f32;
        let variance: f32 = patch.iter().map(|level| (level - mean) * (level - mean)).sum();
        let modelled = projected.dot(fit) - mean * mean * AREA as f32;
        let unexplained = (variance - modelled).max(0.0);
        let of_row = self.normal.solve(&Unknowns::from_fn(|i, _| f32::from(u8::from(i == Y))))[Y];
        let noise_variance = unexplained / (AREA - UNKNOWNS) as f32;
        let sigma_y_px = (noise_variance * of_row).sqrt() / fit[GAIN];
        modelled >= MIN_EXPLAINED * variance && sigma_y_px <= MAX_SIGMA_Y_PX
    }
}

/// The right patch around `start + shift`, through the polynomial of [`TAPS`] neighbours in each direction.
///
/// Interpolation delays fine detail by too little, which pulls the answer towards the middle between two pixels: on
/// detail of four pixels' period, two neighbours or Keys' four delay a quarter of a pixel by 0.205, six by 0.242.
fn interpolate(right: ImageRef<'_, u8>, start: [usize; 2], shift: [f32; 2]) -> [f32; AREA] {
    const ROWS: usize = SIDE + TAPS - 1;
    let [(x, across), (y, down)] = [0, 1].map(|axis| {
        let whole = shift[axis].floor();
        // MARGIN keeps the first tap inside.
        let first = (start[axis] - HALF - (TAPS / 2 - 1)).wrapping_add_signed(whole as isize);
        (first, lagrange_weights(shift[axis] - whole))
    });
    // Tap by tap over whole rows, so that vectors of neighbours are summed at once.
    let mut rows = [[0f32; SIDE]; ROWS];
    for (row, y) in rows.iter_mut().zip(y..) {
        let levels: [f32; ROWS] = {
            let source = &right.row(y)[x..x + ROWS];
            std::array::from_fn(|i| f32::from(source[i]))
        };
        for (tap, weight) in across.iter().enumerate() {
            for i in 0..SIDE {
                row[i] += weight * levels[i + tap];
            }
        }
    }
    let mut patch = [0f32; AREA];
    for (values, taps) in patch.chunks_exact_mut(SIDE).zip(rows.windows(TAPS)) {
        for (weight, row) in down.iter().zip(taps) {
            for i in 0..SIDE {
                values[i] += weight * row[i];
            }
        }
    }
    patch
}

/// Lagrange's weights of the pixels at -2, -1, 0, 1, 2 and 3 for a position `t` from 0 to 1.
fn lagrange_weights(t: f32) -> [f32; TAPS] {
    let position = |tap: usize| tap as f32 - (TAPS / 2 - 1) as f32;
    std::array::from_fn(|tap| {
        let others = (0..TAPS).filter(|&other| other != tap);
        others.map(|other| (t - position(other)) / (position(tap) - position(other))).product()
    })
}

fn dot(a: &[f32; AREA], b: &[f32; AREA]) -> f32 {
    // Eight sums that do not wait for each other.
    let mut lanes = [0f32; 8];
    for (a, b) in a.chunks_exact(8).zip(b.chunks_exact(8)) {
        for i in 0..8 {
            lanes[i] += a[i] * b[i];
        }
    }
    let tail = AREA / 8 * 8;
    let rest: f32 = a[tail..].iter().zip(&b[tail..]).map(|(a, b)| a * b).sum();
    lanes.iter().sum::<f32>() + rest
}
