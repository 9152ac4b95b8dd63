//! The inner loops, each as a readable reference and as variants for particular instruction sets.
//!
//! Kernels see slices, not images. The [`Kernels`] of a [`Level`] are a table of function pointers, filled with the
//! references and overwritten upward; each entry computes the same bits at every level (`tests/simd_kernels.rs`).

pub mod alignment;
pub mod coarse;
pub mod floor;
pub mod grey;
pub mod islands;
mod level;
pub mod planes;
pub mod range;
pub mod remap;
pub mod sad;
pub mod select;
pub mod semi_global;
pub mod sort;
pub mod texture;
pub mod tile;
pub mod weighted;
pub mod windowed;
pub mod windows;
pub mod xsobel;

pub use level::{Level, simd_level};

use alignment::corners::{GradientRow, HalveRow, MaximaRow, StrengthRow};
use alignment::patches::{Correlate, PatchSums};
use alignment::registration::{Gram, Interpolate, ModelColumns, Project};
use coarse::RefineRow;
use floor::FloorRow;
use grey::GreyRow;
use islands::BreaksRow;
use planes::{NearTile, PlaneTile};
use range::RangeRow;
use remap::RemapRow;
use sad::{AddRow, RowShape, SadRow};
use select::SelectRow;
use semi_global::features::{CensusRow, ExtremesRow};
use semi_global::{CostRow, ExcessRow, HorizontalRows, SumRow, VerticalRow, WindowRow};
use sort::SortColumns;
use texture::TextureRow;
use tile::{GatherTile, SpanTile};
use weighted::WeightedRow;
use windowed::{BestRow, BestWindowsRow, BoxRow, PixelCostRow};
use windows::{OfferBin, SumColumns};
use xsobel::XSobelRow;

/// Compiles a portable body once per instruction set: the optimiser vectorises each copy with what the set has.
///
/// `portable!(name, body, Type)` makes a module `name` with functions `avx2` and `avx512` over `&mut Type`; the body itself is the scalar one.
macro_rules! portable {
    ($name:ident, $body:path, $row:ty) => {
        #[cfg(target_arch = "x86_64")]
        pub(in crate::kernels) mod $name {
            #[allow(clippy::wildcard_imports)]
            use super::*;

            /// The same code, compiled for AVX2.
            ///
            /// # Safety
            /// The processor has what `Level::avx2` proves.
            #[target_feature(enable = "avx2,bmi1,popcnt")]
            pub(in crate::kernels) unsafe fn avx2(row: &mut $row) {
                $body(row);
            }

            /// The same code, compiled for AVX-512.
            ///
            /// # Safety
            /// The processor has what `Level::avx512` proves.
            #[target_feature(enable = "avx512f,avx512bw,avx512vl,avx2,bmi1,popcnt")]
            pub(in crate::kernels) unsafe fn avx512(row: &mut $row) {
                $body(row);
            }
        }
    };
}
use portable;

/// A kernel over the rows that `$row` borrows. Safe to call on a processor of its level, after the row's `check`.
macro_rules! kernel {
    ($row:ident) => { for<'call, 'data> unsafe fn(&'call mut $row<'data>) };
    ($row:ident, $cost:ty) => { for<'call, 'data> unsafe fn(&'call mut $row<'data, $cost>) };
}

