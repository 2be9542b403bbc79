//! Which model a request means: a preset, a model file that is checked in full, or one that was fitted.

use super::error::EngineError;
use super::limits::MAX_SPEED;
use crate::effects::{Scope, alike, effect};
use crate::num::Vec2;
use crate::scene::{MASS_RANGE, MAX_POSITION, SIZE_RANGE, Scene, Shape, Violation};
use crate::world::{ActiveEffect, BodySpec, Model, PRESETS, Preset};

/// Largest time (s), angle (rad) and spin (rad/s) of a model file: beyond it an `f64` resolves them too coarsely.
const MAX_NUMBER: f64 = 1e7;

/// A choice of model, and the path of the request's field.
#[derive(Debug, Clone, PartialEq)]
pub struct ModelSource {
    pub path: &'static str,
    pub kind: ModelSourceKind,
}

#[derive(Debug, Clone, PartialEq)]
pub enum ModelSourceKind {
    /// The preset of the video's world.
    Default,
    Preset(String),
    /// A model file (JSON).
    File(String),
    /// Id of a model that was fitted.
    Fitted(String),
    /// Ids of models that were fitted together, one a video.
    FittedEach(Vec<String>),
}

impl ModelSource {
    /// The preset of the video's world.
    pub fn default_of(path: &'static str) -> ModelSource {
        ModelSource { path, kind: ModelSourceKind::Default }
    }

    /// The model that a fit starts from; refuses one that was fitted.
    pub fn unfitted(&self, scene: &Scene) -> Result<Model, EngineError> {
        match &self.kind {
            ModelSourceKind::Default => Ok(Preset::for_world(scene.world).model(scene)),
            ModelSourceKind::Preset(name) => match Preset::named(name) {
                Some(preset) => Ok(preset.model(scene)),
                None => {
                    let known: Vec<&str> = PRESETS.iter().map(|p| p.name).collect();
                    let message = format!("there is no preset {name:?}; there are {}", known.join(", "));
                    Err(EngineError::invalid(format!("{}.preset", self.path), message))
                }
            },
            ModelSourceKind::File(text) => {
                let path = format!("{}.model_json", self.path);
                let model: Model =
                    serde_json::from_str(text).map_err(|e| EngineError::invalid(&path, e.to_string()))?;
                let mut found = ModelFileViolations { path, list: Vec::new() };
                found.model(&model, scene);
                if found.list.is_empty() { Ok(model) } else { Err(EngineError::Invalid(found.list)) }
            }
            ModelSourceKind::Fitted(_) | ModelSourceKind::FittedEach(_) => Err(EngineError::invalid(
                self.path,
                "is a fitted model, and a fit starts from a preset or a model file; name one of these, or the fitted model in `simulate` or `ask`",
            )),
        }
    }
}

struct ModelFileViolations {
    path: String,
    list: Vec<Violation>,
}

impl ModelFileViolations {
    fn add(&mut self, at: String, message: impl Into<String>) {
        self.list.push(Violation { path: format!("{}.{at}", self.path), message: message.into() });
    }

    fn model(&mut self, model: &Model, scene: &Scene) {
        let (bodies, objects): (Vec<u32>, Vec<u32>) =
            (model.bodies.iter().map(|b| b.id).collect(), scene.objects.iter().map(|o| o.id).collect());
        if bodies != objects {
            self.add("bodies".into(), format!("are {bodies:?}; the video's objects are {objects:?}"));
            return;
        }
        for (i, body) in model.bodies.iter().enumerate() {
            self.body(i, body);
        }
        for (i, wall) in model.walls.iter().enumerate() {
            if ![wall.from.x, wall.from.y, wall.to.x, wall.to.y].iter().all(|v| v.is_finite()) {
                self.add(format!("walls[{i}]"), "must be finite");
            }
        }
        for (i, a) in model.corrections.iter().enumerate() {
            let numbers = [a.time, a.position.x, a.position.y, a.velocity.x, a.velocity.y, a.yaw, a.spin];
            if !numbers.iter().all(|v| v.abs() <= MAX_NUMBER) {
                self.add(format!("anchors[{i}]"), format!("must be finite, within {MAX_NUMBER:e}"));
            }
        }
        for (k, i) in model.impulses.iter().enumerate() {
            let numbers = [i.time, i.until.unwrap_or(i.time), i.velocity.x, i.velocity.y, i.spin, i.delay];
            let deviations = [i.velocity_sd, i.spin_sd, i.delay_sd];
            let valid = numbers.iter().chain(&deviations).all(|v| v.abs() <= MAX_NUMBER);
            if !valid || deviations.iter().any(|sd| *sd < 0.0) {
                self.add(
                    format!("impulses[{k}]"),
                    format!("must be finite, within {MAX_NUMBER:e}; deviations not negative"),
                );
            }
        }
        for (i, active) in model.effects.iter().enumerate() {
            if model.effects.iter().take(i).any(|e| e.name == active.name) {
                self.add(format!("effects[{i}].name"), format!("{} is there twice", active.name));
            }
            self.effect(i, active, &model.bodies);
        }
    }

