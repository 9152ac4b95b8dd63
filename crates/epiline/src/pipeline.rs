//! The whole path for one frame after the other: every buffer is here, and one `process`.

use std::sync::Arc;
use std::time::{Duration, Instant};

use crate::camera::StereoCalibration;
use crate::error::{Error, Result};
use crate::ground::{Ground, GroundEstimator, GroundParams, NoGround};
use crate::image::{Image, ImageRef, StereoPair};
use crate::matching::{DisparityMap, MatchRegion, MatcherParams, StereoMatcher};
use crate::obstacles::{Obstacle, ObstacleFinder, ObstacleParams};
use crate::preprocess::equalize_histogram;
use crate::range::{RangeImage, Triangulation};
use crate::rectification::{
    AlignmentError, AlignmentMeter, AlignmentOptions, Drift, DriftMeter, RectifiedGeometry, Rectifier,
    realign,
};
use crate::regions::{ProfileParams, Profiler, Region, RegionProfile};
use crate::scan::{RobotFromCamera, Scan, ScanParams, Scanner};
use crate::tracking::{Detection, Track, TrackParams, Tracker};

/// What a [`Pipeline`] does to each pair.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PipelineParams {
    /// Matching.
    pub matcher: MatcherParams,
    /// Equalise both histograms first (eq. 3 of the paper). Only for matching without a prefilter.
    pub equalize: bool,
    /// Match only in the regions: what lies outside of them is unknown, also to the search for ground and obstacles.
    /// Where the answers of the matcher depend on the whole image (costs from half the resolution, filling, smoothing,
    /// semi-global matching) all of it is matched first, and no time is saved.
    pub only_regions: bool,
    /// Measure how well the rows of each pair agree.
    pub alignment: bool,
    /// Standard deviation of a disparity, px; used by all stages, whatever `profile`, `ground` and `obstacles` say.
    pub disparity_sigma_px: f64,
    /// How regions are read.
    pub profile: ProfileParams,
    /// How the ground is found; `None`: not at all.
    pub ground: Option<GroundParams>,
    /// How obstacles are found.
    pub obstacles: ObstacleParams,
    /// How they are followed over frames, whose stamps must tell them apart; `None`: not at all.
    pub tracks: Option<TrackParams>,
    /// How the floor is scanned; `None`: not at all.
    pub scan: Option<ScanParams>,
    /// Where the camera is on the robot, for the scan; `None`: the robot is the camera.
    pub robot_from_camera: Option<RobotFromCamera>,
}

impl PipelineParams {
    const BLOCK_SIZE: usize = 9;
    /// Grey levels of clipped x-Sobel.
    const TEXTURE_PER_PIXEL: u32 = 8;

    /// The default for images of this width: every test of the matcher on, and costs from half the resolution counted for
    /// less than a matcher by itself does, and not where a window sees next to nothing: their answers there are what
    /// obstacles that are none are made of, but without them a street has no ground. A sixth of the width is searched
    /// (in steps of 16 px).
    pub fn for_width(width: usize) -> Self {
        let matcher = MatcherParams {
            num_disparities: Self::default_disparities(width),
            block_size: Self::BLOCK_SIZE,
            coarse_weight: 2,
            texture_threshold: Self::TEXTURE_PER_PIXEL * (Self::BLOCK_SIZE * Self::BLOCK_SIZE) as u32,
            ..MatcherParams::with_all_tests()
        };
        Self {
            matcher,
            equalize: false,
            only_regions: false,
            alignment: true,
            disparity_sigma_px: 0.25,
            profile: ProfileParams::default(),
            ground: Some(GroundParams::default()),
            obstacles: ObstacleParams::default(),
            tracks: Some(TrackParams::default()),
            scan: Some(ScanParams::default()),
            robot_from_camera: None,
        }
    }

    /// Disparities to search in images of this width: a sixth of it in steps of 16 px, and no more than it has columns.
    pub fn default_disparities(width: usize) -> usize {
        (width.div_ceil(6 * 16) * 16).clamp(1, MatcherParams::MAX_DISPARITIES).min(width.max(1))
    }
}

/// How long each stage took; zero for one that is off.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[expect(missing_docs, reason = "the names are those of the stages")]
pub struct StageTimes {
    pub equalize: Duration,
    pub rectify: Duration,
    pub matching: Duration,
    pub range: Duration,
    pub regions: Duration,
    pub ground: Duration,
    pub obstacles: Duration,
    pub tracks: Duration,
    pub scan: Duration,
    pub alignment: Duration,
    pub total: Duration,
}

