//! Studies: requests to domain values, findings to replies.

use super::reply::model_name;
use super::request::{Report, model_ids};
use super::v1;
use crate::discover::{
    ChangeVerdict, Comparison, Diagnosis, FORMULA, FoundEffect, ModelChange, ParameterEstimate,
    ParameterOwner, ParameterValue, RankedEffect, SceneComparison, Verdict, check_name,
};
use crate::effects::formula::{Formula, FormulaError, FormulaParameter, MOST_PARAMETERS};
use crate::engine::{
    Choice, ChoiceKind, Discovered, EngineError, Findings, Inquiry, MAX_STUDY_VIDEOS, Pose, Step, Study,
};
use crate::num::Vec2;

/// Effects that a discovery adds at most where nothing is said.
const DEFAULT_EFFECTS: usize = 2;

/// Most laws of one's own that a diagnosis ranks.
const MAX_CANDIDATES: usize = 20;

/// Ids of the videos and the models that the study begins with.
pub fn request(study: Option<v1::StudyRequest>) -> Result<(Vec<String>, Choice), EngineError> {
    let mut report = Report::default();
    let asked = subject(&mut report, study);
    report.finish(asked)
}

fn subject(report: &mut Report, study: Option<v1::StudyRequest>) -> (Vec<String>, Choice) {
    let study = study.unwrap_or_default();
    let named = study.videos.iter().take(MAX_STUDY_VIDEOS + 1).enumerate();
    let videos: Vec<String> =
        named.map(|(i, name)| report.id(&format!("study.videos[{i}]"), name, "videos")).collect();
    // A fitted model is of one video; of several, `models` has one each.
    let only = if let [video] = &videos[..] { video.as_str() } else { "" };
    let choice = report.choice("study.start", study.start.clone(), only);
    if study.models.is_empty() {
        return (videos, choice);
    }
    if study.start.is_some() {
        report.add("study.models", "are given beside a start; give one of the two");
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
                report.add(format!("study.models[{i}]"), message);
            }
        }
    }
    // As many as were given, for the engine to count.
    ids.resize(study.models.len().min(MAX_STUDY_VIDEOS + 1), String::new());
    (videos, Choice { path: "study.models", kind: ChoiceKind::Together(ids) })
}

pub fn discovery(given: v1::DiscoverEffectsRequest) -> Result<(Vec<String>, Choice, Inquiry), EngineError> {
    let (videos, choice) = request(given.study)?;
    let max_effects = given.max_effects.map_or(DEFAULT_EFFECTS, |n| n as usize);
    Ok((videos, choice, Inquiry::Discover { max_effects, frames: given.frames.map(|n| n as usize) }))
}

pub fn diagnose(given: v1::DiagnoseModelRequest) -> Result<(Vec<String>, Choice, Inquiry), EngineError> {
    let mut report = Report::default();
    let (videos, choice) = subject(&mut report, given.study);
    if given.candidates.len() > MAX_CANDIDATES {
        report.add("candidates", format!("are {}; at most {MAX_CANDIDATES}", given.candidates.len()));
    }
    let candidates = given.candidates.into_iter().take(MAX_CANDIDATES).enumerate();
    let laws: Vec<(String, Formula)> =
        candidates.map(|(i, f)| formula(&mut report, &format!("candidates[{i}]"), f)).collect();
    for (i, (name, _)) in laws.iter().enumerate() {
        if laws.iter().take(i).any(|law| law.0 == *name) {
            report.add(format!("candidates[{i}].name"), format!("is {name}, another candidate's"));
        }
    }
    report.finish((videos, choice, Inquiry::Diagnose(laws)))
}

pub fn addition(given: v1::AddEffectRequest) -> Result<(Vec<String>, Choice, Inquiry), EngineError> {
    use v1::add_effect_request::Addition;
    let mut report = Report::default();
    let (videos, choice) = subject(&mut report, given.study);
    let change = match given.addition {
        Some(Addition::Effect(name)) => ModelChange::Add(name),
        Some(Addition::Formula(law)) => {
            let (name, law) = formula(&mut report, "formula", law);
            ModelChange::Write(name, law)
        }
        None => {
            report.add("addition", "is missing; give effect or formula");
            ModelChange::Add(String::new())
        }
    };
    report.finish((videos, choice, Inquiry::Change(change)))
}

pub fn removal(given: v1::RemoveEffectRequest) -> Result<(Vec<String>, Choice, Inquiry), EngineError> {
    let (videos, choice) = request(given.study)?;
    Ok((videos, choice, Inquiry::Change(ModelChange::Remove(given.effect))))
}

