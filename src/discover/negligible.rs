//! What engines and cameras do at contacts anyway: a law that says no more is none to find.

use crate::effects::{EffectEntry, SearchStart};
use crate::scene::Scene;
use crate::world::Model;

/// Whether a law says no more than what engines and cameras do at contacts anyway.
pub fn is_slight(entry: &EffectEntry, values: &[f64], scenes: &[Scene], models: &[Model]) -> bool {
    let small = values.first().is_some_and(|amplitude| amplitude.abs() < entry.profile.negligible);
    small || is_brief(entry, values, scenes, models)
}

/// The longest frame (s).
pub fn frame(scenes: &[Scene]) -> f64 {
    scenes.iter().map(|s| 1.0 / s.fps).fold(0.0, f64::max)
}

/// Whether a law of contacts that take time lets all of them pass within one frame: every engine's and every real contact takes
/// some time, and that is no law to find.
fn is_brief(entry: &EffectEntry, values: &[f64], scenes: &[Scene], models: &[Model]) -> bool {
    let takes_time = matches!(entry.profile.start, Some(SearchStart::ContactFrames(_)));
    takes_time && longest_contact(entry, values, models) < frame(scenes)
}

/// How long the longest contacts take by a law (s).
pub fn longest_contact(entry: &EffectEntry, values: &[f64], models: &[Model]) -> f64 {
    let heaviest = |m: &Model| {
        let mut masses: Vec<f64> = m.bodies.iter().map(|b| b.mass).collect();
        masses.sort_by(|a, b| b.total_cmp(a));
        let [a, b, ..] = masses[..] else { return 0.0 };
        a * b / (a + b)
    };
    (entry.contact_time)(values, models.iter().map(heaviest).fold(0.0, f64::max))
}

#[cfg(test)]
mod tests {
    use super::super::tests::{DISC, film, models};
    use super::*;
    use crate::effects::effect;
    use std::f64::consts::PI;

    #[test]
    fn contacts_that_pass_within_a_frame_are_not_soft() {
        let at_rest = |x: f64| (DISC, 1.0, [x, 0.0], [0.0, 0.0]);
        let scenes = film(&[vec![at_rest(0.0), at_rest(1.0)]], None);
        let soft = effect("soft_contact").expect("it is in the library");
        // Two of 1 kg: half a period of .5 kg on k = 1/s^2.
        let once = frame(&scenes) / (PI * 0.5f64.sqrt());
        let brief = |softness: f64| is_brief(soft, &[softness, 0.0], &scenes, &models(&scenes));
        assert!(brief(0.99 * once) && !brief(1.01 * once));
        assert!(!is_brief(effect("contact_friction").expect("too"), &[0.0], &scenes, &models(&scenes)));
    }
}
