//! The interval of an amplitude that the data bound from below only: friction that stops the slip at every contact changes nothing
//! where it is larger. The profile of the likelihood tells it (Pawitan, In All Likelihood, 2001, sec. 3.4): a number whose
//! profile does not rise up to the parameter's bound has no upper end.

use super::revise::{chi_squares, sum};
use super::weak_form::WeakFormRegression;
use crate::effects::{EffectEntry, Hook};
use crate::fit::{Fit, FitError, FitOptions, StartPoint, estimate};
use crate::num::{NINETY_FIVE, Stop};
use crate::world::Model;

/// Iterations of a fit with the amplitude fixed, which begins at the best point.
const ITERATIONS: usize = 8;
/// Halvings that find the lower end.
const HALVINGS: usize = 6;

/// An amplitude that is known from below only.
pub struct OpenAbove {
    pub low: f64,
    /// The parameter's own bound.
    pub high: f64,
}

/// The interval of the first amplitude of a law of contact between objects, where the trajectories of the fit do not bound it from
/// above; `None` where they do.
pub fn open_above(
    lens: &WeakFormRegression,
    fit: &Fit,
    entry: &EffectEntry,
    value: f64,
    options: &FitOptions,
    stop: Stop,
) -> Result<Option<OpenAbove>, FitError> {
    let Some(amplitude) = entry.spec.params.first() else { return Ok(None) };
    let is_contact = entry.uses(Hook::Contact) && !entry.uses(Hook::Bodies);
    if !is_contact || entry.all_or_nothing().is_some() || value <= 0.0 || value >= amplitude.max {
        return Ok(None);
    }
    let at = |value: f64, max_iterations: usize| -> Result<f64, FitError> {
        let fixed = fixed_at(fit, entry, value);
        let near = FitOptions { start_point: StartPoint::NearOptimum, max_iterations, ..*options };
        Ok(sum(&chi_squares(&estimate(lens.scenes, &fixed, &near, stop)?)))
    };
    let degrees: usize = fit.scenes.iter().map(|s| s.degrees_of_freedom).sum();
    let known = at(value, 0)?;
    let rise = NINETY_FIVE * NINETY_FIVE * (known / degrees.max(1) as f64).max(1.0);
    if at(amplitude.max, 0)?.min(at(amplitude.max, ITERATIONS)?) > known + rise {
        return Ok(None);
    }
    let (mut low, mut inside) = (0.0, value);
    for _ in 0..HALVINGS {
        let middle = 0.5 * (low + inside);
        if at(middle, ITERATIONS)? > known + rise { low = middle } else { inside = middle }
    }
    Ok(Some(OpenAbove { low, high: amplitude.max }))
}

/// The models of a fit with a law's first amplitude fixed.
fn fixed_at(fit: &Fit, entry: &EffectEntry, value: f64) -> Vec<Model> {
    let mut models = fit.models();
    for active in models.iter_mut().flat_map(|m| &mut m.effects).filter(|e| e.name == entry.spec.name) {
        if let Some(p) = active.parameters.first_mut() {
            p.values.fill(value);
            p.prior.sd = 0.0;
        }
    }
    models
}

#[cfg(test)]
mod tests {
    use super::super::contact_law::with_contact;
    use super::super::revise::revise;
    use super::super::screen::{region, with_nuisance};
    use super::super::tests::{DISC, film, models};
    use super::super::verdict::DiscoverOptions;
    use super::*;
    use crate::effects::effect;
    use crate::num::never;

    /// Slip of a contact stops from a third of the tangent of the angle at which discs meet on: 0.1 for a fifth of their diameter.
    #[test]
    fn friction_that_stops_the_slip_is_known_from_below_only() {
        let entry = effect("contact_friction").expect("it is in the library");
        let meeting = |aside: f64| {
            move |v: f64| vec![(DISC, 0.6, [-1.0, aside], [v, 0.0]), (DISC, 0.6, [0.0, 0.0], [0.0, 0.0])]
        };
        let interval = |mu: f64, aside: f64| {
            let scenes =
                film(&[1.0, 1.4, 1.8].map(meeting(aside)), Some(("contact_friction", &[("mu", mu)])));
            let (lens, region) = (WeakFormRegression::new(&scenes), region(&scenes));
            let with = with_contact(&with_nuisance(&models(&scenes)), entry, &[mu, 0.0, 0.0], None, &region);
            let options = DiscoverOptions::default().fit;
            let revision = revise(&lens, &with, Some(entry.spec.name), &options, &never).expect("it runs");
            open_above(&lens, &revision.fit, entry, mu, &options, &never).expect("it runs")
        };
        let open = interval(0.6, 0.1).expect("it sticks");
        assert!(open.low < 0.6 && open.low > 0.02 && open.high == 2.0, "{}", open.low);
        assert!(interval(0.05, 0.25).is_none(), "it slips");
    }
}
