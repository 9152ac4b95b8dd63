//! Resampling through a table of source positions: eq. 4 of the paper,
//! `I_new(x0,y0) = a1·I_old(x1,y1) + a2·I_old(x2,y2) + a3·I_old(x3,y3) + a4·I_old(x4,y4)`.
//!
//! ```text
//! for every pixel with a tap:
//!     sum = (i1·(256 - right) + i2·right)·(256 - down) + (i3·(256 - right) + i4·right)·down
//!     value = (sum + 2¹⁵) >> 16
//! ```
//!
//! The vector kernels do sixteen pixels at a time. They leave the pseudo-code because
//!
//! 1. neighbours have their sources near each other: eight pixels find all of theirs in sixteen columns of three rows,
//!    which three loads bring in and a byte shuffle hands out, where a gather costs as much as the rest. A table is made
//!    of groups that say where the columns begin and where in them each source is, less than four bytes a pixel;
//! 2. levels less 128 are signed bytes, and weights are unsigned ones, but for 256: where `right` is 0 the second source
//!    is the first once more, at 128 each. So a multiplication of bytes gives two products, summed, exactly;
//! 3. those sums fit 16 bits, and the products with `256 - down` and `down` are summed the same way;
//! 4. groups whose sources lie farther apart (a view rolled by more than eight degrees, or shrunk by half) are computed
//!    one pixel at a time, from taps.

#[cfg(target_arch = "x86_64")]
pub mod avx2;
#[cfg(target_arch = "x86_64")]
pub mod avx512;
#[cfg(target_arch = "aarch64")]
pub mod neon;
pub mod reference;

/// Fractional bits of a source position.
pub const FRACTION_BITS: u32 = 8;
/// One pixel in units of a source position.
pub const ONE: u16 = 1 << FRACTION_BITS;

/// Pixels of a group.
pub const GROUP: usize = 16;
/// Pixels that share three rows of [`WINDOW`] columns.
const HALF: usize = GROUP / 2;
/// Columns of the source that half a group reads.
const WINDOW: usize = 16;
/// Rows of the source that half a group reads.
const WINDOW_ROWS: usize = 3;
/// A place no pixel has.
const NOWHERE: u8 = u8::MAX;
/// Marks a group that is computed from taps.
const BY_TAPS: u16 = u16::MAX;

/// Where one output pixel comes from: `(x, y)` is the upper left of its four source pixels; `right` and `down` are
/// the weights, in 1/256, of the right against the left and the lower against the upper ones.
///
/// On the last column `right` is 256 of the column before, so that all four pixels always exist; so too on the last row.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Tap {
    /// Column of the upper left source pixel.
    pub x: u16,
    /// Its row.
    pub y: u16,
    /// Weight of the right pixels, 0 to 256.
    pub right: u16,
    /// Weight of the lower pixels, 0 to 256.
    pub down: u16,
}

/// Sixteen neighbours of a row.
#[derive(Debug, Clone, Copy)]
struct Group {
    /// Upper left of the three rows of sixteen columns that each half reads; [`BY_TAPS`] and an index, in two parts, of
    /// the group's taps.
    windows: [[u16; 2]; 2],
    /// Column of a pixel's upper left source in the window, plus 16 if it is in the second row; or [`NOWHERE`].
    places: [u8; GROUP],
    right: [u8; GROUP],
    down: [u8; GROUP],
}

impl Group {
    fn is_by_taps(&self) -> bool {
        self.windows[0][0] == BY_TAPS
    }
}

/// Where the pixels of an image come from.
///
/// All sources lie inside the size the table was made for: that is checked when it is made, not for each pixel later.
#[derive(Debug, Clone)]
pub struct Table {
    groups: Vec<Group>,
    taps: Vec<[Option<Tap>; GROUP]>,
    width: usize,
    source_width: usize,
    source_height: usize,
}

impl Table {
    /// A table from the taps of an image `width` pixels wide, row after row; `None` where a pixel has no source.
    ///
    /// # Panics
    ///
    /// If a tap reads outside the source, the taps are no rows of `width`, or the source has less than one or more than
    /// 32767 columns or rows.
    pub fn new(taps: &[Option<Tap>], width: usize, (source_width, source_height): (usize, usize)) -> Self {
        assert!(width > 0 && taps.len().is_multiple_of(width), "{} taps in rows of {width}", taps.len());
        let sides = 1..=32_767;
        assert!(sides.contains(&source_width) && sides.contains(&source_height), "source size");
        let mut table = Self { groups: Vec::new(), taps: Vec::new(), width, source_width, source_height };
        for row in taps.chunks(width) {
            for members in row.chunks(GROUP) {
                let mut padded = [None; GROUP];
                padded[..members.len()].copy_from_slice(members);
                assert!(padded.iter().flatten().all(|tap| table.contains(tap)), "a tap outside the source");
                let group = table.group(&padded).unwrap_or_else(|| table.by_taps(padded));
                table.groups.push(group);
            }
        }
        table
    }

