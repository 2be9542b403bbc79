//! Reads one video from the bytes of a file, whose content decides the format.

use crate::scene::files::annotation::read_annotation;
use crate::scene::files::csv::{TableDefaults, is_table, read_table};
use crate::scene::files::encoding::{DecodedText, decode};
use crate::scene::files::tracker_project;
use crate::scene::observation::Scene;
use crate::scene::violations::SceneError;

/// A video and how it was read.
#[derive(Debug, Clone, PartialEq)]
pub struct SceneFile {
    pub scene: Scene,
    /// The format: `annotation`, `csv` (any table of text) or `tracker`.
    pub kind: &'static str,
    /// What is assumed because the file does not state it, a line each.
    pub assumed: Vec<String>,
}

/// Reads a CLEVRER annotation, a table of text, or a project of Tracker; `defaults` hold where a table states nothing.
pub fn read_scene(name: &str, bytes: &[u8], defaults: &TableDefaults) -> Result<SceneFile, SceneError> {
    if tracker_project::is_archive(bytes) {
        let text = tracker_project::unpacked(bytes)?;
        return tracker(name, &text, defaults);
    }
    let DecodedText { text, encoding } = decode(bytes)?;
    let start = text.trim_start();
    if start.starts_with('<') {
        return tracker(name, &text, defaults);
    }
    // A log may begin with a bracket.
    let is_list = || start.starts_with('[') && serde_json::from_str::<Vec<serde_json::Value>>(start).is_ok();
    let (kind, read) = match start.starts_with('{') || is_list() {
        true => ("annotation", read_annotation(name, &text)),
        false => ("csv", read_table(name, &text, defaults)),
    };
    let (scene, mut assumed) = read?;
    assumed.extend(encoding.map(|encoding| format!("text in {encoding}")));
    Ok(SceneFile { scene, kind, assumed })
}

fn tracker(name: &str, text: &str, defaults: &TableDefaults) -> Result<SceneFile, SceneError> {
    let table = tracker_project::table(text)?;
    let (scene, assumed) = read_table(name, &table, defaults)?;
    Ok(SceneFile { scene, kind: "tracker", assumed })
}

/// The text of a file; a file that is no text is refused with the way to text.
pub fn decoded(bytes: &[u8]) -> Result<String, SceneError> {
    Ok(decode(bytes)?.text)
}

/// Whether a file, of which these are the first bytes, is a table of positions.
pub fn holds_positions(bytes: &[u8]) -> bool {
    decode(bytes).is_ok_and(|decoded| is_table(&decoded.text))
}
