//! Free parameters of a set-up's models as the force lens moves them: one a name, wherever it stands; and masses that nobody gave.

use crate::effects::{EffectEntry, ParamId, ParamRole, effect};
use crate::num::elementary;
use crate::scene::{Object, Scene};
use crate::world::{BODY_VALUES, MASS, MASS_BOUNDS, Model};
use serde::{Deserialize, Serialize};

/// Largest step of a difference by a parameter, as a share of its prior's deviation and as a number.
const STEP_SHARE: f64 = 1e-4;
pub const STEP: f64 = 1e-3;
/// Step for lengths that a search begins with (m): the edge of a patch lies between two frames.
const STRIDE: f64 = 0.04;

/// One parameter that the lens can move, and where it stands in each model.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct FreeParameter {
    /// As [`ParamId`] prints it; of a mass `objects[3].mass`.
    pub name: String,
    /// The scene that has it for itself; `None`: all share it.
    pub scene: Option<usize>,
    pub slots: Vec<(usize, usize)>,
    pub min: f64,
    pub max: f64,
    pub mean: f64,
    pub sd: f64,
    /// Step of its differences.
    pub step: f64,
    /// A mass: all numbers here are of its logarithm.
    pub log: bool,
}

impl FreeParameter {
    /// Whether it is this parameter of an effect, whoever shares it.
    pub fn is(&self, entry: &EffectEntry, parameter: &str) -> bool {
        ParamId::parse(&self.name).is_some_and(|id| id.is_of(entry.spec.name, parameter))
    }

    /// The number that a model has for this value.
    pub fn in_model(&self, value: f64) -> f64 {
        if self.log { elementary::exp(value) } else { value }
    }

    fn of_model(&self, number: f64) -> f64 {
        if self.log { elementary::ln(number) } else { number }
    }
}

fn is_unseen(entry: Option<&EffectEntry>, parameter: &str) -> bool {
    entry.is_some_and(|e| e.profile.param_role(parameter) == Some(ParamRole::UnseenInFreeMotion))
}

