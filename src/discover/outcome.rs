//! What a discovery says: verdict, effects with intervals, ranking, revisions; plain data.

use super::revise::Revision;
use crate::effects::{EffectEntry, Hook, Quantity, effect};
use crate::fit::Fit;
pub use crate::num::NINETY_FIVE;
use crate::num::{Vec2, elementary};
use serde::{Deserialize, Serialize};

#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "SCREAMING_SNAKE_CASE")]
pub enum Verdict {
    /// The effects named explain what the model lacked.
    EffectFound,
    /// Something acts, but these videos cannot tell which of some laws it is.
    Ambiguous,
    /// Nothing is missing at this noise.
    Adequate,
    /// Structure remains that no law of the library explains.
    OutsideLibrary,
    /// Too little motion or data.
    NotIdentifiable,
}

/// The whole answer.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Discovery {
    pub verdict: Verdict,
    /// In the order in which they were added.
    pub effects: Vec<FoundEffect>,
    /// Best first.
    pub ranked: Vec<RankedEffect>,
    /// Sets of kinds that these videos cannot tell apart.
    pub ambiguous: Vec<Vec<String>>,
    /// The launch that would tell them apart.
    pub experiment: Option<Experiment>,
    /// The law that remains, where no effect of the library is it and it halves the error on frames that it has not seen.
    pub formula: Option<String>,
    /// The smallest effect of each kind that would have been seen, where nothing is missing.
    pub smallest: Vec<DetectionLimit>,
    /// Measurement noise of a position, all scenes pooled (m).
    pub noise_sigma: f64,
    /// The first is the model without any effect added.
    pub revisions: Vec<Revision>,
    /// One sentence for people: why this verdict, and what to film next where something is open.
    pub reason: String,
}

impl Discovery {
    /// Whether it names a thing that nobody saw.
    pub(super) fn names_unseen_bodies(&self) -> bool {
        self.effects.iter().any(|e| effect(&e.effect).is_some_and(|e| e.uses(Hook::Bodies)))
    }
}

/// Whether the 95 % interval of a number holds none.
pub fn may_be_none(value: f64, sd: f64) -> bool {
    value.abs() < NINETY_FIVE * sd
}

/// An effect that was added, its parameters as reports name them.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct FoundEffect {
    /// Kind as reports name it; `effect` is its name in the library.
    pub kind: String,
    pub effect: String,
    pub parameters: Vec<ParameterEstimate>,
    /// Of a formula: its text.
    #[serde(default)]
    pub text: Option<String>,
    /// Name and standard deviation of each of the law's own parameters (in its unit); the intervals follow from these.
    #[serde(default)]
    pub deviations: Vec<(String, f64)>,
    /// Whether the 95 % intervals of all its amplitudes hold zero: it may well be absent.
    #[serde(default)]
    pub uncertain: bool,
}

impl FoundEffect {
    /// A law of the library.
    pub fn of(entry: &EffectEntry, parameters: Vec<ParameterEstimate>) -> FoundEffect {
        let (kind, effect) = (entry.kind.into(), entry.spec.name.into());
        FoundEffect { kind, effect, parameters, text: None, deviations: vec![], uncertain: false }
    }

    /// A law of the library with a value and a standard deviation for each of its parameters.
    pub fn with_numbers(entry: &EffectEntry, values: &[f64], sd: &[f64]) -> FoundEffect {
        let names = entry.spec.params.iter().map(|p| p.name.to_string());
        let deviations = names.zip(sd.iter().copied()).collect();
        // Whether a body is there is no amplitude, nor is what acts fully or not at all.
        let has_amplitude = !entry.uses(Hook::Bodies) && entry.all_or_nothing().is_none();
        let mut amplitudes = values.iter().zip(sd).take(entry.amplitudes);
        let uncertain = has_amplitude && amplitudes.all(|(&value, &sd)| may_be_none(value, sd));
        FoundEffect { deviations, uncertain, ..FoundEffect::of(entry, reported(entry, values, sd)) }
    }

    /// Gives the fit of the effect's revision the same standard deviations: its own are those of the noise alone, and do not hold
    /// how far the videos disagree.
    pub fn widen(&self, fit: &mut Fit) {
        self.deviations.iter().for_each(|(parameter, sd)| fit.widen(&self.effect, parameter, *sd));
    }

