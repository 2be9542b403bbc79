//! What engines and cameras do at contacts anyway: a law that says no more is none to find.

use super::contact_law::{HEAVIER, RUBBING, SCALE, SOFT};
use crate::effects::EffectEntry;
use crate::scene::Scene;
use crate::world::Model;
use std::f64::consts::PI;

/// What engines and cameras do at contacts anyway, as shares of a length or a mass and as a coefficient of friction: a law that says
/// less is none, however little noise there is.
const SLIGHT: [(&str, f64); 4] = [(SCALE, 0.015), ("wrong_size", 0.02), (HEAVIER, 0.05), (RUBBING, 0.02)];

/// Whether a law says no more than what engines and cameras do at contacts anyway.
pub fn is_slight(entry: &EffectEntry, values: &[f64], scenes: &[Scene], models: &[Model]) -> bool {
    let least = SLIGHT.iter().find(|(name, _)| *name == entry.spec.name);
    let small = least.zip(values.first()).is_some_and(|((_, least), amplitude)| amplitude.abs() < *least);
    small || is_brief(entry, values, scenes, models)
}

/// The longest frame (s).
pub fn frame(scenes: &[Scene]) -> f64 {
    scenes.iter().map(|s| 1.0 / s.fps).fold(0.0, f64::max)
}

/// Whether a law of softness (1/sqrt(k)) lets all contacts pass within one frame: every engine's and every real contact takes
/// some time, and that is no law to find.
fn is_brief(entry: &EffectEntry, values: &[f64], scenes: &[Scene], models: &[Model]) -> bool {
    entry.spec.name == SOFT && values.first().is_some_and(|s| s * time_by_softness(models) < frame(scenes))
}

/// How long the longest contacts take at a softness of one (s): half a period of the reduced mass on the spring.
pub fn time_by_softness(models: &[Model]) -> f64 {
    let heaviest = |m: &Model| {
        let mut masses: Vec<f64> = m.bodies.iter().map(|b| b.mass).collect();
        masses.sort_by(|a, b| b.total_cmp(a));
        let [a, b, ..] = masses[..] else { return 0.0 };
        a * b / (a + b)
    };
    PI * models.iter().map(heaviest).fold(0.0, f64::max).sqrt()
}

#[cfg(test)]
mod tests {
    use super::super::tests::{DISC, film, models};
    use super::*;
    use crate::effects::effect;

    #[test]
    fn contacts_that_pass_within_a_frame_are_not_soft() {
        let at_rest = |x: f64| (DISC, 1.0, [x, 0.0], [0.0, 0.0]);
        let scenes = film(&[vec![at_rest(0.0), at_rest(1.0)]], None);
        let soft = effect(SOFT).expect("it is in the library");
        // Two of 1 kg: half a period of .5 kg on k = 1/s^2.
        let once = frame(&scenes) / (PI * 0.5f64.sqrt());
        let brief = |softness: f64| is_brief(soft, &[softness, 0.0], &scenes, &models(&scenes));
        assert!(brief(0.99 * once) && !brief(1.01 * once));
        assert!(!is_brief(effect(RUBBING).expect("too"), &[0.0], &scenes, &models(&scenes)));
    }
}
