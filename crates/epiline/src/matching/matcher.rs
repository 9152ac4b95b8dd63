//! The matcher: one call per frame, every buffer kept.

use super::fill::Filler;
use super::map::DisparityMap;
use super::params::{MatcherParams, Method};
use super::prepared::PreparedPair;
use super::semi_global::{self, Penalties, SemiGlobal};
use super::speckle::SpeckleFilter;
use super::stripe::{Frame, Stripe};
use super::threads::{stripes, thread_count};
use crate::error::Result;
use crate::image::ImageRef;
use crate::kernels::sad::fits_u16;
use crate::kernels::{CostKernels, Kernels, Level};

/// Dense matching of aligned pairs by the [`Method`] of [`MatcherParams`], with their tests.
///
/// Keeps its buffers: once it has seen a frame of some size, further ones allocate nothing on a single thread. The
/// result depends neither on the number of threads nor on the instruction set.
#[derive(Debug)]
pub struct StereoMatcher {
    params: MatcherParams,
    kernels: Kernels,
    threads: usize,
    pair: PreparedPair,
    buffers: Buffers,
    speckle: SpeckleFilter,
    filler: Filler,
}

/// Buffers for what the parameters need: window sums of one width, or paths.
#[derive(Debug)]
enum Buffers {
    U16(Vec<Stripe<u16>>),
    U32(Vec<Stripe<u32>>),
    SemiGlobal(Box<(SemiGlobal, Penalties)>),
}

impl StereoMatcher {
    /// A matcher for the [level in use](Level::current). Fails if a parameter is outside its range.
    pub fn new(params: MatcherParams) -> Result<Self> {
        Self::with_level(params, Level::current())
    }

    /// A matcher that uses the kernels of `level`.
    pub fn with_level(params: MatcherParams, level: Level) -> Result<Self> {
        params.validate()?;
        let buffers = match params.method {
            Method::Sgm => {
                Buffers::SemiGlobal(Box::new((SemiGlobal::default(), Penalties::new(params.p1, params.p2))))
            }
            Method::Sad if fits_u16(params.largest_difference(), params.block_size) => {
                Buffers::U16(Vec::new())
            }
            Method::Sad => Buffers::U32(Vec::new()),
        };
        Ok(Self {
            params,
            kernels: Kernels::new(level),
            threads: thread_count(params.threads)?,
            pair: PreparedPair::default(),
            buffers,
            speckle: SpeckleFilter::default(),
            filler: Filler::default(),
        })
    }

    /// The parameters it was made with.
    pub fn params(&self) -> &MatcherParams {
        &self.params
    }

    /// Disparities of the left image. `out` takes its size.
    ///
    /// Fails if the images' sizes differ, or if they are narrower than the range of disparities.
    pub fn compute(
        &mut self,
        left: ImageRef<'_, u8>,
        right: ImageRef<'_, u8>,
        out: &mut DisparityMap,
    ) -> Result<()> {
        self.compute_masked(left, right, None, None, out)
    }

    /// The same for images some of whose pixels are meaningless: those where a mask is zero have no answer, and are no
    /// one's candidate.
    pub fn compute_masked(
        &mut self,
        left: ImageRef<'_, u8>,
        right: ImageRef<'_, u8>,
        left_valid: Option<ImageRef<'_, u8>>,
        right_valid: Option<ImageRef<'_, u8>>,
        out: &mut DisparityMap,
    ) -> Result<()> {
        require_sizes(left, right, left_valid, right_valid)?;
        self.params.require_width(left.width())?;
        let Self { params, kernels, threads, pair, buffers, speckle, filler } = self;
        out.resize(left.width(), left.height());
        out.min_disparity = params.min_disparity;
        out.num_disparities = params.num_disparities;
        if let Buffers::U16(_) | Buffers::U32(_) = buffers {
            let lanes = kernels.lanes(params.num_disparities);
            pair.prepare(kernels, params, lanes, left, right, *threads);
        }
        let frame = Frame { kernels, params, pair, left_valid, right_valid };
        match buffers {
            Buffers::U16(stripes) => compute_stripes(stripes, &frame, *threads, out),
            Buffers::U32(stripes) => compute_stripes(stripes, &frame, *threads, out),
            Buffers::SemiGlobal(buffers) => {
                let (buffers, penalties) = &mut **buffers;
                let frame =
                    semi_global::Frame { kernels, params, penalties, left, right, left_valid, right_valid };
                buffers.compute(&frame, *threads, out);
            }
        }
        if params.speckle_size > 0 {
            speckle.mark(out, params.speckle_size, params.speckle_range);
        }
        if params.fill {
            filler.fill(out);
        }
        Ok(())
    }
}

/// Fails unless all four images have one size.
pub(super) fn require_sizes(
    left: ImageRef<'_, u8>,
    right: ImageRef<'_, u8>,
    left_valid: Option<ImageRef<'_, u8>>,
    right_valid: Option<ImageRef<'_, u8>>,
) -> Result<()> {
    left.require_same_size("left", &right, "right")?;
    for (name, mask) in [("left_valid", left_valid), ("right_valid", right_valid)] {
        if let Some(mask) = mask {
            left.require_same_size("left", &mask, name)?;
        }
    }
    Ok(())
}

fn compute_stripes<C: CostKernels>(
    buffers: &mut Vec<Stripe<C>>,
    frame: &Frame<'_>,
    threads: usize,
    out: &mut DisparityMap,
) {
    let (width, height) = (out.width(), out.height());
    let count = stripes(height, threads).len();
    buffers.resize_with(count.max(buffers.len()), Stripe::default);
    let (mut values, mut bits) = (out.values.as_mut_slice(), out.validity.as_mut_slice());
    let mut jobs = stripes(height, threads).zip(buffers).map(|(rows, stripe)| {
        let (stripe_values, stripe_bits);
        (stripe_values, values) = std::mem::take(&mut values).split_at_mut(rows.len() * width);
        (stripe_bits, bits) = std::mem::take(&mut bits).split_at_mut(rows.len() * width);
        move || stripe.compute(frame, rows, stripe_values, stripe_bits)
    });
    if count == 1 {
        jobs.by_ref().for_each(|job| job());
    } else {
        rayon::scope(|scope| jobs.for_each(|job| scope.spawn(move |_| job())));
    }
}