    /// The number that a parameter has.
    pub fn number(&self, parameter: &str) -> Option<f64> {
        let told = self.parameters.iter().find(|p| p.name == parameter)?;
        if let ParameterValue::Number(number) = told.value { Some(number) } else { None }
    }
}

/// One parameter with its 95 % interval.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ParameterEstimate {
    pub name: String,
    /// Empty where a report turns the parameter into another quantity.
    pub unit: String,
    pub value: ParameterValue,
    pub low: ParameterValue,
    pub high: ParameterValue,
    /// Standard deviation of each number; none of a word.
    #[serde(default)]
    pub sd: Vec<f64>,
    /// Whose it is, where objects differ in it.
    #[serde(default)]
    pub owner: Option<ParameterOwner>,
}

/// An object that has a parameter of its own.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct ParameterOwner {
    pub object: u32,
    /// Index of the scene that it is in; `None`: it has this number wherever an object of its id is.
    pub scene: Option<usize>,
    /// Whether the data, and not what was believed, determine the number.
    pub identified: bool,
}

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(untagged)]
pub enum ParameterValue {
    Number(f64),
    Vector([f64; 2]),
    Word(String),
}

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RankedEffect {
    pub kind: String,
    pub effect: String,
    /// In free motion, against the model without it, the price of its parameters paid (nats); `None`: not measured there.
    pub log_evidence: Option<f64>,
    /// The same in windows around contacts. The two are of different data and are never compared.
    #[serde(default)]
    pub contact_log_evidence: Option<f64>,
    /// In free motion, each video left out in turn (m); `None`: not measured.
    pub held_out_rmse: Option<f64>,
}

impl RankedEffect {
    /// What free motion says of an effect.
    pub fn of_free_motion(kind: &str, effect: &str, log_evidence: f64, held_out_rmse: f64) -> RankedEffect {
        let (log_evidence, held_out_rmse) = (Some(log_evidence), Some(held_out_rmse));
        RankedEffect {
            kind: kind.into(),
            effect: effect.into(),
            log_evidence,
            contact_log_evidence: None,
            held_out_rmse,
        }
    }

    /// What windows around contacts say of an effect: they were all fitted, so that no error is of data left out.
    pub fn of_contacts(kind: &str, effect: &str, log_evidence: f64) -> RankedEffect {
        let contact_log_evidence = Some(log_evidence);
        RankedEffect {
            kind: kind.into(),
            effect: effect.into(),
            log_evidence: None,
            contact_log_evidence,
            held_out_rmse: None,
        }
    }

    /// An effect that whole trajectories alone show, as `revision` has it: neither free motion nor contacts give its evidence.
    pub fn of_trajectories(kind: &str, effect: &str, revision: &Revision) -> RankedEffect {
        let held_out_rmse = Some(revision.left_out_rmse);
        RankedEffect {
            kind: kind.into(),
            effect: effect.into(),
            log_evidence: None,
            contact_log_evidence: None,
            held_out_rmse,
        }
    }
}

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct DetectionLimit {
    pub kind: String,
    pub effect: String,
    /// The amplitude, in its unit.
    pub parameter: String,
    pub value: f64,
    pub unit: String,
}

/// A launch, and how far apart the laws would bring the object.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Experiment {
    pub shape: String,
    /// kg.
    pub mass: f64,
    /// m and m/s.
    pub position: Vec2,
    pub velocity: Vec2,
    /// After how long to look (s).
    pub time: f64,
    /// Distance between the two predictions in deviations of a measurement.
    pub sigmas: f64,
}

