//! The inner loops, each as a readable reference and as variants for particular instruction sets.
//!
//! Kernels see slices, not images. The [`Kernels`] of a [`Level`] are a table of function pointers, filled with the
//! references and overwritten upward; each entry computes the same bits at every level (`tests/simd_kernels.rs`).

pub mod alignment;
mod calls;
pub mod coarse;
mod costs;
pub mod floor;
pub mod grey;
pub mod islands;
mod level;
pub mod lookup;
pub mod magnitude;
pub mod planes;
pub mod range;
pub mod remap;
pub mod sad;
pub mod select;
pub mod semi_global;
pub mod sort;
mod table;
pub mod texture;
pub mod tile;
pub mod transpose;
pub mod weighted;
pub mod windowed;
pub mod windows;
pub mod xsobel;

pub use costs::CostKernels;
pub use level::{Level, simd_level};
pub use table::Kernels;

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