/// The kernels of one [`Level`].
///
/// The pointers are private. The methods check the slices; the level vouches for the instructions.
#[derive(Debug, Clone, Copy)]
pub struct Kernels {
    level: Level,
    lane_block: usize,
    add_u16: kernel!(AddRow, u16),
    add_u32: kernel!(AddRow, u32),
    sad_u16: kernel!(SadRow, u16),
    sad_u32: kernel!(SadRow, u32),
    scratch_u16: fn(&RowShape) -> usize,
    scratch_u32: fn(&RowShape) -> usize,
    select_u16: kernel!(SelectRow, u16),
    select_u32: kernel!(SelectRow, u32),
    refine: kernel!(RefineRow),
    xsobel: kernel!(XSobelRow),
    texture: kernel!(TextureRow),
    weighted: kernel!(WeightedRow),
    sort: kernel!(SortColumns),
    gather: kernel!(GatherTile),
    span: kernel!(SpanTile),
    plane: kernel!(PlaneTile),
    near: kernel!(NearTile),
    sum_columns: kernel!(SumColumns),
    offer: kernel!(OfferBin),
    range: kernel!(RangeRow),
    grey: kernel!(GreyRow),
    floor: kernel!(FloorRow),
    breaks: kernel!(BreaksRow),
    extremes: kernel!(ExtremesRow),
    census: kernel!(CensusRow),
    cost: kernel!(CostRow),
    window: kernel!(WindowRow),
    horizontal: kernel!(HorizontalRows),
    vertical: kernel!(VerticalRow),
    sum: kernel!(SumRow),
    excess: kernel!(ExcessRow),
    pixel_cost: kernel!(PixelCostRow),
    boxes: kernel!(BoxRow),
    best_windows: kernel!(BestWindowsRow),
    best: kernel!(BestRow),
    remap: kernel!(RemapRow),
    halve: kernel!(HalveRow),
    gradient: kernel!(GradientRow),
    strength: kernel!(StrengthRow),
    maxima: kernel!(MaximaRow),
    patch_sums: kernel!(PatchSums),
    correlate: kernel!(Correlate),
    model_columns: kernel!(ModelColumns),
    interpolate: kernel!(Interpolate),
    project: kernel!(Project),
    gram: kernel!(Gram),
}