/// A user's law with its name; what is wrong with it is told at `path`.
fn formula(report: &mut Report, path: &str, given: v1::Formula) -> (String, Formula) {
    let name = if given.name.is_empty() { FORMULA.to_string() } else { given.name };
    if let Err(error) = check_name(&name) {
        report.add(format!("{path}.name"), error.to_string());
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
                FormulaError::Text { .. } | FormulaError::TooLong { .. } => "text",
            };
            report.add(format!("{path}.{field}"), error.to_string());
            (name, Formula { text: String::new(), parameters: vec![] })
        }
    }
}

fn video_name(id: &str) -> String {
    format!("videos/{id}")
}

/// In the order in which the request named the videos; a study has one of its own.
fn as_asked<T>(mut all: Vec<T>, asked: &[String], video: impl Fn(&T) -> &str) -> Vec<T> {
    all.sort_by_key(|one| asked.iter().position(|id| video(one) == video_name(id)));
    all
}

pub fn comparison(study: &Study, asked: &[String]) -> Option<v1::Comparison> {
    match &study.findings {
        Findings::Comparison(found) => Some(compared(&study.videos, found, asked)),
        _ => None,
    }
}

fn compared(videos: &[String], found: &Comparison, asked: &[String]) -> v1::Comparison {
    let one = |(video, s): (&String, &SceneComparison)| v1::VideoComparison {
        video: video_name(video),
        rmse: s.rmse,
        noise_sigma: s.noise_sigma,
        reduced_chi_square: s.reduced_chi_square,
        degrees_of_freedom: s.degrees_of_freedom as u64,
        held_out_rmse: s.held_out_rmse,
        objects: s
            .objects
            .iter()
            .map(|o| v1::ObjectComparison {
                object_id: o.id,
                rmse: o.rmse,
                worst: o.worst,
                worst_frame: o.worst_frame as u64,
                reduced_chi_square: o.reduced_chi_square,
                autocorrelation: o.autocorrelation,
            })
            .collect(),
        regimes: s
            .regimes
            .iter()
            .map(|r| v1::Regime {
                regime: r.regime.clone(),
                rmse: r.rmse,
                reduced_chi_square: r.reduced_chi_square,
                frames: r.frames as u64,
            })
            .collect(),
        frame_rmse: s.by_frame.clone(),
    };
    v1::Comparison {
        videos: as_asked(videos.iter().zip(&found.scenes).map(one).collect(), asked, |v| &v.video),
        summary: found.summary.clone(),
    }
}

pub fn diagnosis(study: &Study, asked: &[String]) -> Option<v1::Diagnosis> {
    let Findings::Diagnosis(found) = &study.findings else { return None };
    let Diagnosis { comparison, free_motion, ranked, jumps, too_little } = found;
    let jump = |(scene, j): &(usize, crate::discover::ChangePoint)| v1::Jump {
        video: study.videos.get(*scene).map(|v| video_name(v)).unwrap_or_default(),
        frame: j.frame as u64,
        position: Some(vector(j.position)),
        change: Some(vector(j.change)),
        sigmas: j.sigmas,
    };
    Some(v1::Diagnosis {
        comparison: Some(compared(&study.videos, comparison, asked)),
        free_motion_chi_square: *free_motion,
        ranked: ranked.iter().map(ranking).collect(),
        jumps: jumps.iter().map(jump).collect(),
        too_little: too_little.clone().unwrap_or_default(),
    })
}

fn vector(v: Vec2) -> v1::Vector {
    v1::Vector { x: v.x, y: v.y }
}

fn ranking(r: &RankedEffect) -> v1::RankedEffect {
    v1::RankedEffect {
        kind: r.kind.clone(),
        effect: r.effect.clone(),
        log_evidence: r.log_evidence,
        held_out_rmse: r.held_out_rmse,
    }
}

