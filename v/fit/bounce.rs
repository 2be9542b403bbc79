//! Other bounces: where a simulation leaves its tracks after a contact, that contact may have been a dead one, or a lively
//! one. Both are minima of their own, since what is hit next depends on it.

use super::grow::OUT_OF_NOISE;
use super::problem::{Part, Problem, Window};
use crate::world::{BODY_VALUES, Event, EventKind, Rollout};

/// Mean square of whitened residuals up to which a window is followed.
const FOLLOWED: f64 = 1.25;
/// Contacts before the simulation leaves a track that are looked at, the last first: what follows one may hide another.
const CONTACTS: usize = 2;
/// Restitutions that a contact may have, by effect and parameter, that of its own first; that of a wall goes by the wall's own name.
const OF_OBJECTS: [(&str, &str); 2] = [("restitution", "deviation"), ("restitution", "coefficient")];
const OF_CUSHIONS: (&str, &str) = ("cushion", "restitution");
/// A restitution below this share of the usual one counts as dead.
const LIVELY: f64 = 0.5;

/// Where the simulation of a scene first leaves its tracks.
pub(super) struct Left<'p> {
    pub part: &'p Part<'p>,
    pub rollout: Rollout<f64>,
    pub frame: usize,
    pub body: usize,
}

/// The first frame within the window at which each simulation leaves a track; none of a scene whose tracks are followed.
pub(super) fn left<'p>(problem: &'p Problem<'p>, point: &[f64], window: Window) -> Vec<Left<'p>> {
    let of = |part: &'p Part<'p>| {
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
        let (frame, body) = left.filter(|_| squares > FOLLOWED * f64::from(count))?;
        Some(Left { part, rollout, frame, body })
    };
    problem.parts.iter().filter_map(of).collect()
}

/// Points of the search at which a contact rebounds that does not at this one, or the other way round: of contacts before
/// the first track that a simulation leaves within the window.
pub(super) fn others(problem: &Problem, point: &[f64], left: &[Left]) -> Vec<Vec<f64>> {
    let mut found: Vec<Rebound> = vec![];
    for Left { part, rollout, frame, body } in left {
        let (id, until) = (part.model.bodies[*body].id, part.scene.time_of(*frame));
        let contacts = rollout
            .events
            .iter()
            .rev()
            .filter(|e| e.kind == EventKind::Collision && e.time < until && e.objects.contains(&id));
        let mut of_part: Vec<Rebound> = vec![];
        for rebound in contacts.filter_map(|e| part.rebound(e)) {
            if of_part.len() < CONTACTS && of_part.iter().all(|r| r.own != rebound.own) {
                of_part.push(rebound);
            }
        }
        of_part.retain(|rebound| found.iter().all(|r| r.own != rebound.own));
        found.extend(of_part);
    }
    found.iter().map(|rebound| rebound.other(problem, point)).collect()
}

/// Free parameters on which the rebound at a contact depends; their product does the work.
struct Rebound {
    /// What is the contact's own, or nearly so.
    own: usize,
    /// What it shares with others.
    common: Option<usize>,
    /// What is the own of all the contacts that share it.
    owns: Vec<usize>,
}

impl Rebound {
    /// The point at which this contact is dead where it was lively, or the other way round.
    fn other(&self, problem: &Problem, point: &[f64]) -> Vec<f64> {
        let usual = |k: usize| problem.free[k].mean;
        let dead = |k: usize| point[k] <= LIVELY * usual(k);
        let mut other = point.to_vec();
        let common = self.common.filter(|k| dead(*k));
        let lively = common.is_some() || dead(self.own);
        if let Some(common) = common {
            // It keeps all dead: it rises, and the others stay as they are.
            other[common] = usual(common);
            self.owns.iter().for_each(|k| other[*k] *= point[common] / usual(common));
        }
        other[self.own] = if lively { usual(self.own) } else { problem.free[self.own].min };
        other
    }
}

impl Part<'_> {
    /// What says how much the objects of this contact rebound, as far as it is free.
    fn rebound(&self, contact: &Event) -> Option<Rebound> {
        let body = |id: &u32| self.model.bodies.iter().find(|b| b.id == *id);
        let a = contact.objects.first().and_then(body)?;
        let b = contact.objects.get(1).map_or(Some(a), body)?;
        let free = |slot: usize| self.slots.iter().find(|s| s.0 == slot).map(|s| s.1);
        let sought = match contact.wall.as_deref() {
            None => OF_OBJECTS.to_vec(),
            Some(wall) => vec![(wall, "restitution"), OF_CUSHIONS],
        };
        // The parameter of this contact, and those of all.
        let found = |&(effect, name): &(&str, &str)| -> Option<(usize, Vec<usize>)> {
            let mut first = BODY_VALUES.len() * self.model.bodies.len();
            for active in &self.model.effects {
                for p in &active.parameters {
                    if active.name == effect && p.name == name {
                        let all = (first..first + p.values.len()).filter_map(free).collect();
                        return Some((free(first + p.index(a, b)?)?, all));
                    }
                    first += p.values.len();
                }
            }
            None
        };
        let mut known = sought.iter().filter_map(found);
        let (own, owns) = known.next()?;
        let common = known.next().map(|(k, _)| k).filter(|_| contact.wall.is_none());
        Some(Rebound { own, common, owns })
    }
}
