//! Lessons: CLEVRER's questions with their answers as messages.

use crate::api::v1::{Lesson, ask_request, lesson};
use crate::cli::commands::scene::questions::{ClevrerQuestion, asked, list, word};
use crate::cli::error::Failure;
use serde_json::Value;

/// A question with its answer; `programs`: its program instead of its English text.
pub fn lesson(question: &ClevrerQuestion, programs: bool) -> Result<Lesson, Failure> {
    let of = &question.0;
    let wrong = |what: &str| Failure::input(format!("question {}: {what}", question.id()));
    let (asked, choices) = asked(of, programs).map_err(wrong)?;
    let verdict = |choice: &Value| match choice["answer"].as_str() {
        Some("correct") => Ok(true),
        Some("wrong") => Ok(false),
        _ => Err(wrong("the answer of a choice is neither \"correct\" nor \"wrong\"")),
    };
    let correct = list(&of["choices"]).iter().map(verdict).collect::<Result<_, _>>()?;
    let answer = if choices.is_empty() { word(&of["answer"]) } else { String::new() };
    let asked = match asked {
        ask_request::Question::Text(text) => lesson::Question::Text(text),
        ask_request::Question::Program(program) => lesson::Question::Program(program),
    };
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