    /// The size of the source, width and height.
    pub fn source_size(&self) -> (usize, usize) {
        (self.source_width, self.source_height)
    }

    fn contains(&self, tap: &Tap) -> bool {
        let inside = |first: u16, weight: u16, len: usize| {
            usize::from(first) + 1 < len.max(2) && weight <= ONE && (len > 1 || weight == 0)
        };
        inside(tap.x, tap.right, self.source_width) && inside(tap.y, tap.down, self.source_height)
    }

    fn by_taps(&mut self, taps: [Option<Tap>; GROUP]) -> Group {
        let index = self.taps.len() as u32;
        self.taps.push(taps);
        Group {
            windows: [[BY_TAPS, 0], [index as u16, (index >> 16) as u16]],
            places: [NOWHERE; GROUP],
            right: [0; GROUP],
            down: [0; GROUP],
        }
    }

    /// The group of these taps, if each half's sources lie near enough to each other.
    fn group(&self, taps: &[Option<Tap>; GROUP]) -> Option<Group> {
        let (last_x, last_y) =
            (self.source_width.checked_sub(WINDOW)?, self.source_height.checked_sub(WINDOW_ROWS)?);
        let mut group =
            Group { windows: [[0; 2]; 2], places: [NOWHERE; GROUP], right: [0; GROUP], down: [0; GROUP] };
        for (half, members) in taps.chunks(HALF).enumerate() {
            let present = || members.iter().flatten();
            let x0 = present().map(|tap| usize::from(tap.x)).min().unwrap_or(0).min(last_x);
            let y0 = present().map(|tap| usize::from(tap.y)).min().unwrap_or(0).min(last_y);
            group.windows[half] = [x0 as u16, y0 as u16];
            for (i, tap) in members.iter().enumerate() {
                let Some(tap) = tap else { continue };
                // All of the weight on the right is none on the left: the pixel to the right by itself.
                let (x, right) = if tap.right == ONE { (tap.x + 1, 0) } else { (tap.x, tap.right) };
                let (column, row) = (usize::from(x) - x0, usize::from(tap.y) - y0);
                if column + usize::from(right > 0) >= WINDOW || row > 1 || tap.down == ONE {
                    return None;
                }
                let place = half * HALF + i;
                group.places[place] = (column + WINDOW * row) as u8;
                group.right[place] = right as u8;
                group.down[place] = tap.down as u8;
            }
        }
        Some(group)
    }

    /// The tap of a member of a group.
    fn tap(&self, group: &Group, member: usize) -> Option<Tap> {
        if group.is_by_taps() {
            return self.taps_of(group)[member];
        }
        let [x0, y0] = group.windows[member / HALF];
        let place = u16::from(group.places[member]);
        (place != u16::from(NOWHERE)).then(|| Tap {
            x: x0 + place % WINDOW as u16,
            y: y0 + place / WINDOW as u16,
            right: group.right[member].into(),
            down: group.down[member].into(),
        })
    }

    fn taps_of(&self, group: &Group) -> &[Option<Tap>; GROUP] {
        let [low, high] = group.windows[1];
        &self.taps[usize::from(low) | usize::from(high) << 16]
    }

    fn groups_of(&self, y: usize) -> &[Group] {
        let across = self.width.div_ceil(GROUP);
        &self.groups[y * across..][..across]
    }
}

/// A row to resample.
#[derive(Debug)]
pub struct RemapRow<'a> {
    /// Where its pixels come from.
    pub table: &'a Table,
    /// Which row of the table it is.
    pub y: usize,
    /// The source: rows of its width,
    pub source: &'a [u8],
    /// so many elements apart.
    pub stride: usize,
    /// Out; 0 where there is no source.
    pub values: &'a mut [u8],
}

impl RemapRow<'_> {
    pub(super) fn check(&self) {
        let Table { width, source_width, source_height, .. } = *self.table;
        assert!(self.values.len() == width, "values");
        assert!(self.stride >= source_width, "stride");
        assert!(self.source.len() >= (source_height - 1) * self.stride + source_width, "source");
        assert!((self.y + 1) * width.div_ceil(GROUP) <= self.table.groups.len(), "row {}", self.y);
    }
}
