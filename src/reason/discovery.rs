//! What the model of a video lacks: the answer from a discovery that was run before, as plain data.

use serde::{Deserialize, Serialize};

/// What is kept of a discovery that included the video in question.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct StoredDiscovery {
    pub finding: MissingPart,
    /// Effects found, each with its numbers, such as "quadratic_drag c = 0.120 +- 0.004 kg/m".
    pub effects: Vec<String>,
    /// Sets of effects that the videos cannot tell apart.
    pub alternatives: Vec<Vec<String>>,
    /// The law that no effect of the library is.
    pub formula: Option<String>,
    /// One sentence: why.
    pub reason: String,
    /// How many videos it looked at.
    pub videos: usize,
}

/// The verdict of a discovery, as an answer needs it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum MissingPart {
    /// The effects named.
    Effects,
    /// One of some effects.
    OneOfSeveral,
    /// Nothing at this noise.
    Nothing,
    /// Something that no effect of the library explains.
    NoKnownEffect,
    /// Too little motion or data to tell.
    Undetermined,
}

impl StoredDiscovery {
    /// "yes: quadratic_drag c = 0.120 +- 0.004 kg/m (by a discovery over 3 videos)"; an error says why it is not determined.
    pub fn answer(&self) -> Result<String, String> {
        let list = |names: &[String], word: &str| match names {
            [] => "something".to_string(),
            names => names.join(word),
        };
        let what = match self.finding {
            MissingPart::Effects => format!("yes: {}", list(&self.effects, "; ")),
            MissingPart::OneOfSeveral => {
                let sets: Vec<String> = self.alternatives.iter().map(|set| list(set, " or ")).collect();
                format!("yes: {}, which these videos cannot tell apart", list(&sets, "; "))
            }
            MissingPart::Nothing => "no: nothing is missing at this noise".to_string(),
            MissingPart::NoKnownEffect => {
                let law = self
                    .formula
                    .as_ref()
                    .map_or(String::new(), |f| format!("; this formula is nearest: {f}"));
                format!("yes: something that no effect of the library explains{law}")
            }
            MissingPart::Undetermined => {
                return Err(format!("whether something is missing: {}", self.reason));
            }
        };
        let plural = if self.videos == 1 { "" } else { "s" };
        Ok(format!("{what} (by a discovery over {} video{plural})", self.videos))
    }
}
