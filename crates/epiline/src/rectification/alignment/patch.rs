//! Patches that compare by zero-mean normalised cross-correlation (ZNCC).

use super::corners::Corner;
use crate::image::ImageRef;
use crate::kernels::Kernels;
use crate::kernels::alignment::patches::{AREA, Correlate, PatchSums};
use crate::kernels::alignment::{LANES, SIDE};

/// Half side of a patch, pixels.
pub(super) const HALF: usize = SIDE / 2;
/// Room a patch needs on every side: its half, and one row for the elements beyond its last that a vector reads.
pub(super) const MARGIN: usize = HALF + 1;
const _: () = assert!(LANES - HALF <= 2 * MARGIN);

/// The patches around the corners of one image.
#[derive(Debug, Default)]
pub(super) struct Patches {
    /// Where each begins in the image.
    at: Vec<u32>,
    sums: Vec<[u32; 2]>,
    /// Of each, the sum of its levels and the reciprocal of `√(AREA·Σl² - (Σl)²)`; 0 if it is flat.
    normals: Vec<(u32, f32)>,
}

impl Patches {
    /// Describes an image's corners, all at least [`MARGIN`] inside.
    pub fn describe(&mut self, kernels: &Kernels, image: ImageRef<'_, u8>, corners: &[Corner]) {
        let stride = image.stride();
        let begin = |c: &Corner| (usize::from(c.y) - HALF) * stride + usize::from(c.x) - HALF;
        self.at.clear();
        self.at.extend(corners.iter().map(|corner| begin(corner) as u32));
        self.sums.resize(corners.len(), [0; 2]);
        kernels.patch_sums(&mut PatchSums {
            image: image.elements_from(0, 0),
            stride,
            at: &self.at,
            sums: &mut self.sums,
        });
        self.normals.clear();
        self.normals.extend(self.sums.iter().map(|&[sum, squares]| {
            // AREA²·variance, exact: at most 169²·255² needs the 32 bits and no more.
            let spread = AREA as u32 * squares - sum * sum;
            (sum, if spread > 0 { 1.0 / (spread as f32).sqrt() } else { 0.0 })
        }));
    }
}

/// A patch's comparison with some of another image's.
#[derive(Debug, Default)]
pub(super) struct Comparison {
    at: Vec<u32>,
    products: Vec<u32>,
    /// ZNCC with each, -1 to 1; 0 if either is flat.
    pub zncc: Vec<f32>,
}

impl Comparison {
    /// Compares patch `index` of `patches` with the `candidates` among the `others`.
    pub fn compare(
        &mut self,
        kernels: &Kernels,
        (image, patches, index): (ImageRef<'_, u8>, &Patches, usize),
        (other_image, others, candidates): (ImageRef<'_, u8>, &Patches, &[usize]),
    ) {
        self.at.clear();
        self.at.extend(candidates.iter().map(|&other| others.at[other]));
        self.products.resize(candidates.len(), 0);
        kernels.correlate(&mut Correlate {
            patch: &image.elements_from(0, 0)[patches.at[index] as usize..],
            patch_stride: image.stride(),
            image: other_image.elements_from(0, 0),
            stride: other_image.stride(),
            at: &self.at,
            products: &mut self.products,
        });
        let (sum, scale) = patches.normals[index];
        self.zncc.clear();
        self.zncc.extend(candidates.iter().zip(&self.products).map(|(&other, &product)| {
            let (other_sum, other_scale) = others.normals[other];
            // Both products are below 2³¹.
            let covariance = (AREA as u32 * product) as i32 - (sum * other_sum) as i32;
            covariance as f32 * scale * other_scale
        }));
    }
}