pub fn discovered(study: &Study, asked: &[String]) -> Option<v1::Discovery> {
    let Findings::Discovery(found) = &study.findings else { return None };
    let Discovered { discovery, steps, courses } = found.as_ref();
    let verdict = match discovery.verdict {
        Verdict::EffectFound => v1::Verdict::EffectFound,
        Verdict::Ambiguous => v1::Verdict::Ambiguous,
        Verdict::Adequate => v1::Verdict::Adequate,
        Verdict::OutsideLibrary => v1::Verdict::OutsideLibrary,
        Verdict::NotIdentifiable => v1::Verdict::NotIdentifiable,
    };
    let courses = study.videos.iter().zip(courses).map(|(video, c)| course(video, c)).collect();
    Some(v1::Discovery {
        verdict: verdict.into(),
        reason: discovery.reason.clone(),
        effects: discovery.effects.iter().map(|f| found_effect(f, &study.videos)).collect(),
        ranked: discovery.ranked.iter().map(ranking).collect(),
        ambiguous: discovery
            .ambiguous
            .iter()
            .map(|kinds| v1::AmbiguousKinds { kinds: kinds.clone() })
            .collect(),
        experiment: discovery.experiment.as_ref().map(|e| v1::Experiment {
            shape: e.shape.clone(),
            mass: e.mass,
            position: Some(vector(e.position)),
            velocity: Some(vector(e.velocity)),
            time: e.time,
            sigmas: e.sigmas,
        }),
        formula: discovery.formula.clone().unwrap_or_default(),
        smallest: discovery
            .smallest
            .iter()
            .map(|s| v1::SmallestEffect {
                kind: s.kind.clone(),
                effect: s.effect.clone(),
                parameter: s.parameter.clone(),
                value: s.value,
                unit: s.unit.clone(),
            })
            .collect(),
        noise_sigma: discovery.noise_sigma,
        revisions: steps.iter().map(revision).collect(),
        courses: as_asked(courses, asked, |c: &v1::Course| &c.video),
    })
}

pub fn revised(study: &Study) -> Option<v1::RevisedModels> {
    let Findings::Changed(steps) = &study.findings else { return None };
    let [before, after] = steps.as_ref();
    Some(v1::RevisedModels { before: Some(revision(before)), after: Some(revision(after)) })
}

pub fn revision(step: &Step) -> v1::Revision {
    let names = |ids: &[String]| step.videos.iter().zip(ids).map(|(v, m)| model_name(v, m)).collect();
    let worth = match step.weight.map(|w| w.worth) {
        Some(ChangeVerdict::Better) => v1::Worth::Better,
        Some(ChangeVerdict::NoDifference) => v1::Worth::NoDifference,
        Some(ChangeVerdict::Worse) => v1::Worth::Worse,
        Some(ChangeVerdict::NotIdentifiable) => v1::Worth::NotIdentifiable,
        None => v1::Worth::Unspecified,
    };
    v1::Revision {
        revision: step.number,
        effect: step.added.as_ref().map(|f| f.effect.clone()).unwrap_or_default(),
        rmse: step.rmse,
        held_out_rmse: step.unseen.held_out_rmse,
        left_out_rmse: step.unseen.left_out_rmse,
        reduced_chi_square: step.reduced_chi_square,
        models: names(&step.models),
        parents: names(&step.parents),
        removed: step.removed.clone().unwrap_or_default(),
        added: step.added.as_ref().map(|f| found_effect(f, &step.videos)),
        noise_sigma: step.noise_sigma,
        log_evidence: step.weight.map_or(0.0, |w| w.log_evidence),
        worth: worth.into(),
        too_little: step.too_little.clone().unwrap_or_default(),
    }
}

fn found_effect(f: &FoundEffect, videos: &[String]) -> v1::FoundEffect {
    let parameters = f.parameters.iter().map(|p| parameter(p, videos)).collect();
    let formula = f.text.clone().unwrap_or_default();
    v1::FoundEffect { kind: f.kind.clone(), effect: f.effect.clone(), parameters, formula }
}

fn parameter(p: &ParameterEstimate, videos: &[String]) -> v1::FoundParameter {
    let numbers = |v: &ParameterValue| match v {
        ParameterValue::Number(v) => vec![*v],
        ParameterValue::Vector(v) => v.to_vec(),
        ParameterValue::Word(_) => vec![],
    };
    let word = match &p.value {
        ParameterValue::Word(word) => word.clone(),
        _ => String::new(),
    };
    let owner = |o: ParameterOwner| v1::ParameterOwner {
        object_id: o.object,
        video: o.scene.and_then(|k| videos.get(k)).map(|v| video_name(v)).unwrap_or_default(),
        identified: o.identified,
    };
    v1::FoundParameter {
        name: p.name.clone(),
        unit: p.unit.clone(),
        value: numbers(&p.value),
        low: numbers(&p.low),
        high: numbers(&p.high),
        word,
        owner: p.owner.map(owner),
    }
}

fn course(video: &str, c: &crate::engine::Course) -> v1::Course {
    let pose = |p: Option<&Pose>| p.copied().flatten().map(|p| p.to_vec()).unwrap_or_default();
    let frame = |(before, after): (&Vec<Pose>, &Vec<Pose>)| v1::CourseFrame {
        objects: (0..before.len())
            .map(|k| v1::CourseObject { before: pose(before.get(k)), after: pose(after.get(k)) })
            .collect(),
    };
    v1::Course { video: video_name(video), frames: c.before.iter().zip(&c.after).map(frame).collect() }
}