/// Parameters as reports name them, with intervals from independent deviations, within their bounds.
pub fn reported(entry: &EffectEntry, values: &[f64], sd: &[f64]) -> Vec<ParameterEstimate> {
    let at = (entry.report)(values);
    let one = |(which, (name, quantity)): (usize, &(&'static str, Quantity))| {
        let component = |q: &Quantity, c: usize| match q {
            Quantity::Number(v) => *v,
            Quantity::Vector(v) => v[c],
            Quantity::Word(_) => 0.0,
        };
        let deviation = |c: usize| {
            let squares: f64 = (0..values.len())
                .map(|k| {
                    let mut moved = values.to_vec();
                    let step = 1e-3 * sd[k].max(1e-12);
                    moved[k] += step;
                    let there = (entry.report)(&moved);
                    let slope = (component(&there[which].1, c) - component(quantity, c)) / step;
                    elementary::powi(slope * sd[k], 2)
                })
                .sum();
            squares.sqrt()
        };
        let own =
            entry.spec.params.iter().find(|p| p.name == *name || p.name.strip_suffix("_x") == Some(*name));
        let deviations: Vec<f64> = match quantity {
            Quantity::Number(_) => vec![deviation(0)],
            Quantity::Vector(_) => vec![deviation(0), deviation(1)],
            Quantity::Word(_) => vec![],
        };
        let (value, low, high) = match quantity {
            Quantity::Number(v) => {
                let d = NINETY_FIVE * deviations[0];
                let [least, most] = own.map_or_else(|| reach(entry, which), |p| [p.min, p.max]);
                (
                    ParameterValue::Number(*v),
                    ParameterValue::Number((v - d).max(least)),
                    ParameterValue::Number((v + d).min(most)),
                )
            }
            Quantity::Vector([x, y]) => {
                let (dx, dy) = (NINETY_FIVE * deviations[0], NINETY_FIVE * deviations[1]);
                (
                    ParameterValue::Vector([*x, *y]),
                    ParameterValue::Vector([x - dx, y - dy]),
                    ParameterValue::Vector([x + dx, y + dy]),
                )
            }
            Quantity::Word(word) => {
                let word = ParameterValue::Word(word.to_string());
                (word.clone(), word.clone(), word)
            }
        };
        let unit = own.map(|p| p.unit).unwrap_or_default().to_string();
        ParameterEstimate { name: name.to_string(), unit, value, low, high, sd: deviations, owner: None }
    };
    at.iter().enumerate().map(one).collect()
}

/// How far a quantity reaches that a report makes of a law's only parameter: a factor of mass is never negative.
fn reach(entry: &EffectEntry, which: usize) -> [f64; 2] {
    let at = |value: f64| match (entry.report)(&[value]).get(which) {
        Some((_, Quantity::Number(v))) if !v.is_nan() => Some(*v),
        _ => None,
    };
    let ends = match entry.spec.params {
        [only] => at(only.min).zip(at(only.max)),
        _ => None,
    };
    ends.map_or([f64::NEG_INFINITY, f64::INFINITY], |(a, b)| [a.min(b), a.max(b)])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::effect;

    #[test]
    fn intervals_keep_to_the_bounds() {
        let wall = effect("hidden_wall").expect("it is in the library");
        let values: Vec<f64> = wall.spec.params.iter().map(|p| p.default).collect();
        let told = reported(wall, &values, &vec![5.0; values.len()]);
        let restitution = told.iter().find(|r| r.name == "restitution").expect("it is told");
        assert_eq!(
            (&restitution.low, &restitution.high),
            (&ParameterValue::Number(0.0), &ParameterValue::Number(1.0))
        );
        // Nor does what a report makes of a parameter: the factor of 1 + excess.
        let factor = &reported(effect("mass_change").expect("it is in the library"), &[0.0], &[10.0])[0];
        let ParameterValue::Number(low) = factor.low else { panic!("{factor:?}") };
        assert!(low > 0.0 && low < 0.1, "{factor:?}");
    }

    /// A spring whose centre runs away is a wind; a wall has no amplitude.
    #[test]
    fn a_law_is_uncertain_where_its_amplitude_may_be_zero() {
        let of = |name: &str, sd: f64| {
            let entry = effect(name).expect("it is in the library");
            let values: Vec<f64> = entry.spec.params.iter().map(|_| 0.3).collect();
            FoundEffect::with_numbers(entry, &values, &vec![sd; values.len()]).uncertain
        };
        assert_eq!(
            [of("attractor_spring", 0.16), of("attractor_spring", 0.15), of("hidden_wall", 0.16)],
            [true, false, false]
        );
    }
}