    fn body(&mut self, i: usize, body: &BodySpec) {
        let s = &body.start.state;
        let numbers = [body.start.time, s.yaw, s.spin, s.roll.x, s.roll.y];
        let within = |most: f64, v: Vec2| v.x.abs() <= most && v.y.abs() <= most;
        if !(numbers.iter().all(|v| v.abs() <= MAX_NUMBER)
            && within(MAX_POSITION, s.position)
            && within(MAX_SPEED, s.velocity))
        {
            let limits =
                format!("within {MAX_POSITION:e} m and {MAX_SPEED:e} m/s, the rest within {MAX_NUMBER:e}");
            self.add(format!("bodies[{i}].start"), format!("must be finite: {limits}"));
        }
        let [low, high] = MASS_RANGE;
        if !(low..=high).contains(&body.mass) {
            let message = format!("is {:?}; must be from {low:e} to {high:e} kg", body.mass);
            self.add(format!("bodies[{i}].mass"), message);
        }
        let fits = |v: f64| (SIZE_RANGE[0]..=SIZE_RANGE[1]).contains(&v);
        let shape_ok = match body.shape {
            Shape::Disc { radius } | Shape::Ball { radius } => fits(radius),
            Shape::Square { half_side } => fits(half_side),
            Shape::Rectangle { half_length, half_width } => fits(half_length) && fits(half_width),
        };
        if !shape_ok {
            let [low, high] = SIZE_RANGE;
            self.add(format!("bodies[{i}].shape"), format!("must be from {low:e} to {high:e} m in size"));
        }
    }

    fn effect(&mut self, i: usize, active: &ActiveEffect, bodies: &[BodySpec]) {
        let known: Vec<&str> = match (&active.formula, effect(&active.name)) {
            (Some(_), Some(_)) => {
                let message = format!("{} is an effect's name; give the formula its own", active.name);
                return self.add(format!("effects[{i}].name"), message);
            }
            (Some(formula), None) => {
                if let Err(error) = formula.read() {
                    return self.add(format!("effects[{i}].formula"), error.to_string());
                }
                formula.parameters.iter().map(|p| p.name.as_str()).collect()
            }
            (None, Some(entry)) => entry.spec.params.iter().map(|p| p.name).collect(),
            (None, None) => {
                let meant = alike(&active.name).join(", ");
                let message = format!("there is no effect {:?}; did you mean {meant}?", active.name);
                return self.add(format!("effects[{i}].name"), message);
            }
        };
        let given: Vec<&str> = active.parameters.iter().map(|p| p.name.as_str()).collect();
        if given != known {
            self.add(format!("effects[{i}].parameters"), format!("are {given:?}; must be {known:?}"));
            return;
        }
        for (j, p) in active.parameters.iter().enumerate() {
            let (_, min, max) = active.bounds(j).unwrap_or(("1", f64::NEG_INFINITY, f64::INFINITY));
            let at = format!("effects[{i}].parameters[{j}]");
            if !p.labels.is_sorted_by(|a, b| a < b) || p.labels.len() != p.values.len() {
                self.add(format!("{at}.labels"), "must be sorted, one for each value");
                continue;
            }
            for (k, value) in p.values.iter().enumerate() {
                if !(min..=max).contains(value) {
                    let message = format!("is {value}; must be {min} to {max}");
                    self.add(format!("{at}.values[{k}]"), message);
                }
            }
            if !(p.prior.mean.is_finite() && p.prior.sd.is_finite() && p.prior.sd >= 0.0) {
                self.add(format!("{at}.prior"), "must be finite, its sd at least 0");
            }
            let covers = bodies.iter().enumerate().all(|(n, a)| {
                let partners = match p.scope {
                    Scope::ShapePair | Scope::Pair => bodies.get(..n),
                    _ => bodies.get(n..=n),
                };
                partners.unwrap_or_default().iter().all(|b| p.index(a, b).is_some())
            });
            if !covers {
                self.add(format!("{at}.labels"), "lack one that the bodies need");
            }
        }
    }
}
