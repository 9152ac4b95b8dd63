//! The matcher: one call per frame, every buffer kept.

use std::ops::Range;

use super::coarse::CoarseCosts;
use super::crew::{Crew, thread_count};
use super::fill::Filler;
use super::map::{DisparityMap, Validity};
use super::params::{MatcherParams, Method};
use super::prepared::PreparedPair;
use super::regions::{Group, MatchRegion, Reach, Rect, RegionMap, Tile, groups};
use super::row_queue::{Direction, MapRows, RowQueue};
use super::saturation::SaturationTest;
use super::semi_global::{self, Penalties, SemiGlobal};
use super::smooth::Smoother;
use super::speckle::SpeckleFilter;
use super::stripe::{Frame, Stripe};
use super::texture_test::TextureTest;
use super::windowed::{self, WindowStripe};
use crate::error::Result;
use crate::image::ImageRef;
use crate::kernels::{CostKernels, Kernels, Level};

/// How far beyond a box its islands of speckle are followed at first, px.
const SPECKLE_MARGIN: usize = 8;

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
    coarse: Option<CoarseCosts>,
    buffers: Buffers,
    texture: TextureTest,
    saturation: SaturationTest,
    speckle: SpeckleFilter,
    filler: Filler,
    smoother: Smoother,
    region_map: RegionMap,
    tile_map: DisparityMap,
}

/// Both images, and where they have a source.
#[derive(Clone, Copy)]
struct MaskedPair<'a> {
    left: ImageRef<'a, u8>,
    right: ImageRef<'a, u8>,
    left_valid: Option<ImageRef<'a, u8>>,
    right_valid: Option<ImageRef<'a, u8>>,
}

impl<'a> MaskedPair<'a> {
    fn crop(&self, Rect { columns, rows }: &Rect) -> Self {
        let crop = |image: ImageRef<'a, u8>| image.crop(columns.clone(), rows.clone());
        Self {
            left: crop(self.left),
            right: crop(self.right),
            left_valid: self.left_valid.map(crop),
            right_valid: self.right_valid.map(crop),
        }
    }
}

