//! Per column, the nearest surface of each unbroken stretch of disparity.

use super::ObstacleParams;
use super::cells::Cells;
use crate::rectification::RectifiedGeometry;

/// Bins to either side of the fullest one that belong to one upright surface: the scatter of its disparities.
const SCATTER: usize = 2;
/// Bins within which a fuller window may follow the first one with enough pixels: that may hold but the near tail of
/// the scatter.
const TAIL: usize = 3;
/// Bins behind the nearest one in which an upright surface has no pixels any more.
const LEANING_REACH: usize = 4;

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
        peaks.extend(self.stretches.iter().filter_map(|stretch| peak_of(cells, stretch, has_ground)));
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

/// The nearest surface of a stretch: from near to far the first fullest window of 1.5 px. Where no ground is known,
/// of what leans the fullest of all, and `None` if that is not much fuller: it may be a floor or a ceiling.
fn peak_of(cells: &Cells, stretch: &Stretch, has_ground: bool) -> Option<Peak> {
    let &Stretch { column, near, far } = stretch;
    let window = |bin: usize| {
        let below = if bin > 0 { cells.count_at(column, bin - 1) } else { 0 };
        below + cells.count_at(column, bin) + cells.count_at(column, bin + 1)
    };
    let mut fullest = near;
    for bin in (far..near).rev() {
        if fullest - bin > TAIL {
            break;
        }
        if window(bin) > window(fullest) {
            fullest = bin;
        }
    }
    // What leans back has as many pixels in every bin: its near end is what counts.
    let behind = near.saturating_sub(LEANING_REACH);
    let (at_near, at_behind) = (window(near.saturating_sub(1)), window(behind));
    let leans = behind >= far && 2 * at_behind >= at_near;
    if leans && !has_ground {
        // What stands on a floor that is seen before it stands out from the floor.
        fullest = (far..=near).rev().max_by_key(|&bin| window(bin))?;
        if window(fullest) <= 2 * at_near.min(at_behind) {
            return None;
        }
    }
    let bins = if leans && has_ground {
        near.saturating_sub(1)..=near + 1
    } else {
        fullest.saturating_sub(SCATTER)..=fullest + SCATTER
    };
    let seen = cells.seen(column, bins);
    let all = cells.seen(column, far..=near);
    Some(Peak {
        column,
        disparity_px: seen.disparity_px,
        support: all.count * cells.row_step,
        top: all.top.min(seen.top),
        bottom: all.bottom.max(seen.bottom),
        near,
        far,
    })
}