/// Everything known about one pair.
#[derive(Debug, Clone, PartialEq)]
pub struct FrameResult {
    /// Running number, as the source gave it.
    pub seq: u64,
    /// When the left image was exposed, nanoseconds on the source's clock.
    pub left_stamp_nanos: i64,
    /// When the right image was exposed, same clock.
    pub right_stamp_nanos: i64,
    /// Aligned left image.
    pub left: Image<u8>,
    /// Aligned right image.
    pub right: Image<u8>,
    /// Where the aligned images have a source (255) and where not (0): left, right. The same for all frames.
    pub valid: Arc<[Image<u8>; 2]>,
    /// Disparities of the left image.
    pub disparity: DisparityMap,
    /// Metres of the left image.
    pub range: RangeImage,
    /// One per region.
    pub profiles: Vec<RegionProfile>,
    /// The ground, or why there is none.
    pub ground: Ground,
    /// What stands in any of the regions, nearest first.
    pub obstacles: Vec<Obstacle>,
    /// Obstacles followed over frames, oldest first; those not confirmed among them.
    pub tracks: Vec<Track>,
    /// The floor in every direction; without directions if it was not asked for.
    pub scan: Scan,
    /// Vertical residual of the pair, if asked for.
    pub alignment: Option<AlignmentError>,
    /// How the rig has moved since calibration, from this pair and those before it; with `alignment`.
    pub drift: Option<Drift>,
    /// How long it took.
    pub times: StageTimes,
}

/// From raw or aligned pairs to ranges, regions and obstacles.
///
/// Keeps every buffer: with one thread a warm [`process`](Self::process) allocates next to nothing.
#[derive(Debug)]
pub struct Pipeline {
    params: PipelineParams,
    regions: Vec<Region>,
    /// Where to match; empty for the whole image.
    match_regions: Vec<MatchRegion>,
    geometry: RectifiedGeometry,
    /// `None` if pairs come aligned.
    rectifier: Option<Rectifier>,
    valid: Arc<[Image<u8>; 2]>,
    matcher: StereoMatcher,
    triangulation: Triangulation,
    profiler: Profiler,
    /// `None` if no ground was asked for.
    ground: Option<GroundEstimator>,
    finder: ObstacleFinder,
    /// `None` if tracks were not asked for.
    tracker: Option<Tracker>,
    scanner: Scanner,
    meter: AlignmentMeter,
    drift: DriftMeter,
    /// `None` if pairs come aligned.
    calibration: Option<StereoCalibration>,
    equalized: [Image<u8>; 2],
    result: Option<FrameResult>,
}

impl Pipeline {
    /// A pipeline for pairs as the calibrated cameras take them.
    ///
    /// # Errors
    ///
    /// Those of [`Rectifier::new`]; [`Error::InvalidParameter`] for parameters out of range or a region outside the
    /// aligned image.
    pub fn for_cameras(
        calibration: &StereoCalibration,
        regions: Vec<Region>,
        params: PipelineParams,
    ) -> Result<Self> {
        let rectifier = Rectifier::new(calibration)?;
        let geometry = *rectifier.geometry();
        let valid = [rectifier.left_valid(), rectifier.right_valid()].map(copy_of);
        let pipeline = Self::new(geometry, Some(rectifier), valid, regions, params)?;
        let drift = DriftMeter::for_calibration(&geometry, calibration)?;
        Ok(Self { calibration: Some(calibration.clone()), drift, ..pipeline })
    }

    /// A pipeline for pairs that come aligned.
    ///
    /// # Errors
    ///
    /// [`Error::InvalidParameter`] for parameters out of range or a region outside the image.
    pub fn for_aligned(
        geometry: RectifiedGeometry,
        regions: Vec<Region>,
        params: PipelineParams,
    ) -> Result<Self> {
        let whole = || Image::from_fn(geometry.width, geometry.height, |_, _| 255);
        Self::new(geometry, None, [whole(), whole()], regions, params)
    }

