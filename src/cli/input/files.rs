//! Reads a file that a command is given; refuses folders, pipes and what is too large.

use crate::cli::error::Failure;
use crate::scene::decoded;
use std::path::Path;

/// Largest size of a scene file in bytes: the allowed objects and frames need less.
pub const MAX_FILE: u64 = 1 << 30;

/// Whether the path is a file; false for a folder. Refuses anything else: a pipe may never end.
pub fn is_regular_file(path: &Path) -> Result<bool, Failure> {
    let found = path.metadata().map_err(|e| unreadable(path, e))?;
    if found.is_file() && found.len() > MAX_FILE {
        return Err(unreadable(
            path,
            format!("has {} bytes, more than the limit of {MAX_FILE}", found.len()),
        ));
    }
    if !found.is_file() && !found.is_dir() {
        return Err(unreadable(path, "is neither a file nor a folder"));
    }
    Ok(found.is_file())
}

pub fn unreadable(path: &Path, why: impl std::fmt::Display) -> Failure {
    Failure::input(format!("{}: {why}; give a scene file or folder", path.display()))
}

/// The bytes of a file; refuses folders and pipes.
pub fn bytes(path: &Path) -> Result<Vec<u8>, Failure> {
    match is_regular_file(path)? {
        true => std::fs::read(path).map_err(|e| unreadable(path, e)),
        false => Err(unreadable(path, "is a folder")),
    }
}

/// The text of a file, in any encoding.
pub fn text(path: &Path) -> Result<String, Failure> {
    decoded(&bytes(path)?).map_err(|e| Failure::input(e.to_string()))
}

pub fn last(name: Option<&std::ffi::OsStr>) -> Option<String> {
    name.map(|name| name.to_string_lossy().into_owned())
}
