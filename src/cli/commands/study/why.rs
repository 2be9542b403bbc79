//! Why an added law makes a model no better, in one sentence.

use crate::api::v1::{FoundParameter, Revision, Worth};
use crate::cli::output;

/// A change of an error by less than this share is none.
const SAME_ERROR: f64 = 0.02;
/// Log evidence (nats) from which a change is certain.
const CERTAIN: f64 = 10.0;

/// The reason why `after`, which adds a law to `before`, is not better; `None` if it is, or if nothing was added.
pub fn not_better(before: &Revision, after: &Revision) -> Option<String> {
    let added = after.added.as_ref()?;
    if !matches!(after.worth(), Worth::NoDifference | Worth::Worse) {
        return None;
    }
    let amplitudes: Vec<&FoundParameter> = added.parameters.iter().filter(|p| is_amplitude(p)).collect();
    if let Some(zero) = amplitudes.first().filter(|_| amplitudes.iter().all(|p| holds_zero(p))) {
        let interval = zero.low.iter().zip(&zero.high).map(|(low, high)| output::interval(*low, *high));
        let unit = if zero.unit == "1" { String::new() } else { format!(" {}", zero.unit) };
        let interval = interval.collect::<Vec<_>>().join(", ");
        return Some(format!(
            "the 95 % interval of {}, {interval}{unit}, holds 0: the law may be absent",
            zero.name
        ));
    }
    let mm = |v: f64| format!("{:.2}", 1e3 * v);
    let grown = |old: f64, new: f64| new > old * (1.0 + SAME_ERROR);
    let errors = [
        ("the held-out frames", before.held_out_rmse, after.held_out_rmse),
        ("other videos", before.left_out_rmse, after.left_out_rmse),
    ];
    // Of one video there are no others.
    let shown = if after.models.len() > 1 { &errors[..] } else { &errors[..1] };
    if let Some((what, old, new)) = shown.iter().find(|(_, old, new)| grown(*old, *new)) {
        return Some(format!(
            "the error on {what} does not fall with it but rises, from {} to {} mm",
            mm(*old),
            mm(*new)
        ));
    }
    let nats = after.log_evidence;
    if before.rmse - after.rmse < SAME_ERROR * before.rmse {
        return Some(format!(
            "another law of the model explains the same: without it the error is {} mm, with it {} mm",
            mm(before.rmse),
            mm(after.rmse)
        ));
    }
    if nats > 0.0 {
        return Some(format!(
            "there are too few data: they favour it by {nats:.1} nats, and {CERTAIN:.0} are needed; record more videos"
        ));
    }
    Some(format!(
        "its gain does not pay for its parameters: the error falls from {} to {} mm only",
        mm(before.rmse),
        mm(after.rmse)
    ))
}

/// Whether a parameter may be an amplitude: a number that the law would not have at 0, such as a strength. Places, exponents
/// and angles have another zero.
fn is_amplitude(parameter: &FoundParameter) -> bool {
    let name = parameter.name.as_str();
    let is_place = parameter.unit == "m" || parameter.unit == "rad";
    !parameter.low.is_empty() && !is_place && name != "object_id"
}

fn holds_zero(parameter: &FoundParameter) -> bool {
    parameter.low.iter().zip(&parameter.high).all(|(low, high)| *low <= 0.0 && *high >= 0.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::api::v1::FoundEffect;

    #[test]
    fn the_sentence_names_what_speaks_against_the_law() {
        let revision = |rmse: f64, held_out: f64, other: f64| Revision {
            rmse,
            held_out_rmse: held_out,
            left_out_rmse: other,
            models: vec!["one".into(), "two".into()],
            ..Default::default()
        };
        let before = revision(0.010, 0.012, 0.011);
        let with = |mut after: Revision, ends: [f64; 2], nats: f64| {
            let k = FoundParameter {
                name: "k".into(),
                unit: "1/s".into(),
                value: vec![0.5 * (ends[0] + ends[1])],
                low: vec![ends[0]],
                high: vec![ends[1]],
                ..Default::default()
            };
            after.added = Some(FoundEffect { parameters: vec![k], ..Default::default() });
            after.log_evidence = nats;
            after.set_worth(Worth::NoDifference);
            not_better(&before, &after).unwrap_or_default()
        };
        let good = revision(0.009, 0.0119, 0.011);
        assert_eq!(
            with(good.clone(), [-0.1, 0.3], 3.0),
            "the 95 % interval of k, [-0.10 to 0.30] 1/s, holds 0: the law may be absent"
        );
        let says = |after: Revision, nats: f64, words: &str| {
            let found = with(after, [0.1, 0.3], nats);
            assert!(found.contains(words), "{words}: {found}");
        };
        says(revision(0.009, 0.014, 0.011), 3.0, "the error on the held-out frames does not fall");
        says(revision(0.009, 0.012, 0.013), 3.0, "the error on other videos does not fall");
        says(revision(0.00999, 0.012, 0.011), -3.0, "another law of the model explains the same");
        says(good.clone(), 3.0, "too few data: they favour it by 3.0 nats");
        says(good, -3.0, "does not pay for its parameters");
        assert_eq!(not_better(&before, &before), None);
    }
}
