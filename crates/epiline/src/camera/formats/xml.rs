//! OpenCV's XML as a tree.

use std::path::Path;

use roxmltree::{Document, ParsingOptions};

use super::document::Node;
use super::file_error;
use crate::error::Result;

/// Far more than a rig has, far less than a memory holds.
const MAX_NODES: u32 = 1_000_000;
/// Tables within tables.
const MAX_DEPTH: usize = 32;

/// Parses a document; the error gives the line.
pub(super) fn parse(path: &Path, text: &str) -> Result<Node> {
    // Without a document type there are no entities, and nothing that could grow.
    let options = ParsingOptions { allow_dtd: false, nodes_limit: MAX_NODES, ..ParsingOptions::default() };
    let refused = |reason: String| file_error(path, "document", format!("is not valid XML: {reason}"));
    let document = Document::parse_with_options(text, options).map_err(|e| refused(e.to_string()))?;
    node(document.root_element(), MAX_DEPTH).ok_or_else(|| refused(format!("more than {MAX_DEPTH} levels")))
}

/// Elements become tables, elements named `_` lists, and text what it looks like; `None` beyond the depth.
fn node(element: roxmltree::Node<'_, '_>, depth: usize) -> Option<Node> {
    let children: Vec<_> = element.children().filter(|child| child.is_element()).collect();
    if children.is_empty() {
        return Some(leaf(element.text().unwrap_or_default().trim()));
    }
    let inner = depth.checked_sub(1)?;
    if children.iter().all(|child| child.has_tag_name("_")) {
        return Some(Node::List(
            children.into_iter().map(|child| node(child, inner)).collect::<Option<_>>()?,
        ));
    }
    let entry =
        |child: roxmltree::Node<'_, '_>| Some((child.tag_name().name().to_owned(), node(child, inner)?));
    Some(Node::Map(children.into_iter().map(entry).collect::<Option<_>>()?))
}

/// A number, a list of numbers separated by space, or a text.
fn leaf(text: &str) -> Node {
    let numbers: Option<Vec<f64>> = text.split_whitespace().map(|word| word.parse().ok()).collect();
    match numbers.as_deref() {
        Some([]) => Node::Null,
        Some([number]) => Node::Number(*number),
        Some(numbers) => Node::List(numbers.iter().copied().map(Node::Number).collect()),
        None => Node::Text(text.to_owned()),
    }
}
