//! Writes the result of a discovery as one self-contained HTML page, and its pictures as SVG. Data in, text out.

mod chart;
pub mod dashboard;
mod document;
pub mod login;
mod numbers;
mod page;
mod plots;
mod stills;
#[cfg(test)]
mod tests;
mod top_view;
mod views;
mod words;

pub use numbers::step_words;

use crate::discover::Discovery;
use crate::media::Still;
use crate::num::{Stop, Stopped};
use crate::reason::{Answer, WordProbabilities};
use crate::scene::Scene;
use crate::world::Model;

/// The content of a page.
pub struct ReportData<'a> {
    /// The videos of the study, in order.
    pub scenes: &'a [Scene],
    /// Stills of each video; none of one that was not made from a video file.
    pub stills: &'a [Vec<Still>],
    pub discovery: &'a Discovery,
    /// What each revision of the discovery changes, such as `+ tilt`.
    pub steps: &'a [String],
    /// Where the page is of kept models and not of a search: its words.
    pub kept: Option<&'a KeptModels>,
    pub answers: &'a [AnsweredQuestion<'a>],
    /// How probable the words of a lexicon are, for each video; empty without a lexicon.
    pub words: &'a [WordProbabilities],
    pub traces: &'a [TraceLink],
}

/// The words of a page of kept models.
pub struct KeptModels {
    pub headline: String,
    pub sentence: String,
    /// Names of the first and the last model.
    pub names: [String; 2],
}

/// A question, its answer, and the model that gave it.
pub struct AnsweredQuestion<'a> {
    pub question: &'a str,
    pub scene: &'a Scene,
    pub model: &'a Model,
    /// With its simulations; their ensembles are not used.
    pub answer: &'a Answer,
}

/// A trace file and what is in it.
pub struct TraceLink {
    pub name: String,
    /// The link to the file; `None`: the page only names it.
    pub href: Option<String>,
    pub about: String,
}

/// The page, and each of its pictures as `(file name, SVG)`.
pub fn report(report: &ReportData, stop: Stop) -> Result<(String, Vec<(String, String)>), Stopped> {
    let views = views::ReportViews::of(report);
    stop(0.2)?;
    let mut pictures = plots::all(report, &views);
    stop(0.4)?;
    pictures.extend(stills::all(report, &views));
    stop(0.6)?;
    let strobes = top_view::strobes(report, &views);
    let mut files = vec![];
    for picture in pictures.iter().chain(&strobes) {
        stop(0.8)?;
        files.push((picture.name.clone() + ".svg", picture.file()));
    }
    Ok((page::html(report, &views, &pictures), files))
}
