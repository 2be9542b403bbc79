//! Before motion is called unexplained, whole trajectories hear the laws that free motion ranks first: of one film, or of few
//! objects, it may be too short to prove any.

use super::proof::{self, at_noise};
use super::revise::{Revision, revise};
use super::screen::ForceCandidate;
use super::search::{ALIKE, FreeMotion, instead};
use super::weak_form::WeakFormRegression;
use crate::fit::{FitError, FitOptions};
use crate::num::{Stop, elementary};
use crate::world::Model;
use rayon::prelude::*;

/// Most laws that are heard.
const HEARD: usize = 4;

/// The law of force with which trajectories follow what was filmed, where free motion leaves structure and proves none;
/// with its revision. `first` is the revision without any.
pub fn heard(
    lens: &WeakFormRegression,
    base: &[Model],
    motion: &FreeMotion,
    first: &Revision,
    options: &FitOptions,
    stop: Stop,
) -> Result<Option<(FreeMotion, Revision)>, FitError> {
    if !motion.found.is_empty() || motion.trimmed_chi_square <= super::MISFIT || at_noise(first) {
        return Ok(None);
    }
    let one = |law: &ForceCandidate| -> Result<_, FitError> {
        let motion = instead(lens, base, motion, law, stop)?;
        let revision = revise(lens, &motion.models, Some(law.entry.spec.name), options, stop)?;
        let follows = proof::follows(&revision) && proof::is_supported(first, &revision, law.added);
        let priced =
            proof::deviance(&revision.fit) + law.added as f64 * elementary::ln(motion.degrees_of_freedom);
        Ok(follows.then_some((priced, law.entry.kind, motion, revision)))
    };
    let laws: Vec<&ForceCandidate> = motion.ranked.iter().map(|(_, law)| law).take(HEARD).collect();
    let tried: Vec<Option<_>> = laws.into_par_iter().map(one).collect::<Result<_, FitError>>()?;
    let mut follow: Vec<_> = tried.into_iter().flatten().collect();
    follow.sort_by(|a, b| a.0.total_cmp(&b.0));
    let least = follow.first().map_or(0.0, |best| best.0);
    let mut kinds: Vec<&'static str> =
        follow.iter().take_while(|law| law.0 - least < ALIKE).map(|law| law.1).collect();
    kinds.dedup();
    let best = follow.into_iter().next().map(|(_, _, motion, revision)| {
        let alike =
            if kinds.len() > 1 { kinds.iter().map(|kind| kind.to_string()).collect() } else { vec![] };
        (FreeMotion { alike, ..motion }, revision)
    });
    Ok(best)
}

#[cfg(test)]
mod tests {
    use super::super::discovery::discover;
    use super::super::outcome::Verdict;
    use super::super::tests::models;
    use super::super::verdict::DiscoverOptions;
    use crate::num::never;
    use crate::scene::parse_csv;

    /// Of three discs in one film the lightest alone shows the wind of (.06, -.03) N clearly.
    #[test]
    fn a_wind_in_one_film_of_few_objects_is_no_law_outside_the_library() {
        let text = include_str!("../../tests/data/wind/video_1.csv");
        let scenes = [parse_csv("video_1", text).expect("it is one")];
        let options = DiscoverOptions::default();
        let found = discover(&scenes, &models(&scenes), &options, &never).expect("it runs");
        let told = (found.verdict, found.effects.first().map(|e| e.kind.as_str()));
        assert_eq!(told, (Verdict::EffectFound, Some("uniform_force")), "{}", found.reason);
    }
}
