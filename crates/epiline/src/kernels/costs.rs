//! Kernels for accumulators of several widths.

use super::Kernels;
use super::sad::{self, AddRow, RowShape, SadRow};
use super::select::SelectRow;

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
