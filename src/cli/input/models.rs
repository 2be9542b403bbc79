//! Reads the models and formulas that a command is given.

use super::files::{MAX_FILE, last};
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

/// A model that a command is given.
#[derive(Debug, Clone, PartialEq)]
pub enum ModelArgument {
    /// A preset, or the text of a model file.
    Start(ModelChoice),
    /// One that the service keeps: its name, or the first digits of its id; and the flag that names it.
    Kept { flag: String, name: String },
}

impl ModelArgument {
    fn start(choice: model_choice::Choice) -> ModelArgument {
        ModelArgument::Start(ModelChoice { choice: Some(choice) })
    }

    /// The choice, of an argument that names no model of the service.
    pub fn of_start(&self) -> Option<ModelChoice> {
        if let ModelArgument::Start(choice) = self { Some(choice.clone()) } else { None }
    }
}

/// Whether a text names a model and not a scene: a preset, a kept model, or a model file.
pub fn is_model(text: &str) -> bool {
    let path = Path::new(text);
    if !path.exists() {
        return Preset::named(text).is_some() || text.starts_with("videos/") || is_id_start(text);
    }
    let is_small = path.metadata().is_ok_and(|found| found.is_file() && found.len() <= MAX_FILE);
    let is_json = path.extension().is_some_and(|e| e.eq_ignore_ascii_case("json"));
    let value = || serde_json::from_str::<serde_json::Value>(&std::fs::read_to_string(path).ok()?).ok();
    is_small && is_json && value().is_some_and(|v| v.get("bodies").is_some() && v.get("effects").is_some())
}

/// Whether a text may be the first digits of an id.
fn is_id_start(text: &str) -> bool {
    !text.is_empty() && text.chars().all(|c| c.is_ascii_digit() || ('a'..='f').contains(&c))
}

/// A model: a preset, one of the service (`videos/...`, or the first digits of its id), or a model file.
pub fn model(flag: &str, choice: Option<&str>) -> Result<Option<ModelArgument>, Failure> {
    let Some(choice) = choice else { return Ok(None) };
    let found = if Preset::named(choice).is_some() {
        ModelArgument::start(model_choice::Choice::Preset(choice.into()))
    } else if choice.starts_with("videos/") || (is_id_start(choice) && !Path::new(choice).exists()) {
        ModelArgument::Kept { flag: flag.into(), name: choice.into() }
    } else {
        let read = match Path::new(choice).metadata() {
            Ok(found) if !found.is_file() => Err(std::io::Error::other("it is not a file")),
            _ => std::fs::read_to_string(choice),
        };
        let wrong = |e: &dyn std::fmt::Display| {
            let known: Vec<&str> = crate::world::PRESETS.iter().map(|p| p.name).collect();
            let known = known.join(", ");
            Failure::input(format!(
                "{flag} {choice}: is neither a preset, nor the id of a model (`vrdp show` lists them), nor a readable \
                 model file ({e}); the presets are {known}"
            ))
        };
        let text = read.map_err(|e| wrong(&e))?;
        serde_json::from_str::<serde::de::IgnoredAny>(&text).map_err(|e| wrong(&e))?;
        ModelArgument::start(model_choice::Choice::ModelJson(text))
    };
    Ok(Some(found))
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

    #[test]
    fn a_model_is_a_preset_an_id_or_a_file() {
        let read = |text| model("--model", Some(text)).map(Option::unwrap);
        assert!(matches!(read("table"), Ok(ModelArgument::Start(_))));
        for name in ["0123ab", "7", "videos/1/models/2"] {
            let kept = ModelArgument::Kept { flag: "--model".into(), name: name.into() };
            assert_eq!(read(name).unwrap(), kept);
        }
        let refused = read("tabel").unwrap_err().to_string();
        assert!(refused.contains("nor the id of a model") && refused.contains("air_table"), "{refused}");
    }
}
