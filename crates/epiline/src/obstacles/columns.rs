//! Per column, the nearest surface of each unbroken stretch of disparity.

use super::ObstacleParams;
use super::cells::Cells;
use crate::rectification::RectifiedGeometry;

/// Bins to either side of the fullest one that belong to one upright surface: the scatter of its disparities.
const SCATTER: usize = 2;
/// Bins within which a fuller one may follow the first one with enough pixels: that may hold but the near tail of the
/// scatter.
const TAIL: usize = 3;
/// The leading bin has at least so many tenths of the pixels of the fullest of them.
const LEADING_TENTHS: usize = 7;
/// Where no ground is known, a level plane no farther than this over or under the camera is a ceiling or a floor, metres.
const HIGHEST_M: f64 = 4.0;

/// An upright surface as one column sees it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Peak {
    pub column: usize,
    /// Mean disparity, px.
    pub disparity_px: f64,
    /// Pixels of the whole stretch.
    pub support: usize,
    /// First and last row.
    pub top: usize,
    pub bottom: usize,
    /// The nearest and the farthest bin of the stretch.
    pub near: usize,
    pub far: usize,
}

/// An unbroken stretch of bins with enough pixels in one column.
#[derive(Debug, Clone, Copy)]
struct Stretch {
    column: usize,
    near: usize,
    far: usize,
}

/// Lists peaks; keeps its memory.
#[derive(Debug, Clone, Default)]
pub(super) struct ColumnReader {
    stretches: Vec<Stretch>,
    /// The open stretch of each column while bins are visited, as index into `stretches`.
    open: Vec<usize>,
}

const CLOSED: usize = usize::MAX;

impl ColumnReader {
    /// The peaks of every column, column by column, near ones first.
    pub fn read(
        &mut self,
        cells: &Cells,
        geometry: &RectifiedGeometry,
        has_ground: bool,
        params: &ObstacleParams,
        peaks: &mut Vec<Peak>,
    ) {
        self.find_stretches(cells, geometry, has_ground, params);
        peaks.clear();
        peaks.extend(self.stretches.iter().map(|stretch| peak_of(cells, stretch)));
    }

    fn find_stretches(
        &mut self,
        cells: &Cells,
        geometry: &RectifiedGeometry,
        has_ground: bool,
        params: &ObstacleParams,
    ) {
        self.stretches.clear();
        self.open.clear();
        self.open.resize(cells.width(), CLOSED);
        let level_px = geometry.baseline_m / HIGHEST_M;
        for bin in (0..cells.bins()).rev() {
            let needed =
                params.support_px(geometry, Cells::center_px(bin), has_ground).div_ceil(cells.row_step);
            let Some(here) = cells.row(bin) else { continue };
            let nearer = cells.row(bin + 1);
            let farther = bin.checked_sub(1).and_then(|bin| cells.row(bin));
            for (column, cell) in here.iter().enumerate() {
                let count = cell.count();
                if count == 0 {
                    continue;
                }
                let beside = [nearer, farther].map(|row| row.map_or(0, |row| row[column].count()));
                if count + beside[0].max(beside[1]) < needed {
                    continue;
                }
                if !has_ground && cells.lean_px(column, around(bin)).abs() > level_px {
                    continue;
                }
                match self.open[column] {
                    index if index != CLOSED && self.stretches[index].far == bin + 1 => {
                        self.stretches[index].far = bin;
                    }
                    _ => {
                        self.open[column] = self.stretches.len();
                        self.stretches.push(Stretch { column, near: bin, far: bin });
                    }
                }
            }
        }
        self.stretches.sort_unstable_by_key(|stretch| (stretch.column, std::cmp::Reverse(stretch.near)));
    }
}

/// The bins in which a surface has its pixels whose disparities are mostly in one of them.
fn around(bin: usize) -> std::ops::RangeInclusive<usize> {
    bin.saturating_sub(SCATTER)..=bin + SCATTER
}

/// The nearest surface of a stretch.
///
/// Its leading bin is the nearest one with nearly as many pixels as any of the next: what is nearer is the tail of its
/// scatter. Of the bins around that, those whose pixels lie in the same rows are its own: others are another surface
/// above or below it, or the rest of one that leans.
fn peak_of(cells: &Cells, stretch: &Stretch) -> Peak {
    let &Stretch { column, near, far } = stretch;
    let next = || (near.saturating_sub(TAIL).max(far)..=near).rev();
    let most = next().map(|bin| cells.count_at(column, bin)).max().unwrap_or(0);
    let leading =
        next().find(|&bin| 10 * cells.count_at(column, bin) >= LEADING_TENTHS * most).unwrap_or(near);
    let seen = cells.seen_with(column, leading, around(leading));
    let all = cells.seen(column, far..=near);
    Peak {
        column,
        disparity_px: seen.disparity_px,
        support: all.count * cells.row_step,
        top: all.top.min(seen.top),
        bottom: all.bottom.max(seen.bottom),
        near,
        far,
    }
}