    fn new(
        geometry: RectifiedGeometry,
        rectifier: Option<Rectifier>,
        valid: [Image<u8>; 2],
        regions: Vec<Region>,
        mut params: PipelineParams,
    ) -> Result<Self> {
        let matcher = StereoMatcher::new(params.matcher)?;
        params.profile.disparity_sigma_px = params.disparity_sigma_px;
        params.profile.validate()?;
        if let Some(ground) = &mut params.ground {
            ground.disparity_sigma_px = params.disparity_sigma_px;
        }
        params.obstacles.disparity_sigma_px = params.disparity_sigma_px;
        params.obstacles.validate()?;
        if let Some(scan) = &mut params.scan {
            scan.disparity_sigma_px = params.disparity_sigma_px;
            scan.validate()?;
        }
        for region in &regions {
            region.validate(geometry.width, geometry.height)?;
        }
        let match_regions = if params.only_regions {
            if regions.is_empty() {
                return Err(Error::invalid("only_regions", "true", "needs at least one region"));
            }
            regions.iter().map(|region| region.to_match(Some(&geometry))).collect::<Result<_>>()?
        } else {
            Vec::new()
        };
        let MatcherParams { min_disparity, num_disparities, .. } = params.matcher;
        let searched =
            AlignmentOptions { num_disparities: min_disparity + num_disparities, ..Default::default() };
        Ok(Self {
            params,
            regions,
            match_regions,
            geometry,
            rectifier,
            valid: Arc::new(valid),
            matcher,
            triangulation: Triangulation::new(&geometry, params.disparity_sigma_px)?,
            profiler: Profiler::default(),
            ground: params.ground.map(GroundEstimator::new).transpose()?,
            finder: ObstacleFinder::default(),
            tracker: params.tracks.map(Tracker::new).transpose()?,
            scanner: Scanner::default(),
            meter: AlignmentMeter::new(searched)?,
            drift: DriftMeter::new(&geometry),
            calibration: None,
            equalized: [Image::default(), Image::default()],
            result: None,
        })
    }

    /// Geometry of the aligned images.
    pub fn geometry(&self) -> &RectifiedGeometry {
        &self.geometry
    }

    /// The regions read.
    pub fn regions(&self) -> &[Region] {
        &self.regions
    }

    /// The parameters in use.
    pub fn params(&self) -> &PipelineParams {
        &self.params
    }

    /// A result without content, to fill with [`process_into`](Self::process_into).
    pub fn empty_result(&self) -> FrameResult {
        FrameResult {
            seq: 0,
            left_stamp_nanos: 0,
            right_stamp_nanos: 0,
            left: Image::default(),
            right: Image::default(),
            valid: self.valid.clone(),
            disparity: DisparityMap::default(),
            range: RangeImage::new(&self.geometry),
            profiles: self.regions.iter().cloned().map(RegionProfile::new).collect(),
            ground: Err(NoGround::NotAsked),
            obstacles: Vec::new(),
            tracks: Vec::new(),
            scan: Scan::default(),
            alignment: None,
            drift: None,
            times: StageTimes::default(),
        }
    }

    /// Takes the rig to hold as it is now: from the next pair on, drift counts from what was seen so far.
    ///
    /// # Errors
    ///
    /// [`Error::Degenerate`] if no pair with enough matches was seen yet.
    pub fn set_drift_reference(&mut self) -> Result<()> {
        let seen = self.drift.drift();
        if seen.frames == 0 {
            return Err(Error::degenerate("drift", "no pair with enough matches was seen yet"));
        }
        self.drift.set_reference(seen);
        Ok(())
    }

    /// Corrects the rig by the drift seen so far: from the next pair on the corrected calibration, which is returned,
    /// aligns. What was seen before is forgotten.
    ///
    /// # Errors
    ///
    /// [`Error::Degenerate`] for pairs that come aligned, and those of [`realign`]; the pipeline is as before then.
    pub fn realign(&mut self) -> Result<StereoCalibration> {
        let Some(calibration) = &self.calibration else {
            return Err(Error::degenerate(
                "realign",
                "the pairs come aligned; there is no calibration to correct",
            ));
        };
        let corrected = realign(calibration, &self.drift.drift())?;
        *self = Self::for_cameras(&corrected, self.regions.clone(), self.params)?;
        Ok(corrected)
    }

    /// Processes a pair. The result stays valid until the next call.
    ///
    /// # Errors
    ///
    /// [`Error::SizeMismatch`] unless both images have the size of the calibrated (or, for
    /// [`for_aligned`](Self::for_aligned), the aligned) images; what the matcher refuses.
    pub fn process(&mut self, pair: StereoPair<'_>) -> Result<&FrameResult> {
        let mut result = self.result.take().unwrap_or_else(|| self.empty_result());
        let outcome = self.process_into(pair, &mut result);
        let result = self.result.insert(result);
        outcome.map(|()| &*result)
    }

