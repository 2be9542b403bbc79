//! The information that the lessons of videos have of the weights (see `moderated`).

use super::run::{PRESUPPOSED_WEIGHT, feature_count, logits_of, run};
use crate::concepts::lessons::{PreparedVideo, RecordedLoss, RunItems};
use crate::concepts::lexicon::LearnedFamily;
use crate::concepts::moderated::{InformationSum, input};
use crate::concepts::tape::{LEAST, Variable};
use nalgebra::DVector;
use rayon::prelude::*;

/// Derivatives of the logarithm of a probability by the logits of all words, with the weight of its information.
type WeightedGradient = (Vec<f64>, f64);

/// Sets the information that the lessons of these videos have of the weights of each family.
pub fn inform(families: &mut [LearnedFamily], videos: &[PreparedVideo], used: &[usize]) {
    let of_video = |v: &usize| {
        let video = videos.get(*v)?;
        let logits = logits_of(families, video);
        let run = run(video, families, &logits, (RunItems::Simulated, None)).ok()?;
        Some((video, information(&run)))
    };
    let each: Vec<Option<(&PreparedVideo, Vec<WeightedGradient>)>> = used.par_iter().map(of_video).collect();
    let length = feature_count(videos);
    let mut sums: Vec<InformationSum> =
        families.iter().map(|f| InformationSum::new(f.words.len(), length)).collect();
    for (video, all) in each.iter().flatten() {
        let inputs: Vec<DVector<f64>> = video.features.iter().map(|f| input(f)).collect();
        for (gradient, weight) in all {
            let mut rest = &gradient[..];
            for (family, sum) in families.iter().zip(&mut sums) {
                let words = family.words.len();
                let (own, others) = rest.split_at((words * inputs.len()).min(rest.len()));
                add(sum, words, &inputs, (own, *weight));
                rest = others;
            }
        }
    }
    for (family, sum) in families.iter_mut().zip(sums) {
        family.information = Some(sum.finish());
    }
}

/// Adds `h_w = sum_o g_ow x_o` of each word of a family.
fn add(sum: &mut InformationSum, words: usize, inputs: &[DVector<f64>], (gradient, weight): (&[f64], f64)) {
    for word in 0..words {
        let own = || gradient.iter().skip(word).step_by(words);
        if own().all(|g| *g == 0.0) {
            continue;
        }
        let mut h = DVector::zeros(inputs.first().map_or(0, |x| x.len()));
        own().zip(inputs).for_each(|(g, x)| h.axpy(*g, x, 1.0));
        sum.add(word, &h, weight);
    }
}

/// Of the answers on a tape, and of what they presuppose.
fn information(run: &RecordedLoss) -> Vec<WeightedGradient> {
    let tape = &run.tape;
    let weighted = |v: Variable, weight: f64| -> Option<WeightedGradient> {
        let p = tape.value(v);
        let gradient = tape.gradient(v, &run.logits);
        // g = dP/P, and P/(1 - P) g g^T.
        let scale = weight / (p.max(LEAST) * (1.0 - p).max(LEAST));
        gradient.iter().any(|g| *g != 0.0).then_some((gradient, scale))
    };
    let of = |a: &crate::concepts::lessons::RecordedAnswer| {
        [weighted(a.right, a.weight), weighted(a.presupposed, PRESUPPOSED_WEIGHT * a.weight)]
    };
    run.answers.iter().flat_map(of).flatten().collect()
}
