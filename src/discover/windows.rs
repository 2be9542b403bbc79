//! Short films around each contact and each jump without a partner, with models of what they show.

use super::smooth_track::{ChangePoint, SmoothTrack, started};
use super::weak_form::WeakFormRegression;
use crate::effects::{EffectEntry, ParamRole, Scope, effect};
use crate::scene::Scene;
use crate::world::{Model, Parameter, Prior};
use serde::{Deserialize, Serialize};
use std::ops::Range;

/// Frames before and after a contact that a short film shows.
const BEFORE: usize = 14;
const AFTER: usize = 16;
/// Longest time from the first contact to the last in one short film (frames): objects may have stopped there, or lie in a
/// heap.
const LONGEST: usize = 40;
/// Objects of a film from which it may be a heap, and fewest frames before and after a meeting in it that tell of it.
const HEAPED: usize = 3;
const TELLING: usize = 5;
/// Jumps of two objects are one meeting, though sizes that are believed keep them apart: within so many frames, with opposite
/// changes (cosine), away from each other (cosine), no farther than this many times what is believed.
const TOGETHER: usize = 2;
const OPPOSITE: f64 = 0.9;
const AWAY: f64 = 0.5;
const REACH: f64 = 2.0;
/// Prior deviation of the ratio of a pair's restitution to the others'.
const SCATTER: f64 = 0.15;

/// The short films of a set-up, with models of what they show.
#[derive(Serialize, Deserialize)]
pub struct ContactWindows {
    pub scenes: Vec<Scene>,
    pub models: Vec<Model>,
    /// Of each film with more than two objects, shorter ones of two that meet while neither meets another.
    pub meetings: Vec<Vec<(Scene, Model)>>,
    /// Jumps without a partner, and the index of the scene that shows each.
    pub jumps: Vec<(usize, ChangePoint)>,
}

impl ContactWindows {
    /// Some of the films, chosen by their index.
    pub fn only(&self, keep: impl Fn(usize) -> bool) -> ContactWindows {
        let kept: Vec<usize> = (0..self.scenes.len()).filter(|&film| keep(film)).collect();
        ContactWindows {
            scenes: kept.iter().map(|&film| self.scenes[film].clone()).collect(),
            models: kept.iter().map(|&film| self.models[film].clone()).collect(),
            meetings: kept.iter().map(|&film| self.meetings[film].clone()).collect(),
            jumps: self.jumps.clone(),
        }
    }
}

/// Cuts the short films; forces between contacts stay as the models have them.
pub fn contacts(lens: &WeakFormRegression, models: &[Model]) -> ContactWindows {
    let mut all = ContactWindows { scenes: vec![], models: vec![], meetings: vec![], jumps: vec![] };
    for (index, (scene, paths)) in lens.scenes.iter().zip(&lens.paths).enumerate() {
        // Spans of frames with the objects in them, merged while they overlap and share an object.
        let mut spans: Vec<(usize, usize, Vec<usize>)> = vec![];
        for (i, path) in paths.iter().enumerate() {
            for j in (0..paths.len()).filter(|&j| j > i) {
                let mut frames: Vec<usize> =
                    path.near.iter().filter(|(_, other)| *other == j).map(|n| n.0).collect();
                frames.sort_unstable();
                let mut run: Option<(usize, usize)> = None;
                for f in frames {
                    match &mut run {
                        Some((_, last)) if f - *last <= AFTER => *last = f,
                        _ => {
                            spans.extend(run.map(|(a, b)| (a, b, vec![i, j])));
                            run = Some((f, f));
                        }
                    }
                }
                spans.extend(run.map(|(a, b)| (a, b, vec![i, j])));
            }
            for jump in &path.jumps {
                let radius = |k: usize| scene.objects[k].shape.bounding_radius();
                let meets = |&j: &usize| {
                    j != i && paths[j].jumps.iter().any(|k| meet(jump, k, REACH * (radius(i) + radius(j))))
                };
                let partner = (0..paths.len()).find(meets);
                let mut objects: Vec<usize> = partner.into_iter().chain([i]).collect();
                objects.sort_unstable();
                spans.push((jump.frame, jump.frame, objects));
                if partner.is_none() {
                    all.jumps.push((index, *jump));
                }
            }
        }
        spans.sort();
        let film = |bodies: &[usize], window: Range<usize>| {
            let film = short_film(scene, bodies, window.start, window.end.min(scene.times.len()));
            let own: Vec<SmoothTrack> = bodies.iter().map(|&b| paths[b].clone()).collect();
            // What is hit as the film begins has no velocity to begin with.
            let model = started(&film, &own, &part(&models[index], bodies))?;
            Some((from_frame(film, window.start), model))
        };
        for span in merged(&spans) {
            let meetings = if span.objects.len() < HEAPED { vec![] } else { meetings(&spans, &span) };
            let window = span.first.saturating_sub(BEFORE)..span.end;
            if let Some((scene, model)) = film(&span.objects, window) {
                all.scenes.push(scene);
                all.models.push(model);
                let meetings = meetings.into_iter().filter_map(|(pair, window)| film(pair, window));
                all.meetings.push(meetings.collect());
            }
        }
    }
    all
}