/// Free parameters of all effects that show between contacts, and the masses that laws of force may tell.
pub fn free_parameters(scenes: &[Scene], models: &[Model]) -> Vec<FreeParameter> {
    let mut free: Vec<FreeParameter> = vec![];
    for (scene, (model, filmed)) in models.iter().zip(scenes).enumerate() {
        let unknown = |o: &Object| o.mass.is_none() && model.mass_sd > 0.0;
        for (body, object) in filmed.objects.iter().enumerate().filter(|(_, o)| unknown(o)) {
            free.push(FreeParameter {
                name: format!("objects[{}].mass", object.id),
                scene: Some(scene),
                slots: vec![(scene, body * BODY_VALUES.len() + MASS)],
                min: elementary::ln(MASS_BOUNDS[0]),
                max: elementary::ln(MASS_BOUNDS[1]),
                mean: 0.0,
                sd: model.mass_sd,
                step: STEP_SHARE * model.mass_sd,
                log: true,
            });
        }
        let mut at = BODY_VALUES.len() * model.bodies.len();
        for active in &model.effects {
            let entry = effect(&active.name);
            let acts = active.on
                && (active.formula.is_some() || entry.is_some_and(EffectEntry::shows_in_free_motion));
            for (k, parameter) in active.parameters.iter().enumerate() {
                let bounds = active.bounds(k);
                for (label, mean) in parameter.labels.iter().zip(&parameter.means) {
                    if acts && parameter.prior.sd > 0.0 && !is_unseen(entry, &parameter.name) {
                        let own = (!active.shares(parameter)).then_some(scene);
                        let name = parameter.full_name(active, label);
                        match free.iter_mut().find(|f| f.name == name && f.scene == own) {
                            Some(known) => known.slots.push((scene, at)),
                            None => free.push(FreeParameter {
                                name,
                                scene: own,
                                slots: vec![(scene, at)],
                                min: bounds.map_or(f64::NEG_INFINITY, |b| b.1),
                                max: bounds.map_or(f64::INFINITY, |b| b.2),
                                mean: *mean,
                                sd: parameter.prior.sd,
                                step: (STEP_SHARE * parameter.prior.sd).min(STEP),
                                log: false,
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
pub fn stride(free: &mut [FreeParameter], entry: &EffectEntry) {
    for p in entry.spec.params.iter().skip(entry.amplitudes) {
        let name = ParamId { effect: entry.spec.name, parameter: p.name, label: "" }.to_string();
        if p.unit == "m"
            && let Some(f) = free.iter_mut().find(|f| f.name == name)
        {
            f.step = STRIDE;
        }
    }
}

/// The numbers of each model with the free parameters at `values`.
pub fn flats(models: &[Model], free: &[FreeParameter], values: &[f64]) -> Vec<Vec<f64>> {
    let mut flats: Vec<Vec<f64>> = models.iter().map(Model::flatten).collect();
    for (f, value) in free.iter().zip(values) {
        for &(scene, slot) in &f.slots {
            flats[scene][slot] = f.in_model(*value);
        }
    }
    flats
}

/// Where the free parameters stand in the models.
pub fn values_of(models: &[Model], free: &[FreeParameter]) -> Vec<f64> {
    let flats: Vec<Vec<f64>> = models.iter().map(Model::flatten).collect();
    let value =
        |f: &FreeParameter| f.slots.first().map_or(f.mean, |&(scene, slot)| f.of_model(flats[scene][slot]));
    free.iter().map(value).collect()
}

/// The models with the free parameters at these values.
pub fn at_values(models: &[Model], free: &[FreeParameter], values: &[f64]) -> Vec<Model> {
    models.iter().zip(flats(models, free, values)).map(|(m, flat)| m.with_values(&flat)).collect()
}

#[cfg(test)]
mod tests {
    use super::super::tests::{CUBE, DISC, film, models};
    use super::super::{DiscoverOptions, WeakFormRegression, discover, fit_forces};
    use crate::num::never;
    use crate::scene::Scene;

    /// Videos under a wind whose objects have masses that nobody gave.
    fn windy() -> Vec<Scene> {
        let launches = [
            vec![(DISC, 0.5, [-2.0, 0.5], [1.3, 0.1]), (CUBE, 2.0, [1.5, -1.5], [-0.5, 0.9])],
            vec![(CUBE, 0.8, [0.0, 2.0], [0.4, -1.4]), (DISC, 1.7, [-2.0, -1.0], [0.9, 0.0])],
            vec![(DISC, 1.5, [-1.5, -1.5], [0.8, 0.9]), (DISC, 0.6, [1.8, 1.8], [-1.5, 0.2])],
        ];
        let mut scenes = film(&launches, Some(("uniform_force", &[("F_x", 0.15), ("F_y", -0.1)])));
        scenes.iter_mut().flat_map(|s| &mut s.objects).for_each(|o| o.mass = None);
        scenes
    }

    #[test]
    fn a_force_tells_masses_that_nobody_gave() {
        let scenes = windy();
        let found =
            discover(&scenes, &models(&scenes), &DiscoverOptions::default(), &never).expect("it runs");
        let names: Vec<&str> = found.effects.iter().map(|e| e.effect.as_str()).collect();
        assert_eq!(names, ["uniform_force"], "{}", found.reason);
        let lens = WeakFormRegression::new(&scenes);
        let last = found.revisions.last().expect("there is the first").fit.models();
        let (free, seen) = fit_forces(&lens, &last);
        let masses: Vec<f64> =
            free.iter().zip(&seen.values).filter(|(f, _)| f.log).map(|(f, v)| f.in_model(*v)).collect();
        let ratio = masses[1] / masses[0];
        assert!((3.0..5.0).contains(&ratio), "{masses:?}");
    }

    #[test]
    fn masses_cost_nothing_where_no_force_tells_them() {
        let scenes = windy();
        let mut given = scenes.clone();
        given.iter_mut().flat_map(|s| &mut s.objects).for_each(|o| o.mass = Some(1.0));
        let cost = |scenes: &[Scene]| fit_forces(&WeakFormRegression::new(scenes), &models(scenes)).1.cost;
        let (unknown, known) = (cost(&scenes), cost(&given));
        assert!((unknown / known - 1.0).abs() < 1e-9, "{unknown} {known}");
    }
}
