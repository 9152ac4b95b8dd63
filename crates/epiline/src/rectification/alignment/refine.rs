//! Sub-pixel position of a left patch in the right image, by least squares.

use nalgebra::{Cholesky, Const, SMatrix, SVector};

use super::patch::HALF;
use crate::image::ImageRef;
use crate::kernels::Kernels;
use crate::kernels::alignment::patches::AREA;
use crate::kernels::alignment::registration::{COLUMNS, Gram, Interpolate, Levels, Project, TAPS};
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

type Normal = SMatrix<f32, COLUMNS, COLUMNS>;
type Unknowns = SVector<f32, COLUMNS>;

/// A left patch `T`, ready to be located in the right image.
///
/// The right patch is modelled as
/// `R(x, y) = gain·T(x, y) + offset + shift_x·Tx + shift_y·Ty + (slope_x·x + slope_y·y)·Tx`
/// with `Tx, Ty` the derivatives of `T`: gain and offset absorb a difference of exposure, the slopes the change of
/// disparity across a slanted surface. The system depends on `T` alone and is factorised once (inverse composition,
/// Baker & Matthews, 2004).
struct Template {
    columns: [Levels; COLUMNS],
    normal: Cholesky<f32, Const<COLUMNS>>,
}

impl Template {
    fn around(kernels: &Kernels, left: ImageRef<'_, u8>, x: usize, y: usize) -> Option<Self> {
        let mut columns = [[[0f32; LANES]; SIDE]; COLUMNS];
        let [tx, ty, gain, offset, slope_x, slope_y] = &mut columns;
        let mut total = 0;
        for j in 0..SIDE {
            let dy = (j as f32 - HALF as f32) / HALF as f32;
            let row_at = |y: usize| -> &[u8; SIDE + 2] {
                left.elements_from(x - HALF - 1, y - HALF + j)
                    .first_chunk()
                    .expect("MARGIN keeps a patch inside")
            };
            let [above, here, below] = [y - 1, y, y + 1].map(row_at);
            for i in 0..SIDE {
                let dx = (i as f32 - HALF as f32) / HALF as f32;
                tx[j][i] = 0.5 * (f32::from(here[i + 2]) - f32::from(here[i]));
                ty[j][i] = 0.5 * (f32::from(below[i + 1]) - f32::from(above[i + 1]));
                gain[j][i] = f32::from(here[i + 1]);
                offset[j][i] = 1.0;
                slope_x[j][i] = dx * tx[j][i];
                slope_y[j][i] = dy * tx[j][i];
                total += u32::from(here[i + 1]);
            }
        }
        // Keeps gain and offset apart in single precision.
        let mean = total as f32 / AREA as f32;
        gain.iter_mut().flat_map(|row| &mut row[..SIDE]).for_each(|level| *level -= mean);
        let mut gram = Gram { columns: &columns, products: Default::default() };
        kernels.gram(&mut gram);
        let normal = Normal::from_fn(|i, j| gram.products[i][j]).cholesky()?;
        Some(Self { normal, columns })
    }

    fn project(&self, kernels: &Kernels, patch: &Levels) -> Unknowns {
        let mut call = Project { columns: &self.columns, patch, sums: [0.0; COLUMNS] };
        kernels.project(&mut call);
        Unknowns::from(call.sums)
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
        let levels = patch.iter().flat_map(|row| &row[..SIDE]);
        let variance: f32 = levels.map(|level| (level - mean) * (level - mean)).sum();
        let modelled = projected.dot(fit) - mean * mean * AREA as f32;
        let unexplained = (variance - modelled).max(0.0);
        let of_row = self.normal.solve(&Unknowns::from_fn(|i, _| f32::from(u8::from(i == Y))))[Y];
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
        let whole = shift[axis].floor();
        // MARGIN keeps the first tap inside.
        let first = (start[axis] - HALF - (TAPS / 2 - 1)).wrapping_add_signed(whole as isize);
        (first, lagrange_weights(shift[axis] - whole))
    });
    let image = right.elements_from(x, y);
    kernels.interpolate(&mut Interpolate { image, stride: right.stride(), across, down, patch });
}

/// Lagrange's weights of the pixels at -2, -1, 0, 1, 2 and 3 for a position `t` from 0 to 1.
fn lagrange_weights(t: f32) -> [f32; TAPS] {
    /// `Π (p - q)` over the other positions `q`, for each position `p`.
    const SPANS: [f32; TAPS] = [-120.0, 24.0, -12.0, 12.0, -24.0, 120.0];
    let distances: [f32; TAPS] = std::array::from_fn(|tap| t - (tap as f32 - (TAPS / 2 - 1) as f32));
    std::array::from_fn(|tap| {
        let others = (0..TAPS).filter(|&other| other != tap);
        others.map(|other| distances[other]).product::<f32>() / SPANS[tap]
    })
}
