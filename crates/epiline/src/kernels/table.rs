//! Which kernel does what at a level.

use super::alignment::corners::{GradientRow, HalveRow, MaximaRow, StrengthRow};
use super::alignment::patches::{Correlate, PatchSums};
use super::alignment::registration::{Gram, Interpolate, ModelColumns, Project};
use super::coarse::RefineRow;
use super::floor::FloorRow;
use super::grey::GreyRow;
use super::islands::BreaksRow;
use super::lookup::LookupRow;
use super::magnitude::MagnitudeRow;
use super::planes::{NearTile, PlaneTile};
use super::range::RangeRow;
use super::remap::RemapRow;
use super::sad::{AddRow, RowShape, SadRow};
use super::select::SelectRow;
use super::semi_global::features::{CensusRow, ExtremesRow};
use super::semi_global::{CostRow, ExcessRow, HorizontalRows, SumRow, VerticalRow, WindowRow};
use super::sort::SortColumns;
use super::texture::TextureRow;
use super::tile::{GatherTile, SpanTile};
use super::transpose::Transpose;
use super::weighted::WeightedRows;
use super::windowed::{BestRow, BestWindowsRow, BoxRow, PixelCostRow};
use super::windows::{OfferBin, SumColumns};
use super::xsobel::XSobelRow;
use super::{
    Level, alignment, coarse, floor, grey, islands, lookup, magnitude, planes, range, remap, sad, select,
    semi_global, sort, texture, tile, transpose, weighted, windowed, windows, xsobel,
};

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
    pub(super) level: Level,
    pub(super) lane_block: usize,
    pub(super) add_u16: kernel!(AddRow, u16),
    pub(super) add_u32: kernel!(AddRow, u32),
    pub(super) sad_u16: kernel!(SadRow, u16),
    pub(super) sad_u32: kernel!(SadRow, u32),
    pub(super) scratch_u16: fn(&RowShape) -> usize,
    pub(super) scratch_u32: fn(&RowShape) -> usize,
    pub(super) select_u16: kernel!(SelectRow, u16),
    pub(super) select_u32: kernel!(SelectRow, u32),
    pub(super) refine: kernel!(RefineRow),
    pub(super) xsobel: kernel!(XSobelRow),
    pub(super) texture: kernel!(TextureRow),
    pub(super) weighted: kernel!(WeightedRows),
    pub(super) transpose: kernel!(Transpose),
    pub(super) magnitude: kernel!(MagnitudeRow),
    pub(super) lookup: kernel!(LookupRow),
    pub(super) sort: kernel!(SortColumns),
    pub(super) gather: kernel!(GatherTile),
    pub(super) span: kernel!(SpanTile),
    pub(super) plane: kernel!(PlaneTile),
    pub(super) near: kernel!(NearTile),
    pub(super) sum_columns: kernel!(SumColumns),
    pub(super) offer: kernel!(OfferBin),
    pub(super) range: kernel!(RangeRow),
    pub(super) grey: kernel!(GreyRow),
    pub(super) floor: kernel!(FloorRow),
    pub(super) breaks: kernel!(BreaksRow),
    pub(super) extremes: kernel!(ExtremesRow),
    pub(super) census: kernel!(CensusRow),
    pub(super) cost: kernel!(CostRow),
    pub(super) window: kernel!(WindowRow),
    pub(super) horizontal: kernel!(HorizontalRows),
    pub(super) vertical: kernel!(VerticalRow),
    pub(super) sum: kernel!(SumRow),
    pub(super) excess: kernel!(ExcessRow),
    pub(super) pixel_cost: kernel!(PixelCostRow),
    pub(super) boxes: kernel!(BoxRow),
    pub(super) best_windows: kernel!(BestWindowsRow),
    pub(super) best: kernel!(BestRow),
    pub(super) remap: kernel!(RemapRow),
    pub(super) halve: kernel!(HalveRow),
    pub(super) gradient: kernel!(GradientRow),
    pub(super) strength: kernel!(StrengthRow),
    pub(super) maxima: kernel!(MaximaRow),
    pub(super) patch_sums: kernel!(PatchSums),
    pub(super) correlate: kernel!(Correlate),
    pub(super) model_columns: kernel!(ModelColumns),
    pub(super) interpolate: kernel!(Interpolate),
    pub(super) project: kernel!(Project),
    pub(super) gram: kernel!(Gram),
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
            weighted: weighted::weighted_rows,
            transpose: transpose::transpose,
            magnitude: magnitude::magnitude_row,
            lookup: lookup::lookup_row,
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
                    weighted: weighted::avx512::weighted_rows,
                    transpose: transpose::avx512::transpose,
                    magnitude: magnitude::row::avx512,
                    lookup: lookup::avx512::lookup_row,
                    sort: sort::columns::avx512,
                    gather: tile::gathered::avx512,
                    span: tile::span::avx512,
                    plane: planes::sums::avx512,
                    near: planes::near::avx512,
                    sum_columns: windows::summed::avx512,
                    offer: windows::offered::avx512,
                    range: range::row::avx512,
                    grey: grey::avx512::grey_row,
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
                    weighted: weighted::avx2::weighted_rows,
                    transpose: transpose::avx2::transpose,
                    magnitude: magnitude::row::avx2,
                    lookup: lookup::avx2::lookup_row,
                    sort: sort::columns::avx2,
                    gather: tile::gathered::avx2,
                    span: tile::span::avx2,
                    plane: planes::sums::avx2,
                    near: planes::near::avx2,
                    sum_columns: windows::summed::avx2,
                    offer: windows::offered::avx2,
                    range: range::row::avx2,
                    grey: grey::avx2::grey_row,
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
                weighted: weighted::neon::weighted_rows,
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
}
