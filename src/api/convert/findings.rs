//! Findings of studies to replies.

use super::names::{model_name, video_name};
use crate::api::v1;
use crate::discover::{
    ChangePoint, ChangeVerdict, Comparison, Diagnosis, FoundEffect, ParameterEstimate, ParameterOwner,
    ParameterValue, RankedEffect, SceneComparison, Verdict,
};
use crate::engine::{
    Discovered, Findings, OptionalPose, RevisionRecord, SideDifference, StoredFit, Study, TrajectoryPair,
};
use crate::num::Vec2;
use crate::world::{Model, UnseenPush};

/// Sorts by the order in which the request named the videos; a study has an order of its own.
fn in_request_order<T>(mut all: Vec<T>, requested: &[String], video: impl Fn(&T) -> &str) -> Vec<T> {
    all.sort_by_key(|one| requested.iter().position(|id| video(one) == video_name(id)));
    all
}

pub fn comparison(study: &Study, requested: &[String]) -> Option<v1::Comparison> {
    match &study.findings {
        Findings::Comparison(found) => Some(compared(&study.videos, found, requested)),
        _ => None,
    }
}

fn compared(videos: &[String], found: &Comparison, requested: &[String]) -> v1::Comparison {
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
        videos: in_request_order(videos.iter().zip(&found.scenes).map(one).collect(), requested, |v| {
            &v.video
        }),
        summary: found.summary.clone(),
        models: vec![],
        difference: None,
    }
}

/// Names of models in the order of the request's videos.
pub fn model_names(fits: &[StoredFit]) -> Vec<String> {
    fits.iter().map(|f| model_name(&f.video, &f.id)).collect()
}

/// The difference of two sides, whose models have the order of the request's videos.
pub fn difference(against: v1::Comparison, videos: &[String], found: SideDifference) -> v1::ModelDifference {
    let of_video = |(video, all): (&String, Vec<crate::discover::Separation>)| {
        let one = |s: crate::discover::Separation| v1::Separation {
            video: video_name(video),
            regime: s.regime,
            rms: s.rms,
            largest: s.largest,
            object_id: s.object,
            frame: s.frame as u64,
        };
        all.into_iter().map(one).collect::<Vec<_>>()
    };
    let (log_evidence, reason) = match found.log_evidence {
        Ok(evidence) => (Some(evidence), String::new()),
        Err(reason) => (None, reason.to_string()),
    };
    v1::ModelDifference {
        against: Some(Box::new(against)),
        log_evidence,
        no_evidence_reason: reason,
        separations: videos.iter().zip(found.separations).flat_map(of_video).collect(),
    }
}

pub fn diagnosis(study: &Study, requested: &[String]) -> Option<v1::Diagnosis> {
    let Findings::Diagnosis(found) = &study.findings else { return None };
    let Diagnosis { comparison, free_motion, ranked, jumps, too_little } = found;
    let change_point = |(scene, j): &(usize, ChangePoint)| v1::ChangePoint {
        video: study.videos.get(*scene).map(|v| video_name(v)).unwrap_or_default(),
        frame: j.frame as u64,
        position: Some(vector(j.position)),
        change: Some(vector(j.change)),
        sigmas: j.sigmas,
    };
    Some(v1::Diagnosis {
        comparison: Some(compared(&study.videos, comparison, requested)),
        free_motion_chi_square: *free_motion,
        ranked: ranked.iter().map(ranking).collect(),
        change_points: jumps.iter().map(change_point).collect(),
        not_identifiable_reason: too_little.clone().unwrap_or_default(),
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
        contact_log_evidence: r.contact_log_evidence,
        held_out_rmse: r.held_out_rmse,
    }
}

pub fn discovered(study: &Study, requested: &[String]) -> Option<v1::Discovery> {
    let Findings::Discovery(found) = &study.findings else { return None };
    let Discovered { discovery, records, trajectories } = found.as_ref();
    let verdict = match discovery.verdict {
        Verdict::EffectFound => v1::Verdict::EffectFound,
        Verdict::Ambiguous => v1::Verdict::Ambiguous,
        Verdict::Adequate => v1::Verdict::Adequate,
        Verdict::OutsideLibrary => v1::Verdict::OutsideLibrary,
        Verdict::NotIdentifiable => v1::Verdict::NotIdentifiable,
    };
    let trajectories =
        study.videos.iter().zip(trajectories).map(|(video, c)| trajectory_pair(video, c)).collect();
    let last = discovery.revisions.last().into_iter().flat_map(|r| &r.fit.scenes);
    let pushes = study.videos.iter().zip(last).flat_map(|(v, s)| unseen_pushes(v, &s.model)).collect();
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
        revisions: records.iter().map(revision).collect(),
        trajectories: in_request_order(trajectories, requested, |c: &v1::TrajectoryPair| &c.video),
        unseen_pushes: in_request_order(pushes, requested, |p: &v1::UnseenPush| &p.video),
    })
}

