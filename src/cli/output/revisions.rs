//! The errors of revisions as a table, as bars in a terminal and as an SVG; the drawings mark the noise.

use super::table::table as aligned;
use crate::api::v1::{Model, Revision, Worth};

/// Characters of the longest bar.
const CELLS: usize = 40;
/// Widths of the drawing, of its labels and of its numbers, and height of a row (px).
const WIDTH: f64 = 720.0;
const NAMES: f64 = 200.0;
const NUMBERS: f64 = 80.0;
const ROW: f64 = 34.0;
/// What the columns of the table mean.
pub const HELD_OUT: &str = "  held out: the last quarter of each video, predicted by a fit of the rest\n";
pub const OTHER_VIDEOS: &str =
    "  other videos: motion between contacts, each video predicted with the parameters of the others\n";

/// Against the revision it was made from.
const EVIDENCE: &str = "  log evidence: gain over the revision it was made from, in nats, less the price of its parameters (BIC)\n";

/// Digits of an id in tables.
pub const ID_DIGITS: usize = 8;

/// The first digits of a model's id, of its name.
pub fn short_id(model: &str) -> String {
    model.rsplit('/').next().unwrap_or_default().chars().take(ID_DIGITS).collect()
}

/// The first digits of a revision's id.
pub fn id(r: &Revision) -> String {
    short_id(r.models.first().map_or("", String::as_str))
}

/// The revisions from the first to this one.
pub fn lineage<'r>(known: &[&'r Revision], to: &'r Revision) -> Vec<&'r Revision> {
    let mut lineage = vec![to];
    while let Some(before) = lineage.last().and_then(|r| known.iter().find(|p| p.models == r.parents)) {
        lineage.push(before);
    }
    lineage.reverse();
    lineage
}

/// What a revision changes.
pub fn change(r: &Revision) -> String {
    match (r.effect.as_str(), r.removed.as_str()) {
        ("", "") => "start".into(),
        ("", removed) => format!("- {removed}"),
        (added, _) => format!("+ {added}"),
    }
}

/// What the revision of a model changes; `fit` of a model that was only fitted.
pub fn change_of(model: &Model) -> String {
    model.history.as_ref().map_or("fit".into(), change)
}

/// A table of the errors of revisions, with a legend: the errors on other videos only if there are `several`, the evidence
/// only where a revision was weighed against its parent.
pub fn table(revisions: &[&Revision], several: bool, name: impl Fn(&Revision) -> String) -> String {
    let is_weighed = |r: &Revision| r.worth() != Worth::Unspecified && r.worth() != Worth::NotIdentifiable;
    let weighed = revisions.iter().any(|r| is_weighed(r));
    let mm = |v: f64| format!("{:.2}", 1e3 * v);
    let shown = |cells: [String; 6]| -> Vec<String> {
        let is_shown = |column: usize| (several || column != 2) && (weighed || column != 5);
        cells.into_iter().enumerate().filter(|(column, _)| is_shown(*column)).map(|(_, cell)| cell).collect()
    };
    let header = ["revision", "held out mm", "other videos mm", "rmse mm", "chi-square", "log evidence"];
    let header = shown(header.map(String::from));
    let row = |r: &&Revision| {
        let chi = format!("{:.2}", r.reduced_chi_square);
        let evidence = if is_weighed(r) { format!("{:.1}", r.log_evidence) } else { "-".into() };
        shown([name(r), mm(r.held_out_rmse), mm(r.left_out_rmse), mm(r.rmse), chi, evidence])
    };
    let rows: Vec<Vec<String>> = revisions.iter().map(row).collect();
    let table = aligned(&header.iter().map(String::as_str).collect::<Vec<_>>(), &rows);
    table + HELD_OUT + if several { OTHER_VIDEOS } else { "" } + if weighed { EVIDENCE } else { "" }
}

fn largest(revisions: &[&Revision], noise: f64) -> f64 {
    revisions.iter().map(|r| r.rmse).fold(noise, f64::max).max(f64::MIN_POSITIVE)
}

