//! From the obstacles of each frame to tracks.
//!
//! ```text
//! predict every track to the frame's stamp
//! parts of one thing -> the best seen part
//! assign obstacles to confirmed tracks, what is left to the others   (each at least cost, inside the gates)
//! update; begin tracks at what is left, unless it is a part of a track that was seen
//! confirm tracks seen often enough, end those seen too rarely
//! ```

use super::assignment::{Assignment, UNASSIGNED};
use super::kalman::{Filter, Innovation};
use super::own_motion::OwnMotion;
use super::{Continuity, Detection, EgoMotion, Track, TrackParams};
use crate::error::Result;

/// Weight of a new width or height in the smoothed one.
const SIZE_WEIGHT: f64 = 0.3;

/// A track and what it takes to go on with it.
#[derive(Debug, Clone, Copy)]
struct Member {
    track: Track,
    filter: Filter,
    born_nanos: i64,
    /// Above or below the camera, metres.
    offset_m: f64,
    /// One bit a frame, the last one lowest: seen or not.
    history: u32,
    /// How many frames it has lived, this one included.
    frames: u32,
}

/// Follows obstacles over frames; keeps its buffers.
///
/// The same frames give the same tracks, whatever machine or thread: nothing is random, and no clock is read.
#[derive(Debug, Clone)]
pub struct Tracker {
    params: TrackParams,
    members: Vec<Member>,
    next_id: u64,
    last_nanos: Option<i64>,
    own_motion: OwnMotion,
    detections: Vec<Detection>,
    /// Detections by how well they were seen.
    by_support: Vec<usize>,
    /// Detections that no track has yet, of those that stand for themselves.
    free: Vec<usize>,
    /// Members taking part in an assignment.
    rows: Vec<usize>,
    /// Of each row and free detection what the one says to the other; `None` outside the gate.
    pairs: Vec<Option<Innovation>>,
    assignment: Assignment,
}

impl Tracker {
    /// A tracker without tracks.
    ///
    /// # Errors
    ///
    /// [`Error::InvalidParameter`](crate::Error::InvalidParameter) for a parameter out of range.
    pub fn new(params: TrackParams) -> Result<Self> {
        params.validate()?;
        Ok(Self {
            params,
            members: Vec::new(),
            next_id: 0,
            last_nanos: None,
            own_motion: OwnMotion::default(),
            detections: Vec::new(),
            by_support: Vec::new(),
            free: Vec::new(),
            rows: Vec::new(),
            pairs: Vec::new(),
            assignment: Assignment::default(),
        })
    }

    /// The parameters in use.
    pub fn params(&self) -> &TrackParams {
        &self.params
    }

    /// Forgets all tracks; their ids are not given again.
    pub fn reset(&mut self) {
        self.members.clear();
        self.own_motion.reset();
        self.last_nanos = None;
    }

    /// Takes in what was seen at `stamp_nanos` and fills `out` with every track that lives, oldest first.
    ///
    /// `ego` is how the camera moved since the update before; give it always or never, for it decides what velocities
    /// are relative to.
    ///
    /// # Errors
    ///
    /// [`Error::InvalidParameter`](crate::Error::InvalidParameter) for a detection or a motion that is not finite or
    /// out of range; the tracks are as before then.
    pub fn update(
        &mut self,
        detections: impl IntoIterator<Item = Detection>,
        stamp_nanos: i64,
        ego: Option<&EgoMotion>,
        out: &mut Vec<Track>,
    ) -> Result<Continuity> {
        self.detections.clear();
        self.detections.extend(detections);
        self.detections.iter().try_for_each(Detection::validate)?;
        ego.map_or(Ok(()), EgoMotion::validate)?;

        let (continuity, elapsed_s) = self.continuity(stamp_nanos);
        if continuity != Continuity::Repeated {
            if matches!(continuity, Continuity::Backward | Continuity::Gap) {
                self.members.clear();
                self.own_motion.reset();
            }
            self.last_nanos = Some(stamp_nanos);
            let estimated = self
                .params
                .scene_stands_still
                .then(|| self.own_motion.estimate(&self.detections, elapsed_s.max(0.0)));
            self.predict(elapsed_s, ego.or(estimated.as_ref()));
            self.find_wholes();
            for confirmed in [true, false] {
                self.assign(confirmed);
            }
            self.begin_tracks(stamp_nanos);
            self.end_tracks();
            for member in &mut self.members {
                member.describe(stamp_nanos);
            }
        }
        out.clear();
        out.extend(self.members.iter().map(|member| member.track));
        Ok(continuity)
    }

