//! The words of a lexicon on a page: how probable each is of each object, as bars, and what a change multiplies.

use super::top_view::name;
use crate::reason::{ChangedQuantity, WordProbabilities};
use crate::scene::Scene;
use maud::{Markup, html};

/// Length of a full bar (px).
const BAR: f64 = 60.0;

/// Which objects each word fits and which it does not, for each video.
pub fn words(scenes: &[Scene], words: &[WordProbabilities]) -> Markup {
    html! {
        section aria-labelledby="words" {
            h2 id="words" { "Words of the lexicon" }
            p { "A bar is the probability that the word fits the object. ✓: it fits rather than not. Of the words of one family, such as \
                 colours, each object has one." }
            @for (k, (scene, words)) in scenes.iter().zip(words).enumerate() {
                details open[k == 0] {
                    summary { (scene.name) }
                    (of_objects(scene, words))
                }
            }
            @if let Some(words) = words.first().filter(|w| !w.changes.is_empty()) { (changes(words)) }
        }
    }
}

fn of_objects(scene: &Scene, words: &WordProbabilities) -> Markup {
    let rows = words.of_objects(scene, &words.vocabulary());
    let mut named: Vec<&str> = rows.iter().map(|r| r.word.as_str()).collect();
    named.dedup();
    html! {
        div class="scroll" { table {
            thead { tr { th { "Word" } @for object in &scene.objects { th { (name(object)) } } } }
            tbody { @for word in named {
                tr { th { (word) }
                    @for row in rows.iter().filter(|r| r.word == word) { td { (bar(row.probability, row.cosine_score)) } } }
            } }
        } }
    }
}

/// P(word) as a bar and a number; the paper's score in its title.
fn bar(probability: f64, cosine_score: Option<f64>) -> Markup {
    let shown = if probability.is_finite() { probability.clamp(0.0, 1.0) } else { 0.0 };
    let score = cosine_score.filter(|s| s.is_finite()).map(|s| format!("cosine score {s:.2}"));
    html! {
        span title=[score] {
            svg width=(BAR) height="10" viewBox=(format!("0 0 {BAR} 10")) role="img" aria-label=(format!("{:.0} %", 100.0 * shown)) {
                rect width=(BAR) height="10" fill="none" stroke="currentColor" opacity="0.3" {}
                rect width=(format!("{:.1}", BAR * shown)) height="10" fill="currentColor" opacity="0.7" {}
            }
            " " (format!("{:.0} %", 100.0 * shown)) @if shown > 0.5 { " ✓" }
        }
    }
}

fn changes(words: &WordProbabilities) -> Markup {
    let quantity = |quantity: ChangedQuantity| match quantity {
        ChangedQuantity::Mass => "mass",
        ChangedQuantity::Velocity => "velocity",
        ChangedQuantity::Restitution => "restitution",
        ChangedQuantity::Friction => "friction",
    };
    html! {
        table {
            thead { tr { th { "Word" } th { "multiplies" } th { "by" } } }
            tbody { @for change in &words.changes {
                tr { th { (change.name) } td { (quantity(change.quantity)) } td { (format!("{:.3}", change.factor)) } }
            } }
        }
    }
}
