//! Questions: requests to domain values, answers to replies.

use crate::api::convert::names::{model_name, trace_name};
use crate::api::convert::violations::{MAX_LIST, Violations};
use crate::api::v1;
use crate::engine::{EngineError, ModelSource, PublishedAnswer};
use crate::reason::{AskOptions, ChoiceAnswer, DerivationStep, Question, WordOfObject};

/// Id of the lexicon whose words answer, if one is named.
pub fn lexicon(request: &v1::AskRequest) -> Result<Option<String>, EngineError> {
    let mut r = Violations::default();
    let named = Some(&request.lexicon).filter(|name| !name.is_empty());
    let id = named.map(|name| r.id("lexicon", name, "lexica"));
    r.finish(id)
}

/// Video, model, question and options.
pub fn ask_request(
    request: v1::AskRequest,
) -> Result<(String, ModelSource, Question, AskOptions), EngineError> {
    let mut r = Violations::default();
    let video = r.id("video", &request.video, "videos");
    let source = r.source("model", request.model, &video);
    let options = AskOptions { rollouts: r.rollouts(request.rollouts), seed: request.seed };
    let question = question(&mut r, "", request.question, request.choices);
    r.finish((video, source, question, options))
}

/// A question with its choices; `at` is the path of the message that holds them, with a dot at its end.
pub fn question(
    r: &mut Violations,
    at: &str,
    question: Option<v1::ask_request::Question>,
    choices: Vec<v1::Choice>,
) -> Question {
    use v1::ask_request::Question as Given;
    use v1::choice::Choice as One;
    if choices.len() > MAX_LIST {
        r.add(format!("{at}choices"), format!("are {}; at most {MAX_LIST}", choices.len()));
    }
    let given = choices.into_iter().take(MAX_LIST).map(|c| c.choice).enumerate();
    match question {
        Some(Given::Text(text)) => {
            let question = r.text(&format!("{at}text"), text);
            let mut choices = Vec::new();
            for (i, one) in given {
                match one {
                    Some(One::Text(text)) => choices.push(r.text(&format!("{at}choices[{i}].text"), text)),
                    _ => r.add(format!("{at}choices[{i}].text"), "is missing; the question is English"),
                }
            }
            Question::English { question, choices }
        }
        Some(Given::Program(program)) => {
            let mut choices = Vec::new();
            for (i, one) in given {
                match one {
                    Some(One::Program(program)) => choices.push(program.tokens),
                    _ => r.add(format!("{at}choices[{i}].program"), "is missing; the question is a program"),
                }
            }
            r.tokens(&format!("{at}program"), &program.tokens);
            for (i, tokens) in choices.iter().enumerate() {
                r.tokens(&format!("{at}choices[{i}].program"), tokens);
            }
            Question::Program { program: program.tokens, choices }
        }
        None => {
            r.add(format!("{at}question"), "is missing; give text or program");
            Question::Program { program: vec![], choices: vec![] }
        }
    }
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
        reading: answer.reading.clone(),
        words: answer.words.iter().map(word_of_object).collect(),
    }
}

/// How probable a word is of one object.
pub fn word_of_object(found: &WordOfObject) -> v1::WordOfObject {
    v1::WordOfObject {
        word: found.word.clone(),
        object_id: found.object_id,
        probability: found.probability,
        cosine_score: found.cosine_score,
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
