//! A parsed document as a tree whose every entry knows its name, so that errors can say it.

use std::fmt;
use std::path::Path;

use nalgebra::Matrix3;

use super::file_error;
use crate::error::{Error, Result};

/// What a YAML, JSON or XML document can hold, with every number as f64.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Node {
    Null,
    Bool(bool),
    Number(f64),
    Text(String),
    List(Vec<Node>),
    Map(Vec<(String, Node)>),
}

impl fmt::Display for Node {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Null => f.write_str("empty"),
            Self::Bool(value) => write!(f, "{value}"),
            Self::Number(value) => write!(f, "{value}"),
            Self::Text(value) => {
                // A whole file may end up in one unclosed quotation.
                let shown: String = value.chars().take(40).collect();
                write!(f, "'{shown}'{}", if shown.len() < value.len() { "…" } else { "" })
            }
            Self::List(values) => write!(f, "a list of {}", values.len()),
            Self::Map(_) => f.write_str("a table"),
        }
    }
}

/// The largest image side accepted, pixels.
const MAX_SIDE_PX: usize = 16_384;

/// A node with the path that leads to it.
#[derive(Debug, Clone)]
pub(super) struct Entry<'a> {
    file: &'a Path,
    name: String,
    node: &'a Node,
}

impl<'a> Entry<'a> {
    /// The file.
    pub fn file(&self) -> &'a Path {
        self.file
    }

    /// The document.
    pub fn root(file: &'a Path, node: &'a Node) -> Self {
        Self { file, name: String::new(), node }
    }

    /// An error about this entry.
    pub fn error(&self, reason: impl Into<String>) -> Error {
        let name = if self.name.is_empty() { "document" } else { &self.name };
        file_error(self.file, name, reason)
    }

    /// An error about an entry of this table.
    pub fn about(&self, key: &str, reason: impl Into<String>) -> Error {
        let name = if self.name.is_empty() { key.to_owned() } else { format!("{}.{key}", self.name) };
        file_error(self.file, name, reason)
    }

    fn expected(&self, what: &str) -> Error {
        self.error(format!("is {}; expected {what}", self.node))
    }

    fn child(&self, name: String, node: &'a Node) -> Self {
        Self { file: self.file, name, node }
    }

    /// The entry of a table, or `None` if there is none of this name or it is empty.
    pub fn optional(&self, key: &str) -> Result<Option<Self>> {
        let Node::Map(entries) = self.node else { return Err(self.expected("a table")) };
        let name = if self.name.is_empty() { key.to_owned() } else { format!("{}.{key}", self.name) };
        let found = entries.iter().find(|(k, node)| k == key && *node != Node::Null);
        Ok(found.map(|(_, node)| self.child(name, node)))
    }

    /// The entry of a table.
    pub fn get(&self, key: &str) -> Result<Self> {
        self.optional(key)?.ok_or_else(|| self.about(key, "is missing"))
    }

    /// A finite number no larger than physical quantities are.
    pub fn number(&self) -> Result<f64> {
        // No length in metres, angle, pixel or coefficient of a camera; squares of it are still far from overflow.
        const LARGEST: f64 = 1e15;
        match self.node {
            Node::Number(value) if value.is_finite() && value.abs() <= LARGEST => Ok(*value),
            _ => Err(self.expected(&format!("a finite number no larger than {LARGEST:e}"))),
        }
    }

    /// A whole number from 0 to `largest`.
    pub fn count(&self, largest: usize) -> Result<usize> {
        match self.node {
            Node::Number(value) if value.fract() == 0.0 && (0.0..=largest as f64).contains(value) => {
                Ok(*value as usize)
            }
            _ => Err(self.expected(&format!("a whole number from 0 to {largest}"))),
        }
    }

    /// A text.
    pub fn text(&self) -> Result<&'a str> {
        match self.node {
            Node::Text(value) => Ok(value),
            _ => Err(self.expected("a text")),
        }
    }

    /// The entries of a list.
    pub fn list(&self) -> Result<impl ExactSizeIterator<Item = Self> + use<'a>> {
        let Node::List(values) = self.node else { return Err(self.expected("a list")) };
        let parent = self.clone();
        Ok(values
            .iter()
            .enumerate()
            .map(move |(i, node)| parent.child(format!("{}[{i}]", parent.name), node)))
    }

    /// A finite number larger than zero.
    pub fn positive(&self) -> Result<f64> {
        let value = self.number()?;
        (value > 0.0).then_some(value).ok_or_else(|| self.error(format!("is {value}; must be positive")))
    }

    /// The side of an image, pixels.
    pub fn side_px(&self) -> Result<usize> {
        match self.count(MAX_SIDE_PX)? {
            0 => Err(self.error("is 0; must be positive")),
            pixels => Ok(pixels),
        }
    }

    /// Width and height of an image, pixels.
    pub fn size_px(&self) -> Result<[usize; 2]> {
        let sides = self.list()?.map(|side| side.side_px()).collect::<Result<Vec<_>>>()?;
        sides.try_into().map_err(|_| self.error("must hold width and height"))
    }

    /// The first of several names that a table's entry may have.
    pub fn first_of(&self, keys: &[&str]) -> Result<Option<Self>> {
        for key in keys {
            if let Some(found) = self.optional(key)? {
                return Ok(Some(found));
            }
        }
        Ok(None)
    }

    /// Nine numbers, row after row, that are a rotation matrix.
    pub fn rotation(&self, values: &[f64]) -> Result<Matrix3<f64>> {
        let matrix = Matrix3::from_row_slice(values);
        let residual = (matrix.transpose() * matrix - Matrix3::identity()).abs().max();
        if residual > 1e-4 || matrix.determinant() < 0.0 {
            return Err(self.error(format!("is no rotation matrix: off orthonormal by {residual:.2e}")));
        }
        Ok(matrix)
    }

    /// Focal lengths and principal point of a camera matrix, row after row; skew is refused.
    pub fn pinhole(&self, k: &[f64]) -> Result<([f64; 2], [f64; 2])> {
        let &[fx, skew, cx, zero_1, fy, cy, zero_2, zero_3, one] = k else {
            return Err(self.expected("a 3x3 camera matrix"));
        };
        if [skew, zero_1, zero_2, zero_3, one] != [0.0, 0.0, 0.0, 0.0, 1.0] {
            return Err(
                self.error(format!("is {k:?}; expected fx 0 cx, 0 fy cy, 0 0 1: skew is not supported"))
            );
        }
        if fx <= 0.0 || fy <= 0.0 {
            return Err(self.error(format!("has focal lengths {fx} and {fy} px; they must be positive")));
        }
        Ok(([fx, fy], [cx, cy]))
    }

    /// Exactly `N` numbers.
    pub fn numbers<const N: usize>(&self) -> Result<[f64; N]> {
        let numbers = self.all_numbers(N)?;
        Ok(numbers.try_into().expect("as many as asked for"))
    }

    /// Exactly `count` numbers.
    pub fn all_numbers(&self, count: usize) -> Result<Vec<f64>> {
        let list = self.list().map_err(|_| self.expected(&format!("a list of {count} numbers")))?;
        if list.len() != count {
            return Err(self.expected(&format!("a list of {count} numbers")));
        }
        list.map(|entry| entry.number()).collect()
    }

    /// `side` rows of `side` numbers, row after row.
    pub fn square(&self, side: usize) -> Result<Vec<f64>> {
        let rows = self.list()?;
        if rows.len() != side {
            return Err(self.expected(&format!("a list of {side} rows of {side} numbers")));
        }
        let mut values = Vec::with_capacity(side * side);
        for row in rows {
            values.extend(row.all_numbers(side)?);
        }
        Ok(values)
    }
}
