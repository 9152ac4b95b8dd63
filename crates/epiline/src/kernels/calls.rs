//! The kernels as safe calls: slices are checked, and the level vouches for the instructions.

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
use super::{Kernels, Level, sad};

impl Kernels {
    /// The level they were chosen for.
    pub fn level(&self) -> Level {
        self.level
    }

    /// How many lanes of costs a pixel needs for `num_disparities`: the next number the kernels handle.
    pub fn lanes(&self, num_disparities: usize) -> usize {
        sad::padded_lanes(num_disparities, self.lane_block)
    }

    fn check_lanes(&self, lanes: usize) {
        assert!(sad::padded_lanes(lanes, self.lane_block) == lanes, "{lanes} lanes");
    }
}

/// A method for each kernel. `$ready` is what is asked of a call before: nothing, its `check`, or the lanes too.
macro_rules! calls {
    ($panics:literal, |$kernels:ident, $call:ident| $ready:block, $($(#[$doc:meta])+ $name:ident($row:ident);)+) => {
        impl Kernels {
            $(
                $(#[$doc])+
                #[doc = $panics]
                pub fn $name(&self, $call: &mut $row<'_>) {
                    let $kernels = self;
                    $ready
                    // SAFETY: the call is ready; the table was made from a level, which exists only where the processor
                    // has its instructions.
                    unsafe { ($kernels.$name)($call) }
                }
            )+
        }
    };
}

calls! {
    "\n# Panics\n\nIf a slice has not the length, or a number the range, that the call's `check` demands.",
    |kernels, call| { call.check() },
    /// One row of [`xsobel`].
    xsobel(XSobelRow);
    /// The floor and the obstacles of a row.
    floor(FloorRow);
    /// Windows of a row with too little texture.
    texture(TextureRow);
    /// Columns of disparities as a tile.
    gather(GatherTile);
    /// Sums over a tile's pixels near a plane.
    plane(PlaneTile);
    /// A tile's pixels near a plane that are near the camera.
    near(NearTile);
    /// Sums over neighbouring columns.
    sum_columns(SumColumns);
    /// A bin for each column's window of disparity.
    offer(OfferBin);
    /// Metres of a row.
    range(RangeRow);
    /// Weighted sums of rows of pixels.
    weighted(WeightedRows);
    /// Rows to columns.
    transpose(Transpose);
    /// Grey levels of a row replaced through a table.
    lookup(LookupRow);
    /// Grey levels of a row.
    grey(GreyRow);
    /// Where stretches of linked disparities end in a row.
    breaks(BreaksRow);
    /// What a row at half the resolution adds to costs.
    refine(RefineRow);
    /// Extremes of a row within half a pixel.
    extremes(ExtremesRow);
    /// The census of a row.
    census(CensusRow);
    /// A row resampled through a table.
    remap(RemapRow);
    /// A row at half the size.
    halve(HalveRow);
    /// Gradient products of a row, and their sums per column.
    gradient(GradientRow);
    /// Smaller eigenvalues of a row.
    strength(StrengthRow);
    /// Local maxima of a row.
    maxima(MaximaRow);
    /// Sums of patches.
    patch_sums(PatchSums);
    /// Products of a patch with others.
    correlate(Correlate);
}

calls! {
    "\n# Panics\n\nIf a slice has not the length that the call's `check` demands, or lanes are none that [`lanes`](Self::lanes) gives.",
    |kernels, call| { call.check(); kernels.check_lanes(call.lanes) },
    /// Pixel costs of a row, and their sums per column.
    cost(CostRow);
    /// Matching costs of a row.
    window(WindowRow);
    /// Both horizontal paths through rows.
    horizontal(HorizontalRows);
    /// One step of vertical paths.
    vertical(VerticalRow);
    /// Sums over the paths and the best candidates of a row.
    sum(SumRow);
    /// By how much the sums over the paths exceed the best.
    excess(ExcessRow);
    /// Pixel costs of a row by one kind of difference, and their sums per column.
    pixel_cost(PixelCostRow);
    /// Box sums of a row.
    boxes(BoxRow);
    /// Costs from the best of five windows.
    best_windows(BestWindowsRow);
    /// The best candidates of a row.
    best(BestRow);
}

calls! {
    "\n# Panics\n\nIf something does not lie inside.",
    |kernels, call| {},
    /// The largest magnitude of a row.
    magnitude(MagnitudeRow);
    /// Each lane in ascending order.
    sort(SortColumns);
    /// Where in a tile's columns values of a span lie.
    span(SpanTile);
    /// The columns of a patch's model.
    model_columns(ModelColumns);
    /// A patch between pixels.
    interpolate(Interpolate);
    /// Sums of products of a patch with a model's columns.
    project(Project);
    /// Sums of products of a model's columns.
    gram(Gram);
}
