//! Restitution that falls with speed, for which numbers of pairs stand in: each pair is seen at a few speeds only.

use super::windows::ContactWindows;
use crate::effects::{EffectEntry, ParamRole, SearchStart, effect};
use crate::num::elementary;
use crate::world::{EventKind, Model, Parameter, trace};
use std::collections::BTreeMap;

/// Bounds of the ratio of a pair's restitution to the common one.
const BOUNDS: [f64; 2] = [0.25, 4.0];
/// Contacts from which a fall with speed is told, and the least that one is taken to rebound.
const FEWEST: usize = 3;
const LEAST: f64 = 0.02;
/// Steepest fall that the law knows (s/m): contacts of about one speed say nothing.
const STEEPEST: f64 = 20.0;

/// Whether restitution falls with speed by this law.
pub fn decays(entry: &EffectEntry) -> bool {
    entry.profile.start == Some(SearchStart::RestitutionDecay)
}

/// The parameters of a model that have a meaning, with it.
fn roles(model: &mut Model) -> impl Iterator<Item = (ParamRole, &mut Parameter)> {
    model.effects.iter_mut().flat_map(|active| {
        let profile = effect(&active.name).map(|e| e.profile);
        active.parameters.iter_mut().filter_map(move |p| Some((profile?.param_role(&p.name)?, p)))
    })
}

/// A first contact of two objects in a film: its speed of approach (m/s) and its coefficient of restitution.
struct FirstContact {
    film: usize,
    label: usize,
    speed: f64,
    restitution: f64,
}

/// Models of the films in which restitution falls with speed as the first contacts of all pairs say (1/v0, s/m, beside them),
/// while each of these rebounds as before: what comes after hangs on that, and a search that begins with other rebounds loses
/// it. `None` where slow contacts do not rebound more.
pub fn as_met(films: &ContactWindows, models: &[Model]) -> Option<(f64, Vec<Model>)> {
    let meetings: Vec<FirstContact> = (0..models.len()).flat_map(|film| met(films, models, film)).collect();
    let n = meetings.len() as f64;
    let mean = |of: &dyn Fn(&FirstContact) -> f64| meetings.iter().map(of).sum::<f64>() / n;
    let (speed, level) = (mean(&|m| m.speed), mean(&|m| elementary::ln(m.restitution)));
    let spread = mean(&|m| elementary::powi(m.speed - speed, 2));
    let inverse_v0 = -mean(&|m| (m.speed - speed) * elementary::ln(m.restitution)) / spread;
    if meetings.len() < FEWEST || !(0.0..STEEPEST).contains(&inverse_v0) || inverse_v0 == 0.0 {
        return None;
    }
    let common = elementary::exp(level + speed * inverse_v0).min(1.0);
    let at_rest = |m: &FirstContact| m.restitution * elementary::exp(m.speed * inverse_v0);
    let mut models = models.to_vec();
    for (film, model) in models.iter_mut().enumerate() {
        for (role, p) in roles(model) {
            match role {
                ParamRole::CommonRestitution => p.values.fill(common),
                ParamRole::PairRestitution => {
                    p.values.clone_from(&p.means);
                    for m in meetings.iter().filter(|m| m.film == film) {
                        p.values[m.label] = (at_rest(m) / common).clamp(BOUNDS[0], BOUNDS[1]);
                    }
                }
                _ => {}
            }
        }
    }
    Some((inverse_v0, models))
}

