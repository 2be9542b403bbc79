//! Questions: requests to domain values, answers to replies.

use super::names::{model_name, trace_name};
use super::violations::{MAX_LIST, Violations};
use crate::api::v1;
use crate::engine::{EngineError, ModelSource, PublishedAnswer};
use crate::reason::{AskOptions, ChoiceAnswer, DerivationStep, Question};

/// Video, model, question and options.
pub fn ask_request(
    request: v1::AskRequest,
) -> Result<(String, ModelSource, Question, AskOptions), EngineError> {
    use v1::ask_request::Question as Given;
    use v1::choice::Choice as One;
    let mut r = Violations::default();
    let video = r.id("video", &request.video, "videos");
    let source = r.source("model", request.model, &video);
    let options = AskOptions { rollouts: r.rollouts(request.rollouts), seed: request.seed };
    if request.choices.len() > MAX_LIST {
        r.add("choices", format!("are {}; at most {MAX_LIST}", request.choices.len()));
    }
    let given = request.choices.into_iter().take(MAX_LIST).map(|c| c.choice).enumerate();
    let question = match request.question {
        Some(Given::Text(text)) => {
            let question = r.text("text", text);
            let mut choices = Vec::new();
            for (i, one) in given {
                match one {
                    Some(One::Text(text)) => choices.push(r.text(&format!("choices[{i}].text"), text)),
                    _ => r.add(format!("choices[{i}].text"), "is missing; the question is English"),
                }
            }
            Question::English { question, choices }
        }
        Some(Given::Program(program)) => {
            let mut choices = Vec::new();
            for (i, one) in given {
                match one {
                    Some(One::Program(program)) => choices.push(program.tokens),
                    _ => r.add(format!("choices[{i}].program"), "is missing; the question is a program"),
                }
            }
            r.tokens("program", &program.tokens);
            for (i, tokens) in choices.iter().enumerate() {
                r.tokens(&format!("choices[{i}].program"), tokens);
            }
            Question::Program { program: program.tokens, choices }
        }
        None => {
            r.add("question", "is missing; give text or program");
            Question::Program { program: vec![], choices: vec![] }
        }
    };
    r.finish((video, source, question, options))
}

pub fn answer(video: &str, done: &PublishedAnswer) -> v1::AskResponse {
    let answer = &done.answer;
    v1::AskResponse {
        answer: answer.answer.clone(),
        probability: answer.probability,
        choices: answer.choices.iter().map(choice).collect(),
        derivation: answer.derivation.iter().map(step).collect(),
        program: Some(v1::Program { tokens: answer.program.clone() }),
        explanation: answer.explanation.clone(),
        traces: done.traces.iter().map(|id| trace_name(id)).collect(),
        model: model_name(video, &done.model),
    }
}

fn choice(c: &ChoiceAnswer) -> v1::ChoiceAnswer {
    v1::ChoiceAnswer {
        choice: c.choice.clone(),
        correct: c.correct,
        probability: c.probability,
        derivation: c.derivation.iter().map(step).collect(),
    }
}

fn step(s: &DerivationStep) -> v1::Step {
    v1::Step { token: s.token.clone(), text: s.result.clone() }
}
