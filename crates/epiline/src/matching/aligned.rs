//! Buffers whose first element lies at the start of a cache line.

use std::ops::{Deref, DerefMut};

/// Bytes of a cache line, and of the longest vector.
const LINE_BYTES: usize = 64;

/// A vector of plain values that starts on a cache line, so that no vector of it straddles two.
#[derive(Debug, Default)]
pub(super) struct AlignedVec<T> {
    data: Vec<T>,
    start: usize,
    len: usize,
}

impl<T: Copy> AlignedVec<T> {
    /// Makes it `len` copies of `value`, keeping its memory where that suffices.
    pub fn reset(&mut self, len: usize, value: T) {
        let slack = LINE_BYTES / size_of::<T>();
        self.data.clear();
        self.data.resize(len + slack, value);
        self.start = self.data.as_ptr().align_offset(LINE_BYTES).min(slack);
        self.len = len;
    }

    /// Makes it `len` values: those it has if it has so many, else copies of `value`.
    pub fn resize(&mut self, len: usize, value: T) {
        if self.len != len {
            self.reset(len, value);
        }
    }
}

impl<T> Deref for AlignedVec<T> {
    type Target = [T];

    fn deref(&self) -> &[T] {
        &self.data[self.start..self.start + self.len]
    }
}

impl<T> DerefMut for AlignedVec<T> {
    fn deref_mut(&mut self) -> &mut [T] {
        &mut self.data[self.start..self.start + self.len]
    }
}
