//! Models: fit requests to domain values, fits and the catalogue of effects to replies.

use super::findings::{revision, unseen_pushes};
use super::names::model_name;
use super::violations::Violations;
use crate::api::v1;
use crate::effects::{EFFECTS, EffectEntry, ParamSpec, Scope};
use crate::engine::{EngineError, JointVideos, MAX_STUDY_VIDEOS, ModelSource, StoredFit};
use crate::fit::{Estimate, Fit, FitOptions, Method, PairRestitution, Termination};

/// Most iterations of a fit that a caller may ask for.
const MAX_ITERATIONS: u32 = 10_000;

/// Video, joint videos, start model and options of a fit.
pub fn fit_request(
    given: v1::FitModelRequest,
) -> Result<(String, JointVideos, ModelSource, FitOptions), EngineError> {
    let mut violations = Violations::default();
    violations.request_id(&given.request_id);
    let video = violations.id("parent", &given.parent, "videos");
    let source = violations.source("start", given.start, &video);
    if given.whole_setup && !given.others.is_empty() {
        violations.add("others", "are named and whole_setup is set; choose one");
    }
    let named = given.others.iter().take(MAX_STUDY_VIDEOS + 1).enumerate();
    let named: Vec<String> =
        named.map(|(i, name)| violations.id(&format!("others[{i}]"), name, "videos")).collect();
    let others = if given.whole_setup { JointVideos::Setup } else { JointVideos::Named(named) };
    let mut options = FitOptions::default();
    match given.max_iterations {
        0 => {}
        n if n <= MAX_ITERATIONS => options.max_iterations = n as usize,
        n => violations.add("max_iterations", format!("is {n}; must be at most {MAX_ITERATIONS}")),
    }
    match v1::FitMethod::try_from(given.method) {
        Ok(v1::FitMethod::Unspecified | v1::FitMethod::GaussNewton) => {}
        Ok(v1::FitMethod::StagedLbfgs) => options.method = Method::Paper,
        Err(_) => violations.add("method", format!("is {}, which is no method", given.method)),
    }
    violations.finish((video, others, source, options))
}

pub fn model(stored: &StoredFit) -> v1::Model {
    let name = model_name(&stored.video, &stored.id);
    let Some(scene) = stored.fit.scenes.first() else {
        return v1::Model { name, ..v1::Model::default() };
    };
    let objects = stored.fit.objects(0).into_iter().map(|o| v1::ObjectEstimate {
        object_id: o.id,
        mass: Some(estimate(&stored.fit, &o.mass)),
        restitution: Some(estimate(&stored.fit, &o.restitution)),
    });
    let shared = stored.fit.shared(0).into_iter().map(|s| v1::SharedEstimate {
        effect: s.effect,
        parameter: s.parameter,
        labels: s.labels,
        values: s.values.iter().map(|e| estimate(&stored.fit, e)).collect(),
    });
    v1::Model {
        name,
        revision: stored.revision,
        preset: scene.model.preset.clone(),
        rmse: scene.rmse,
        noise_sigma: scene.noise_sigma,
        noise_yaw: scene.noise_yaw,
        reduced_chi_square: scene.reduced_chi_square,
        degrees_of_freedom: scene.degrees_of_freedom as u64,
        identified: stored.fit.posterior.estimates.iter().all(|e| e.identified),
        adequate: scene.adequate,
        converged: stored.fit.outcome == Termination::Converged,
        iterations: stored.fit.iterations as u64,
        objects: objects.collect(),
        shared: shared.collect(),
        // A model is plain data with string keys, which JSON always takes.
        model_json: serde_json::to_string(&scene.model).unwrap_or_default(),
        history: stored.record.as_ref().map(revision),
        create_time: None,
        pairs: stored.fit.posterior.pairs.iter().map(|p| pair(&stored.fit, p)).collect(),
        covariance: None,
        unseen_pushes: unseen_pushes(&stored.video, &scene.model),
    }
}

fn pair(fit: &Fit, p: &PairRestitution) -> v1::PairEstimate {
    v1::PairEstimate { object_ids: p.objects.to_vec(), restitution: Some(estimate(fit, &p.estimate)) }
}

/// The models of a fit.
pub fn fitted(fit: &StoredFit, others: &[&StoredFit]) -> v1::FittedModels {
    v1::FittedModels { model: Some(model(fit)), others: others.iter().map(|fit| model(fit)).collect() }
}

/// The covariance of a model's fitted numbers, if it is known.
pub fn covariance(stored: &StoredFit) -> Option<v1::ParameterCovariance> {
    let (estimates, rows) = stored.fit.posterior.covariance();
    let names: Vec<String> = estimates.iter().map(|e| e.name.clone()).collect();
    (!names.is_empty()).then(|| v1::ParameterCovariance { names, values: rows.concat() })
}

/// An estimate of the fit of one video.
fn estimate(fit: &Fit, e: &Estimate) -> v1::Estimate {
    let [low95, high95] = fit.interval(0, e);
    v1::Estimate { value: e.value, sd: e.sd, unit: e.unit.clone(), identified: e.identified, low95, high95 }
}

pub fn effects() -> Vec<v1::Effect> {
    let effect = |e: &EffectEntry| v1::Effect {
        name: e.spec.name.into(),
        description: e.spec.doc.into(),
        source: e.spec.source.into(),
        parameters: e.spec.params.iter().map(parameter).collect(),
    };
    EFFECTS.iter().map(effect).collect()
}

fn parameter(p: &ParamSpec) -> v1::EffectParameter {
    let scope = match p.scope {
        Scope::Setup => "setup",
        Scope::Material => "material",
        Scope::Shape => "shape",
        Scope::Object => "object",
        Scope::ShapePair => "shape_pair",
        Scope::Pair => "pair",
    };
    v1::EffectParameter {
        name: p.name.into(),
        description: p.doc.into(),
        unit: p.unit.into(),
        default_value: p.default,
        min: p.min,
        max: p.max,
        scope: scope.into(),
    }
}
