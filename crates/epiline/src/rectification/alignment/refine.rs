//! Sub-pixel position of a left patch in the right image, by least squares.

use super::patch::HALF;
use crate::image::ImageRef;
use crate::kernels::Kernels;
use crate::kernels::alignment::patches::AREA;
use crate::kernels::alignment::registration::{
    COLUMNS, Gram, Interpolate, Levels, ModelColumns, Project, TAPS,
};
use crate::kernels::alignment::{LANES, SIDE};

/// Farthest the refined position may lie from the whole pixel it started from, pixels.
const MAX_SHIFT_PX: f32 = 2.0;
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
const OFFSET: usize = 3;

type Unknowns = [f32; COLUMNS];

/// A left patch `T`, ready to be located in the right image.
///
/// The right patch is modelled as
/// `R(x, y) = gain·T(x, y) + offset + shift_x·Tx + shift_y·Ty + (slope_x·x + slope_y·y)·Tx`
/// with `Tx, Ty` the derivatives of `T`: gain and offset absorb a difference of exposure, the slopes the change of
/// disparity across a slanted surface. The system depends on `T` alone and is factorised once (inverse composition,
/// Baker & Matthews, 2004).
struct Template {
    columns: [Levels; COLUMNS],
    normal: Cholesky,
}

impl Template {
    fn around(kernels: &Kernels, left: ImageRef<'_, u8>, x: usize, y: usize) -> Option<Self> {
        let mut columns = [[[0f32; LANES]; SIDE]; COLUMNS];
        // MARGIN keeps a patch and its neighbours inside.
        let image = left.elements_from(x - HALF - 1, y - HALF - 1);
        kernels.model_columns(&mut ModelColumns { image, stride: left.stride(), columns: &mut columns });
        let mut gram = Gram { columns: &columns, products: Default::default() };
        kernels.gram(&mut gram);
        let normal = Cholesky::of(&gram.products)?;
        Some(Self { columns, normal })
    }

    fn project(&self, kernels: &Kernels, patch: &Levels) -> Unknowns {
        let mut call = Project { columns: &self.columns, patch, sums: [0.0; COLUMNS] };
        kernels.project(&mut call);
        call.sums
    }
}

/// `L·Lᵀ` of a positive definite matrix.
struct Cholesky {
    lower: [Unknowns; COLUMNS],
    /// Reciprocals of the diagonal.
    scale: Unknowns,
}

impl Cholesky {
    /// `None` unless the matrix is positive definite.
    fn of(matrix: &[Unknowns; COLUMNS]) -> Option<Self> {
        let (mut lower, mut scale) = ([[0.0; COLUMNS]; COLUMNS], [0.0; COLUMNS]);
        for i in 0..COLUMNS {
            for j in 0..=i {
                let below: f32 = (0..j).map(|k| lower[i][k] * lower[j][k]).sum();
                let rest = matrix[i][j] - below;
                if i > j {
                    lower[i][j] = rest * scale[j];
                } else if rest > 0.0 {
                    lower[i][i] = rest.sqrt();
                    scale[i] = 1.0 / lower[i][i];
                } else {
                    return None;
                }
            }
        }
        Some(Self { lower, scale })
    }

    fn solve(&self, right_side: &Unknowns) -> Unknowns {
        let mut x = *right_side;
        for i in 0..COLUMNS {
            let known: f32 = (0..i).map(|k| self.lower[i][k] * x[k]).sum();
            x[i] = (x[i] - known) * self.scale[i];
        }
        for i in (0..COLUMNS).rev() {
            let known: f32 = (i + 1..COLUMNS).map(|k| self.lower[k][i] * x[k]).sum();
            x[i] = (x[i] - known) * self.scale[i];
        }
        x
    }
}

