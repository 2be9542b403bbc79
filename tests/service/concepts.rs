//! Words: learned from examples and from questions, kept, used in questions, refused where they cannot be learned.

use crate::harness::*;
use tonic::{Code, Status};
use v1::learn_concepts_request::Source;
use v1::operation::Result as Outcome;
use vrdp::api::v1;

/// A small video whose objects have features: shine, and what says nothing.
fn shown(number: u32, shine: [f32; 3]) -> v1::Video {
    let mut video = video(&format!("v{number}"), 12);
    video.feature_layout = "shine-1".into();
    for (object, shine) in video.objects.iter_mut().zip(shine) {
        object.features = vec![shine, 0.1 * ((object.id + number) % 3) as f32];
    }
    video
}

fn example(video: &str, object_id: u32) -> v1::ConceptExample {
    v1::ConceptExample { video: video.into(), object_id, ..Default::default() }
}

fn shiny(yes: Vec<v1::ConceptExample>, no: Vec<v1::ConceptExample>) -> Source {
    let (name, kind) = ("shiny".into(), v1::ConceptKind::Static.into());
    Source::Examples(v1::WordExamples { name, kind, yes, no, ..Default::default() })
}

async fn learn(service: &Running, source: Source) -> Result<v1::Lexicon, Status> {
    let request = v1::LearnConceptsRequest { source: Some(source), ..Default::default() };
    let mut stream = service.concepts().learn_concepts(request).await?.into_inner();
    let mut found = None;
    while let Some(message) = stream.message().await? {
        if let Some(v1::learn_concepts_response::Event::Lexicon(lexicon)) = message.event {
            found = Some(lexicon);
        }
    }
    Ok(found.expect("a stream that ends well has a lexicon"))
}

/// The same as an operation, which goes on without its caller.
async fn as_operation(service: &Running, source: Source) -> Option<Outcome> {
    let request = v1::LearnConceptsRequest { source: Some(source), ..Default::default() };
    let work = Some(v1::start_operation_request::Work::LearnConcepts(request));
    let request = v1::StartOperationRequest { work, ..Default::default() };
    let name = service.operations().start_operation(request).await.unwrap().into_inner().name;
    let request = v1::WaitOperationRequest { name };
    let mut stream = service.operations().wait_operation(request).await.unwrap().into_inner();
    let mut result = None;
    while let Some(operation) = stream.message().await.unwrap() {
        result = operation.result;
    }
    result
}

async fn written(service: &Running, request: v1::WriteReportRequest) -> String {
    let mut stream = service.models().write_report(request).await.unwrap().into_inner();
    let mut html = String::new();
    while let Some(message) = stream.message().await.unwrap() {
        if let Some(v1::write_report_response::Event::Report(report)) = message.event {
            html = report.html;
        }
    }
    html
}

fn program(video: &str, tokens: &[&str], lexicon: &str) -> v1::AskRequest {
    let tokens = tokens.iter().map(|t| t.to_string()).collect();
    v1::AskRequest {
        video: video.into(),
        question: Some(v1::ask_request::Question::Program(v1::Program { tokens })),
        rollouts: Some(8),
        lexicon: lexicon.into(),
        ..Default::default()
    }
}

