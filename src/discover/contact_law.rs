//! Laws of contact, and what is wrong with an object, as models take them, and as fits tell them.

use super::screen::with_effect;
use crate::effects::{EffectEntry, ParamId, ParamRole, Region, Role, Scope};
use crate::fit::{Estimate, Fit};
use crate::num::elementary;
use crate::world::{Model, Parameter, Prior};

/// Values of shapes agree within this many deviations.
const SAME_VALUE: f64 = 3.0;
/// Prior deviations of a wall's restitution and angle.
const RESTITUTION_SD: f64 = 0.3;

/// Whether a candidate is a wrong scale of lengths, which all contacts show and every video shares.
pub fn is_scale(entry: &EffectEntry) -> bool {
    entry.profile.role == Role::Camera && entry.shows_at_contacts() && !entry.of_objects()
}

/// The models with a law of contact or an unseen thing, which is there or not: its presence is no parameter. What befalls
/// one object alone has a value for that `object` only.
pub fn with_contact(
    models: &[Model],
    entry: &EffectEntry,
    values: &[f64],
    object: Option<u32>,
    region: &Region,
) -> Vec<Model> {
    let mut with = with_effect(models, entry, values, region);
    for model in &mut with {
        let mut bodies = model.bodies.clone();
        bodies.retain(|b| object.is_none_or(|id| b.id == id));
        for p in
            model.effects.iter_mut().filter(|e| e.name == entry.spec.name).flat_map(|e| &mut e.parameters)
        {
            match entry.profile.param_role(&p.name) {
                Some(ParamRole::Presence) => p.prior = Prior { mean: 1.0, sd: 0.0 },
                // One or the other: between them is nothing.
                Some(ParamRole::Choice) => p.prior.sd = 0.0,
                // Faces and edges rebound differently, and an engine's cylinders may not rebound at all.
                Some(ParamRole::WallRestitution) => {
                    let prior = Prior { mean: p.values.first().copied().unwrap_or(0.5), sd: RESTITUTION_SD };
                    *p = Parameter::new(&p.name, Scope::Shape, prior, &bodies);
                }
                _ => p.prior.sd = p.prior.sd.min(1.0),
            }
            if object.is_some() {
                let value = p.values.first().copied();
                *p = Parameter::new(&p.name, p.scope, p.prior, &bodies);
                p.values.iter_mut().for_each(|v| *v = value.unwrap_or(*v));
            }
        }
    }
    with
}

/// What the fit says of one parameter of an effect, for each label.
pub fn estimates_of<'f>(fit: &'f Fit, effect: &str, parameter: &str) -> Vec<&'f Estimate> {
    let own = |e: &&Estimate| ParamId::parse(&e.name).is_some_and(|id| id.is_of(effect, parameter));
    fit.posterior.estimates.iter().filter(own).collect()
}

/// One value, and its deviation, of a parameter that shapes may differ in: the largest that is identified (an edge that
/// catches loses, none gains), pooled with those that agree with it.
pub fn pooled(of: &[&Estimate]) -> Option<(f64, f64)> {
    let known = of.iter().any(|e| e.identified);
    let of: Vec<&&Estimate> = of.iter().filter(|e| e.identified || !known).collect();
    let largest = of.iter().max_by(|a, b| a.value.total_cmp(&b.value))?;
    let agrees = |e: &Estimate| largest.value - e.value <= SAME_VALUE * elementary::hypot(largest.sd, e.sd);
    let (mut sum, mut weight) = (0.0, 0.0);
    for e in of.iter().filter(|e| e.sd > 0.0 && agrees(e)) {
        sum += e.value / (e.sd * e.sd);
        weight += 1.0 / (e.sd * e.sd);
    }
    if weight > 0.0 { Some((sum / weight, (1.0 / weight).sqrt())) } else { Some((largest.value, largest.sd)) }
}
