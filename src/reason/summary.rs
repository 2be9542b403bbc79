//! One answer from the values of all rollouts: the most frequent one, the likely events, or mean and deviation.

use super::describe::{at_time, describe, event_words, quantity, vector};
use super::events::SceneEvent;
use super::value::ProgramValue;
use crate::num::Vec2;
use crate::scene::Scene;

/// What the values of an answer are drawn from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Sampling {
    /// The scene alone: they are certain.
    Scene,
    /// One simulation each.
    Simulations,
    /// The words of a lexicon; with simulations, several draws of words for each of this number of them.
    Words { simulations: Option<usize> },
}

impl From<bool> for Sampling {
    /// Without a lexicon: whether something was simulated.
    fn from(is_simulated: bool) -> Sampling {
        if is_simulated { Sampling::Simulations } else { Sampling::Scene }
    }
}

/// The mean of the share under Jeffreys' prior if `k` of `n` simulations agree; the share itself where nothing was simulated.
pub fn estimated_probability(k: usize, n: usize, sampling: impl Into<Sampling>) -> f64 {
    let share = k as f64 / n.max(1) as f64;
    match sampling.into() {
        Sampling::Scene => share,
        Sampling::Simulations | Sampling::Words { simulations: None } => (k as f64 + 0.5) / (n as f64 + 1.0),
        // Draws of words on one simulation count as that one.
        Sampling::Words { simulations: Some(most) } => {
            let independent = n.min(most) as f64;
            (share * independent + 0.5) / (independent + 1.0)
        }
    }
}

/// The share of `n` simulations that a probability of `estimated_probability` comes from.
pub fn estimated_share(probability: f64, n: usize) -> f64 {
    ((probability * (n as f64 + 1.0) - 0.5) / n.max(1) as f64).clamp(0.0, 1.0)
}

/// The answer in words, and its probability.
pub fn summary(scene: &Scene, values: &[ProgramValue], sampling: impl Into<Sampling>) -> (String, f64) {
    let sampling = sampling.into();
    let counted = |k: usize| estimated_probability(k, values.len(), sampling);
    let numeric = numbers(values);
    if 2 * numeric.len() >= values.len().max(1) {
        return (numeric_words(scene, values, &numeric), counted(numeric.len()));
    }
    match values.iter().find(|v| !matches!(v, ProgramValue::Undetermined(_))) {
        Some(ProgramValue::Events(_)) => return likely_events(scene, values, sampling),
        Some(ProgramValue::Event(_)) => return likely_event(scene, values, sampling),
        _ => {}
    }
    let mut tally: Vec<(String, usize)> = vec![];
    for value in values {
        let text = describe(scene, value);
        match tally.iter_mut().find(|(t, _)| *t == text) {
            Some((_, n)) => *n += 1,
            None => tally.push((text, 1)),
        }
    }
    // Of equally frequent answers the first one, so that the result is deterministic.
    let most = tally.iter().rev().max_by_key(|(_, n)| *n).cloned().unwrap_or_default();
    (most.0, counted(most.1))
}

/// The values with a mean, as vectors.
fn numbers(values: &[ProgramValue]) -> Vec<Vec2> {
    let number = |v: &ProgramValue| match v {
        ProgramValue::Quantity(value, _) | ProgramValue::Time(value) => Some(Vec2 { x: *value, y: 0.0 }),
        ProgramValue::Vector(value, _) => Some(*value),
        _ => None,
    };
    values.iter().filter_map(number).filter(|v| v.x.is_finite() && v.y.is_finite()).collect()
}

/// Mean and standard deviation (of a vector: per coordinate).
pub fn mean_and_deviation(numbers: &[Vec2], coordinates: usize) -> (Vec2, f64) {
    let n = numbers.len().max(1) as f64;
    let mean = numbers.iter().fold(Vec2::default(), |sum, v| sum + *v) * (1.0 / n);
    let squares: f64 = numbers.iter().map(|v| (*v - mean).norm_squared()).sum();
    (mean, (squares / ((n - 1.0).max(1.0) * coordinates as f64)).sqrt())
}