/// The first contact of each pair in a film, as its model has it.
fn met(films: &ContactWindows, models: &[Model], film: usize) -> Vec<FirstContact> {
    let model = &models[film];
    let parameter = |role: ParamRole| model.effects.iter().find_map(|e| e.parameter(role));
    let common = parameter(ParamRole::CommonRestitution);
    let (Some(common), Some(of_pair)) = (common, parameter(ParamRole::PairRestitution)) else {
        return vec![];
    };
    let mut first = BTreeMap::new();
    for event in trace(model, &films.scenes[film].times).events {
        let ([a, b], EventKind::Collision, Some(impulse)) = (&event.objects[..], event.kind, event.impulse)
        else {
            continue;
        };
        let body = |id: &u32| model.bodies.iter().find(|body| body.id == *id);
        let (Some(a), Some(b)) = (body(a), body(b)) else { continue };
        let (Some(at), Some(label)) = (common.index(a, b), of_pair.index(a, b)) else { continue };
        let restitution = f64::max(common.values[at] * of_pair.values[label], LEAST);
        // Newton's law: the impulse takes the approach and gives the rebound.
        let speed = impulse.abs() * (1.0 / a.mass + 1.0 / b.mass) / (1.0 + restitution);
        first.entry(label).or_insert(FirstContact { film, label, speed, restitution });
    }
    first.into_values().collect()
}

#[cfg(test)]
mod tests {
    use super::super::contact_law::with_contact;
    use super::super::screen::region;
    use super::super::tests::{DISC, film, models};
    use super::*;
    use crate::effects::effect;

    fn set(models: &mut [Model], wanted: ParamRole, values: &[f64]) {
        for (model, value) in models.iter_mut().zip(values) {
            roles(model).filter(|(role, _)| *role == wanted).for_each(|(_, p)| p.values.fill(*value));
        }
    }

    /// Discs that meet head on at these speeds, each pair with a restitution of its own.
    fn meeting(speeds: &[f64], restitution: impl Fn(f64) -> f64) -> (ContactWindows, Vec<Model>) {
        let launch = |v: &f64| vec![(DISC, 0.6, [-0.6, 0.0], [*v, 0.0]), (DISC, 0.9, [0.0, 0.0], [0.0, 0.0])];
        let scenes = film(&speeds.iter().map(launch).collect::<Vec<_>>(), None);
        let mut models = models(&scenes);
        for model in &mut models {
            model.effects.retain(|e| e.name == "restitution");
        }
        for (model, v) in models.iter_mut().zip(speeds) {
            for (body, (_, _, [x, y], [vx, vy])) in model.bodies.iter_mut().zip(launch(v)) {
                body.start.state.position = crate::num::vec2(x, y);
                body.start.state.velocity = crate::num::vec2(vx, vy);
            }
        }
        set(&mut models, ParamRole::CommonRestitution, &vec![0.5; speeds.len()]);
        set(
            &mut models,
            ParamRole::PairRestitution,
            &speeds.iter().map(|v| restitution(*v) / 0.5).collect::<Vec<_>>(),
        );
        let meetings = vec![vec![]; speeds.len()];
        (ContactWindows { scenes, models: models.clone(), meetings, jumps: vec![] }, models)
    }

    #[test]
    fn a_law_for_which_pairs_stand_in_begins_where_they_rebound_as_they_did() {
        let (films, models) = meeting(&[0.4, 0.9, 1.4, 2.0], |v| 0.8 * (-v / 1.3).exp());
        let (inverse_v0, begun) = as_met(&films, &models).expect("slow ones rebound more");
        assert!((inverse_v0 - 1.0 / 1.3).abs() < 0.01, "{inverse_v0}");
        let fading = effect("speed_dependent_restitution").expect("it is there");
        let begun = with_contact(&begun, fading, &[inverse_v0], None, &region(&films.scenes));
        for (film, (model, known)) in begun.iter().zip(&models).enumerate() {
            let last = |model: &Model| {
                let states = trace(model, &films.scenes[film].times).states;
                states.into_iter().next_back().expect("it has frames")
            };
            for (a, b) in last(model).into_iter().zip(last(known)) {
                let (a, b) = (a.expect("it is there"), b.expect("it is there"));
                assert!((a.position - b.position).norm() < 1e-3, "{film}: {a:?} {b:?}");
            }
        }
    }

    #[test]
    fn slow_contacts_that_rebound_no_more_begin_nothing() {
        let (films, models) = meeting(&[0.4, 0.9, 1.4, 2.0], |v| 0.3 + 0.1 * v);
        assert!(as_met(&films, &models).is_none());
    }
}