/// Buffers for what the parameters need: sums of absolute differences of one width, other window sums, or paths.
#[derive(Debug)]
enum Buffers {
    U16(Vec<Stripe<u16>>),
    U32(Vec<Stripe<u32>>),
    Windowed(Vec<WindowStripe>),
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
            Method::Sad if params.fits_u16() => Buffers::U16(Vec::new()),
            Method::Sad => Buffers::U32(Vec::new()),
            Method::Sad5 | Method::Census | Method::Bt => Buffers::Windowed(Vec::new()),
        };
        Ok(Self {
            params,
            kernels: Kernels::new(level),
            threads: thread_count(params.threads)?,
            pair: PreparedPair::default(),
            coarse: params.is_guided().then(|| CoarseCosts::new(level)),
            buffers,
            texture: TextureTest::default(),
            saturation: SaturationTest::default(),
            speckle: SpeckleFilter::default(),
            filler: Filler::default(),
            smoother: Smoother::default(),
            region_map: RegionMap::default(),
            tile_map: DisparityMap::default(),
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
        let params = self.params;
        let pair = MaskedPair { left, right, left_valid, right_valid };
        Crew::assemble(self.threads, |crew| self.compute_whole(crew, &params, &pair, out));
        Ok(())
    }

    /// Disparities of some boxes of the left image, each with the range it asks for: exactly the values and bits that
    /// matching the whole image with that range gives them. Everything else is [`Validity::BORDER`]. A pixel in several
    /// boxes has the range of the first. `out` takes the images' size; its range spans those of the boxes.
    ///
    /// The cost is that of the boxes and of margins around them: half a window on every side, with [`Method::Sad5`] a whole
    /// one; on the left the largest
    /// disparity, and on the right, with the left–right test, as many columns as there are disparities. Islands of
    /// speckle that leave a box are followed outside of it. With [`MatcherParams::coarse_weight`],
    /// [`fill`](MatcherParams::fill) or [`smooth`](MatcherParams::smooth), and for [`Method::Sgm`], answers depend on the
    /// whole image: all of it is matched.
    ///
    /// Fails as [`compute_masked`](Self::compute_masked) does, and if there is no box, more than
    /// [`MatchRegion::MAX_COUNT`], or one that is empty or not inside the image.
    pub fn compute_regions(
        &mut self,
        left: ImageRef<'_, u8>,
        right: ImageRef<'_, u8>,
        left_valid: Option<ImageRef<'_, u8>>,
        right_valid: Option<ImageRef<'_, u8>>,
        regions: &[MatchRegion],
        out: &mut DisparityMap,
    ) -> Result<()> {
        require_sizes(left, right, left_valid, right_valid)?;
        let pair = MaskedPair { left, right, left_valid, right_valid };
        let (width, height) = (left.width(), left.height());
        let groups = groups(regions, &self.params, width, height)?;
        out.resize(width, height);
        out.values.fill(0);
        out.validity.fill(Validity::BORDER);
        let end = |group: &Group| group.params.min_disparity + group.params.num_disparities;
        out.min_disparity = groups.iter().map(|group| group.params.min_disparity).min().unwrap_or(0);
        out.num_disparities = groups.iter().map(end).max().unwrap_or(0) - out.min_disparity;
        let mut region_map = std::mem::take(&mut self.region_map);
        Crew::assemble(self.threads, |crew| {
            for group in &groups {
                region_map.start(width, height, &group.asked);
                match Reach::of(&group.params) {
                    None => self.compute_whole(crew, &group.params, &pair, &mut region_map.map),
                    Some(reach) => self.compute_near(crew, group, reach, &pair, &mut region_map),
                }
                region_map.copy_to(&group.asked, out);
            }
        });
        self.region_map = region_map;
        Ok(())
    }

    /// Answers what a group asks for from crops of the images.
    fn compute_near(
        &mut self,
        crew: &Crew,
        group: &Group,
        reach: Reach,
        pair: &MaskedPair<'_>,
        region_map: &mut RegionMap,
    ) {
        let params = &group.params;
        let (width, height) = (pair.left.width(), pair.left.height());
        let mut wanted = group.asked.clone();
        let mut margin = SPECKLE_MARGIN;
        while !wanted.is_empty() {
            for tile in reach.tiles(&wanted, width, height) {
                let crop = reach.around(&tile.bounds, width, height);
                let first_column = reach.first_matched(&tile.bounds, &crop);
                self.compute_tile(crew, params, &pair.crop(&crop), &tile, &crop, first_column);
                region_map.take(&tile, crop.columns.start, &self.tile_map);
            }
            if params.speckle_size == 0 {
                return;
            }
            region_map.clear_speckles();
            let (size, range) = (params.speckle_size, params.speckle_range);
            let rows = region_map.rows();
            self.speckle.mark(&self.kernels, crew, &mut region_map.map, rows, size, range);
            wanted = region_map.undecided(params.speckle_range, margin);
            margin *= 2;
        }
    }

    /// Matches the rows of a tile in a crop of the pair, which is `crop` in the image, into `tile_map`.
    fn compute_tile(
        &mut self,
        crew: &Crew,
        params: &MatcherParams,
        pair: &MaskedPair<'_>,
        tile: &Tile,
        crop: &Rect,
        first_column: usize,
    ) {
        let Rect { rows, .. } = &tile.bounds;
        let mut tile_map = std::mem::take(&mut self.tile_map);
        tile_map.resize(crop.columns.len(), rows.len());
        let rows = rows.start - crop.rows.start..rows.end - crop.rows.start;
        self.match_rows(crew, params, pair, rows, first_column, &mut tile_map);
        self.tile_map = tile_map;
    }

    /// Every step, for the whole image.
    fn compute_whole(
        &mut self,
        crew: &Crew,
        params: &MatcherParams,
        pair: &MaskedPair<'_>,
        out: &mut DisparityMap,
    ) {
        out.resize(pair.left.width(), pair.left.height());
        out.min_disparity = params.min_disparity;
        out.num_disparities = params.num_disparities;
        self.match_rows(crew, params, pair, 0..pair.left.height(), 0, out);
        if params.speckle_size > 0 {
            let (size, range) = (params.speckle_size, params.speckle_range);
            self.speckle.mark(&self.kernels, crew, out, 0..pair.left.height(), size, range);
        }
        if params.fill {
            self.filler.fill(crew, out, pair.left);
        }
        if params.smooth {
            self.smoother.smooth(crew, out, pair.left);
        }
    }

    /// Everything that is decided row by row, for some rows of a pair; paths need all of them. `out` has the pair's width
    /// and those rows; columns left of `first_column` may get any value.
    fn match_rows(
        &mut self,
        crew: &Crew,
        params: &MatcherParams,
        pair: &MaskedPair<'_>,
        rows: Range<usize>,
        first_column: usize,
        out: &mut DisparityMap,
    ) {
        let &MaskedPair { left, right, left_valid, right_valid } = pair;
        let Self { kernels, pair, coarse, buffers, texture, saturation, .. } = self;
        if let Buffers::U16(_) | Buffers::U32(_) = buffers {
            let lanes = kernels.lanes(params.num_disparities);
            pair.prepare(kernels, params, lanes, left, right, crew);
        }
        if let Some(coarse) = coarse {
            coarse.compute(params, [left, right], [left_valid, right_valid], crew);
        }
        let coarse = coarse.as_ref();
        let frame = Frame { kernels, params, pair, left_valid, right_valid, coarse, first_column };
        let first_row = rows.start;
        match buffers {
            Buffers::U16(stripes) => compute_stripes(stripes, &frame, rows, crew, out),
            Buffers::U32(stripes) => compute_stripes(stripes, &frame, rows, crew, out),
            Buffers::Windowed(stripes) => {
                let frame = windowed::Frame { kernels, params, left, right, left_valid, right_valid };
                compute_stripes(stripes, &frame, rows, crew, out);
                if params.texture_threshold > 0 {
                    texture.mark(kernels, params, left, first_row, out);
                }
            }
            Buffers::SemiGlobal(buffers) => {
                let (buffers, penalties) = &mut **buffers;
                let frame =
                    semi_global::Frame { kernels, params, penalties, left, right, left_valid, right_valid };
                buffers.compute(&frame, crew, out);
            }
        }
        if params.saturation_threshold > 0 {
            saturation.mark(kernels, params, left, first_row, out);
        }
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

/// What matches rows of a frame `F`, with buffers of its own.
trait StripeBuffers<F>: Default + Send {
    /// Matches the rows of a queue on their way in a direction; row 0 of the map is row `first` of the images.
    fn compute(&mut self, frame: &F, first: usize, direction: Direction, queue: &RowQueue<MapRows<'_>>);
}

impl<C: CostKernels> StripeBuffers<Frame<'_>> for Stripe<C> {
    fn compute(
        &mut self,
        frame: &Frame<'_>,
        first: usize,
        direction: Direction,
        queue: &RowQueue<MapRows<'_>>,
    ) {
        self.compute(frame, first, direction, queue);
    }
}

impl StripeBuffers<windowed::Frame<'_>> for WindowStripe {
    fn compute(
        &mut self,
        frame: &windowed::Frame<'_>,
        first: usize,
        direction: Direction,
        queue: &RowQueue<MapRows<'_>>,
    ) {
        self.compute(frame, first, direction, queue);
    }
}

/// Fewer rows than this are not worth a thread: a window's rows must be summed before the first.
const MIN_ROWS: usize = 32;

fn compute_stripes<F: Sync, S: StripeBuffers<F>>(
    buffers: &mut Vec<S>,
    frame: &F,
    rows: Range<usize>,
    crew: &Crew,
    out: &mut DisparityMap,
) {
    let workers = crew.size().min(rows.len().div_ceil(MIN_ROWS));
    buffers.resize_with(workers.max(buffers.len()), S::default);
    let stripes = &RowQueue::stripes(rows.len(), workers, MapRows::of(out));
    crew.run_all(buffers[..workers].iter_mut().enumerate().map(|(worker, stripe)| {
        move || stripe.compute(frame, rows.start, Direction::of_worker(worker), stripes.of_worker(worker))
    }));
}
