//! Questions are understood without a fit, after other questions, by words of the caller's own, and by a language model where our
//! reader does not understand them.

use crate::harness::*;
use axum::Router;
use axum::http::{HeaderMap, StatusCode};
use axum::routing::post;
use serde_json::{Value, json};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex};
use std::time::Duration;
use tonic::Code;
use tonic::transport::Endpoint;
use vrdp::api::{Security, v1};
use vrdp::engine::{ChatParser, ChatSettings, Engine};

fn parse(video: &str, text: &str) -> v1::ParseQuestionRequest {
    v1::ParseQuestionRequest {
        video: video.into(),
        question: Some(v1::parse_question_request::Question::Text(text.into())),
        ..Default::default()
    }
}

fn ask(video: &str, text: &str) -> v1::AskRequest {
    v1::AskRequest {
        video: video.into(),
        question: Some(v1::ask_request::Question::Text(text.into())),
        rollouts: Some(4),
        ..Default::default()
    }
}

fn own(word: &str, means: &str) -> v1::OwnWord {
    v1::OwnWord { word: word.into(), means: means.into() }
}

#[tokio::test]
async fn a_question_is_parsed_without_a_fit_and_its_program_answers() {
    let folder = tempfile::tempdir().unwrap();
    let service = start(folder.path(), CAPACITY).await;
    let alone = service.reasoning().parse_question(parse("", "How many cubes are there?")).await;
    assert_eq!(
        alone.unwrap().into_inner().program.unwrap().tokens,
        ["objects", "cube", "filter_shape", "count"]
    );
    let name = service.create(video("a", 12)).await.unwrap();
    let found =
        service.reasoning().parse_question(parse(&name, "how fast is object 0 at the end?")).await.unwrap();
    let found = found.into_inner();
    assert!(found.parser.is_empty() && found.reading.contains("speed"), "{found:?}");
    let missing = service.reasoning().parse_question(parse(&name, "Is the purple cylinder moving?")).await;
    let missing = missing.unwrap_err();
    assert_eq!(missing.code(), Code::InvalidArgument, "objects are resolved: {missing:?}");
    let models = v1::ListModelsRequest { parent: name.clone(), ..Default::default() };
    assert!(service.models().list_models(models).await.unwrap().into_inner().models.is_empty(), "no fit");
    let by_program = v1::AskRequest {
        question: Some(v1::ask_request::Question::Program(found.program.unwrap())),
        ..ask(&name, "")
    };
    let by_program = service.reasoning().ask(by_program).await.unwrap().into_inner();
    let by_text = service.reasoning().ask(ask(&name, "how fast is object 0 at the end?")).await.unwrap();
    assert_eq!(by_program.answer, by_text.into_inner().answer);
    service.stop().await;
}

#[tokio::test]
async fn earlier_questions_and_own_words_are_understood() {
    let folder = tempfile::tempdir().unwrap();
    let service = start(folder.path(), CAPACITY).await;
    let name = service.create(video("a", 12)).await.unwrap();
    let refused = service.reasoning().ask(ask(&name, "Is it moving when the video ends?")).await.unwrap_err();
    assert_eq!(refused.code(), Code::InvalidArgument);
    let after = v1::AskRequest {
        previous: vec!["How fast is object 1 at the end?".into()],
        ..ask(&name, "Is it moving when the video ends?")
    };
    let answer = service.reasoning().ask(after).await.unwrap().into_inner();
    assert!(answer.program.unwrap().tokens.contains(&"1".to_string()), "{}", answer.reading);
    let mut named = ask(&name, "Is the cue ball moving when the video ends?");
    named.words = vec![own("cue ball", "object 2")];
    let answer = service.reasoning().ask(named.clone()).await.unwrap().into_inner();
    assert!(answer.program.unwrap().tokens.contains(&"2".to_string()), "{}", answer.reading);
    named.words = vec![own("", "object 2"), own("cue", &"x".repeat(101))];
    let wrong = service.reasoning().ask(named).await.unwrap_err();
    assert_eq!(fields(&wrong), ["words[0].word", "words[1].means"]);
    service.stop().await;
}

#[tokio::test]
async fn the_operations_and_grammars_are_listed() {
    let folder = tempfile::tempdir().unwrap();
    let service = start(folder.path(), CAPACITY).await;
    let listed = service.reasoning().list_operations(v1::ReasoningListOperationsRequest {}).await.unwrap();
    let listed = listed.into_inner();
    let count = listed.operations.iter().find(|o| o.name == "count").unwrap();
    assert!(!count.doc.is_empty() && count.signature.contains("->") && !count.example.is_empty());
    let schema: Value = serde_json::from_str(&listed.json_schema).unwrap();
    assert_eq!(schema["required"], json!(["program"]));
    for operation in &listed.operations {
        assert!(listed.gbnf_grammar.contains(&format!("\"{}\"", operation.name)), "{}", operation.name);
    }
    service.stop().await;
}

