//! The restitution e of each two objects that collide: e = coefficient r_a r_b d_ab, at most 1, with the uncertainty of the
//! product.

use super::super::problem::{FitProblem, Horizon, SceneProblem};
use super::parameter_estimate::{Estimate, IDENTIFIED};
use crate::effects::ParamRole;
use crate::num::elementary;
use crate::world::{BODY_VALUES, BodySpec};
use nalgebra::{DMatrix, RowDVector};
use serde::{Deserialize, Serialize};
use std::collections::BTreeSet;

/// The restitution of two objects that collide in a video.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct PairRestitution {
    /// Index of the scene.
    pub scene: usize,
    /// Their ids, the smaller first.
    pub objects: [u32; 2],
    pub estimate: Estimate,
}

/// All of a problem at its best point; `factor` is that of the parameters' covariance.
pub(super) fn pair_restitutions(
    problem: &FitProblem,
    point: &[f64],
    horizon: Horizon,
    factor: &DMatrix<f64>,
) -> Vec<PairRestitution> {
    let mut all = vec![];
    for (index, scene) in problem.scenes.iter().enumerate() {
        let values = scene.values(&problem.parameters, point);
        for objects in touching(scene, problem, point, horizon) {
            let slots = slots(scene, objects);
            if slots.is_empty() {
                continue;
            }
            let value = slots.iter().filter_map(|slot| values.get(*slot)).product::<f64>().min(1.0);
            let estimate = estimate(problem, (scene, &values), &slots, value, factor);
            let name = format!("pairs[{}-{}].restitution", objects[0], objects[1]);
            let estimate = Estimate { scene: Some(index), name, ..estimate };
            all.push(PairRestitution { scene: index, objects, estimate });
        }
    }
    all
}

/// The objects that collide in the simulation, two by two.
fn touching(
    scene: &SceneProblem,
    problem: &FitProblem,
    point: &[f64],
    horizon: Horizon,
) -> BTreeSet<[u32; 2]> {
    let rollout = scene.rollout(&problem.parameters, point, horizon);
    let pair = |objects: &[u32]| match *objects {
        [a, b] => Some([a.min(b), a.max(b)]),
        _ => None,
    };
    rollout.events.iter().filter_map(|event| pair(&event.objects)).collect()
}

/// Where the factors of a contact's restitution stand among the model's values.
fn slots(scene: &SceneProblem, objects: [u32; 2]) -> Vec<usize> {
    let bodies = &scene.model.bodies;
    let body = |id: u32| bodies.iter().find(|b| b.id == id);
    let [Some(a), Some(b)] = objects.map(body) else { return vec![] };
    let mut slots = vec![];
    let mut first = BODY_VALUES.len() * bodies.len();
    for active in &scene.model.effects {
        for p in &active.parameters {
            let of: &[(&BodySpec, &BodySpec)] = match active.role_of(p).filter(|_| active.on) {
                Some(ParamRole::CommonRestitution | ParamRole::PairRestitution) => &[(a, b)],
                Some(ParamRole::ObjectRestitution) => &[(a, a), (b, b)],
                _ => &[],
            };
            slots.extend(of.iter().filter_map(|(x, y)| Some(first + p.index(x, y)?)));
            first += p.values.len();
        }
    }
    slots
}

/// The product of these values and its standard deviation.
fn estimate(
    problem: &FitProblem,
    (scene, values): (&SceneProblem, &[f64]),
    slots: &[usize],
    value: f64,
    factor: &DMatrix<f64>,
) -> Estimate {
    let mut deviation = RowDVector::<f64>::zeros(factor.ncols());
    let mut prior = 0.0;
    for &slot in slots {
        let Some(k) = scene.parameter_at(slot) else { continue };
        let parameter = &problem.parameters[k];
        let others = slots.iter().filter(|other| **other != slot).map(|other| values[*other]);
        let slope = others.product::<f64>() * if parameter.log { values[slot] } else { 1.0 };
        deviation += slope * factor.row(k);
        prior += elementary::powi(slope * parameter.sd, 2);
    }
    let sd = deviation.norm();
    let identified = sd < IDENTIFIED * prior.sqrt();
    Estimate { scene: None, name: String::new(), value, sd, unit: "1".into(), identified }
}