/// A bar for the error of each revision on all frames, and a mark for the noise (m).
pub fn text(revisions: &[&Revision], noise: f64) -> String {
    let most = largest(revisions, noise);
    let cells = |v: f64| (CELLS as f64 * v / most).round().max(1.0) as usize;
    let floor = cells(noise);
    let bar = |r: &&Revision| {
        let cell = |c| match c {
            c if c == floor => '|',
            c if c <= cells(r.rmse) => '█',
            _ => ' ',
        };
        let drawn: String = (1..=CELLS).map(cell).collect();
        format!("  {:<26} {drawn} {:.2} mm\n", change(r), 1e3 * r.rmse)
    };
    let rows: String = revisions.iter().map(bar).collect();
    format!("{rows}  {:<26} {:>floor$}  noise {:.2} mm\n", "", "|", 1e3 * noise)
}

/// An SVG with two bars for each revision, all frames and held-out frames, and a line for the noise.
pub fn svg(title: &str, revisions: &[&Revision], noise: f64) -> String {
    let most = largest(revisions, noise);
    let most = revisions.iter().map(|r| r.held_out_rmse).fold(most, f64::max);
    let at = |v: f64| NAMES + (WIDTH - NAMES - NUMBERS) * v / most;
    let height = 60.0 + ROW * revisions.len() as f64;
    let mut out = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {WIDTH} {height}\" font-family=\"sans-serif\" \
         font-size=\"13\">\n<rect width=\"{WIDTH}\" height=\"{height}\" fill=\"white\"/>\n\
         <text x=\"10\" y=\"22\" font-weight=\"bold\">{}</text>\n",
        escaped(title)
    );
    for (k, r) in revisions.iter().enumerate() {
        let y = 36.0 + ROW * k as f64;
        let bar = |dy: f64, v: f64, colour: &str| {
            let width = at(v) - NAMES;
            format!(
                "<rect x=\"{NAMES}\" y=\"{}\" width=\"{width:.1}\" height=\"10\" fill=\"{colour}\"/>\n\
                 <text x=\"{:.1}\" y=\"{}\" font-size=\"10\">{:.2} mm</text>\n",
                y + dy,
                at(v) + 5.0,
                y + dy + 9.0,
                1e3 * v
            )
        };
        out += &format!("<text x=\"10\" y=\"{}\">{}</text>\n", y + 15.0, escaped(&change(r)));
        out += &(bar(0.0, r.rmse, "#2b6cb0") + &bar(12.0, r.held_out_rmse, "#90cdf4"));
    }
    let (x, end) = (at(noise), height - 22.0);
    out += &format!(
        "<line x1=\"{x:.1}\" x2=\"{x:.1}\" y1=\"30\" y2=\"{end}\" stroke=\"#c53030\" stroke-dasharray=\"4 3\"/>\n\
         <text x=\"10\" y=\"{}\" font-size=\"10\">dark: all frames; light: held out, the last quarter predicted by a fit of the rest; \
         dashed: noise {:.2} mm</text>\n</svg>\n",
        height - 8.0,
        1e3 * noise
    );
    out
}

fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bars_fall_to_the_noise() {
        let revision = |effect: &str, rmse| Revision { effect: effect.into(), rmse, ..Default::default() };
        let removed = Revision { removed: "tilt".into(), rmse: 0.005, ..Default::default() };
        let all = [revision("", 0.02), revision("coriolis", 0.005), removed];
        let rungs: Vec<&Revision> = all.iter().collect();
        insta::assert_snapshot!(text(&rungs, 0.005), @r"
          start                      █████████|██████████████████████████████ 20.00 mm
          + coriolis                 █████████|                               5.00 mm
          - tilt                     █████████|                               5.00 mm
                                              |  noise 5.00 mm
        ");
        let errors = |several| table(&rungs, several, change);
        assert!(errors(true).contains("other videos") && !errors(false).contains("other videos"));
        let drawn = svg("a <b>", &rungs, 0.005);
        assert!(drawn.contains("a &lt;b&gt;") && drawn.contains("+ coriolis") && drawn.ends_with("</svg>\n"));
    }
}
