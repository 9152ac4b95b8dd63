//! The one error of the library: every variant carries the names, values and units of what was wrong.

use thiserror::Error;

/// What can go wrong between two photographs and a range.
///
/// Messages are one line, name the offending quantity and give its value and unit; nothing in this crate panics
/// on a caller's data.
#[derive(Debug, Clone, PartialEq, Error)]
#[non_exhaustive]
pub enum Error {
    /// A parameter is outside its legal range.
    #[error("{name} = {value}: {expected}")]
    InvalidParameter {
        /// The parameter as the public API spells it.
        name: &'static str,
        /// The value given, with its unit.
        value: String,
        /// What would have been legal.
        expected: String,
    },
    /// Two things that must have one size do not.
    #[error(
        "{first} is {first_width}x{first_height} px but {second} is {second_width}x{second_height} px; \
         they must have one size"
    )]
    SizeMismatch {
        /// Name of the first image.
        first: &'static str,
        /// Its width in pixels.
        first_width: usize,
        /// Its height in pixels.
        first_height: usize,
        /// Name of the second image.
        second: &'static str,
        /// Its width in pixels.
        second_width: usize,
        /// Its height in pixels.
        second_height: usize,
    },
    /// A buffer does not hold the image it is said to hold.
    #[error(
        "{name}: {width}x{height} px with a stride of {stride} needs {needed} elements, the buffer has {actual}"
    )]
    BufferTooSmall {
        /// Name of the image.
        name: &'static str,
        /// Width in pixels.
        width: usize,
        /// Height in pixels.
        height: usize,
        /// Elements from one row to the next.
        stride: usize,
        /// Elements needed.
        needed: usize,
        /// Elements given.
        actual: usize,
    },
    /// There is less data than the method needs.
    #[error("{what}: {actual} given, at least {needed} needed")]
    NotEnoughData {
        /// What is counted.
        what: &'static str,
        /// How many there are.
        actual: usize,
        /// How many it takes.
        needed: usize,
    },
    /// The data do not determine the answer.
    #[error("{what}: {reason}")]
    Degenerate {
        /// The computation.
        what: &'static str,
        /// Why it has no answer, in words a user can act on.
        reason: String,
    },
    /// A file's content is not what its format demands.
    #[error("{what}: field '{field}' {reason}")]
    InvalidFile {
        /// The format, and the file's name where known.
        what: String,
        /// The entry that is wrong.
        field: String,
        /// What is wrong with it.
        reason: String,
    },
    /// The operating system refused.
    #[error("{path}: {reason}")]
    Io {
        /// The path.
        path: String,
        /// The system's reason.
        reason: String,
    },
}

impl Error {
    /// An [`Error::InvalidParameter`] from anything that prints.
    pub fn invalid(name: &'static str, value: impl std::fmt::Display, expected: impl Into<String>) -> Self {
        Self::InvalidParameter { name, value: value.to_string(), expected: expected.into() }
    }

    /// An [`Error::Degenerate`].
    pub fn degenerate(what: &'static str, reason: impl Into<String>) -> Self {
        Self::Degenerate { what, reason: reason.into() }
    }
}

/// Result with this crate's [`enum@Error`].
pub type Result<T> = std::result::Result<T, Error>;
