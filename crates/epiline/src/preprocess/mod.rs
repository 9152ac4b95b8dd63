//! What is done to images before they are matched, and to disparity before it is clustered.

mod grey;

pub use grey::grey_from_bgr;
