//! Restarts from other restitutions: where a simulation leaves its tracks after a contact, that contact may have been inelastic
//! where it was taken for elastic, or the other way round. Both are minima of their own, since what is hit next depends on it.

use super::super::problem::{FitProblem, SceneProblem};
use super::divergence::Divergence;
use crate::effects::{ActsOn, ParamRole, effect};
use crate::world::{ActiveEffect, BODY_VALUES, Event, EventKind};

/// Contacts before the divergence that are tried, the last first: a later contact may hide an earlier one.
const CONTACTS: usize = 2;
/// A restitution up to this share of its prior mean counts as inelastic.
const INELASTIC: f64 = 0.5;

/// Points of the search at which one contact before the divergence is switched from inelastic to elastic, or back.
pub(in super::super) fn points(
    problem: &FitProblem,
    point: &[f64],
    divergences: &[Divergence],
) -> Vec<Vec<f64>> {
    let mut found: Vec<RestitutionParameters> = vec![];
    for Divergence { scene, rollout, frame, body } in divergences {
        let (id, until) = (scene.model.bodies[*body].id, scene.scene.time_of(*frame));
        let contacts = rollout
            .events
            .iter()
            .rev()
            .filter(|e| e.kind == EventKind::Collision && e.time < until && e.objects.contains(&id));
        let mut of_scene: Vec<RestitutionParameters> = vec![];
        for parameters in contacts.filter_map(|e| restitution_of(scene, e)) {
            if of_scene.len() < CONTACTS && of_scene.iter().all(|r| r.own != parameters.own) {
                of_scene.push(parameters);
            }
        }
        of_scene.retain(|parameters| found.iter().all(|r| r.own != parameters.own));
        found.extend(of_scene);
    }
    found.iter().map(|parameters| parameters.switched(problem, point)).collect()
}

/// Free parameters whose product is the restitution of a contact.
struct RestitutionParameters {
    /// Of this contact alone, or nearly so.
    own: usize,
    /// Shared with other contacts.
    common: Option<usize>,
    /// The own parameters of all contacts that share the common one.
    owns: Vec<usize>,
}

impl RestitutionParameters {
    /// The point at which this contact is inelastic if it was elastic, or the other way round.
    fn switched(&self, problem: &FitProblem, point: &[f64]) -> Vec<f64> {
        let usual = |k: usize| problem.parameters[k].mean;
        let is_inelastic = |k: usize| point[k] <= INELASTIC * usual(k);
        let mut other = point.to_vec();
        let common = self.common.filter(|k| is_inelastic(*k));
        let to_elastic = common.is_some() || is_inelastic(self.own);
        if let Some(common) = common {
            // It makes all contacts inelastic: it rises, and the products of the other contacts stay as they are.
            other[common] = usual(common);
            self.owns.iter().for_each(|k| other[*k] *= point[common] / usual(common));
        }
        other[self.own] = if to_elastic { usual(self.own) } else { problem.parameters[self.own].min };
        other
    }
}

/// Whether an effect is the hidden wall of this name; without a name, whether it acts at the walls of a table.
fn is_of_wall(active: &ActiveEffect, wall: Option<&str>) -> bool {
    match wall {
        Some(wall) => active.name == wall,
        None => effect(&active.name).is_some_and(|e| e.profile.acts_on == ActsOn::TableWalls),
    }
}

/// The parameters of a contact's restitution, as far as they are free.
fn restitution_of(scene: &SceneProblem, contact: &Event) -> Option<RestitutionParameters> {
    let body = |id: &u32| scene.model.bodies.iter().find(|b| b.id == *id);
    let a = contact.objects.first().and_then(body)?;
    let b = contact.objects.get(1).map_or(Some(a), body)?;
    // The contact's own restitution first; that of a hidden wall is a parameter of the effect of its name.
    let candidates: [(ParamRole, Option<&str>); 2] = match contact.wall.as_deref() {
        None => [(ParamRole::PairRestitution, None), (ParamRole::CommonRestitution, None)],
        wall => [(ParamRole::WallRestitution, wall), (ParamRole::WallRestitution, None)],
    };
    // The parameter of this contact, and those of all contacts.
    let found = |&(role, wall): &(ParamRole, Option<&str>)| -> Option<(usize, Vec<usize>)> {
        let mut first = BODY_VALUES.len() * scene.model.bodies.len();
        for active in &scene.model.effects {
            let counts = role != ParamRole::WallRestitution || is_of_wall(active, wall);
            for p in &active.parameters {
                if counts && active.role_of(p) == Some(role) {
                    let all = (first..first + p.values.len()).filter_map(|s| scene.parameter_at(s)).collect();
                    return Some((scene.parameter_at(first + p.index(a, b)?)?, all));
                }
                first += p.values.len();
            }
        }
        None
    };
    let mut known = candidates.iter().filter_map(found);
    let (own, owns) = known.next()?;
    let common = known.next().map(|(k, _)| k).filter(|_| contact.wall.is_none());
    Some(RestitutionParameters { own, common, owns })
}
