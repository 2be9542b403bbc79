//! What was found, as a page to look at: one self-contained HTML file, and its pictures as SVG. Data in, text out.

mod chart;
pub mod dashboard;
mod document;
mod look;
mod page;
mod plots;
mod table;
#[cfg(test)]
mod tests;

use crate::discover::Discovery;
use crate::reason::Answer;
use crate::scene::Scene;
use crate::world::Model;

/// What a page is made of.
pub struct Report<'a> {
    /// The videos of the study, in order.
    pub scenes: &'a [Scene],
    pub discovery: &'a Discovery,
    pub answers: &'a [Answered<'a>],
    pub traces: &'a [TraceLink],
}

/// A question, its answer, and the model that it stands on.
pub struct Answered<'a> {
    pub question: &'a str,
    pub scene: &'a Scene,
    pub model: &'a Model,
    /// With its simulations; their ensembles are not looked at.
    pub answer: &'a Answer,
}

/// A trace file and what is in it.
pub struct TraceLink {
    pub name: String,
    /// Where it can be fetched from; `None`: it is only named.
    pub href: Option<String>,
    pub about: String,
}

/// The page, and each of its pictures as `(file name, SVG)`.
pub fn report(report: &Report) -> (String, Vec<(String, String)>) {
    let views = look::Views::of(report);
    let pictures = plots::all(report, &views);
    let strobes = table::strobes(report, &views);
    let files = pictures.iter().chain(&strobes).map(|p| (p.name.clone() + ".svg", p.file()));
    let files: Vec<(String, String)> = files.collect();
    (page::html(report, &views, &pictures), files)
}
