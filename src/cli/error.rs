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

    /// Adds the name of the file or scene that failed.
    pub fn at(self, place: &str) -> Self {
        match self {
            Failure::Input(message) => Failure::Input(format!("{place}: {message}")),
            Failure::Other(message) => Failure::Other(format!("{place}: {message}")),
        }
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
        match status.code() {
            tonic::Code::InvalidArgument
            | tonic::Code::NotFound
            | tonic::Code::OutOfRange
            | tonic::Code::FailedPrecondition => Failure::Input(message),
            code => Failure::Other(format!("{message} ({code:?})")),
        }
    }
}
