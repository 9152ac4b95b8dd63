//! What is done to images before they are matched, and to disparity before it is clustered.

mod equalize;
mod grey;
mod low_pass;

pub use equalize::equalize_histogram;
pub use grey::grey_from_bgr;
pub use low_pass::GaussianLowPass;
