//! What is wrong with an input: collected, limited in number, and returned all at once.

use std::collections::BTreeMap;

/// Most violations in one error; the others are counted.
pub(super) const MAX_VIOLATIONS: usize = 100;
/// Most violations of one kind in a file of rows; they differ only in numbers and quoted text.
const MAX_OF_A_KIND: usize = 5;
/// Numbers from here on are readable with an exponent.
const MANY_DIGITS: f64 = 1e9;

/// One thing that is wrong with an input: where, and what.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Violation {
    /// Dotted path with indices, such as `objects[3].samples[7].x`.
    pub path: String,
    pub message: String,
}

/// A refused input, with everything that is wrong with it.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{}", lines(.violations))]
pub struct SceneError {
    pub violations: Vec<Violation>,
}

impl SceneError {
    /// An error with a single violation.
    pub(super) fn single(path: impl Into<String>, message: impl Into<String>) -> SceneError {
        SceneError { violations: vec![Violation { path: path.into(), message: message.into() }] }
    }
}

fn lines(violations: &[Violation]) -> String {
    let lines: Vec<String> = violations.iter().map(|v| format!("{}: {}", v.path, v.message)).collect();
    lines.join("\n")
}

/// Collects violations; keeps the first [`MAX_VIOLATIONS`] and counts the others.
#[derive(Default)]
pub(super) struct SceneViolations {
    violations: Vec<Violation>,
    /// Most violations kept of one kind; `None`: all.
    most_of_a_kind: Option<usize>,
    /// For each kind: how many there are, and the index of the last one that is kept.
    kinds: BTreeMap<String, (usize, Option<usize>)>,
    more: usize,
}

/// A number of an input as messages show it: without the hundreds of digits of a large one.
pub(super) fn readable(value: f64) -> String {
    if value.is_finite() && value.abs() >= MANY_DIGITS { format!("{value:e}") } else { value.to_string() }
}

/// Path and message without numbers and quoted text: equal for violations of one kind.
fn kind_of(path: &str, message: &str) -> String {
    let mut quoted = false;
    let alike = |c: &char| {
        quoted ^= *c == '"';
        !quoted && !c.is_ascii_digit() && !matches!(c, '-' | '.')
    };
    path.chars().chain(message.chars()).filter(alike).collect()
}

impl SceneViolations {
    /// For a file of rows: keeps [`MAX_OF_A_KIND`] violations of each kind.
    pub(super) fn of_rows() -> Self {
        SceneViolations { most_of_a_kind: Some(MAX_OF_A_KIND), ..SceneViolations::default() }
    }

    pub(super) fn add(&mut self, path: impl Into<String>, message: impl Into<String>) {
        let (path, message) = (path.into(), message.into());
        let room = self.violations.len() < MAX_VIOLATIONS;
        if let Some(most) = self.most_of_a_kind {
            let (count, last) = self.kinds.entry(kind_of(&path, &message)).or_default();
            *count += 1;
            if *count > most {
                return;
            }
            *last = room.then_some(self.violations.len()).or(*last);
        }
        if room {
            self.violations.push(Violation { path, message });
        } else {
            self.more += 1;
        }
    }

    pub(super) fn is_empty(&self) -> bool {
        self.violations.is_empty()
    }

    /// An error if anything was added.
    pub(super) fn finish(mut self) -> Result<(), SceneError> {
        if self.violations.is_empty() {
            return Ok(());
        }
        let most = self.most_of_a_kind.unwrap_or(usize::MAX);
        for (count, last) in self.kinds.into_values().filter(|(count, _)| *count > most) {
            if let Some(kept) = last.and_then(|at| self.violations.get_mut(at)) {
                kept.message += &format!(" (and {} more like these)", count - most);
            }
        }
        if self.more > 0 {
            let message = format!("and {} more violations; correct these first", self.more);
            self.violations.push(Violation { path: "...".to_string(), message });
        }
        Err(SceneError { violations: self.violations })
    }

    pub(super) fn finite(&mut self, path: impl FnOnce() -> String, value: f64, most: f64, unit: &str) {
        if !value.is_finite() {
            self.add(path(), format!("is {value}; give a finite number"));
        } else if value.abs() > most {
            self.add(path(), format!("is {}; it must lie within {most:e} {unit}", readable(value)));
        }
    }

    pub(super) fn within(
        &mut self,
        path: impl FnOnce() -> String,
        value: f64,
        [low, high]: [f64; 2],
        unit: &str,
    ) {
        if !(low..=high).contains(&value) {
            self.add(path(), format!("is {}; it must be from {low:e} to {high:e} {unit}", readable(value)));
        }
    }
}
