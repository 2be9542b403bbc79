//! Reads one video from the bytes of a file, whose content decides the format.

use crate::scene::files::annotation::read_annotation;
use crate::scene::files::csv::{TableDefaults, is_table, read_table};
use crate::scene::files::encoding::{DecodedText, decode};
use crate::scene::files::records::{self, TableText};
use crate::scene::files::tracker_project;
use crate::scene::observation::Scene;
use crate::scene::violations::SceneError;
use serde_json::{Map, Value};

/// A video and how it was read.
#[derive(Debug, Clone, PartialEq)]
pub struct SceneFile {
    pub scene: Scene,
    /// The format: `annotation`, `csv` (any table, records or log) or `tracker`.
    pub kind: &'static str,
    /// What is assumed because the file does not state it, a line each.
    pub assumed: Vec<String>,
}

/// Reads a CLEVRER annotation, a table, records, a log, or a project of Tracker; `defaults` hold where a table states nothing.
pub fn read_scene(name: &str, bytes: &[u8], defaults: &TableDefaults) -> Result<SceneFile, SceneError> {
    if tracker_project::is_archive(bytes) {
        let text = tracker_project::unpacked(bytes)?;
        return tracker(name, &text, defaults);
    }
    if let Some(table) = records::of_bytes(bytes) {
        let TableText { text, taken } = table?;
        let mut read = of_text(name, &text, defaults)?;
        read.assumed.extend(taken);
        return Ok(read);
    }
    let DecodedText { text, encoding } = decode(bytes)?;
    let start = text.trim_start();
    let mut read = match start.chars().next() {
        Some('<') => of_xml(name, &text, defaults),
        // A log may begin with a bracket.
        Some('{' | '[') => of_json(name, &text, defaults),
        _ => of_text(name, &text, defaults),
    }?;
    read.assumed.extend(encoding.map(|encoding| format!("text in {encoding}")));
    Ok(read)
}

fn tracker(name: &str, text: &str, defaults: &TableDefaults) -> Result<SceneFile, SceneError> {
    let table = tracker_project::table(text)?;
    let (scene, assumed) = read_table(name, &table, defaults)?;
    Ok(SceneFile { scene, kind: "tracker", assumed })
}

fn of_xml(name: &str, text: &str, defaults: &TableDefaults) -> Result<SceneFile, SceneError> {
    match records::of_xml(text) {
        Some(table) => of_records(name, &table?, defaults),
        None => tracker(name, text, defaults),
    }
}

fn of_json(name: &str, text: &str, defaults: &TableDefaults) -> Result<SceneFile, SceneError> {
    if let Some(table) = records::of_json(text) {
        return of_records(name, &table?, defaults);
    }
    let is_json = text.trim_start().starts_with('{') || serde_json::from_str::<Vec<Value>>(text).is_ok();
    if !is_json {
        return of_text(name, text, defaults);
    }
    let root = serde_json::from_str::<Map<String, Value>>(text).unwrap_or_default();
    if !root.is_empty()
        && !["motion_trajectory", "object_property", "world"].iter().any(|key| root.contains_key(*key))
    {
        let message = "is JSON without tracks that are known; give records with `frame` or `t`, `id`, `x` and `y`, or CLEVRER's \
                       `object_property` and `motion_trajectory`";
        return Err(SceneError::single("(file)", message));
    }
    let (scene, assumed) = read_annotation(name, text)?;
    Ok(SceneFile { scene, kind: "annotation", assumed })
}

fn of_text(name: &str, text: &str, defaults: &TableDefaults) -> Result<SceneFile, SceneError> {
    if let Some(table) = records::of_motion_capture(text) {
        return of_records(name, &table, defaults);
    }
    if let Some(table) = Some(text).filter(|text| !is_table(text)).and_then(records::of_text) {
        return of_records(name, &table?, defaults);
    }
    let (scene, assumed) = read_table(name, text, defaults)?;
    Ok(SceneFile { scene, kind: "csv", assumed })
}

/// The scene of records that were written as a table.
fn of_records(name: &str, table: &TableText, defaults: &TableDefaults) -> Result<SceneFile, SceneError> {
    let (scene, mut assumed) = read_table(name, &table.text, defaults)?;
    assumed.extend(table.taken.iter().cloned());
    Ok(SceneFile { scene, kind: "csv", assumed })
}

/// The text of a file; a file that is no text is refused with the way to text.
pub fn decoded(bytes: &[u8]) -> Result<String, SceneError> {
    Ok(decode(bytes)?.text)
}

/// Whether a file, of which these are the first bytes, is a table of positions.
pub fn holds_positions(bytes: &[u8]) -> bool {
    decode(bytes).is_ok_and(|decoded| is_table(&decoded.text) || records::of_text(&decoded.text).is_some())
}

/// Whether a file is JSON whose records have positions.
pub fn holds_records(bytes: &[u8]) -> bool {
    decode(bytes).is_ok_and(|decoded| records::of_json(&decoded.text).is_some_and(|table| table.is_ok()))
}