    /// What a stamp is to the one before, and the seconds between them.
    fn continuity(&self, stamp_nanos: i64) -> (Continuity, f64) {
        let Some(last) = self.last_nanos else { return (Continuity::Started, 0.0) };
        // Wider than the stamps: their difference may not fit.
        let elapsed_s = (i128::from(stamp_nanos) - i128::from(last)) as f64 * 1e-9;
        let continuity = match stamp_nanos.cmp(&last) {
            std::cmp::Ordering::Less => Continuity::Backward,
            std::cmp::Ordering::Equal => Continuity::Repeated,
            std::cmp::Ordering::Greater if elapsed_s > self.params.max_gap_s => Continuity::Gap,
            std::cmp::Ordering::Greater => Continuity::Advanced,
        };
        (continuity, elapsed_s)
    }

    fn predict(&mut self, elapsed_s: f64, ego: Option<&EgoMotion>) {
        for member in &mut self.members {
            member.filter.predict(elapsed_s, self.params.velocity_walk_mps);
            if let Some(ego) = ego {
                member.filter.follow(ego);
            }
            member.track.obstacle = None;
            member.track.misses += 1;
            member.frames += 1;
            member.history <<= 1;
        }
    }

    /// Lists as free what stands for itself: of detections that are one thing, seen in two regions or in parts above
    /// each other, the one of most pixels.
    fn find_wholes(&mut self) {
        let Self { params, detections, by_support, free, .. } = self;
        by_support.clear();
        by_support.extend(0..detections.len());
        by_support.sort_unstable_by_key(|&i| (std::cmp::Reverse(detections[i].support), i));
        free.clear();
        for &i in &*by_support {
            if !free.iter().any(|&whole| are_one(&detections[whole], &detections[i], params)) {
                free.push(i);
            }
        }
        free.sort_unstable();
    }

    /// Gives free detections to the members that are, or are not, confirmed.
    ///
    /// The confirmed come first: a new track, whose gate is wide because its velocity is unknown, takes nothing from
    /// them.
    fn assign(&mut self, confirmed: bool) {
        let gate = self.params.gate();
        self.rows.clear();
        self.rows.extend((0..self.members.len()).filter(|&i| self.members[i].track.confirmed == confirmed));
        self.pairs.clear();
        let mut largest = f64::NEG_INFINITY;
        for &row in &self.rows {
            let filter = &self.members[row].filter;
            for &column in &self.free {
                let detection = &self.detections[column];
                let innovation = filter
                    .innovation(detection.position_m(), &detection.covariance(&self.params))
                    .filter(|innovation| innovation.squared_distance <= gate);
                largest = largest.max(innovation.map_or(largest, |found| found.log_determinant));
                self.pairs.push(innovation);
            }
        }
        if largest == f64::NEG_INFINITY {
            return;
        }
        let (rows, columns) = (self.rows.len(), self.free.len());
        // Minus twice the logarithm of the likelihood. The same for every row that misses, and not less than any pair.
        let cost = |row: usize, column: usize| {
            self.pairs[row * columns + column]
                .map_or(f64::INFINITY, |found| found.squared_distance + found.log_determinant)
        };
        let assigned = self.assignment.solve(rows, columns, gate + largest, cost);
        for (row, &column) in assigned.iter().enumerate().filter(|&(_, &column)| column != UNASSIGNED) {
            let innovation =
                self.pairs[row * columns + column].expect("only pairs within the gate are assigned");
            let index = self.free[column];
            self.members[self.rows[row]].take(&self.detections[index], index, &innovation, &self.params);
        }
        let members = &self.members;
        self.free.retain(|&index| !members.iter().any(|member| member.track.obstacle == Some(index)));
    }

    fn begin_tracks(&mut self, stamp_nanos: i64) {
        let gate = self.params.gate();
        let seen_before = self.members.len();
        for &index in &self.free {
            let detection = &self.detections[index];
            let of_track = |member: &Member| member.holds(detection, gate, &self.params);
            if self.members[..seen_before].iter().any(of_track) {
                continue;
            }
            self.members.push(Member::new(self.next_id, detection, index, stamp_nanos, &self.params));
            self.next_id += 1;
        }
    }