#[tokio::test]
async fn a_word_from_examples_is_kept_described_used_and_deleted() {
    let folder = tempfile::tempdir().unwrap();
    let service = start(folder.path(), CAPACITY).await;
    let mut videos = vec![];
    for (number, shine) in (0..).zip([[0.9, 0.1, 0.8], [0.95, 0.15, 0.2], [0.85, 0.9, 0.1]]) {
        videos.push(service.create(shown(number, shine)).await.unwrap());
    }
    let [a, b, c] = &videos[..] else { panic!("three") };
    let yes = vec![example(a, 0), example(b, 0), example(c, 0), example(c, 1)];
    let no = vec![example(a, 1), example(b, 1), example(b, 2), example(c, 2)];
    let learned = learn(&service, shiny(yes.clone(), no.clone())).await.unwrap();
    assert_eq!(learned.words, ["shiny"]);
    assert_eq!(
        learn(&service, shiny(yes.clone(), no.clone())).await.unwrap(),
        learned,
        "equal requests, equal bytes"
    );
    assert_eq!(as_operation(&service, shiny(yes, no)).await, Some(Outcome::Lexicon(learned.clone())));
    // Of the first video, two are shiny; one of these was no example.
    let how_many = |lexicon: &str| program(a, &["objects", "shiny", "filter_concept", "count"], lexicon);
    let answer = service.reasoning().ask(how_many(&learned.name)).await.unwrap().into_inner();
    assert_eq!(answer.answer.as_deref(), Some("2"));
    // English has the word, and the answer says how probable it is of each object.
    let mut asked = how_many(&learned.name);
    asked.question = Some(v1::ask_request::Question::Text("How many shiny objects are there?".into()));
    let answer = service.reasoning().ask(asked).await.unwrap().into_inner();
    assert_eq!(answer.answer.as_deref(), Some("2"), "{answer:?}");
    let fits: Vec<bool> = answer.words.iter().map(|w| w.probability > 0.5).collect();
    assert_eq!(fits, [true, false, true], "{:?}", answer.words);
    let study = Some(v1::StudyRequest { videos: vec![a.clone()], ..Default::default() });
    let page =
        v1::WriteReportRequest { study, as_is: true, lexicon: learned.name.clone(), ..Default::default() };
    let page = written(&service, page).await;
    assert!(page.contains("Words of the lexicon") && page.contains("<th>shiny</th>"));
    let refused = service.reasoning().ask(how_many("")).await.unwrap_err();
    assert_eq!(refused.code(), Code::InvalidArgument, "no lexicon, no word: {refused:?}");
    service.stop().await;

    let service = start(folder.path(), CAPACITY).await;
    let name = learned.name.clone();
    let got = service.concepts().get_lexicon(v1::GetLexiconRequest { name: name.clone() }).await.unwrap();
    assert_eq!(got.into_inner(), learned, "a lexicon survives a restart");
    let asked =
        v1::DescribeConceptRequest { lexicon: name.clone(), word: "shiny".into(), ..Default::default() };
    let word = service.concepts().describe_concept(asked).await.unwrap().into_inner();
    assert_eq!((word.examples, word.counter_examples), (4, 4));
    assert!(word.looks_at[0].weight > 0.0 && word.objects.is_empty(), "{word:?}");
    let asked = v1::DescribeConceptRequest { lexicon: name.clone(), word: "shiny".into(), video: a.clone() };
    let word = service.concepts().describe_concept(asked).await.unwrap().into_inner();
    let fits: Vec<(u32, bool)> = word.objects.iter().map(|w| (w.object_id, w.probability > 0.5)).collect();
    assert_eq!(fits, [(0, true), (1, false), (2, true)], "{word:?}");
    let asked =
        v1::DescribeConceptRequest { lexicon: name.clone(), word: "dull".into(), ..Default::default() };
    let unknown = service.concepts().describe_concept(asked).await.unwrap_err();
    assert!(unknown.code() == Code::NotFound && unknown.message().contains("shiny"), "{unknown:?}");
    let put = v1::CreateLexiconRequest { content: learned.content.clone() };
    assert_eq!(service.concepts().create_lexicon(put).await.unwrap().into_inner().name, name);
    let delete = || v1::DeleteLexiconRequest { name: name.clone() };
    service.concepts().delete_lexicon(delete()).await.unwrap();
    assert_eq!(service.concepts().delete_lexicon(delete()).await.unwrap_err().code(), Code::NotFound);
    let listed = service.concepts().list_lexica(v1::ListLexicaRequest::default()).await.unwrap().into_inner();
    assert_eq!(listed.lexica, []);
    let gone = service.reasoning().ask(how_many(&name)).await.unwrap_err();
    assert_eq!(gone.code(), Code::NotFound, "{gone:?}");
    service.stop().await;
}

/// A video of one disc, which the ground brakes, and one at rest.
fn braked(number: u32, speed: f64) -> v1::Video {
    let mut video = video(&format!("braked {number}"), 40);
    video.world = v1::World::Table.into();
    video.objects.truncate(2);
    for (object, speed) in video.objects.iter_mut().zip([speed, 0.0]) {
        let deceleration = if speed > 0.0 { 0.5 } else { 0.0 };
        let at = |f: u32| {
            let (t, small) = (0.04 * f64::from(f), 0.001 * f64::from((f * 7 + number) % 5) - 0.002);
            sample(f, speed * t - 0.5 * deceleration * t * t + small, 2.0 * f64::from(object.id) - small)
        };
        object.samples = (0..40).map(at).collect();
    }
    video
}

