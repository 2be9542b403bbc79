//! What a fit says of objects and of effects, by their names.

use super::super::result::{Fit, SceneFit};
use super::laplace::Posterior;
use super::pairs::PairRestitution;
use super::parameter_estimate::Estimate;
use crate::effects::{EffectEntry, ParamId, ParamRole, ParamSpec, parameter_with};
use crate::num::NINETY_FIVE;
use crate::world::{ActiveEffect, BODY_VALUES, BodySpec, MASS, Model, Parameter};

/// What is known of one object of a scene.
#[derive(Debug, Clone, PartialEq)]
pub struct ObjectEstimate {
    pub id: u32,
    /// kg, or relative if the scene gives no mass.
    pub mass: Estimate,
    /// The object's factor r in e = coefficient r_a r_b d_ab.
    pub restitution: Estimate,
}

/// One parameter that the objects of a set-up share; several values if it differs by material or pair.
#[derive(Debug, Clone, PartialEq)]
pub struct SharedEstimate {
    pub effect: String,
    pub parameter: String,
    /// What each value applies to; one empty label if there is one value.
    pub labels: Vec<String>,
    pub values: Vec<Estimate>,
}

impl Fit {
    /// The fitted models, one a scene.
    pub fn models(&self) -> Vec<Model> {
        self.scenes.iter().map(|s| s.model.clone()).collect()
    }

    /// Fits of single scenes of one joint fit as one, to show; without what sampling needs.
    pub fn joined(fits: &[&Fit]) -> Option<Fit> {
        let first = fits.first()?;
        let (mut own, mut shared): (Vec<Estimate>, Vec<Estimate>) = (vec![], vec![]);
        for (k, fit) in fits.iter().enumerate() {
            for e in &fit.posterior.estimates {
                let is_other = shared.iter().any(|s| s.name == e.name && s != e);
                match e.scene {
                    None if !is_other && shared.contains(e) => {}
                    None if !is_other => shared.push(e.clone()),
                    // Found before the shared one of this name.
                    _ => own.push(Estimate { scene: Some(k), ..e.clone() }),
                }
            }
        }
        own.extend(shared);
        let scenes = fits.iter().flat_map(|f| f.scenes.iter().cloned()).collect();
        let of = |(k, fit): (usize, &&Fit)| {
            let pairs = fit.posterior.pairs.iter().cloned();
            pairs.map(|pair| PairRestitution { scene: k, ..pair }).collect::<Vec<_>>()
        };
        let pairs = fits.iter().enumerate().flat_map(of).collect();
        let posterior = Posterior { estimates: own, pairs, ..Posterior::default() };
        Some(Fit { scenes, posterior, losses: vec![], ..(*first).clone() })
    }

    /// The part of the fit that concerns one scene.
    pub fn of_scene(&self, scene: usize) -> Fit {
        Fit {
            scenes: self.scenes.get(scene).cloned().into_iter().collect(),
            posterior: self.posterior.of_scene(scene),
            iterations: self.iterations,
            outcome: self.outcome,
            losses: self.losses.clone(),
        }
    }

    /// Raises the standard deviation of a law's parameter to `sd` (in its unit) where the fit has one value of it: something that
    /// the noise does not explain is known to add to it.
    pub fn widen(&mut self, effect: &str, parameter: &str, sd: f64) {
        let is_of = |e: &Estimate| ParamId::parse(&e.name).is_some_and(|id| id.is_of(effect, parameter));
        let mut own: Vec<&mut Estimate> = self.posterior.estimates.iter_mut().filter(|e| is_of(e)).collect();
        if let [only] = &mut own[..] {
            only.sd = only.sd.max(sd);
        }
    }

    /// The 95 % interval of an estimate of a scene, cut off where its parameter ends.
    pub fn interval(&self, scene: usize, estimate: &Estimate) -> [f64; 2] {
        let reach = NINETY_FIVE * estimate.sd;
        let [least, most] = self.bounds(scene, &estimate.name);
        [(estimate.value - reach).max(least), (estimate.value + reach).min(most)]
    }

    fn bounds(&self, scene: usize, name: &str) -> [f64; 2] {
        let of_effect = || {
            let (id, scene) = (ParamId::parse(name)?, self.scenes.get(scene)?);
            let active = scene.model.effect(id.effect)?;
            let k = active.parameters.iter().position(|p| p.name == id.parameter)?;
            active.bounds(k).map(|(_, least, most)| [least, most])
        };
        let is_positive = name.ends_with("].mass") || name.ends_with("].restitution");
        let least = if is_positive { 0.0 } else { f64::NEG_INFINITY };
        of_effect().unwrap_or([least, f64::INFINITY])
    }

