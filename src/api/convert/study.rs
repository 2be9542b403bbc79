//! Studies: requests to domain values.

use super::names::model_ids;
use super::violations::Violations;
use crate::api::v1;
use crate::discover::{FORMULA, ModelChange, check_name};
use crate::effects::formula::{Formula, FormulaError, FormulaParameter, MOST_PARAMETERS};
use crate::engine::{EngineError, MAX_STUDY_VIDEOS, ModelSource, ModelSourceKind, StudyKind};

/// Most effects that a discovery adds where the request names no number.
const DEFAULT_EFFECTS: usize = 2;

/// Most formulas that a diagnosis ranks.
const MAX_CANDIDATES: usize = 20;

/// Ids of the videos, and the models with which the study starts.
pub fn request(study: Option<v1::StudyRequest>) -> Result<(Vec<String>, ModelSource), EngineError> {
    let mut violations = Violations::default();
    let subject = subject(&mut violations, study);
    violations.finish(subject)
}

fn subject(violations: &mut Violations, study: Option<v1::StudyRequest>) -> (Vec<String>, ModelSource) {
    let study = study.unwrap_or_default();
    let named = study.videos.iter().take(MAX_STUDY_VIDEOS + 1).enumerate();
    let videos: Vec<String> =
        named.map(|(i, name)| violations.id(&format!("study.videos[{i}]"), name, "videos")).collect();
    // A fitted model is of one video; of several, `models` has one each.
    let only = if let [video] = &videos[..] { video.as_str() } else { "" };
    let source = violations.source("study.start", study.start.clone(), only);
    if study.models.is_empty() {
        return (videos, source);
    }
    if study.start.is_some() {
        violations.add("study.models", "are given beside a start; give one of the two");
    }
    // A model names its video: they may come in any order.
    let mut ids = vec![String::new(); videos.len()];
    for (i, name) in study.models.iter().take(MAX_STUDY_VIDEOS + 1).enumerate() {
        let of = model_ids(name).and_then(|(video, id)| Some((videos.iter().position(|v| v == video)?, id)));
        match of.and_then(|(at, id)| Some((ids.get_mut(at).filter(|known| known.is_empty())?, id))) {
            Some((free, id)) => *free = id.to_string(),
            None => {
                let message = format!(
                    "is {name:?}; give one videos/{{video}}/models/{{id}} of each of the study's videos"
                );
                violations.add(format!("study.models[{i}]"), message);
            }
        }
    }
    // The engine refuses a wrong number of models.
    ids.resize(study.models.len().min(MAX_STUDY_VIDEOS + 1), String::new());
    (videos, ModelSource { path: "study.models", kind: ModelSourceKind::FittedEach(ids) })
}

pub fn discovery(
    given: v1::DiscoverEffectsRequest,
) -> Result<(Vec<String>, ModelSource, StudyKind), EngineError> {
    let (videos, source) = request(given.study)?;
    let max_effects = given.max_effects.map_or(DEFAULT_EFFECTS, |n| n as usize);
    Ok((videos, source, StudyKind::Discover { max_effects, frames: given.frames.map(|n| n as usize) }))
}

pub fn diagnose(
    given: v1::DiagnoseModelRequest,
) -> Result<(Vec<String>, ModelSource, StudyKind), EngineError> {
    let mut violations = Violations::default();
    let (videos, source) = subject(&mut violations, given.study);
    if given.candidates.len() > MAX_CANDIDATES {
        violations.add("candidates", format!("are {}; at most {MAX_CANDIDATES}", given.candidates.len()));
    }
    let candidates = given.candidates.into_iter().take(MAX_CANDIDATES).enumerate();
    let formulas: Vec<(String, Formula)> =
        candidates.map(|(i, f)| formula(&mut violations, &format!("candidates[{i}]"), f)).collect();
    for (i, (name, _)) in formulas.iter().enumerate() {
        if formulas.iter().take(i).any(|other| other.0 == *name) {
            violations.add(format!("candidates[{i}].name"), format!("is {name}, another candidate's"));
        }
    }
    violations.finish((videos, source, StudyKind::Diagnose(formulas)))
}

pub fn addition(given: v1::AddEffectRequest) -> Result<(Vec<String>, ModelSource, StudyKind), EngineError> {
    use v1::add_effect_request::Addition;
    let mut violations = Violations::default();
    let (videos, source) = subject(&mut violations, given.study);
    let change = match given.addition {
        Some(Addition::Effect(name)) => ModelChange::Add(name),
        Some(Addition::Formula(law)) => {
            let (name, law) = formula(&mut violations, "formula", law);
            ModelChange::Write(name, law)
        }
        None => {
            violations.add("addition", "is missing; give effect or formula");
            ModelChange::Add(String::new())
        }
    };
    violations.finish((videos, source, StudyKind::Change(change)))
}

pub fn removal(given: v1::RemoveEffectRequest) -> Result<(Vec<String>, ModelSource, StudyKind), EngineError> {
    let (videos, source) = request(given.study)?;
    Ok((videos, source, StudyKind::Change(ModelChange::Remove(given.effect))))
}

/// A formula with its name; its violations have the path `path`.
fn formula(violations: &mut Violations, path: &str, given: v1::Formula) -> (String, Formula) {
    let name = if given.name.is_empty() { FORMULA.to_string() } else { given.name };
    if let Err(error) = check_name(&name) {
        violations.add(format!("{path}.name"), error.to_string());
    }
    let own = |p: v1::FormulaParameter| {
        let unit = if p.unit.is_empty() { "1".to_string() } else { p.unit };
        FormulaParameter::new(p.name, unit, p.start, p.min, p.max)
    };
    let parameters = given.parameters.into_iter().take(MOST_PARAMETERS + 1).map(own).collect();
    match Formula::new(&given.text, parameters) {
        Ok(law) => (name, law),
        Err(error) => {
            let field = match error {
                FormulaError::Parameter { .. } | FormulaError::Unit { .. } | FormulaError::Count { .. } => {
                    "parameters"
                }
                FormulaError::Text { .. } | FormulaError::Mismatch { .. } | FormulaError::TooLong { .. } => {
                    "text"
                }
            };
            violations.add(format!("{path}.{field}"), error.to_string());
            (name, Formula { text: String::new(), parameters: vec![] })
        }
    }
}