impl Kernels {
    /// The kernels of `level`.
    pub fn new(level: Level) -> Self {
        let kernels = Self {
            level,
            lane_block: sad::reference::LANE_BLOCK,
            add_u16: sad::reference::add_row,
            add_u32: sad::reference::add_row,
            sad_u16: sad::reference::sad_row,
            sad_u32: sad::reference::sad_row,
            scratch_u16: sad::reference::scratch_len,
            scratch_u32: sad::reference::scratch_len,
            select_u16: select::narrow,
            select_u32: select::wide,
            refine: coarse::refine_row,
            xsobel: xsobel::xsobel_row,
            texture: texture::texture_row,
            weighted: weighted::weighted_row,
            sort: sort::sort_columns,
            gather: tile::gather_tile,
            span: tile::span_tile,
            plane: planes::plane_tile,
            near: planes::near_tile,
            sum_columns: windows::sum_columns,
            offer: windows::offer_bin,
            range: range::range_row,
            grey: grey::grey_row,
            floor: floor::floor_row,
            breaks: islands::breaks_row,
            extremes: semi_global::features::extremes,
            census: semi_global::features::census,
            cost: semi_global::reference::cost_row,
            window: semi_global::reference::window_row,
            horizontal: semi_global::reference::horizontal_rows,
            vertical: semi_global::reference::vertical_row,
            sum: semi_global::reference::sum_row,
            excess: semi_global::reference::excess_row,
            pixel_cost: windowed::reference::pixel_cost_row,
            boxes: windowed::reference::box_row,
            best_windows: windowed::reference::best_windows_row,
            best: windowed::reference::best_row,
            remap: remap::reference::remap_row,
            halve: alignment::corners::halve_row,
            gradient: alignment::corners::gradient_row,
            strength: alignment::corners::strength_row,
            maxima: alignment::corners::maxima_row,
            patch_sums: alignment::patches::patch_sums,
            correlate: alignment::patches::correlate,
            model_columns: alignment::registration::model_columns,
            interpolate: alignment::registration::interpolate,
            project: alignment::registration::project,
            gram: alignment::registration::gram,
        };
        #[cfg(target_arch = "x86_64")]
        {
            if Some(level) == Level::avx512() {
                return Self {
                    lane_block: sad::avx512::LANE_BLOCK,
                    add_u16: sad::avx512::add_row,
                    add_u32: sad::add_u32::avx512,
                    sad_u16: sad::avx512::sad_row,
                    scratch_u16: sad::ring::scratch_len,
                    sad_u32: sad::sad_u32::avx512,
                    select_u16: select::select_u16::avx512,
                    select_u32: select::select_u32::avx512,
                    refine: coarse::row::avx512,
                    xsobel: xsobel::row::avx512,
                    texture: texture::row::avx512,
                    weighted: weighted::row::avx512,
                    sort: sort::columns::avx512,
                    gather: tile::gathered::avx512,
                    span: tile::span::avx512,
                    plane: planes::sums::avx512,
                    near: planes::near::avx512,
                    sum_columns: windows::summed::avx512,
                    offer: windows::offered::avx512,
                    range: range::row::avx512,
                    grey: grey::row::avx512,
                    floor: floor::row::avx512,
                    breaks: islands::row::avx512,
                    extremes: semi_global::features::extremes_row::avx512,
                    census: semi_global::features::census_row::avx512,
                    cost: semi_global::avx512::cost_row,
                    window: semi_global::avx512::window_row,
                    horizontal: semi_global::avx512::horizontal_rows,
                    vertical: semi_global::avx512::vertical_row,
                    sum: semi_global::avx512::sum_row,
                    excess: semi_global::avx512::excess_row,
                    pixel_cost: windowed::vector::avx512::pixel_cost_row,
                    boxes: windowed::vector::avx512::box_row,
                    best_windows: windowed::vector::avx512::best_windows_row,
                    best: windowed::vector::avx512::best_row,
                    remap: remap::avx512::remap_row,
                    halve: alignment::corners::halve::avx512,
                    gradient: alignment::corners::gradient::avx512,
                    strength: alignment::corners::strength::avx512,
                    maxima: alignment::corners::maxima::avx512,
                    patch_sums: alignment::patches::sums::avx512,
                    correlate: alignment::patches::products::avx512,
                    model_columns: alignment::registration::columns::avx512,
                    interpolate: alignment::registration::interpolated::avx512,
                    project: alignment::registration::projected::avx512,
                    gram: alignment::registration::products::avx512,
                    ..kernels
                };
            }
            if Some(level) == Level::avx2() {
                return Self {
                    lane_block: sad::avx2::LANE_BLOCK,
                    add_u16: sad::avx2::add_row,
                    add_u32: sad::add_u32::avx2,
                    sad_u16: sad::avx2::sad_row,
                    scratch_u16: sad::ring::scratch_len,
                    sad_u32: sad::sad_u32::avx2,
                    select_u16: select::select_u16::avx2,
                    select_u32: select::select_u32::avx2,
                    refine: coarse::row::avx2,
                    xsobel: xsobel::row::avx2,
                    texture: texture::row::avx2,
                    weighted: weighted::row::avx2,
                    sort: sort::columns::avx2,
                    gather: tile::gathered::avx2,
                    span: tile::span::avx2,
                    plane: planes::sums::avx2,
                    near: planes::near::avx2,
                    sum_columns: windows::summed::avx2,
                    offer: windows::offered::avx2,
                    range: range::row::avx2,
                    grey: grey::row::avx2,
                    floor: floor::row::avx2,
                    breaks: islands::row::avx2,
                    extremes: semi_global::features::extremes_row::avx2,
                    census: semi_global::features::census_row::avx2,
                    cost: semi_global::avx2::cost_row,
                    window: semi_global::avx2::window_row,
                    horizontal: semi_global::avx2::horizontal_rows,
                    vertical: semi_global::avx2::vertical_row,
                    sum: semi_global::avx2::sum_row,
                    excess: semi_global::avx2::excess_row,
                    pixel_cost: windowed::vector::avx2::pixel_cost_row,
                    boxes: windowed::vector::avx2::box_row,
                    best_windows: windowed::vector::avx2::best_windows_row,
                    best: windowed::vector::avx2::best_row,
                    remap: remap::avx2::remap_row,
                    halve: alignment::corners::halve::avx2,
                    gradient: alignment::corners::gradient::avx2,
                    strength: alignment::corners::strength::avx2,
                    maxima: alignment::corners::maxima::avx2,
                    patch_sums: alignment::patches::sums::avx2,
                    correlate: alignment::patches::products::avx2,
                    model_columns: alignment::registration::columns::avx2,
                    interpolate: alignment::registration::interpolated::avx2,
                    project: alignment::registration::projected::avx2,
                    gram: alignment::registration::products::avx2,
                    ..kernels
                };
            }
        }
        #[cfg(target_arch = "aarch64")]
        if Some(level) == Level::neon() {
            // What is portable is compiled with NEON anyway: the target has it.
            return Self {
                lane_block: sad::neon::LANE_BLOCK,
                add_u16: sad::neon::add_row,
                sad_u16: sad::neon::sad_row,
                scratch_u16: sad::ring::scratch_len,
                cost: semi_global::neon::cost_row,
                window: semi_global::neon::window_row,
                horizontal: semi_global::neon::horizontal_rows,
                vertical: semi_global::neon::vertical_row,
                sum: semi_global::neon::sum_row,
                excess: semi_global::neon::excess_row,
                pixel_cost: windowed::vector::neon::pixel_cost_row,
                boxes: windowed::vector::neon::box_row,
                best_windows: windowed::vector::neon::best_windows_row,
                best: windowed::vector::neon::best_row,
                remap: remap::neon::remap_row,
                ..kernels
            };
        }
        kernels
    }