    fn end_tracks(&mut self) {
        let TrackParams { confirm_hits, confirm_window, max_misses, .. } = self.params;
        self.members.retain_mut(|member| {
            let window = u32::MAX >> (32 - confirm_window);
            let hits = (member.history & window).count_ones();
            member.track.confirmed |= hits >= confirm_hits;
            let behind_camera = member.filter.state.y <= 0.0;
            let lost = if member.track.confirmed {
                member.track.misses > max_misses
            } else {
                member.frames.min(confirm_window) - hits > confirm_window - confirm_hits
            };
            !(behind_camera || lost)
        });
    }
}

/// Whether two detections are one thing: they share half the columns of the narrower, at one range as far as can be
/// told.
fn are_one(one: &Detection, other: &Detection, params: &TrackParams) -> bool {
    let (a, b) = (one.bounds, other.bounds);
    let shared = (a.x + a.width).min(b.x + b.width).saturating_sub(a.x.max(b.x));
    let narrower = a.width.min(b.width);
    let (sigma_one_m, _) = one.sigmas_m(params);
    let (sigma_other_m, _) = other.sigmas_m(params);
    let apart_m = one.position_m().norm() - other.position_m().norm();
    narrower > 0
        && 2 * shared >= narrower
        && apart_m * apart_m <= params.gate() * (sigma_one_m.powi(2) + sigma_other_m.powi(2))
}

impl Member {
    fn new(id: u64, detection: &Detection, index: usize, stamp_nanos: i64, params: &TrackParams) -> Self {
        let position_m = detection.position_m();
        let filter = Filter::new(position_m, detection.covariance(params), params.initial_velocity_mps);
        Self {
            track: Track {
                id,
                position_m: position_m.into(),
                velocity_mps: [0.0; 2],
                covariance: filter.covariance.into(),
                range_m: detection.range_m,
                sigma_m: detection.sigma_m,
                bearing_rad: detection.bearing_rad,
                age_s: 0.0,
                hits: 1,
                misses: 0,
                confirmed: false,
                obstacle: Some(index),
                bounds: detection.bounds,
                width_m: detection.width_m,
                height_m: detection.height_m,
                surprise: f64::NAN,
            },
            filter,
            born_nanos: stamp_nanos,
            offset_m: detection.offset_m(),
            history: 1,
            frames: 1,
        }
    }

    /// It is this detection, the `index`-th of the frame.
    fn take(&mut self, detection: &Detection, index: usize, innovation: &Innovation, params: &TrackParams) {
        self.filter.update(innovation, &detection.covariance(params));
        self.offset_m = detection.offset_m();
        self.history |= 1;
        let track = &mut self.track;
        track.obstacle = Some(index);
        track.misses = 0;
        track.hits += 1;
        track.bounds = detection.bounds;
        track.width_m += SIZE_WEIGHT * (detection.width_m - track.width_m);
        track.height_m += SIZE_WEIGHT * (detection.height_m - track.height_m);
        track.surprise = innovation.squared_distance;
    }

    /// Whether a detection is a part of this track's obstacle, which was seen in the same frame: it touches it, and is
    /// at its range as far as can be told.
    fn holds(&self, detection: &Detection, gate: f64, params: &TrackParams) -> bool {
        if self.track.obstacle.is_none() {
            return false;
        }
        let position_m = detection.position_m();
        let ray = position_m.normalize();
        let off_m = position_m - self.filter.state.xy();
        let along_m = off_m.dot(&ray);
        let across_m = off_m.perp(&ray);
        let (sigma_m, _) = detection.sigmas_m(params);
        let variance =
            sigma_m * sigma_m + (ray.transpose() * self.filter.covariance.fixed_view::<2, 2>(0, 0) * ray).x;
        let reach_m = 0.5 * (self.track.width_m + detection.width_m);
        across_m.abs() <= reach_m && along_m * along_m <= gate * variance
    }

    /// Writes what the filter knows into the track.
    fn describe(&mut self, now_nanos: i64) {
        let state = self.filter.state;
        let covariance = self.filter.covariance;
        let ground_m = state.xy().norm();
        let ray = state.xy() / ground_m;
        let ground_variance = (ray.transpose() * covariance.fixed_view::<2, 2>(0, 0) * ray).x;
        let track = &mut self.track;
        track.position_m = [state.x, state.y];
        track.velocity_mps = [state.z, state.w];
        // Symmetric: columns are rows.
        track.covariance = covariance.into();
        track.range_m = ground_m.hypot(self.offset_m);
        track.sigma_m = ground_variance.sqrt() * track.range_m / ground_m;
        track.bearing_rad = state.x.atan2(state.y);
        track.age_s = (i128::from(now_nanos) - i128::from(self.born_nanos)) as f64 * 1e-9;
    }
}