/// Where in the right image the patch around the left pixel `(x, y)` lies, starting from the right pixel `start`;
/// both at least [`MARGIN`] inside. `None` if it does not settle nearby, fits badly or leaves the row uncertain.
pub(super) fn locate(
    kernels: &Kernels,
    left: ImageRef<'_, u8>,
    [x, y]: [usize; 2],
    right: ImageRef<'_, u8>,
    start: [usize; 2],
) -> Option<[f64; 2]> {
    let template = Template::around(kernels, left, x, y)?;
    let mut shift = [0f32; 2];
    let mut patch = [[0f32; LANES]; SIDE];
    for _ in 0..MAX_ITERATIONS {
        interpolate(kernels, right, start, shift, &mut patch);
        let projected = template.project(kernels, &patch);
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
        if step[0] * step[0] + step[1] * step[1] < CONVERGED_PX * CONVERGED_PX {
            return template
                .is_trustworthy(&patch, &projected, &fit)
                .then(|| [0, 1].map(|axis| start[axis] as f64 + f64::from(shift[axis])));
        }
    }
    None
}

impl Template {
    fn is_trustworthy(&self, patch: &Levels, projected: &Unknowns, fit: &Unknowns) -> bool {
        let mean = projected[OFFSET] / AREA as f32;
        let mut squares = [0f32; LANES];
        for row in patch {
            for x in 0..LANES {
                squares[x] += (row[x] - mean) * (row[x] - mean);
            }
        }
        let variance: f32 = squares[..SIDE].iter().sum();
        let explained: f32 = projected.iter().zip(fit).map(|(a, b)| a * b).sum();
        let modelled = explained - mean * mean * AREA as f32;
        let unexplained = (variance - modelled).max(0.0);
        let of_row = self.normal.solve(&std::array::from_fn(|i| f32::from(u8::from(i == Y))))[Y];
        let noise_variance = unexplained / (AREA - COLUMNS) as f32;
        let sigma_y_px = (noise_variance * of_row).sqrt() / fit[GAIN];
        modelled >= MIN_EXPLAINED * variance && sigma_y_px <= MAX_SIGMA_Y_PX
    }
}

/// The right patch around `start + shift`, through the polynomial of [`TAPS`] neighbours in each direction.
///
/// Interpolation delays fine detail by too little, which pulls the answer towards the middle between two pixels: on
/// detail of four pixels' period, two neighbours or Keys' four delay a quarter of a pixel by 0.205, six by 0.242.
fn interpolate(
    kernels: &Kernels,
    right: ImageRef<'_, u8>,
    start: [usize; 2],
    shift: [f32; 2],
    patch: &mut Levels,
) {
    let [(x, across), (y, down)] = [0, 1].map(|axis| {
        // Rounded down; a shift is small, and the library's floor is a call.
        let whole = (shift[axis] + MAX_SHIFT_PX) as usize as f32 - MAX_SHIFT_PX;
        // MARGIN keeps the first tap inside.
        let first = (start[axis] - HALF - (TAPS / 2 - 1)).wrapping_add_signed(whole as isize);
        (first, lagrange_weights(shift[axis] - whole))
    });
    let image = right.elements_from(x, y);
    kernels.interpolate(&mut Interpolate { image, stride: right.stride(), across, down, patch });
}

/// Lagrange's weights of the pixels at -2, -1, 0, 1, 2 and 3 for a position `t` from 0 to 1.
fn lagrange_weights(t: f32) -> [f32; TAPS] {
    /// `1 / Π (p - q)` over the other positions `q`, for each position `p`.
    const SCALES: [f32; TAPS] = [-1.0 / 120.0, 1.0 / 24.0, -1.0 / 12.0, 1.0 / 12.0, -1.0 / 24.0, 1.0 / 120.0];
    let distances: [f32; TAPS] = std::array::from_fn(|tap| t - (tap as f32 - (TAPS / 2 - 1) as f32));
    std::array::from_fn(|tap| {
        let others = (0..TAPS).filter(|&other| other != tap);
        others.map(|other| distances[other]).product::<f32>() * SCALES[tap]
    })
}
