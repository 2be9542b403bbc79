//! The table of ranked candidates.

use crate::api::v1::RankedEffect;
use crate::cli::output::{self, revisions};
use crate::discover::FORMULA;

/// What the columns of log evidence mean.
const LOG_EVIDENCE: &str = "  log evidence (nats): gain over the model without the candidate, less the cost of its parameters; above 5 is strong
  between contacts and at contacts it is from different data: compare candidates within one column only
";

/// A table of the best `most` candidates and of all formulas of the user; errors on other videos if there are several `videos`.
pub fn ranking(ranked: &[RankedEffect], most: usize, videos: usize) -> String {
    if ranked.is_empty() {
        return String::new();
    }
    let columns = if videos > 1 { 4 } else { 3 };
    let row = |r: &RankedEffect| {
        let evidence = |value: Option<f64>| value.map(|e| format!("{e:.1}")).unwrap_or_default();
        let error = r.held_out_rmse.map(|e| format!("{:.2}", 1e3 * e)).unwrap_or_default();
        let cells = [r.effect.clone(), evidence(r.log_evidence), evidence(r.contact_log_evidence), error];
        cells[..columns].to_vec()
    };
    let shown = ranked.iter().enumerate().filter(|(k, r)| *k < most || r.kind == FORMULA);
    let rows: Vec<Vec<String>> = shown.map(|(_, r)| row(r)).collect();
    let table = output::table(
        &["candidate", "log evidence between contacts", "at contacts", "other videos mm"][..columns],
        &rows,
    );
    format!("\n{table}{LOG_EVIDENCE}{}", if videos > 1 { revisions::OTHER_VIDEOS } else { "" })
}
