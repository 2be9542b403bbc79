//! Studies: requests to domain values, findings to replies.

use super::reply::model_name;
use super::request::Report;
use super::v1;
use crate::discover::{Comparison, Diagnosis, Ranked, SceneComparison, Value, Verdict};
use crate::effects::effect;
use crate::engine::{Choice, Discovered, EngineError, Findings, Inquiry, MAX_STUDY_VIDEOS, Pose, Study};
use crate::num::Vec2;

/// Effects that a discovery adds at most where nothing is said.
const DEFAULT_EFFECTS: usize = 2;

/// Ids of the videos and the model that their fits start from.
pub fn request(study: Option<v1::StudyRequest>) -> Result<(Vec<String>, Choice), EngineError> {
    let study = study.unwrap_or_default();
    let mut report = Report::default();
    let named = study.videos.iter().take(MAX_STUDY_VIDEOS + 1).enumerate();
    let videos = named.map(|(i, name)| report.id(&format!("study.videos[{i}]"), name, "videos")).collect();
    let choice = report.choice("study.start", study.start, "");
    report.finish((videos, choice))
}

pub fn discovery(given: v1::DiscoverEffectsRequest) -> Result<(Vec<String>, Choice, Inquiry), EngineError> {
    let (videos, choice) = request(given.study)?;
    let max_effects = given.max_effects.map_or(DEFAULT_EFFECTS, |n| n as usize);
    Ok((videos, choice, Inquiry::Discover { max_effects, frames: given.frames.map(|n| n as usize) }))
}

fn video_name(id: &str) -> String {
    format!("videos/{id}")
}

pub fn comparison(study: &Study) -> Option<v1::Comparison> {
    match &study.findings {
        Findings::Comparison(found) => Some(compared(&study.videos, found)),
        _ => None,
    }
}

fn compared(videos: &[String], found: &Comparison) -> v1::Comparison {
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
        videos: videos.iter().zip(&found.scenes).map(one).collect(),
        summary: found.summary.clone(),
    }
}

pub fn diagnosis(study: &Study) -> Option<v1::Diagnosis> {
    let Findings::Diagnosis(Diagnosis { comparison, free_motion, ranked, jumps }) = &study.findings else {
        return None;
    };
    let jump = |(scene, j): &(usize, crate::discover::Jump)| v1::Jump {
        video: study.videos.get(*scene).map(|v| video_name(v)).unwrap_or_default(),
        frame: j.frame as u64,
        position: Some(vector(j.position)),
        change: Some(vector(j.change)),
        sigmas: j.sigmas,
    };
    Some(v1::Diagnosis {
        comparison: Some(compared(&study.videos, comparison)),
        free_motion_chi_square: *free_motion,
        ranked: ranked.iter().map(ranking).collect(),
        jumps: jumps.iter().map(jump).collect(),
    })
}

fn vector(v: Vec2) -> v1::Vector {
    v1::Vector { x: v.x, y: v.y }
}

fn ranking(r: &Ranked) -> v1::RankedEffect {
    v1::RankedEffect {
        kind: r.kind.clone(),
        effect: r.effect.clone(),
        log_evidence: r.log_evidence,
        held_out_rmse: r.held_out_rmse,
    }
}

pub fn discovered(study: &Study) -> Option<v1::Discovery> {
    let Findings::Discovery(found) = &study.findings else { return None };
    let Discovered { discovery, models, courses } = found.as_ref();
    let parameter = |of: &str, p: &crate::discover::Reported| {
        let numbers = |v: &Value| match v {
            Value::Number(v) => vec![*v],
            Value::Vector(v) => v.to_vec(),
            Value::Word(_) => vec![],
        };
        let word = match &p.value {
            Value::Word(word) => word.clone(),
            _ => String::new(),
        };
        v1::FoundParameter {
            name: p.name.clone(),
            unit: unit(of, &p.name),
            value: numbers(&p.value),
            low: numbers(&p.low),
            high: numbers(&p.high),
            word,
        }
    };
    let effect = |f: &crate::discover::Found| v1::FoundEffect {
        kind: f.kind.clone(),
        effect: f.effect.clone(),
        parameters: f.parameters.iter().map(|p| parameter(&f.effect, p)).collect(),
    };
    let revision = |(k, r): (usize, &crate::discover::Revision)| v1::Revision {
        revision: k as u32,
        effect: r.effect.clone().unwrap_or_default(),
        rmse: r.rmse,
        held_out_rmse: r.held_out_rmse,
        left_out_rmse: r.left_out_rmse,
        reduced_chi_square: r.reduced_chi_square,
        models: study
            .videos
            .iter()
            .zip(models.get(k).into_iter().flatten())
            .map(|(v, m)| model_name(v, m))
            .collect(),
    };
    let verdict = match discovery.verdict {
        Verdict::EffectFound => v1::Verdict::EffectFound,
        Verdict::Ambiguous => v1::Verdict::Ambiguous,
        Verdict::Adequate => v1::Verdict::Adequate,
        Verdict::OutsideLibrary => v1::Verdict::OutsideLibrary,
        Verdict::NotIdentifiable => v1::Verdict::NotIdentifiable,
    };
    Some(v1::Discovery {
        verdict: verdict.into(),
        reason: discovery.reason.clone(),
        effects: discovery.effects.iter().map(effect).collect(),
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
        revisions: discovery.revisions.iter().enumerate().map(revision).collect(),
        courses: study.videos.iter().zip(courses).map(|(video, c)| course(video, c)).collect(),
    })
}

/// Unit of a parameter as reports name it; empty where a report turns it into another quantity.
fn unit(of: &str, name: &str) -> String {
    let params = effect(of).map_or(&[][..], |e| e.spec.params);
    let named = |p: &&crate::effects::ParamSpec| p.name == name || p.name.strip_suffix("_x") == Some(name);
    params.iter().find(named).map_or("", |p| p.unit).to_string()
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