/// What something unseen does to the objects of a video.
pub fn unseen_pushes(video: &str, model: &Model) -> Vec<v1::UnseenPush> {
    let one = |p: UnseenPush| v1::UnseenPush {
        video: video_name(video),
        object_id: p.id,
        first_frame: p.frames[0] as u64,
        last_frame: p.frames[1] as u64,
        begin_time: p.from,
        end_time: p.until,
        velocity_change: Some(v1::Vector { x: p.velocity.x, y: p.velocity.y }),
        spin_change: p.spin,
        sentence: p.sentence(),
    };
    model.unseen_pushes().into_iter().map(one).collect()
}

pub fn revised(study: &Study) -> Option<v1::RevisedModels> {
    let Findings::Changed(records) = &study.findings else { return None };
    let [before, after] = records.as_ref();
    Some(v1::RevisedModels { before: Some(revision(before)), after: Some(revision(after)) })
}

pub fn revision(record: &RevisionRecord) -> v1::Revision {
    let names = |ids: &[String]| record.videos.iter().zip(ids).map(|(v, m)| model_name(v, m)).collect();
    let worth = match record.evidence.map(|w| w.worth) {
        Some(ChangeVerdict::Better) => v1::Worth::Better,
        Some(ChangeVerdict::NoDifference) => v1::Worth::NoDifference,
        Some(ChangeVerdict::Worse) => v1::Worth::Worse,
        Some(ChangeVerdict::NotIdentifiable) => v1::Worth::NotIdentifiable,
        None => v1::Worth::Unspecified,
    };
    v1::Revision {
        revision: record.number,
        effect: record.added.as_ref().map(|f| f.effect.clone()).unwrap_or_default(),
        rmse: record.rmse,
        held_out_rmse: record.prediction_errors.held_out_rmse,
        left_out_rmse: record.prediction_errors.left_out_rmse,
        reduced_chi_square: record.reduced_chi_square,
        models: names(&record.models),
        parents: names(&record.parents),
        removed: record.removed.clone().unwrap_or_default(),
        added: record.added.as_ref().map(|f| found_effect(f, &record.videos)),
        noise_sigma: record.noise_sigma,
        log_evidence: record.evidence.map_or(0.0, |w| w.log_evidence),
        worth: worth.into(),
        not_identifiable_reason: record.not_identifiable_reason.clone().unwrap_or_default(),
        create_time: None,
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
        sd: p.sd.clone(),
    }
}

fn trajectory_pair(video: &str, c: &TrajectoryPair) -> v1::TrajectoryPair {
    let pose = |p: Option<&OptionalPose>| p.copied().flatten().map(|p| p.to_vec()).unwrap_or_default();
    let frame = |(before, after): (&Vec<OptionalPose>, &Vec<OptionalPose>)| v1::TrajectoryPairFrame {
        objects: (0..before.len())
            .map(|k| v1::PosePair { before: pose(before.get(k)), after: pose(after.get(k)) })
            .collect(),
    };
    v1::TrajectoryPair {
        video: video_name(video),
        frames: c.before.iter().zip(&c.after).map(frame).collect(),
    }
}
