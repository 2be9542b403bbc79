//! What stored discoveries say of the model of a video.

use crate::discover::{Discovery, FoundEffect, ParameterValue, Verdict};
use crate::engine::error::EngineError;
use crate::engine::results::{Findings, Study};
use crate::engine::state::Engine;
use crate::reason::{MissingPart, StoredDiscovery};
use crate::store::TableKind;

impl Engine {
    /// The stored discovery over the most videos, this one among them.
    pub(super) async fn discovery_of(&self, video: &str) -> Result<Option<StoredDiscovery>, EngineError> {
        let named = video.to_string();
        let includes = move |study: &Study| {
            matches!(study.findings, Findings::Discovery(_)) && study.videos.contains(&named)
        };
        let studies = self.store.list(TableKind::Studies, "", "", usize::MAX, includes).await?;
        let widest = studies.into_iter().map(|(_, study)| study).max_by_key(|study| study.videos.len());
        Ok(widest.and_then(|study| match study.findings {
            Findings::Discovery(found) => Some(summary(&found.discovery, study.videos.len())),
            _ => None,
        }))
    }
}

fn summary(found: &Discovery, videos: usize) -> StoredDiscovery {
    let finding = match found.verdict {
        Verdict::EffectFound => MissingPart::Effects,
        Verdict::Ambiguous => MissingPart::OneOfSeveral,
        Verdict::Adequate => MissingPart::Nothing,
        Verdict::OutsideLibrary => MissingPart::NoKnownEffect,
        Verdict::NotIdentifiable => MissingPart::Undetermined,
    };
    StoredDiscovery {
        finding,
        effects: found.effects.iter().map(effect_words).collect(),
        alternatives: found.ambiguous.clone(),
        formula: found.formula.clone(),
        reason: found.reason.clone(),
        videos,
    }
}

/// "linear_drag: c = 0.121 kg/s (0.118 to 0.124)".
fn effect_words(effect: &FoundEffect) -> String {
    let number = |value: &ParameterValue| match value {
        ParameterValue::Number(v) => format!("{v:.3e}").parse::<f64>().unwrap_or(*v).to_string(),
        ParameterValue::Vector([x, y]) => format!("({x:.3}, {y:.3})"),
        ParameterValue::Word(word) => word.clone(),
    };
    let words = effect.parameters.iter().map(|p| match p.value {
        ParameterValue::Word(_) => format!("{} = {}", p.name, number(&p.value)),
        _ => {
            let unit = if p.unit.is_empty() { String::new() } else { format!(" {}", p.unit) };
            format!("{} = {}{unit} ({} to {})", p.name, number(&p.value), number(&p.low), number(&p.high))
        }
    });
    let words: Vec<String> = words.collect();
    if words.is_empty() { effect.kind.clone() } else { format!("{}: {}", effect.kind, words.join(", ")) }
}
