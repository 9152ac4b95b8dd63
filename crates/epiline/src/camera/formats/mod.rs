//! Rig files: our own, and what other systems write.
//!
//! Errors name the file, the entry and the value; a file that is read is a rig that could exist.

pub mod kitti;
mod rig;
mod yaml;

use std::fs::File;
use std::io::{Read, Write};
use std::path::Path;

use crate::error::{Error, Result};

/// No calibration of real cameras comes near this; it keeps a wrong path from filling the memory.
const MAX_FILE_BYTES: u64 = 64 << 20;

fn io_error(path: &Path, reason: impl std::fmt::Display) -> Error {
    Error::Io { path: path.display().to_string(), reason: reason.to_string() }
}

fn file_error(path: &Path, field: impl Into<String>, reason: impl Into<String>) -> Error {
    Error::InvalidFile { what: path.display().to_string(), field: field.into(), reason: reason.into() }
}

/// A whole text file, UTF-8 and of reasonable size.
fn read_text(path: &Path) -> Result<String> {
    let file = File::open(path).map_err(|e| io_error(path, e))?;
    let mut bytes = Vec::new();
    file.take(MAX_FILE_BYTES + 1).read_to_end(&mut bytes).map_err(|e| io_error(path, e))?;
    if bytes.len() as u64 > MAX_FILE_BYTES {
        return Err(file_error(
            path,
            "file",
            format!("is larger than {} MiB; no rig is", MAX_FILE_BYTES >> 20),
        ));
    }
    String::from_utf8(bytes).map_err(|e| {
        let offset = e.utf8_error().valid_up_to();
        file_error(path, "file", format!("is not text: the byte at offset {offset} is not UTF-8"))
    })
}

/// Writes a file so that its name never stands for half of it: a temporary name, then a rename.
fn write_atomically(path: &Path, text: &str) -> Result<()> {
    let name = path.file_name().ok_or_else(|| io_error(path, "is not a file name"))?.to_string_lossy();
    let temporary = path.with_file_name(format!(".{name}.{}.tmp", std::process::id()));
    let write = || {
        let mut file = File::create(&temporary)?;
        file.write_all(text.as_bytes())?;
        file.sync_all()?;
        std::fs::rename(&temporary, path)
    };
    write().map_err(|e| {
        // The reason is in `e`; whether the leftover can be removed changes nothing about it.
        let _ = std::fs::remove_file(&temporary);
        io_error(path, e)
    })
}