    /// The level they were chosen for.
    pub fn level(&self) -> Level {
        self.level
    }

    /// How many lanes of costs a pixel needs for `num_disparities`: the next number the kernels handle.
    pub fn lanes(&self, num_disparities: usize) -> usize {
        sad::padded_lanes(num_disparities, self.lane_block)
    }

    /// One row of [`xsobel`].
    ///
    /// # Panics
    /// If the slices are not of one length.
    pub fn xsobel(&self, row: &mut XSobelRow<'_>) {
        row.check();
        // SAFETY: the table was made from a level, which exists only where the processor has its instructions.
        unsafe { (self.xsobel)(row) }
    }

    /// The floor and the obstacles of a row.
    pub fn floor(&self, row: &mut FloorRow<'_>) {
        row.check();
        // SAFETY: the row was checked, and the level is proof of the instructions.
        unsafe { (self.floor)(row) }
    }

    /// Windows of a row with too little texture.
    ///
    /// # Panics
    /// If a slice has not the length that the row's `check` demands; so too below.
    pub fn texture(&self, row: &mut TextureRow<'_>) {
        row.check();
        // SAFETY: the table's level proves the instructions.
        unsafe { (self.texture)(row) }
    }

    /// Weighted sums of stretches of pixels.
    ///
    /// # Panics
    /// As above.
    pub fn weighted(&self, row: &mut WeightedRow<'_>) {
        row.check();
        // SAFETY: as above.
        unsafe { (self.weighted)(row) }
    }

    /// Each lane in ascending order.
    pub fn sort(&self, columns: &mut SortColumns<'_>) {
        // SAFETY: as above.
        unsafe { (self.sort)(columns) }
    }

    /// Columns of disparities as a tile.
    ///
    /// # Panics
    /// As above.
    pub fn gather(&self, tile: &mut GatherTile<'_>) {
        tile.check();
        // SAFETY: as above.
        unsafe { (self.gather)(tile) }
    }

    /// Where in a tile's columns values of a span lie.
    pub fn span(&self, tile: &mut SpanTile<'_>) {
        // SAFETY: as above.
        unsafe { (self.span)(tile) }
    }

    /// Sums over a tile's pixels near a plane.
    ///
    /// # Panics
    /// Without a step.
    pub fn plane(&self, tile: &mut PlaneTile<'_>) {
        tile.check();
        // SAFETY: as above.
        unsafe { (self.plane)(tile) }
    }

