//! Up to where a model follows a video, and which object leaves its track first: what is said of a video that is not followed rests on
//! this, and what something unseen does is sought there.

use super::proof;
use super::resample::Resampled;
use super::revise::Revision;
use crate::fit::{FitError, FitOptions, SceneFit, StartPoint, estimate_noise, estimate_one, initial_model};
use crate::num::Stop;
use crate::scene::{Sample, Scene, Track};
use crate::world::{EventKind, Model, SimulationLimits, simulate_observed, trace};

/// Mean distance of two neighbouring samples from a fit beyond which it does not follow them (deviations).
const DRIFT: f64 = 4.0;
/// Fewest frames that the start of a video has.
const SHORTEST: usize = 8;
/// Frames before the end of what is followed from which the object that leaves is sought.
const BEFORE: usize = 2;
/// Frames before that end, and after it, in which another object or a wall that is near may be what the object touches.
const CONTACT_FRAMES: usize = 8;
const BESIDE: usize = 2;
/// Objects nearer than this share of their radii together may touch.
const NEAR: f64 = 1.5;

/// The start of a video that a model follows, and what happens then.
pub struct FollowedStart {
    /// Fitted to it.
    pub model: Model,
    /// Its length.
    pub frames: usize,
    /// Index of the object that leaves its track first.
    pub object: usize,
    /// Its last contact before, or what is near then; `None` where it touches nothing.
    pub contact: Option<LastContact>,
}

/// What an object touched, or may have touched.
#[derive(Debug, Clone, PartialEq)]
pub struct LastContact {
    pub frame: usize,
    /// Another object's id; `None`: a wall.
    pub other: Option<u32>,
}

impl FollowedStart {
    /// Whether what happens then may be a contact.
    pub fn may_be_a_contact(&self) -> bool {
        self.contact.as_ref().is_some_and(|c| c.frame + CONTACT_FRAMES >= self.frames)
    }
}

/// The longest start of a video that the model follows, by bisection; `None` if it follows nothing, or all.
pub fn followed_start(
    scene: &Scene,
    model: &Model,
    options: &FitOptions,
    stop: Stop,
) -> Result<Option<FollowedStart>, FitError> {
    // Local searches, each from where the one before ended: one that misses a contact ends there, where none is passed over.
    let options = FitOptions { start_point: StartPoint::NearOptimum, ..*options };
    let mut from = model.clone();
    from.copy_state_from(&initial_model(scene, model));
    let (mut followed, mut not) = (SHORTEST.min(scene.times.len()), scene.times.len());
    let mut best: Option<Model> = None;
    while followed + 1 < not {
        let middle = (followed + not) / 2;
        let part = first_frames(scene, middle);
        let fit = estimate_one(&part, best.as_ref().unwrap_or(&from), &options, stop)?;
        let fitted = fit.scenes.into_iter().next();
        match fitted.filter(|s| departure(&part, &s.model, s.noise_sigma, 0).is_none()) {
            Some(fitted) => (followed, best) = (middle, Some(fitted.model)),
            None => not = middle,
        }
    }
    let Some(model) = best.filter(|_| followed + 1 < scene.times.len()) else { return Ok(None) };
    let sigma = estimate_noise(scene).position;
    let leaves = departure(scene, &model, sigma, followed.saturating_sub(BEFORE));
    Ok(leaves.map(|object| FollowedStart {
        contact: last_contact(scene, &model, object, followed),
        model,
        frames: followed,
        object,
    }))
}

/// The first frames of a scene; an object that enters later keeps its first sample.
fn first_frames(scene: &Scene, frames: usize) -> Scene {
    let mut part = scene.clone();
    let mut end = frames;
    for track in &mut part.tracks {
        let seen = track.samples.iter().filter(|s| s.frame < frames).count().max(1);
        track.samples.truncate(seen);
        end = end.max(track.samples.last().map_or(0, |s| s.frame + 1));
    }
    part.times.truncate(end);
    part
}

