//! The accuracy of answers by type of question, and how well the stated probabilities are calibrated.

use super::questions::{list, word};
use crate::cli::output;
use crate::num::elementary;
use crate::num::share_interval;
use serde_json::Value;
use std::collections::BTreeMap;

/// Whether an answer is the right one.
pub fn same(given: Option<&Value>, right: &str) -> bool {
    given.is_some_and(|g| word(g).trim().eq_ignore_ascii_case(right.trim()))
}

/// Number of right answers, and of all.
#[derive(Default, Clone, Copy)]
struct Share(usize, usize);

impl Share {
    fn add(&mut self, right: bool) {
        self.0 += right as usize;
        self.1 += 1;
    }

    /// The share with its 95 % Wilson interval.
    fn text(self) -> String {
        let [low, high] = share_interval(self.0, self.1);
        let [p, low, high] = [self.0 as f64 / self.1 as f64, low, high].map(|x| 100.0 * x);
        format!("{p:.1} % [{low:.1}, {high:.1}] of {}", self.1)
    }
}

/// Upper ends of the bins of the reliability table.
const BINS: [f64; 7] = [0.02, 0.1, 0.3, 0.7, 0.9, 0.98, 1.0];

/// Accuracy by type of question, per option and per question, and the stated probabilities.
#[derive(Default)]
pub struct Scores {
    by_type: BTreeMap<String, [Share; 2]>,
    /// The stated probability of each option, and whether the option was right.
    stated: Vec<(f64, bool)>,
}

impl Scores {
    /// Counts a question that has a right answer; a missing answer counts as wrong. Says whether all of it is right.
    pub fn add(&mut self, question: &Value, given: Option<&Value>, probabilities: &[f64]) -> Option<bool> {
        let mut options = vec![];
        let mut stated = probabilities.iter();
        for choice in list(&question["choices"]) {
            let right = choice["answer"].as_str()?;
            self.stated.extend(stated.next().map(|p| (*p, right.eq_ignore_ascii_case("correct"))));
            options.push(same(given.and_then(|g| g.get(word(&choice["choice_id"]))), right));
        }
        if options.is_empty() {
            if question["answer"].is_null() {
                return None;
            }
            let right = same(given, &word(&question["answer"]));
            self.stated.extend(stated.next().map(|p| (*p, right)));
            options.push(right);
        }
        for name in [question["question_type"].as_str().unwrap_or("untyped"), "all"] {
            let [of_options, of_questions] = self.by_type.entry(name.to_string()).or_default();
            options.iter().for_each(|right| of_options.add(*right));
            of_questions.add(options.iter().all(|right| *right));
        }
        Some(options.iter().all(|right| *right))
    }

    pub fn table(&self) -> String {
        let (all, types): (Vec<_>, Vec<_>) = self.by_type.iter().partition(|(name, _)| *name == "all");
        let row =
            |(name, shares): (&String, &[Share; 2])| vec![name.clone(), shares[0].text(), shares[1].text()];
        let rows: Vec<Vec<String>> = types.into_iter().chain(all).map(row).collect();
        if rows.is_empty() {
            return "  the questions have no right answers, so nothing is scored\n".into();
        }
        output::table(&["type", "per option [95 %]", "per question [95 %]"], &rows)
    }

    /// The reliability diagram as a table (DeGroot and Fienberg 1983), with the Brier score: the mean squared
    /// difference between stated probability and outcome.
    pub fn reliability(&self) -> String {
        if self.stated.is_empty() {
            return String::new();
        }
        let mut rows = vec![];
        let mut low = 0.0;
        for high in BINS {
            let within = |p: f64| p <= high && (p > low || low == 0.0);
            let bin: Vec<(f64, bool)> = self.stated.iter().filter(|(p, _)| within(*p)).copied().collect();
            if !bin.is_empty() {
                let mut share = Share::default();
                bin.iter().for_each(|(_, came)| share.add(*came));
                let mean = bin.iter().map(|(p, _)| p).sum::<f64>() / bin.len() as f64;
                rows.push(vec![format!("{:.1} %", 100.0 * mean), share.text()]);
            }
            low = high;
        }
        let miss = |(p, came): &(f64, bool)| elementary::powi(p - f64::from(u8::from(*came)), 2);
        let brier = self.stated.iter().map(miss).sum::<f64>() / self.stated.len() as f64;
        let table = output::table(&["stated probability", "came true [95 %]"], &rows);
        format!("\n{table}  Brier score {brier:.4} (0: perfect; 0.25: guessing)\n")
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn answers_are_counted_by_option_and_by_question() {
        let choices = json!([{ "choice_id": 0, "answer": "correct" }, { "choice_id": 1, "answer": "wrong" }]);
        let several = json!({ "question_type": "predictive", "choices": choices });
        let open = json!({ "question_type": "descriptive", "answer": "2" });
        let mut scores = Scores::default();
        scores.add(&several, Some(&json!({ "0": "correct", "1": "correct" })), &[0.9, 0.6]);
        scores.add(&several, Some(&json!({ "0": "correct", "1": "wrong" })), &[0.9, 0.1]);
        scores.add(&open, Some(&json!("2")), &[1.0]);
        scores.add(&open, None, &[]);
        scores.add(&json!({ "question_type": "descriptive" }), Some(&json!("3")), &[1.0]);
        assert_eq!(scores.stated, [(0.9, true), (0.6, false), (0.9, true), (0.1, false), (1.0, true)]);
        assert!(
            scores.reliability().ends_with("Brier score 0.0780 (0: perfect; 0.25: guessing)\n"),
            "{}",
            scores.reliability()
        );
        insta::assert_snapshot!(scores.table(), @r"
          type                per option [95 %]       per question [95 %]
          ───────────────────────────────────────────────────────────────
          descriptive   50.0 % [9.5, 90.5] of 2   50.0 % [9.5, 90.5] of 2
          predictive   75.0 % [30.1, 95.4] of 4   50.0 % [9.5, 90.5] of 2
          all          66.7 % [30.0, 90.3] of 6  50.0 % [15.0, 85.0] of 4
        ");
    }
}
