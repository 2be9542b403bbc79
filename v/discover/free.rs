//! Free parameters of a set-up's models as the force lens moves them: one a name, wherever it stands.

use crate::effects::{EffectEntry, Hook, effect};
use crate::world::{BODY_VALUES, Model};

/// Largest step of a difference by a parameter, as a share of its prior's deviation and as a number.
const STEP_SHARE: f64 = 1e-4;
pub const STEP: f64 = 1e-3;
/// Step for lengths that a search begins with (m): the edge of a patch lies between two frames.
const STRIDE: f64 = 0.04;
/// Parameters that turn bodies and move none: the force lens is blind to them.
const TURN_ONLY: [(&str, &str); 1] = [("friction_offset", "lever")];

/// One parameter that the lens can move, and where it stands in each model.
#[derive(Debug, Clone)]
pub struct Free {
    pub name: String,
    pub slots: Vec<(usize, usize)>,
    pub min: f64,
    pub max: f64,
    pub mean: f64,
    pub sd: f64,
    /// Step of its differences.
    pub step: f64,
}

/// Free parameters of all effects that act between contacts.
pub fn free_parameters(models: &[Model]) -> Vec<Free> {
    let mut free: Vec<Free> = vec![];
    for (scene, model) in models.iter().enumerate() {
        let mut at = BODY_VALUES.len() * model.bodies.len();
        for active in &model.effects {
            let entry = effect(&active.name);
            let forces = |e: &EffectEntry| e.uses(Hook::Force) || e.uses(Hook::Pair);
            let blind = |p: &str| TURN_ONLY.contains(&(active.name.as_str(), p));
            let acts = active.on && (active.formula.is_some() || entry.is_some_and(forces));
            for (k, parameter) in active.parameters.iter().enumerate() {
                let bounds = active.bounds(k);
                for (label, mean) in parameter.labels.iter().zip(&parameter.means) {
                    if acts && parameter.prior.sd > 0.0 && !blind(&parameter.name) {
                        let place =
                            if !active.shares(parameter) { format!("@{scene}") } else { String::new() };
                        let name = parameter.full_name(active, label) + &place;
                        match free.iter_mut().find(|f| f.name == name) {
                            Some(known) => known.slots.push((scene, at)),
                            None => free.push(Free {
                                name,
                                slots: vec![(scene, at)],
                                min: bounds.map_or(f64::NEG_INFINITY, |b| b.1),
                                max: bounds.map_or(f64::INFINITY, |b| b.2),
                                mean: *mean,
                                sd: parameter.prior.sd,
                                step: (STEP_SHARE * parameter.prior.sd).min(STEP),
                            }),
                        }
                    }
                    at += 1;
                }
            }
        }
    }
    free
}

/// Wide differences by lengths, for the beginning of a search.
pub fn stride(free: &mut [Free], entry: &EffectEntry) {
    for (k, p) in entry.spec.params.iter().enumerate().skip(entry.amplitudes) {
        let name = format!("{}.{}", entry.spec.name, entry.spec.params[k].name);
        if p.unit == "m"
            && let Some(f) = free.iter_mut().find(|f| f.name == name)
        {
            f.step = STRIDE;
        }
    }
}

/// The numbers of each model with the free parameters at `values`.
pub fn flats(models: &[Model], free: &[Free], values: &[f64]) -> Vec<Vec<f64>> {
    let mut flats: Vec<Vec<f64>> = models.iter().map(Model::flatten).collect();
    for (f, value) in free.iter().zip(values) {
        for &(scene, slot) in &f.slots {
            flats[scene][slot] = *value;
        }
    }
    flats
}

/// Where the free parameters stand in the models.
pub fn values_of(models: &[Model], free: &[Free]) -> Vec<f64> {
    let flats: Vec<Vec<f64>> = models.iter().map(Model::flatten).collect();
    free.iter().map(|f| f.slots.first().map_or(f.mean, |&(scene, slot)| flats[scene][slot])).collect()
}

/// The models with the free parameters at these values.
pub fn at_values(models: &[Model], free: &[Free], values: &[f64]) -> Vec<Model> {
    models.iter().zip(flats(models, free, values)).map(|(m, flat)| m.with_values(&flat)).collect()
}
