//! Tsai.