fn numeric_words(scene: &Scene, values: &[ProgramValue], numbers: &[Vec2]) -> String {
    let kind = values.iter().find(|v| !matches!(v, ProgramValue::Undetermined(_)));
    match kind {
        Some(ProgramValue::Vector(_, unit)) => {
            let (mean, sd) = mean_and_deviation(numbers, 2);
            vector(mean, sd, unit)
        }
        Some(ProgramValue::Time(_)) => {
            let (mean, sd) = mean_and_deviation(numbers, 1);
            at_time(scene, mean.x, sd)
        }
        Some(ProgramValue::Quantity(_, unit)) => {
            let (mean, sd) = mean_and_deviation(numbers, 1);
            quantity(mean.x, sd, unit)
        }
        _ => String::new(),
    }
}

/// Events alike with the number of rollouts that have them and their times.
type Tally = Vec<(SceneEvent, Vec<f64>)>;

fn add(tally: &mut Tally, event: &SceneEvent) {
    match tally.iter_mut().find(|(e, _)| e.is_like(event)) {
        Some((_, times)) => times.push(event.time),
        None => tally.push((event.clone(), vec![event.time])),
    }
}

/// An event at the mean of its times.
fn timed(scene: &Scene, event: &SceneEvent, times: &[f64]) -> String {
    let points: Vec<Vec2> = times.iter().map(|t| Vec2 { x: *t, y: 0.0 }).collect();
    let (mean, sd) = mean_and_deviation(&points, 1);
    let words = event_words(scene, event);
    let frame = scene.frame_at(mean.x);
    // Half a frame does not show.
    let spread = sd * scene.fps;
    match (frame, spread >= 0.5) {
        (0, _) => words,
        (_, false) => format!("{words} (frame {frame})"),
        (_, true) => format!("{words} (frame {frame} +- {spread:.0})"),
    }
}

/// The most frequent event, whatever its time.
fn likely_event(scene: &Scene, values: &[ProgramValue], sampling: Sampling) -> (String, f64) {
    let mut tally: Tally = vec![];
    for value in values {
        if let ProgramValue::Event(event) = value {
            add(&mut tally, event);
        }
    }
    let most = tally.iter().rev().max_by_key(|(_, times)| times.len());
    most.map_or((String::new(), 0.0), |(event, times)| {
        (timed(scene, event, times), estimated_probability(times.len(), values.len(), sampling))
    })
}

/// The events of at least half of the rollouts, in words, and the probability of the least likely of them.
fn likely_events(scene: &Scene, values: &[ProgramValue], sampling: Sampling) -> (String, f64) {
    let mut tally: Tally = vec![];
    for value in values {
        let ProgramValue::Events(events) = value else { continue };
        for (k, event) in events.iter().enumerate() {
            if !events.iter().take(k).any(|e| e.is_like(event)) {
                add(&mut tally, event);
            }
        }
    }
    let share = |times: &[f64]| estimated_probability(times.len(), values.len(), sampling);
    let likely: Vec<_> = tally.iter().filter(|(_, times)| share(times) >= 0.5).collect();
    if likely.is_empty() {
        let most = tally.iter().map(|(_, times)| share(times)).fold(share(&[]), f64::max);
        return ("nothing is likely to happen".to_string(), 1.0 - most);
    }
    // The share of a single event is the probability of the answer.
    let words = likely.iter().map(|(event, times)| match likely.len() {
        1 => timed(scene, event, times),
        _ => format!("{} ({:.0} %)", timed(scene, event, times), 100.0 * share(times)),
    });
    let least = likely.iter().map(|(_, times)| share(times)).fold(1.0, f64::min);
    (words.collect::<Vec<_>>().join("; "), least)
}