    /// How many draws the fit has.
    pub fn draws(&self) -> usize {
        self.posterior.draws.len()
    }

    /// Models of one scene drawn from the posterior; the seed picks among the draws of [`with_draws`](crate::fit::with_draws); none
    /// without it.
    pub fn draw(&self, scene: usize, count: usize, seed: u64) -> Vec<Model> {
        let model = &self.scenes[scene].model;
        let kept = self.posterior.draws.len();
        let pick =
            |i: usize| self.posterior.model(scene, model, (i + (seed % kept.max(1) as u64) as usize) % kept);
        if kept == 0 { vec![] } else { (0..count.min(kept)).map(pick).collect() }
    }

    /// Mass and restitution of each object of a scene, in the scene's order.
    pub fn objects(&self, scene: usize) -> Vec<ObjectEstimate> {
        let SceneFit { model, .. } = &self.scenes[scene];
        let values = model.flatten();
        let one = |(b, body): (usize, &BodySpec)| {
            let name = format!("objects[{}].mass", body.id);
            let given = Estimate {
                scene: Some(scene),
                name: name.clone(),
                value: values[b * BODY_VALUES.len() + MASS],
                sd: 0.0,
                unit: "kg".into(),
                identified: true,
            };
            let mass = self.posterior.named(scene, &name).cloned().unwrap_or(given);
            ObjectEstimate { id: body.id, mass, restitution: self.restitution(scene, body.id) }
        };
        model.bodies.iter().enumerate().map(one).collect()
    }

    /// The restitution factor of one object: its own if the model has one, else the root of its best known contact.
    fn restitution(&self, scene: usize, id: u32) -> Estimate {
        let name = format!("objects[{id}].restitution");
        let label = id.to_string();
        let of = |(entry, p): (&'static EffectEntry, &'static ParamSpec)| (entry.spec.name, p.name);
        let object = parameter_with(ParamRole::ObjectRestitution).map(of);
        let object =
            object.map(|(effect, parameter)| ParamId { effect, parameter, label: &label }.to_string());
        if let Some(own) = object.and_then(|name| self.posterior.named(scene, &name)) {
            return Estimate { name, ..own.clone() };
        }
        let common = parameter_with(ParamRole::CommonRestitution).map(of);
        let shared = self.shared(scene);
        let coefficient = shared.iter().find(|s| Some((&*s.effect, &*s.parameter)) == common);
        let touches = |label: &str| ParamId { effect: "", parameter: "", label }.concerns(id);
        let best =
            coefficient.into_iter().flat_map(|s| s.labels.iter().zip(&s.values)).filter(|(label, _)| {
                label.is_empty() || !label.contains(|c: char| c.is_ascii_digit()) || touches(label)
            });
        let best = best.min_by(|a, b| a.1.sd.total_cmp(&b.1.sd)).map(|(_, e)| e.clone());
        let e = best.unwrap_or(Estimate {
            scene: Some(scene),
            name: String::new(),
            value: 0.0,
            sd: 0.0,
            unit: "1".into(),
            identified: false,
        });
        let root = e.value.max(0.0).sqrt();
        Estimate { scene: Some(scene), name, value: root, sd: e.sd / (2.0 * root.max(0.1)), ..e }
    }

    /// Parameters of the effects as they apply to a scene.
    pub fn shared(&self, scene: usize) -> Vec<SharedEstimate> {
        let active = self.scenes[scene].model.effects.iter().filter(|e| e.on);
        active
            .flat_map(|active| {
                (0..active.parameters.len()).map(move |k| self.shared_parameter(scene, active, k))
            })
            .collect()
    }

    fn shared_parameter(&self, scene: usize, active: &ActiveEffect, k: usize) -> SharedEstimate {
        let parameter: &Parameter = &active.parameters[k];
        let unit = active.bounds(k).map_or("1", |b| b.0);
        let value = |(label, value): (&String, &f64)| {
            let name = parameter.full_name(active, label);
            let fixed = Estimate {
                scene: None,
                name: name.clone(),
                value: *value,
                sd: 0.0,
                unit: unit.to_string(),
                identified: false,
            };
            self.posterior.named(scene, &name).cloned().unwrap_or(fixed)
        };
        SharedEstimate {
            effect: active.name.clone(),
            parameter: parameter.name.clone(),
            labels: parameter.labels.clone(),
            values: parameter.labels.iter().zip(&parameter.values).map(value).collect(),
        }
    }
}