    /// A tile's pixels near a plane that are near the camera.
    ///
    /// # Panics
    /// As above; so too below.
    pub fn near(&self, tile: &mut NearTile<'_>) {
        tile.check();
        // SAFETY: as above.
        unsafe { (self.near)(tile) }
    }

    /// Sums over neighbouring columns.
    pub fn sum_columns(&self, row: &mut SumColumns<'_>) {
        row.check();
        // SAFETY: as above.
        unsafe { (self.sum_columns)(row) }
    }

    /// A bin for each column's window of disparity.
    pub fn offer(&self, row: &mut OfferBin<'_>) {
        row.check();
        // SAFETY: as above.
        unsafe { (self.offer)(row) }
    }

    /// Metres of a row.
    pub fn range(&self, row: &mut RangeRow<'_>) {
        row.check();
        // SAFETY: as above.
        unsafe { (self.range)(row) }
    }

    /// Grey levels of a row.
    ///
    /// # Panics
    /// As above.
    pub fn grey(&self, row: &mut GreyRow<'_>) {
        row.check();
        // SAFETY: as above.
        unsafe { (self.grey)(row) }
    }

    /// Where stretches of linked disparities end in a row.
    ///
    /// # Panics
    /// As above.
    pub fn breaks(&self, row: &mut BreaksRow<'_>) {
        row.check();
        // SAFETY: as above.
        unsafe { (self.breaks)(row) }
    }

    /// What a row at half the resolution adds to costs.
    ///
    /// # Panics
    /// If a slice has not the length, or a number the range, that the row's `check` demands.
    pub fn refine(&self, row: &mut RefineRow<'_>) {
        row.check();
        // SAFETY: the slices were checked; the table's level proves the instructions.
        unsafe { (self.refine)(row) }
    }

    /// Extremes of a row within half a pixel.
    ///
    /// # Panics
    /// If a slice has not the length that the row's `check` demands.
    pub fn extremes(&self, row: &mut ExtremesRow<'_>) {
        row.check();
        // SAFETY: the slices were checked; the table's level proves the instructions.
        unsafe { (self.extremes)(row) }
    }

    /// The census of a row.
    ///
    /// # Panics
    /// If a slice has not the length that the row's `check` demands.
    pub fn census(&self, row: &mut CensusRow<'_>) {
        row.check();
        // SAFETY: the slices were checked; the table's level proves the instructions.
        unsafe { (self.census)(row) }
    }

    /// Pixel costs of a row, and their sums per column.
    ///
    /// # Panics
    /// If a slice has not the length that the row's `check` demands, or lanes are none that [`lanes`](Self::lanes) gives.
    pub fn cost(&self, row: &mut CostRow<'_>) {
        row.check();
        self.check_lanes(row.lanes);
        // SAFETY: the slices were checked; the table's level proves the instructions.
        unsafe { (self.cost)(row) }
    }

    /// Matching costs of a row.
    ///
    /// # Panics
    /// If a slice has not the length that the row's `check` demands, or lanes are none that [`lanes`](Self::lanes) gives.
    pub fn window(&self, row: &mut WindowRow<'_>) {
        row.check();
        self.check_lanes(row.lanes);
        // SAFETY: the slices were checked; the table's level proves the instructions.
        unsafe { (self.window)(row) }
    }

    /// Both horizontal paths through rows.
    ///
    /// # Panics
    /// If a slice has not the length that the rows' `check` demands, or lanes are none that [`lanes`](Self::lanes) gives.
    pub fn horizontal(&self, rows: &mut HorizontalRows<'_>) {
        rows.check();
        self.check_lanes(rows.lanes);
        // SAFETY: the slices were checked; the table's level proves the instructions.
        unsafe { (self.horizontal)(rows) }
    }

    /// One step of vertical paths.
    ///
    /// # Panics
    /// If a slice has not the length that the row's `check` demands, or lanes are none that [`lanes`](Self::lanes) gives.
    pub fn vertical(&self, row: &mut VerticalRow<'_>) {
        row.check();
        self.check_lanes(row.lanes);
        // SAFETY: the slices were checked; the table's level proves the instructions.
        unsafe { (self.vertical)(row) }
    }

