//! A question on the command line, in English or as a program.

use crate::api::v1::{Choice, OwnWord, Program, ask_request, choice};
use crate::cli::error::Failure;

#[derive(clap::Args)]
pub struct AskedArgs {
    /// The question in English; the forms below are understood.
    #[arg(long, value_name = "TEXT")]
    pub question: Option<String>,
    /// The question as a program: tokens in postfix order with spaces between (`vrdp parse` shows those of a question).
    #[arg(long, value_name = "TOKENS")]
    pub program: Option<String>,
    /// A choice to judge as correct or wrong, a program if the question is one; may be repeated. Without it the answer is open.
    #[arg(long, value_name = "TEXT")]
    pub choice: Vec<String>,
    /// A question that was asked before this one, so that "it" and "and when?" are understood; may be repeated, oldest first.
    #[arg(long, value_name = "TEXT")]
    pub previous: Vec<String>,
    /// A word of your own and what it means, such as "cue ball=white ball" or "target=object 3"; may be repeated.
    #[arg(long, value_name = "WORD=MEANING")]
    pub word: Vec<String>,
}

impl AskedArgs {
    /// The question and its choices.
    pub fn question(&self) -> (ask_request::Question, Vec<Choice>) {
        let program = |text: &str| Program { tokens: text.split_whitespace().map(String::from).collect() };
        match &self.program {
            Some(tokens) => {
                let of = |text: &String| Choice { choice: Some(choice::Choice::Program(program(text))) };
                (ask_request::Question::Program(program(tokens)), self.choice.iter().map(of).collect())
            }
            None => {
                let of = |text: &String| Choice { choice: Some(choice::Choice::Text(text.clone())) };
                let text = self.question.clone().unwrap_or_default();
                (ask_request::Question::Text(text), self.choice.iter().map(of).collect())
            }
        }
    }

    /// The caller's own words.
    pub fn words(&self) -> Result<Vec<OwnWord>, Failure> {
        let one = |given: &String| match given.split_once('=') {
            Some((word, means)) if !word.trim().is_empty() && !means.trim().is_empty() => {
                Ok(OwnWord { word: word.trim().into(), means: means.trim().into() })
            }
            _ => Err(Failure::input(format!(
                "--word {given:?}: is not WORD=MEANING, such as \"cue ball=white ball\""
            ))),
        };
        self.word.iter().map(one).collect()
    }
}