/// The key and the body of a call.
type Call = (Option<String>, Value);

/// What the chat endpoint of a test was sent, and what it answers.
#[derive(Clone, Default)]
struct Endpoints {
    calls: Arc<AtomicUsize>,
    seen: Arc<Mutex<Vec<Call>>>,
    replies: Arc<Mutex<Vec<(StatusCode, String)>>>,
}

/// A chat endpoint on a free port, which gives these replies in order.
async fn chat(replies: &[(StatusCode, &str)]) -> (Endpoints, String) {
    let endpoint = Endpoints::default();
    *endpoint.replies.lock().unwrap() = replies.iter().rev().map(|(s, t)| (*s, t.to_string())).collect();
    let shared = endpoint.clone();
    let answer = move |headers: HeaderMap, body: String| async move {
        shared.calls.fetch_add(1, Ordering::SeqCst);
        let key = headers.get("authorization").and_then(|v| v.to_str().ok()).map(String::from);
        shared.seen.lock().unwrap().push((key, serde_json::from_str(&body).unwrap()));
        shared.replies.lock().unwrap().pop().unwrap_or((StatusCode::GONE, String::new()))
    };
    let listener = tokio::net::TcpListener::bind("127.0.0.1:0").await.unwrap();
    let url = format!("http://{}/v1/", listener.local_addr().unwrap());
    let app = Router::new().route("/v1/chat/completions", post(answer));
    tokio::spawn(async move { axum::serve(listener, app).await });
    (endpoint, url)
}

/// A reply of the endpoint with a program.
fn completion(tokens: &[&str]) -> String {
    let content = json!({ "program": tokens }).to_string();
    json!({ "choices": [{ "message": { "role": "assistant", "content": content } }] }).to_string()
}

async fn with_parser(folder: &std::path::Path, url: String) -> Running {
    let settings = ChatSettings {
        url,
        model: "small-1".into(),
        key: Some("k3y".into()),
        timeout: Duration::from_secs(20),
    };
    let engine = Engine::open(folder, CAPACITY).unwrap().with_parser(ChatParser::new(settings).unwrap());
    start_engine(engine, Security::default(), |url| Endpoint::from_shared(url).unwrap()).await
}

#[tokio::test]
async fn a_language_model_writes_the_program_of_what_our_reader_does_not_understand() {
    let folder = tempfile::tempdir().unwrap();
    let program = ["objects", "count"];
    let wrong = ["objects", "objects", "fly"];
    let (endpoint, url) = chat(&[
        (StatusCode::OK, &completion(&program)),
        (StatusCode::OK, &completion(&wrong)),
        (StatusCode::UNAUTHORIZED, "no"),
    ])
    .await;
    let service = with_parser(folder.path(), url).await;
    let name = service.create(video("a", 12)).await.unwrap();
    let understood = service.reasoning().ask(ask(&name, "How many objects are there?")).await.unwrap();
    assert_eq!(understood.into_inner().parser, "");
    assert_eq!(endpoint.calls.load(Ordering::SeqCst), 0, "what our reader understands is not sent");

    let odd = "Zähle mir bitte alles, was da herumliegt!";
    let answer = service.reasoning().ask(ask(&name, odd)).await.unwrap().into_inner();
    assert_eq!(
        (answer.parser.as_str(), answer.program.unwrap().tokens),
        ("small-1", program.map(String::from).into())
    );
    assert_eq!(answer.answer.as_deref(), Some("3"));
    assert!(answer.explanation.contains("The language model small-1 wrote this program"));
    assert!(answer.reading.contains("number"), "read back in English: {}", answer.reading);
    service.reasoning().ask(ask(&name, odd)).await.unwrap();
    assert_eq!(endpoint.calls.load(Ordering::SeqCst), 1, "an equal question is answered from memory");
    {
        let seen = endpoint.seen.lock().unwrap();
        let (key, request) = &seen[0];
        assert_eq!(key.as_deref(), Some("Bearer k3y"));
        assert_eq!((&request["model"], &request["temperature"]), (&json!("small-1"), &json!(0)));
        let schema = &request["response_format"]["json_schema"]["schema"];
        assert_eq!(schema["required"], json!(["program"]));
        let asked = request["messages"][1]["content"].as_str().unwrap();
        assert!(asked.contains(odd) && asked.contains("object 1"), "{asked}");
    }
    let refused = service.reasoning().ask(ask(&name, "Wie bitte?")).await.unwrap_err();
    assert_eq!(refused.code(), Code::InvalidArgument);
    assert!(refused.message().contains("small-1") && refused.message().contains("fly"), "{refused:?}");
    let refused = service.reasoning().ask(ask(&name, "Was?")).await.unwrap_err();
    assert!(refused.message().contains("status 401") && !refused.message().contains("http"), "{refused:?}");
    service.stop().await;
}
