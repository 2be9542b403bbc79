//! What engines and cameras do at contacts anyway: a law that says no more is none to find.

use super::contact_law::{HEAVIER, RUBBING, SCALE};
use super::film::Contacts;
use crate::effects::EffectEntry;
use crate::world::Model;

/// What engines and cameras do at contacts anyway, as shares of a length or a mass and as a coefficient of friction: a law that says
/// less is none, however little noise there is.
const SLIGHT: [(&str, f64); 4] = [(SCALE, 0.015), ("wrong_size", 0.02), (HEAVIER, 0.05), (RUBBING, 0.02)];

/// Whether a law says no more than what engines and cameras do at contacts anyway.
pub fn is_slight(entry: &EffectEntry, values: &[f64]) -> bool {
    let least = SLIGHT.iter().find(|(name, _)| *name == entry.spec.name);
    least.zip(values.first()).is_some_and(|((_, least), amplitude)| amplitude.abs() < *least)
}

/// Whether softness (1/sqrt(k)) lets all contacts pass within one frame (half a period of the reduced mass on the
/// spring): every engine's and every real contact takes some time, and that is no law to find.
pub fn brief(films: &Contacts, softness: f64) -> bool {
    let frame = films.scenes.iter().map(|s| 1.0 / s.fps).fold(0.0, f64::max);
    let heaviest = |m: &Model| {
        let mut masses: Vec<f64> = m.bodies.iter().map(|b| b.mass).collect();
        masses.sort_by(|a, b| b.total_cmp(a));
        let [a, b, ..] = masses[..] else { return 0.0 };
        a * b / (a + b)
    };
    let reduced = films.models.iter().map(heaviest).fold(0.0, f64::max);
    std::f64::consts::PI * softness * reduced.sqrt() < frame
}