    /// Sums over the paths and the best candidates of a row.
    ///
    /// # Panics
    /// If a slice has not the length that the row's `check` demands, or lanes are none that [`lanes`](Self::lanes) gives.
    pub fn sum(&self, row: &mut SumRow<'_>) {
        row.check();
        self.check_lanes(row.lanes);
        // SAFETY: the slices were checked; the table's level proves the instructions.
        unsafe { (self.sum)(row) }
    }

    /// By how much the sums over the paths exceed the best.
    ///
    /// # Panics
    /// If a slice has not the length that the row's `check` demands, or lanes are none that [`lanes`](Self::lanes) gives.
    pub fn excess(&self, row: &mut ExcessRow<'_>) {
        row.check();
        self.check_lanes(row.lanes);
        // SAFETY: the slices were checked; the table's level proves the instructions.
        unsafe { (self.excess)(row) }
    }

    /// Pixel costs of a row by one kind of difference, and their sums per column.
    ///
    /// # Panics
    /// If a slice has not the length that the row's `check` demands, or lanes are none that [`lanes`](Self::lanes) gives.
    pub fn pixel_cost(&self, row: &mut PixelCostRow<'_>) {
        row.check();
        self.check_lanes(row.lanes);
        // SAFETY: the slices were checked; the table's level proves the instructions.
        unsafe { (self.pixel_cost)(row) }
    }

    /// Box sums of a row.
    ///
    /// # Panics
    /// If a slice has not the length that the row's `check` demands, or lanes are none that [`lanes`](Self::lanes) gives.
    pub fn boxes(&self, row: &mut BoxRow<'_>) {
        row.check();
        self.check_lanes(row.lanes);
        // SAFETY: the slices were checked; the table's level proves the instructions.
        unsafe { (self.boxes)(row) }
    }

    /// Costs from the best of five windows.
    ///
    /// # Panics
    /// If a slice has not the length that the row's `check` demands, or lanes are none that [`lanes`](Self::lanes) gives.
    pub fn best_windows(&self, row: &mut BestWindowsRow<'_>) {
        row.check();
        self.check_lanes(row.lanes);
        // SAFETY: the slices were checked; the table's level proves the instructions.
        unsafe { (self.best_windows)(row) }
    }

    /// The best candidates of a row.
    ///
    /// # Panics
    /// If a slice has not the length that the row's `check` demands, or lanes are none that [`lanes`](Self::lanes) gives.
    pub fn best(&self, row: &mut BestRow<'_>) {
        row.check();
        self.check_lanes(row.lanes);
        // SAFETY: the slices were checked; the table's level proves the instructions.
        unsafe { (self.best)(row) }
    }

    /// A row resampled through a table.
    ///
    /// # Panics
    /// If the row has not the length, or the source not the size, of the table.
    pub fn remap(&self, row: &mut RemapRow<'_>) {
        row.check();
        // SAFETY: the sizes were checked; the table's level proves the instructions.
        unsafe { (self.remap)(row) }
    }

    /// A row at half the size.
    ///
    /// # Panics
    /// If a slice has not the length that the row's `check` demands.
    pub fn halve(&self, row: &mut HalveRow<'_>) {
        row.check();
        // SAFETY: the table's level proves the instructions.
        unsafe { (self.halve)(row) }
    }

    /// Gradient products of a row, and their sums per column.
    ///
    /// # Panics
    /// If a slice has not the length that the row's `check` demands.
    pub fn gradient(&self, row: &mut GradientRow<'_>) {
        row.check();
        // SAFETY: the table's level proves the instructions.
        unsafe { (self.gradient)(row) }
    }

    /// Smaller eigenvalues of a row.
    ///
    /// # Panics
    /// If a slice has not the length that the row's `check` demands.
    pub fn strength(&self, row: &mut StrengthRow<'_>) {
        row.check();
        // SAFETY: the table's level proves the instructions.
        unsafe { (self.strength)(row) }
    }

