//! Errors of commands, and their exit statuses.

use std::fmt;
use tonic_types::StatusExt;

/// A command that failed.
#[derive(Debug)]
pub enum Failure {
    /// Bad input or usage: says what is wrong, where, and what to do.
    Input(String),
    /// Anything else.
    Other(String),
}

impl Failure {
    pub fn input(message: impl Into<String>) -> Self {
        Failure::Input(message.into())
    }

    pub fn other(message: impl fmt::Display) -> Self {
        Failure::Other(message.to_string())
    }

    /// Changes the message.
    pub fn map(self, change: impl FnOnce(String) -> String) -> Self {
        match self {
            Failure::Input(message) => Failure::Input(change(message)),
            Failure::Other(message) => Failure::Other(change(message)),
        }
    }

    /// Adds the name of the file or scene that failed.
    pub fn at(self, place: &str) -> Self {
        self.map(|message| format!("{place}: {message}"))
    }

    /// Combines the failures of `count` scenes or files: bad input if one of them is.
    pub fn combined(mut failures: Vec<Failure>, count: usize) -> Result<(), Failure> {
        if count == 1 {
            return failures.pop().map_or(Ok(()), Err);
        }
        if failures.is_empty() {
            return Ok(());
        }
        let mut message = format!("{} of {count} inputs failed:", failures.len());
        for failure in &failures {
            message += &format!("\n{failure}");
        }
        match failures.iter().any(|f| matches!(f, Failure::Input(_))) {
            true => Err(Failure::Input(message)),
            false => Err(Failure::Other(message)),
        }
    }

    pub fn status(&self) -> u8 {
        match self {
            Failure::Input(_) => 2,
            Failure::Other(_) => 1,
        }
    }
}

impl fmt::Display for Failure {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        match self {
            Failure::Input(message) | Failure::Other(message) => f.write_str(message),
        }
    }
}

/// Fields of requests that a user sets with a flag.
const FLAGS: [(&str, &str); 9] = [
    ("study.start.model_json", "--model"),
    ("study.start", "--model"),
    ("start.model_json", "--model"),
    ("start", "--model"),
    ("model.model_json", "--model"),
    ("study.models", "--on"),
    ("formula.text", "the formula"),
    ("formula.name", "--name"),
    ("rollouts", "--rollouts"),
];

/// A line of a message with the flag in place of the request's field: `start.preset: ...` becomes `--model: ...`.
fn with_flag(line: &str) -> String {
    let text = line.trim_start();
    let indent = &line[..line.len() - text.len()];
    let known = FLAGS.iter().find_map(|(field, flag)| {
        let rest = text.strip_prefix(field)?;
        let rest = rest.strip_prefix(".preset").or_else(|| rest.strip_prefix(".model")).unwrap_or(rest);
        let is_whole = rest.starts_with(['.', ':', '[']);
        is_whole
            .then(|| format!("{indent}{flag}{}", rest.replacen('.', " ", usize::from(rest.starts_with('.')))))
    });
    known.unwrap_or_else(|| line.to_string())
}

impl From<tonic::Status> for Failure {
    fn from(status: tonic::Status) -> Self {
        let mut message = status.message().to_string();
        if let Some(bad) = status.get_details_bad_request() {
            for violation in bad.field_violations {
                let line = format!("{}: {}", violation.field, violation.description);
                if message != line {
                    message += &format!("\n  {line}");
                }
            }
        }
        let message = message.lines().map(with_flag).collect::<Vec<_>>().join("\n");
        match status.code() {
            tonic::Code::InvalidArgument
            | tonic::Code::NotFound
            | tonic::Code::OutOfRange
            | tonic::Code::FailedPrecondition => Failure::Input(message),
            code => Failure::Other(format!("{message} ({code:?})")),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_message_names_the_flag_and_not_the_field() {
        for (line, shown) in [
            ("start.preset: there is no preset \"x\"", "--model: there is no preset \"x\""),
            ("  study.start: is a fitted model", "  --model: is a fitted model"),
            ("start.model_json.effects[2].name: is there twice", "--model effects[2].name: is there twice"),
            ("formula.text: line 1", "the formula: line 1"),
            ("starting again: later", "starting again: later"),
            ("video.objects[0].x: is 3", "video.objects[0].x: is 3"),
        ] {
            assert_eq!(with_flag(line), shown);
        }
    }
}