/// The object that is first out of the noise (m) of a simulation, from frame `from` on.
fn departure(scene: &Scene, model: &Model, sigma: f64, from: usize) -> Option<usize> {
    let limits = SimulationLimits::default();
    let run = simulate_observed::<f64>(model, &model.flatten(), &scene.times, &limits);
    let first = |(object, track): (usize, &Track)| {
        let id = scene.objects[object].id;
        let off = |s: &Sample| {
            let state = run.states.get(s.frame)?.get(object).copied().flatten()?;
            Some(((state.position - s.position).norm(), s.frame))
        };
        let counts = |s: &&Sample| s.frame >= from && !model.passes_over(id, scene.time_of(s.frame));
        let all: Vec<(f64, usize)> = track.samples.iter().filter(counts).filter_map(off).collect();
        let far = |w: &&[(f64, usize)]| w.iter().map(|o| o.0).sum::<f64>() > 2.0 * DRIFT * sigma;
        all.windows(2).find(far).map(|w| (w[0].1, object))
    };
    scene.tracks.iter().enumerate().filter_map(first).min().map(|(_, object)| object)
}

/// The last contact of an object in a simulation before the end of what is followed, or what its track is near about then.
fn last_contact(scene: &Scene, model: &Model, object: usize, end: usize) -> Option<LastContact> {
    let id = scene.objects[object].id;
    let run = trace(model, &scene.times);
    let touched = run.events.iter().filter(|e| e.kind == EventKind::Collision && e.objects.contains(&id));
    let mut simulated = touched.map(|e| LastContact {
        frame: scene.frame_at(e.time),
        other: e.objects.iter().find(|o| **o != id).copied(),
    });
    let simulated = simulated.rfind(|c| c.frame < end + BESIDE);
    let radius = |k: usize| scene.objects[k].shape.bounding_radius();
    let near = |other: usize, frame: usize| {
        let place = |k: usize| scene.tracks[k].at(frame).map(|s| s.position);
        let pair = place(object).zip(place(other));
        pair.is_some_and(|(a, b)| (a - b).norm() < NEAR * (radius(object) + radius(other)))
    };
    let frames = || (end.saturating_sub(CONTACT_FRAMES)..end + BESIDE).rev();
    let others = (0..scene.tracks.len()).filter(|k| *k != object);
    let beside = others.filter_map(|other| {
        let frame = frames().find(|frame| near(other, *frame))?;
        Some(LastContact { frame, other: Some(scene.objects[other].id) })
    });
    beside.chain(simulated).max_by_key(|c| c.frame)
}

/// The sentence on videos that the last revision does not follow; empty if it follows all.
pub fn unfollowed(
    videos: &Resampled,
    last: &Revision,
    options: &FitOptions,
    stop: Stop,
) -> Result<String, FitError> {
    let mut lost: Vec<(usize, &SceneFit)> =
        last.fit.scenes.iter().enumerate().filter(|(_, s)| proof::lost(s)).collect();
    lost.sort_by(|a, b| b.1.reduced_chi_square.total_cmp(&a.1.reduced_chi_square));
    let Some((k, worst)) = lost.first() else { return Ok(String::new()) };
    let others = match lost.len() {
        1 => String::new(),
        n => format!(" and {} more", n - 1),
    };
    let scene = &videos.scenes[*k];
    let start = followed_start(scene, &worst.model, options, stop)?;
    let frame = |frame| videos.frame(*k, frame);
    let why = start.map_or_else(|| "no part of it is followed".into(), |start| departs(scene, &start, frame));
    Ok(format!(
        "; the simulation does not follow {}{others} (reduced chi-square {:.0}): {why}; run `compare` to see where",
        worst.name, worst.reduced_chi_square
    ))
}

/// Where an object leaves its track, and after which contact.
fn departs(scene: &Scene, start: &FollowedStart, given: impl Fn(usize) -> usize) -> String {
    let id = scene.objects[start.object].id;
    let why = match &start.contact {
        None => {
            "where it touches no other object and no wall, so that another law or something unseen acts, or its times or positions \
             are wrong"
                .to_string()
        }
        Some(LastContact { frame, other }) => {
            let with = other.map_or("a wall".into(), |id| format!("object {id}"));
            format!(
                "after it is at {with} in frame {}: that contact is chaotic or differs from the model's, or another law acts",
                given(*frame)
            )
        }
    };
    format!("object {id} leaves the simulation at frame {}, {why}", given(start.frames))
}
