//! A written law as the force lens sees it: its numbers free beside the models' own.

use super::formula::ResidualLaw;
use super::free::FreeParameter;
use super::search::CLEAN;
use super::weak_form::{LensFit, WeakFormRegression, fit_forces};
use crate::effects::formula::Formula;
use crate::world::{ActiveEffect, Model, Prior};

/// The models with a user's law, its parameters free within their bounds.
fn with_formula(models: &[Model], name: &str, formula: &Formula) -> Vec<Model> {
    let one = |model: &Model| {
        let mut model = model.clone();
        if let Ok(mut active) = ActiveEffect::of_formula(name, formula.clone(), &model.bodies) {
            for (parameter, spec) in active.parameters.iter_mut().zip(&formula.parameters) {
                parameter.prior = Prior { mean: spec.default, sd: spec.max - spec.min };
            }
            model.effects.push(active);
        }
        model
    };
    models.iter().map(one).collect()
}

/// The models with a law of this name, and what the lens sees of them.
pub fn fit_written(
    lens: &WeakFormRegression,
    models: &[Model],
    name: &str,
    formula: &Formula,
) -> (Vec<Model>, Vec<FreeParameter>, LensFit) {
    let with = with_formula(models, name, formula);
    let (free, seen) = fit_forces(lens, &with);
    (with, free, seen)
}

/// The law with all of its numbers and the models' fitted at once: a strong law bends the models' far from where they stood
/// without it, and the search, which is linear, sees it from there. `None` where it has no value.
pub fn refitted(lens: &WeakFormRegression, models: &[Model], law: &ResidualLaw) -> Option<ResidualLaw> {
    const NAME: &str = "proposed";
    let formula = Formula::new(&law.text, vec![]).ok()?;
    let (with, mut free, mut seen) = fit_written(lens, models, NAME, &formula);
    // Masses that nobody gave suit any law a little: they are told by one that leaves noise.
    if free.iter().any(|f| f.log) && seen.chi_square > (1.0 + CLEAN) * lens.degrees_of_freedom() as f64 {
        free.retain(|f| !f.log);
        seen = lens.fit(&with, &free);
    }
    let number = |name: &str| {
        let full = format!("{NAME}.{name}");
        Some(seen.values[free.iter().position(|f| f.name == full)?])
    };
    let cost = Some(seen.cost).filter(|cost| cost.is_finite())?;
    Some(ResidualLaw { text: with_numbers(&law.text, number), cost, ..law.clone() })
}

/// A law's text with other numbers for the parameters that it declares.
pub fn with_numbers(text: &str, number: impl Fn(&str) -> Option<f64>) -> String {
    let renewed = |part: &str| -> Option<String> {
        let (declared, value) = part.strip_prefix("let ")?.split_once(" = ")?;
        let number = number(declared.split(' ').next()?)?;
        let bounds = value.find(" from ").map_or("", |at| &value[at..]);
        Some(format!("let {declared} = {number:.4e}{bounds}"))
    };
    let parts = text.split("; ").map(|part| renewed(part).unwrap_or_else(|| part.to_string()));
    parts.collect::<Vec<_>>().join("; ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_declared_numbers_are_renewed() {
        let text = "let c1 = -1.0000e-1; let n = -2 from -6 to 4; ax = c1*x^n + 3; ay = c1*y";
        let renewed = with_numbers(text, |name| match name {
            "c1" => Some(0.25),
            "n" => Some(-1.5),
            _ => None,
        });
        let wanted = "let c1 = 2.5000e-1; let n = -1.5000e0 from -6 to 4; ax = c1*x^n + 3; ay = c1*y";
        assert_eq!(renewed, wanted);
        assert!(Formula::new(&renewed, vec![]).is_ok());
    }
}
