//! Questions: requests to domain values, answers to replies.

use crate::api::convert::names::{model_name, trace_name};
use crate::api::convert::violations::{MAX_LIST, Violations};
use crate::api::v1;
use crate::engine::{AskedQuestion, EngineError, ModelSource, Parsed, PublishedAnswer};
use crate::reason::{
    AskOptions, ChoiceAnswer, Conversation, DerivationStep, OperationInfo, OwnWord, Question, WordOfObject,
    gbnf_grammar, json_schema, list_operations,
};

/// Video, model, question and options.
pub fn ask_request(
    request: v1::AskRequest,
) -> Result<(String, ModelSource, AskedQuestion, AskOptions), EngineError> {
    let mut r = Violations::default();
    r.request_id(&request.request_id);
    let video = r.id("video", &request.video, "videos");
    let source = r.source("model", request.model, &video);
    let options = AskOptions { rollouts: r.rollouts(request.rollouts), seed: request.seed };
    let question = question(&mut r, "", request.question, request.choices);
    let conversation = conversation(&mut r, request.previous, request.words);
    let lexicon = r.optional_id("lexicon", &request.lexicon, "lexica");
    r.finish((video, source, AskedQuestion { question, conversation, lexicon }, options))
}

/// Video, if one is named, and question.
pub fn parse_request(
    request: v1::ParseQuestionRequest,
) -> Result<(Option<String>, AskedQuestion), EngineError> {
    use v1::ask_request::Question as Asked;
    use v1::parse_question_request::Question as Given;
    let mut r = Violations::default();
    let video = r.optional_id("video", &request.video, "videos");
    let given = request.question.map(|given| match given {
        Given::Text(text) => Asked::Text(text),
        Given::Program(program) => Asked::Program(program),
    });
    let question = question(&mut r, "", given, request.choices);
    let conversation = conversation(&mut r, request.previous, request.words);
    let lexicon = r.optional_id("lexicon", &request.lexicon, "lexica");
    r.finish((video, AskedQuestion { question, conversation, lexicon }))
}

/// The questions before, and the caller's own words.
fn conversation(r: &mut Violations, previous: Vec<String>, words: Vec<v1::OwnWord>) -> Conversation {
    for (path, count) in [("previous", previous.len()), ("words", words.len())] {
        if count > MAX_LIST {
            r.add(path, format!("are {count}; at most {MAX_LIST}"));
        }
    }
    let previous = previous.into_iter().take(MAX_LIST).enumerate();
    let previous = previous.map(|(i, text)| r.text(&format!("previous[{i}]"), text)).collect();
    let words = words.into_iter().take(MAX_LIST).enumerate().map(|(i, own)| OwnWord {
        word: r.word(&format!("words[{i}].word"), own.word),
        means: r.word(&format!("words[{i}].means"), own.means),
    });
    let words = words.collect();
    Conversation { previous, words }
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
        parser: done.parser.clone().unwrap_or_default(),
        words: answer.words.iter().map(word_of_object).collect(),
    }
}

pub fn parsed(found: Parsed) -> v1::ParseQuestionResponse {
    let program = |tokens: Vec<String>| v1::Program { tokens };
    v1::ParseQuestionResponse {
        program: Some(program(found.question.program)),
        choices: found.question.choices.into_iter().map(program).collect(),
        reading: found.question.reading,
        parser: found.parser.unwrap_or_default(),
    }
}

/// All operations of programs, and the grammars of programs.
pub fn operations() -> v1::ReasoningListOperationsResponse {
    let one = |o: OperationInfo| v1::ProgramOperation {
        name: o.name.to_string(),
        aliases: o.aliases.iter().map(|a| a.to_string()).collect(),
        signature: o.signature,
        doc: o.line,
        example: o.example.unwrap_or_default(),
    };
    v1::ReasoningListOperationsResponse {
        operations: list_operations().into_iter().map(one).collect(),
        json_schema: json_schema().to_string(),
        gbnf_grammar: gbnf_grammar(),
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
