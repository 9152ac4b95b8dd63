//! What is done to images before they are matched, and to disparity before it is clustered.

mod equalize;
mod grey;
mod low_pass;
mod xsobel;

pub use equalize::equalize_histogram;
pub use grey::grey_from_bgr;
pub use low_pass::GaussianLowPass;
pub use xsobel::xsobel;
pub(crate) use xsobel::xsobel_row;
