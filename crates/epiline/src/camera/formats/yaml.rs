//! A YAML document as a tree whose every entry knows its name, so that errors can say it.

use std::fmt;
use std::path::Path;

use serde::Deserialize;
use serde::de::{Deserializer, MapAccess, SeqAccess, Visitor};

use super::file_error;
use crate::error::{Error, Result};

/// What a YAML document can hold, with every number as f64.
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

struct NodeVisitor;

impl<'de> Visitor<'de> for NodeVisitor {
    type Value = Node;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("a YAML value")
    }

    fn visit_unit<E>(self) -> std::result::Result<Node, E> {
        Ok(Node::Null)
    }

    fn visit_bool<E>(self, value: bool) -> std::result::Result<Node, E> {
        Ok(Node::Bool(value))
    }

    fn visit_i64<E>(self, value: i64) -> std::result::Result<Node, E> {
        Ok(Node::Number(value as f64))
    }

    fn visit_u64<E>(self, value: u64) -> std::result::Result<Node, E> {
        Ok(Node::Number(value as f64))
    }

    fn visit_i128<E>(self, value: i128) -> std::result::Result<Node, E> {
        Ok(Node::Number(value as f64))
    }

    fn visit_u128<E>(self, value: u128) -> std::result::Result<Node, E> {
        Ok(Node::Number(value as f64))
    }

    fn visit_f64<E>(self, value: f64) -> std::result::Result<Node, E> {
        Ok(Node::Number(value))
    }

    fn visit_str<E>(self, value: &str) -> std::result::Result<Node, E> {
        Ok(Node::Text(value.to_owned()))
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut list: A) -> std::result::Result<Node, A::Error> {
        let mut values = Vec::new();
        while let Some(value) = list.next_element()? {
            values.push(value);
        }
        Ok(Node::List(values))
    }

    fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> std::result::Result<Node, A::Error> {
        let mut entries = Vec::new();
        while let Some(entry) = map.next_entry()? {
            entries.push(entry);
        }
        Ok(Node::Map(entries))
    }
}

impl<'de> Deserialize<'de> for Node {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> std::result::Result<Self, D::Error> {
        deserializer.deserialize_any(NodeVisitor)
    }
}

/// Parses a document; the error gives the line.
pub(super) fn parse(path: &Path, text: &str) -> Result<Node> {
    let options = serde_saphyr::options! {
        // A view takes some 25 nodes; rigs from thousands of photographs must load.
        budget: serde_saphyr::budget! { max_nodes: 4_000_000, max_events: 16_000_000 },
        // NaN is refused where it is read, by name.
        non_finite_float_policy: serde_saphyr::NonFiniteFloatPolicy::PassThrough,
        with_snippet: false,
    };
    serde_saphyr::from_str_with_options(text, options).map_err(|error| {
        let reason = error.to_string().split_whitespace().collect::<Vec<_>>().join(" ");
        file_error(path, "document", format!("is not valid YAML: {reason}"))
    })
}

/// A node with the path that leads to it.
#[derive(Debug, Clone)]
pub(super) struct Entry<'a> {
    file: &'a Path,
    name: String,
    node: &'a Node,
}

impl<'a> Entry<'a> {
    /// The document.
    pub fn root(file: &'a Path, node: &'a Node) -> Self {
        Self { file, name: String::new(), node }
    }

    /// An error about this entry.
    pub fn error(&self, reason: impl Into<String>) -> Error {
        let name = if self.name.is_empty() { "document" } else { &self.name };
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
        self.optional(key)?.ok_or_else(|| {
            let name = if self.name.is_empty() { key.to_owned() } else { format!("{}.{key}", self.name) };
            file_error(self.file, name, "is missing")
        })
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
