//! Lessons: CLEVRER's questions with their answers as messages.

use crate::api::v1::{Choice, Lesson, Program, choice, lesson};
use crate::cli::commands::scene::questions::{ClevrerQuestion, list, word};
use crate::cli::error::Failure;

/// A question with its answer; `programs`: its program instead of its English text.
pub fn lesson(question: &ClevrerQuestion, programs: bool) -> Result<Lesson, Failure> {
    let of = &question.0;
    let wrong = |what: &str| Failure::input(format!("question {}: {what}", question.id()));
    let tokens = |of: &serde_json::Value| -> Result<Program, Failure> {
        let tokens: Option<Vec<String>> =
            list(&of["program"]).iter().map(|t| t.as_str().map(Into::into)).collect();
        Ok(Program { tokens: tokens.ok_or_else(|| wrong("a token of \"program\" is not a string"))? })
    };
    let text = |of: &serde_json::Value, key: &str| {
        of[key].as_str().map(str::to_string).ok_or_else(|| wrong(&format!("the text \"{key}\" is missing")))
    };
    let asked = match programs {
        true => lesson::Question::Program(tokens(of)?),
        false => lesson::Question::Text(text(of, "question")?),
    };
    let (mut choices, mut correct) = (vec![], vec![]);
    for one in list(&of["choices"]) {
        let choice = match programs {
            true => choice::Choice::Program(tokens(one)?),
            false => choice::Choice::Text(text(one, "choice")?),
        };
        choices.push(Choice { choice: Some(choice) });
        correct.push(match one["answer"].as_str() {
            Some("correct") => true,
            Some("wrong") => false,
            _ => return Err(wrong("the answer of a choice is neither \"correct\" nor \"wrong\"")),
        });
    }
    let answer = if choices.is_empty() { word(&of["answer"]) } else { String::new() };
    Ok(Lesson { question: Some(asked), choices, answer, correct })
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn a_lesson_holds_the_question_and_its_right_answer() {
        let open = ClevrerQuestion(json!({ "question_id": 1, "question": "How many?", "answer": 2 }));
        let read = lesson(&open, false).unwrap();
        assert_eq!(
            (read.answer.as_str(), read.question),
            ("2", Some(lesson::Question::Text("How many?".into())))
        );
        let choices = json!({ "question_id": 2, "question": "What next?", "choices": [
            { "choice": "the cube exits", "answer": "correct" }, { "choice": "the ball exits", "answer": "wrong" },
        ] });
        assert_eq!(lesson(&ClevrerQuestion(choices), false).unwrap().correct, [true, false]);
        let broken =
            json!({ "question_id": 3, "question": "What next?", "choices": [{ "choice": "it exits" }] });
        let refused = lesson(&ClevrerQuestion(broken), false).unwrap_err().to_string();
        assert!(refused.contains("question 3: the answer of a choice"), "{refused}");
    }
}
