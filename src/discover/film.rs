//! Short films around each contact and each jump without a partner, with models of what they show.

use super::force::Lens;
use super::path::{Jump, Path, started};
use crate::effects::{Hook, Scope, effect};
use crate::scene::Scene;
use crate::world::{Model, Parameter, Prior};

/// Frames before and after a contact that a short film shows.
const BEFORE: usize = 14;
const AFTER: usize = 16;
/// Longest time that objects may be near each other in one short film (frames): they may have stopped there.
const LONGEST: usize = 40;
/// Prior deviation of the ratio of a pair's restitution to the others'.
const SCATTER: f64 = 0.15;

/// The short films of a set-up, with models of what they show.
pub struct Contacts {
    pub scenes: Vec<Scene>,
    pub models: Vec<Model>,
    /// Whether a jump without a partner is in it.
    pub jumps: Vec<(usize, Jump)>,
}

/// Cuts the short films; forces between contacts stay as the models have them.
pub fn contacts(lens: &Lens, models: &[Model]) -> Contacts {
    let mut all = Contacts { scenes: vec![], models: vec![], jumps: vec![] };
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
                spans.push((jump.frame, jump.frame, vec![i]));
                all.jumps.push((index, *jump));
            }
        }
        for span in &mut spans {
            span.1 = span.1.min(span.0 + LONGEST);
        }
        spans.sort();
        let mut merged: Vec<(usize, usize, Vec<usize>)> = vec![];
        for span in spans {
            let joins = merged.iter_mut().find(|m| {
                span.0 <= m.1 + BEFORE && m.0 <= span.1 + BEFORE && span.2.iter().any(|b| m.2.contains(b))
            });
            match joins {
                Some(m) => {
                    (m.0, m.1) = (m.0.min(span.0), m.1.max(span.1));
                    m.2.extend(&span.2);
                    m.2.sort_unstable();
                    m.2.dedup();
                }
                None => merged.push(span),
            }
        }
        for (first, last, bodies) in merged {
            let window = first.saturating_sub(BEFORE)..(last + AFTER).min(scene.times.len());
            let film = short_film(scene, &bodies, window.start, window.end);
            let own: Vec<Path> = bodies.iter().map(|&b| paths[b].clone()).collect();
            let model = part(&models[index], &bodies);
            // What is hit as the film begins has no velocity to begin with.
            if let Some(model) = started(&film, &own, &model) {
                all.models.push(model);
                all.scenes.push(from_frame(film, window.start));
            }
        }
    }
    all
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
    for active in &mut part.effects {
        let entry = effect(&active.name);
        let between =
            active.formula.is_some() || entry.is_some_and(|e| e.uses(Hook::Force) || e.uses(Hook::Pair));
        for p in &mut active.parameters {
            let mut own = Parameter::new(&p.name, p.scope, p.prior, &part.bodies);
            for (label, (value, mean)) in own.labels.iter().zip(own.values.iter_mut().zip(&mut own.means)) {
                if let Ok(at) = p.labels.binary_search(label) {
                    (*value, *mean) = (p.values[at], p.means[at]);
                }
            }
            // Engines scatter from pair to pair; a law must say more than that.
            let scatters = p.scope == Scope::Pair && p.prior.sd > 0.0;
            if active.name == "restitution" && p.name == "deviation" && !scatters {
                own = Parameter::new(&p.name, Scope::Pair, Prior { mean: 1.0, sd: SCATTER }, &part.bodies);
            }
            let known = between && active.name != "ball_spin" && p.scope != Scope::Object;
            if known {
                own.prior = Prior { sd: 0.0, ..own.prior };
            }
            *p = own;
        }
    }
    part
}
