//! Reads the models and formulas that a command is given.

use super::scenes::{MAX_FILE, last};
use crate::api::v1::{Formula, ModelChoice, model_choice};
use crate::cli::error::Failure;
use crate::effects;
use crate::world::Preset;
use std::path::Path;

/// Advice for a missing or unreadable formula.
const FORMULA_ADVICE: &str =
    "give one such as \"ax = 0.1\", or a file that holds it (see `vrdp revise --help`)";

/// A formula: a text with `=`, or a file that holds it; named after the file if no name is given.
pub fn formula(given: &str, name: Option<&str>) -> Result<Formula, Failure> {
    let path = Path::new(given);
    let (text, stem) = if given.contains('=') {
        (given.to_string(), None)
    } else if given.trim().is_empty() {
        (String::new(), None)
    } else {
        let read = match path.metadata() {
            Ok(found) if !found.is_file() => Err(std::io::Error::other("it is not a file")),
            Ok(found) if found.len() > MAX_FILE => Err(std::io::Error::other("it is too large")),
            _ => std::fs::read_to_string(path),
        };
        let text = read.map_err(|e| Failure::input(format!("{given}: {e}; {FORMULA_ADVICE}")))?;
        (text, last(path.file_stem()))
    };
    if text.trim().is_empty() {
        return Err(Failure::input(format!("the formula is empty; {FORMULA_ADVICE}")));
    }
    // Checked before any work, as the service does it again.
    effects::formula::Formula::new(&text, vec![]).map_err(|e| {
        Failure::input(format!("the formula {}: {e}", stem.as_deref().unwrap_or(text.trim())))
    })?;
    let name = name.map(str::to_string).or(stem).unwrap_or_default();
    Ok(Formula { name, text, parameters: vec![] })
}

/// The start model: a preset, a model of the service (`videos/...`), or a model file.
pub fn model(flag: &str, choice: Option<&str>) -> Result<Option<ModelChoice>, Failure> {
    let Some(choice) = choice else { return Ok(None) };
    let kind = if Preset::named(choice).is_some() {
        model_choice::Choice::Preset(choice.into())
    } else if choice.starts_with("videos/") {
        model_choice::Choice::Model(choice.into())
    } else {
        let read = match Path::new(choice).metadata() {
            Ok(found) if !found.is_file() => Err(std::io::Error::other("it is not a file")),
            _ => std::fs::read_to_string(choice),
        };
        let wrong = |e: &dyn std::fmt::Display| {
            let known: Vec<&str> = crate::world::PRESETS.iter().map(|p| p.name).collect();
            let known = known.join(", ");
            Failure::input(format!(
                "{flag} {choice}: is neither a preset nor a readable model file ({e}); the presets are {known}"
            ))
        };
        let text = read.map_err(|e| wrong(&e))?;
        serde_json::from_str::<serde::de::IgnoredAny>(&text).map_err(|e| wrong(&e))?;
        model_choice::Choice::ModelJson(text)
    };
    Ok(Some(ModelChoice { choice: Some(kind) }))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_bad_formula_says_what_to_give() {
        for wrong in ["", "  ", "no_such_file", "/dev/null"] {
            let message = formula(wrong, None).unwrap_err().to_string();
            assert!(message.contains("give one such as \"ax = 0.1\""), "{wrong}: {message}");
        }
        assert_eq!(formula("ax = 1", None).unwrap().text, "ax = 1");
    }
}