/// Whether two jumps are what two objects do to each other, at this distance (m) at most.
fn meet(a: &ChangePoint, b: &ChangePoint, reach: f64) -> bool {
    let (apart, back) = (b.position - a.position, -a.change.unit());
    a.frame.abs_diff(b.frame) <= TOGETHER
        && apart.norm() < reach
        && back.dot(b.change.unit()) > OPPOSITE
        && back.dot(apart.unit()) > AWAY
}

/// Frames in which objects are near each other.
#[derive(Debug, Clone, PartialEq)]
struct ContactSpan {
    first: usize,
    last: usize,
    objects: Vec<usize>,
    /// End of what a film may show of it.
    end: usize,
}

/// Spans that overlap and share an object as one, cut where it would be long: in a heap one contact leads to the next until
/// the film ends. What begins after the cut is a span of its own, and where it begins this one's film ends.
fn merged(spans: &[(usize, usize, Vec<usize>)]) -> Vec<ContactSpan> {
    let mut merged: Vec<ContactSpan> = vec![];
    for (first, last, objects) in spans {
        let mut joined = false;
        for m in &mut merged {
            let longest = m.first + LONGEST;
            if joined || *first > m.last + BEFORE || !objects.iter().any(|o| m.objects.contains(o)) {
                continue;
            }
            if *first > longest {
                m.end = m.end.min(*first);
                continue;
            }
            m.last = m.last.max(*last).min(longest);
            m.end = m.last + AFTER;
            m.objects.extend(objects);
            m.objects.sort_unstable();
            m.objects.dedup();
            joined = true;
        }
        if !joined {
            let last = (*last).min(first + LONGEST);
            merged.push(ContactSpan { first: *first, last, objects: objects.clone(), end: last + AFTER });
        }
    }
    merged
}

/// Pairs that meet within a film while neither meets another, and the frames from the last meeting of either to the next.
fn meetings<'s>(
    spans: &'s [(usize, usize, Vec<usize>)],
    film: &ContactSpan,
) -> Vec<(&'s [usize], Range<usize>)> {
    let window = |(k, (first, last, pair)): (usize, &'s (usize, usize, Vec<usize>))| {
        let within = pair.len() > 1 && film.first <= *first && *last <= film.last;
        let of_them = |o: &usize| pair.contains(o) && film.objects.contains(o);
        if !within || !pair.iter().all(of_them) {
            return None;
        }
        let (mut begin, mut end) = (first.saturating_sub(BEFORE), last + AFTER);
        for (_, other) in spans.iter().enumerate().filter(|(o, s)| *o != k && s.2.iter().any(of_them)) {
            if other.1 < *first {
                begin = begin.max(other.1 + 1);
            } else {
                end = end.min(other.0);
            }
        }
        (begin + TELLING <= *first && *last + TELLING <= end).then_some((&pair[..], begin..end))
    };
    spans.iter().enumerate().filter_map(window).collect()
}

fn short_film(scene: &Scene, bodies: &[usize], first: usize, end: usize) -> Scene {
    let mut film = scene.clone();
    film.times.truncate(end);
    film.objects = bodies.iter().map(|&b| scene.objects[b].clone()).collect();
    film.tracks = bodies.iter().map(|&b| scene.tracks[b].clone()).collect();
    for track in &mut film.tracks {
        track.samples.retain(|s| (first..end).contains(&s.frame));
    }
    film
}

/// The film from this frame on: what windows of a search grow over.
fn from_frame(mut film: Scene, first: usize) -> Scene {
    film.times.drain(..first.min(film.times.len()));
    film.tracks.iter_mut().flat_map(|t| &mut t.samples).for_each(|s| s.frame -= first);
    film
}