    /// Processes a pair into a result of the caller's, made by [`empty_result`](Self::empty_result) of this pipeline.
    ///
    /// # Errors
    ///
    /// Those of [`process`](Self::process); the result's content is unspecified then.
    pub fn process_into(&mut self, pair: StereoPair<'_>, result: &mut FrameResult) -> Result<()> {
        let begin = Instant::now();
        let mut lap = Lap(begin);
        let times = &mut result.times;
        (result.seq, result.left_stamp_nanos, result.right_stamp_nanos) =
            (pair.seq, pair.left_stamp_nanos, pair.right_stamp_nanos);

        let [mut left, mut right] = [pair.left, pair.right];
        if self.params.equalize {
            equalize_histogram(left, &mut self.equalized[0]);
            equalize_histogram(right, &mut self.equalized[1]);
            [left, right] = self.equalized.each_ref().map(Image::view);
        }
        times.equalize = lap.time();

        if let Some(rectifier) = &self.rectifier {
            rectifier.rectify_left(left, &mut result.left)?;
            rectifier.rectify_right(right, &mut result.right)?;
        } else {
            self.require_aligned_size(left)?;
            left.require_same_size("left image", &right, "right image")?;
            copy_into(left, &mut result.left);
            copy_into(right, &mut result.right);
        }
        times.rectify = lap.time();

        let (left, right) = (result.left.view(), result.right.view());
        // Pairs that come aligned have a source everywhere.
        let [left_valid, right_valid] =
            self.valid.each_ref().map(|mask| self.rectifier.is_some().then(|| mask.view()));
        let (matcher, disparity) = (&mut self.matcher, &mut result.disparity);
        if self.params.only_regions {
            let regions = &self.match_regions;
            matcher.compute_regions(left, right, left_valid, right_valid, regions, disparity)?;
        } else {
            matcher.compute_masked(left, right, left_valid, right_valid, disparity)?;
        }
        times.matching = lap.time();

        self.triangulation.apply(&result.disparity, &mut result.range)?;
        times.range = lap.time();

        for profile in &mut result.profiles {
            self.profiler.read(&result.disparity, Some(&self.geometry), &self.params.profile, profile)?;
        }
        times.regions = lap.time();

        result.ground = match &mut self.ground {
            Some(estimator) => estimator.estimate(&result.disparity, &self.geometry)?,
            None => Err(NoGround::NotAsked),
        };
        times.ground = lap.time();

        self.finder.find(
            &result.disparity,
            &self.geometry,
            result.ground.as_ref().ok(),
            &self.regions,
            &self.params.obstacles,
            &mut result.obstacles,
        )?;
        times.obstacles = lap.time();

        if let Some(tracker) = &mut self.tracker {
            let detections = result.obstacles.iter().map(Detection::from);
            tracker.update(detections, pair.left_stamp_nanos, None, &mut result.tracks)?;
        }
        times.tracks = lap.time();

        if let Some(params) = &self.params.scan {
            let mounting = self.params.robot_from_camera.as_ref();
            let (disparity, scan) = (&result.disparity, &mut result.scan);
            let mut scan_over =
                |ground| self.scanner.scan(disparity, &self.geometry, ground, mounting, params, scan);
            let ground = result.ground.as_ref().ok();
            // An estimate so steep that directions meet over it is one frame's mistake, not the end of a run.
            match scan_over(ground) {
                Err(Error::Degenerate { .. }) if ground.is_some() => scan_over(None)?,
                outcome => outcome?,
            }
        }
        times.scan = lap.time();

        if self.params.alignment {
            let measured = self.meter.measure(left, right, left_valid, right_valid)?;
            result.drift = Some(self.drift.add(&measured.matches));
            store(measured, &mut result.alignment);
        }
        times.alignment = lap.time();
        times.total = begin.elapsed();
        Ok(())
    }

    fn require_aligned_size(&self, left: ImageRef<'_, u8>) -> Result<()> {
        let RectifiedGeometry { width, height, .. } = self.geometry;
        if (left.width(), left.height()) == (width, height) {
            return Ok(());
        }
        Err(Error::SizeMismatch {
            first: "left image",
            first_width: left.width(),
            first_height: left.height(),
            second: "geometry",
            second_width: width,
            second_height: height,
        })
    }
}

/// Time since the last look.
struct Lap(Instant);

impl Lap {
    fn time(&mut self) -> Duration {
        let now = Instant::now();
        now - std::mem::replace(&mut self.0, now)
    }
}

fn copy_into(src: ImageRef<'_, u8>, dst: &mut Image<u8>) {
    dst.resize(src.width(), src.height());
    for (y, row) in src.rows().enumerate() {
        dst.row_mut(y).copy_from_slice(row);
    }
}

fn copy_of(src: ImageRef<'_, u8>) -> Image<u8> {
    let mut copy = Image::default();
    copy_into(src, &mut copy);
    copy
}

/// Copies a measurement, keeping the memory of the one before.
fn store(measured: &AlignmentError, kept: &mut Option<AlignmentError>) {
    match kept {
        Some(kept) => {
            let AlignmentError { median_px, signed_median_px, spread_px, .. } = *measured;
            (kept.median_px, kept.signed_median_px, kept.spread_px) =
                (median_px, signed_median_px, spread_px);
            kept.matches.clone_from(&measured.matches);
        }
        None => *kept = Some(measured.clone()),
    }
}