/// "Slow" halves a velocity: learned from a video and one in which it is so.
#[tokio::test]
async fn a_change_is_learned_from_pairs_of_videos() {
    let folder = tempfile::tempdir().unwrap();
    let service = start(folder.path(), CAPACITY).await;
    let mut names = vec![];
    for (number, speed) in (0..).zip([2.0, 1.0, 2.02]) {
        names.push(service.create(braked(number, speed)).await.unwrap());
    }
    let [as_it_is, slow, again] = &names[..] else { panic!("three") };
    let pair = |changed: &str| v1::ConceptExample { changed_video: changed.into(), ..example(as_it_is, 0) };
    let source = |yes: Vec<v1::ConceptExample>, no: Vec<v1::ConceptExample>| {
        let (name, kind) = ("slow".to_string(), v1::ConceptKind::Change.into());
        let quantity = v1::ChangedQuantity::Velocity.into();
        Source::Examples(v1::WordExamples { name, kind, yes, no, quantity })
    };
    let learned = learn(&service, source(vec![pair(slow)], vec![pair(again)])).await.unwrap();
    let asked = v1::DescribeConceptRequest {
        lexicon: learned.name.clone(),
        word: "slow".into(),
        ..Default::default()
    };
    let word = service.concepts().describe_concept(asked).await.unwrap().into_inner();
    let factor = word.factor.unwrap();
    assert!((factor - 0.5).abs() < 0.05, "{word:?}");
    assert!(word.factor_low <= factor && factor <= word.factor_high, "{word:?}");
    assert_eq!((word.examples, word.counter_examples), (1, 1));
    let contrary = learn(&service, source(vec![pair(slow), pair(again)], vec![])).await.unwrap_err();
    assert_eq!(fields(&contrary), ["examples"], "{contrary:?}");
    assert!(contrary.message().contains("contradict"), "{contrary:?}");
    let no_second = learn(&service, source(vec![example(as_it_is, 0)], vec![])).await.unwrap_err();
    assert_eq!(fields(&no_second), ["examples.yes[0].changed_video"], "{no_second:?}");
    let twice = learn(&service, source(vec![pair(slow), pair(slow)], vec![])).await.unwrap_err();
    assert_eq!(fields(&twice), ["examples.yes[1]"], "{twice:?}");
    let mut other = braked(3, 1.0);
    let square = v1::shape::Kind::Square(v1::shape::Square { half_side: 0.2 });
    other.objects[1].shape = Some(v1::Shape { kind: Some(square) });
    let other = service.create(other).await.unwrap();
    let other = learn(&service, source(vec![pair(slow)], vec![pair(&other)])).await.unwrap_err();
    assert_eq!(fields(&other), ["examples.no[0]"], "{other:?}");
    let none = learn(&service, source(vec![], vec![])).await.unwrap_err();
    assert_eq!(fields(&none), ["examples.yes"], "{none:?}");
    service.stop().await;
}

#[tokio::test]
async fn what_cannot_be_learned_is_refused_with_the_field_and_the_reason() {
    let folder = tempfile::tempdir().unwrap();
    let service = start(folder.path(), CAPACITY).await;
    let a = service.create(shown(0, [0.9, 0.1, 0.8])).await.unwrap();
    let b = service.create(shown(3, [0.9, 0.1, 0.2])).await.unwrap();
    let few = learn(&service, shiny(vec![example(&a, 0)], vec![example(&a, 1)])).await.unwrap_err();
    assert_eq!(fields(&few), ["examples"], "{few:?}");
    let yes = vec![example(&a, 0), example(&a, 2)];
    let (name, kind) = ("the".into(), v1::ConceptKind::Static.into());
    let no = vec![example(&a, 1), example(&b, 1)];
    let article = v1::WordExamples { name, kind, yes: yes.clone(), no, ..Default::default() };
    let refused = learn(&service, Source::Examples(article)).await.unwrap_err();
    assert_eq!(fields(&refused), ["name"], "{refused:?}");
    let contrary =
        learn(&service, shiny(yes.clone(), vec![example(&b, 0), example(&b, 1)])).await.unwrap_err();
    assert!(contrary.message().contains("object 0"), "{contrary:?}");
    let stranger = learn(&service, shiny(yes, vec![example(&b, 9), example(&b, 1)])).await.unwrap_err();
    assert_eq!(fields(&stranger), ["examples.no[0].object_id"]);
    let bare = service.create(video("bare", 12)).await.unwrap();
    let lesson = v1::Lesson {
        question: Some(v1::lesson::Question::Text("How many objects are moving?".into())),
        answer: "2".into(),
        ..Default::default()
    };
    let videos = vec![v1::LessonVideo { video: bare, lessons: vec![lesson], model: None }];
    let lessons = Source::Lessons(v1::Lessons { videos, observed_only: true });
    let refused = learn(&service, lessons).await.unwrap_err();
    assert!([Code::FailedPrecondition, Code::InvalidArgument].contains(&refused.code()), "{refused:?}");
    let broken = v1::CreateLexiconRequest { content: b"{}".to_vec() };
    let refused = service.concepts().create_lexicon(broken).await.unwrap_err();
    assert_eq!(fields(&refused), ["content"]);
    service.stop().await;
}
