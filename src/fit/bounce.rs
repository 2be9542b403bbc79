//! Other bounces: where a simulation leaves its tracks after a contact, that contact may have been a dead one, or a lively
//! one. Both are minima of their own, since what is hit next depends on it.

use super::OUT_OF_NOISE;
use super::problem::{Part, Problem, Window};
use crate::world::{BODY_VALUES, Event, EventKind};

/// Mean square of whitened residuals up to which a window is followed.
const FOLLOWED: f64 = 1.25;
/// Contacts before the simulation leaves a track that are looked at, the last first: what follows one may hide another.
const CONTACTS: usize = 2;
/// Restitutions that a contact may have, by effect and parameter, in the order in which they are tried; that of a wall goes by the wall's
/// own name.
const OF_OBJECTS: [(&str, &str); 2] = [("restitution", "deviation"), ("restitution", "coefficient")];
const OF_CUSHIONS: (&str, &str) = ("cushion", "restitution");
/// A restitution below this share of the usual one counts as dead.
const LIVELY: f64 = 0.5;

/// Points of the search at which a contact rebounds that does not at this one, or the other way round: of contacts before
/// the first track that a simulation leaves within the window.
pub(super) fn others(problem: &Problem, point: &[f64], window: Window) -> Vec<Vec<f64>> {
    let mut found: Vec<usize> = vec![];
    for part in &problem.parts {
        let rollout = part.rollout(&problem.free, point, window);
        let (mut squares, mut count) = (0.0, 0);
        let mut left: Option<(usize, usize)> = None;
        part.each_residual(&rollout, window, |(body, frame, _), r, _| {
            squares += r * r;
            count += 1;
            if r.abs() > OUT_OF_NOISE && left.is_none_or(|(first, _)| frame < first) {
                left = Some((frame, body));
            }
        });
        let Some((frame, body)) = left.filter(|_| squares > FOLLOWED * f64::from(count)) else { continue };
        let (id, until) = (part.model.bodies[body].id, part.scene.time_of(frame));
        let contacts = rollout
            .events
            .iter()
            .rev()
            .filter(|e| e.kind == EventKind::Collision && e.time < until && e.objects.contains(&id));
        let restitutions = contacts.filter_map(|e| part.restitution_of(e));
        let mut of_part: Vec<usize> = vec![];
        for k in restitutions {
            if !of_part.contains(&k) && of_part.len() < CONTACTS {
                of_part.push(k);
            }
        }
        found.extend(of_part.iter().filter(|k| !found.contains(k)).copied().collect::<Vec<_>>());
    }
    let other = |k: usize| {
        let mut other = point.to_vec();
        let usual = problem.free[k].mean;
        other[k] = if point[k] > LIVELY * usual { problem.free[k].min } else { usual };
        other
    };
    found.into_iter().map(other).collect()
}

impl Part<'_> {
    /// The free parameter that says how much the objects of this contact rebound.
    fn restitution_of(&self, contact: &Event) -> Option<usize> {
        let body = |id: &u32| self.model.bodies.iter().find(|b| b.id == *id);
        let a = contact.objects.first().and_then(body)?;
        let b = contact.objects.get(1).map_or(Some(a), body)?;
        let sought = match contact.wall.as_deref() {
            None => OF_OBJECTS.to_vec(),
            Some(wall) => vec![(wall, "restitution"), OF_CUSHIONS],
        };
        sought.iter().find_map(|&(effect, name)| {
            let mut first = BODY_VALUES.len() * self.model.bodies.len();
            for active in &self.model.effects {
                for p in &active.parameters {
                    if active.name == effect && p.name == name {
                        let slot = first + p.index(a, b)?;
                        return self.slots.iter().find(|s| s.0 == slot).map(|s| s.1);
                    }
                    first += p.values.len();
                }
            }
            None
        })
    }
}