    /// Local maxima of a row.
    ///
    /// # Panics
    /// If a slice has not the length that the row's `check` demands.
    pub fn maxima(&self, row: &mut MaximaRow<'_>) {
        row.check();
        // SAFETY: the table's level proves the instructions.
        unsafe { (self.maxima)(row) }
    }

    /// Sums of patches.
    ///
    /// # Panics
    /// If a slice has not the length that the row's `check` demands, or a patch does not lie inside.
    pub fn patch_sums(&self, call: &mut PatchSums<'_>) {
        call.check();
        // SAFETY: the table's level proves the instructions.
        unsafe { (self.patch_sums)(call) }
    }

    /// Products of a patch with others.
    ///
    /// # Panics
    /// If a slice has not the length that the row's `check` demands, or a patch does not lie inside.
    pub fn correlate(&self, call: &mut Correlate<'_>) {
        call.check();
        // SAFETY: the table's level proves the instructions.
        unsafe { (self.correlate)(call) }
    }

    /// The columns of a patch's model.
    ///
    /// # Panics
    /// If it does not lie inside; so too below.
    pub fn model_columns(&self, call: &mut ModelColumns<'_>) {
        // SAFETY: the table's level proves the instructions.
        unsafe { (self.model_columns)(call) }
    }

    /// A patch between pixels.
    ///
    /// # Panics
    /// If it does not lie inside.
    pub fn interpolate(&self, call: &mut Interpolate<'_>) {
        // SAFETY: the table's level proves the instructions.
        unsafe { (self.interpolate)(call) }
    }

    /// Sums of products of a patch with a model's columns.
    pub fn project(&self, call: &mut Project<'_>) {
        // SAFETY: as above.
        unsafe { (self.project)(call) }
    }

    /// Sums of products of a model's columns.
    pub fn gram(&self, call: &mut Gram<'_>) {
        // SAFETY: as above.
        unsafe { (self.gram)(call) }
    }

    fn check_lanes(&self, lanes: usize) {
        assert!(sad::padded_lanes(lanes, self.lane_block) == lanes, "{lanes} lanes");
    }
}

/// Costs that the table has kernels for: what dispatches on the accumulator's type.
pub trait CostKernels: sad::Cost {
    /// Adds a row to the column sums.
    ///
    /// # Panics
    /// If a slice is shorter than `row.check` demands; so too below.
    fn add(kernels: &Kernels, row: &mut AddRow<'_, Self>);

    /// How many cells of scratch memory [`sad`](Self::sad) needs.
    fn scratch_len(kernels: &Kernels, shape: &RowShape) -> usize;

    /// Box sums and best candidates of a row.
    fn sad(kernels: &Kernels, row: &mut SadRow<'_, Self>);

    /// Disparities of a row.
    fn select(kernels: &Kernels, row: &mut SelectRow<'_, Self>);
}

macro_rules! cost_kernels {
    ($cost:ty, $add:ident, $sad:ident, $scratch:ident, $select:ident) => {
        impl CostKernels for $cost {
            fn add(kernels: &Kernels, row: &mut AddRow<'_, Self>) {
                row.check();
                // SAFETY: the slices were checked; the table's level proves the instructions.
                unsafe { (kernels.$add)(row) }
            }

            fn scratch_len(kernels: &Kernels, shape: &RowShape) -> usize {
                (kernels.$scratch)(shape)
            }

            fn sad(kernels: &Kernels, row: &mut SadRow<'_, Self>) {
                row.check((kernels.$scratch)(&row.shape));
                // SAFETY: as above.
                unsafe { (kernels.$sad)(row) }
            }

            fn select(kernels: &Kernels, row: &mut SelectRow<'_, Self>) {
                row.check();
                // SAFETY: as above.
                unsafe { (kernels.$select)(row) }
            }
        }
    };
}
cost_kernels!(u16, add_u16, sad_u16, scratch_u16, select_u16);
cost_kernels!(u32, add_u32, sad_u32, scratch_u32, select_u32);