/// The model with these bodies only; what acts between contacts is known and stays.
fn part(model: &Model, bodies: &[usize]) -> Model {
    let mut part = model.clone();
    part.bodies = bodies.iter().map(|&b| model.bodies[b].clone()).collect();
    part.impulses.retain(|i| part.bodies.iter().any(|b| b.id == i.id));
    for active in &mut part.effects {
        let entry = effect(&active.name);
        let between = active.formula.is_some() || entry.is_some_and(EffectEntry::shows_in_free_motion);
        // What acts in another way after a contact is not known from the motion before it.
        let again = entry.is_some_and(|e| e.profile.changes_after_contact);
        for p in &mut active.parameters {
            let role = entry.and_then(|e| e.profile.param_role(&p.name));
            let mut own = Parameter::new(&p.name, p.scope, p.prior, &part.bodies);
            for (label, (value, mean)) in own.labels.iter().zip(own.values.iter_mut().zip(&mut own.means)) {
                if let Ok(at) = p.labels.binary_search(label) {
                    (*value, *mean) = (p.values[at], p.means[at]);
                }
            }
            // Engines scatter from pair to pair; a law must say more than that.
            let scatters = p.scope == Scope::Pair && p.prior.sd > 0.0;
            if role == Some(ParamRole::PairRestitution) && !scatters {
                own = Parameter::new(&p.name, Scope::Pair, Prior { mean: 1.0, sd: SCATTER }, &part.bodies);
            }
            let known = between && !again && p.scope != Scope::Object;
            if known {
                own.prior = Prior { sd: 0.0, ..own.prior };
            }
            *p = own;
        }
    }
    part
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::num::vec2;

    #[test]
    fn a_heap_is_no_longer_than_a_short_film() {
        let contact = |first: usize, a: usize, b: usize| (first, first + 3, vec![a, b]);
        let all = merged(&[contact(10, 0, 1), contact(20, 1, 2), contact(60, 4, 5)]);
        assert_eq!(all.len(), 2);
        assert_eq!((all[0].first, all[0].last, all[0].end), (10, 23, 23 + AFTER));
        assert_eq!(all[0].objects, [0, 1, 2]);
        // One contact every ten frames: the film ends before what it does not show begins.
        let heap: Vec<_> = (0..10).map(|k| contact(10 * k, k, k + 1)).collect();
        for pair in merged(&heap).windows(2) {
            let (before, after) = (&pair[0], &pair[1]);
            assert!(
                before.last <= before.first + LONGEST && before.end <= after.first,
                "{before:?} {after:?}"
            );
        }
    }

    #[test]
    fn two_that_part_at_once_have_met_though_sizes_keep_them_apart() {
        let at = |frame: usize, x: f64, change: f64| ChangePoint {
            frame,
            position: vec2(x, 0.0),
            change: vec2(change, 0.1),
            sigmas: 9.0,
        };
        let meets = |b: ChangePoint| meet(&at(20, 0.0, -0.5), &b, 0.8);
        assert!(meets(at(21, 0.5, 0.7)));
        assert!(!meets(at(24, 0.5, 0.7)), "later");
        assert!(!meets(at(21, 0.9, 0.7)), "too far");
        assert!(!meets(at(21, 0.5, -0.7)), "the same way");
        assert!(!meets(at(21, -0.5, 0.7)), "through each other");
    }

    #[test]
    fn meetings_end_where_another_begins() {
        let contact = |first: usize, a: usize, b: usize| (first, first + 2, vec![a, b]);
        // 0 and 1 meet, then 1 and 2, then 3 and 4 who meet nobody else, and 2 is struck while it is still at 1.
        let spans = [contact(20, 0, 1), contact(31, 1, 2), contact(33, 3, 4), (35, 35, vec![2])];
        let film = ContactSpan { first: 20, last: 36, objects: vec![0, 1, 2, 3, 4], end: 52 };
        let found = meetings(&spans, &film);
        assert_eq!(found, [(&[0, 1][..], 6..31), (&[3, 4][..], 19..51)]);
        let without = ContactSpan { objects: vec![0, 1, 2], ..film };
        assert_eq!(meetings(&spans, &without).len(), 1, "who is not in the film meets nobody there");
    }
}
