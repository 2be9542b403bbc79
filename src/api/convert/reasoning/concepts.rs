//! Words: requests to lessons and examples, lexica and words to messages.

use super::question::question;
use crate::api::convert::names::lexicon_name;
use crate::api::convert::violations::Violations;
use crate::api::v1;
use crate::api::v1::learn_concepts_request::Source;
use crate::concepts::{
    CalibrationBin, LONGEST_NAME, Lesson, LessonAnswer, Lexicon, WordDescription, WordKind, describe,
};
use crate::engine::{EngineError, ExamplePlace, LearnRequest, NamedChange, NamedExample, VideoLessons};
use crate::reason::{ChangedQuantity, Op, Question, WordFamily};

/// Most videos of one call: more than a data set of the paper's size needs at once.
const MAX_VIDEOS: usize = 10_000;
/// Most lessons of one video, and most examples of a word.
const MAX_LESSONS: usize = 1_000;
/// Bytes of a lexicon: one of 1,024 features and 100 words has a tenth of it.
const MAX_CONTENT: usize = 16 << 20;

/// The lexicon that is extended, what is learned, and the seed.
pub fn learn_request(
    request: v1::LearnConceptsRequest,
) -> Result<(Option<String>, LearnRequest, u64), EngineError> {
    let mut r = Violations::default();
    let base = r.optional_id("base", &request.base, "lexica");
    let learned = match request.source {
        Some(Source::Lessons(given)) => {
            if base.is_some() {
                r.add("base", "is given, but lessons make a lexicon of their own; leave it out");
            }
            LearnRequest::Families(lessons(&mut r, "lessons", given))
        }
        Some(Source::Examples(given)) => examples(&mut r, given),
        Some(Source::Change(given)) => {
            let name = word(&mut r, "change.name", given.name);
            let quantity = quantity(&mut r, "change.quantity", given.quantity);
            let videos = lessons(&mut r, "change.lessons", given.lessons.unwrap_or_default());
            LearnRequest::Change { name, quantity, videos }
        }
        None => {
            r.add("source", "is missing; give lessons, examples or change");
            LearnRequest::Families(vec![])
        }
    };
    r.finish((base, learned, request.seed))
}

fn lessons(r: &mut Violations, path: &str, given: v1::Lessons) -> Vec<VideoLessons> {
    if given.videos.is_empty() || given.videos.len() > MAX_VIDEOS {
        r.add(format!("{path}.videos"), format!("are {}; give 1 to {MAX_VIDEOS}", given.videos.len()));
    }
    let observed_only = given.observed_only;
    let one = |(i, given): (usize, v1::LessonVideo)| {
        let at = format!("{path}.videos[{i}]");
        let video = r.id(&format!("{at}.video"), &given.video, "videos");
        let source = r.source("model", given.model, &video);
        if given.lessons.len() > MAX_LESSONS {
            r.add(format!("{at}.lessons"), format!("are {}; at most {MAX_LESSONS}", given.lessons.len()));
        }
        let all = given.lessons.into_iter().take(MAX_LESSONS).enumerate();
        let lessons = all.map(|(k, given)| lesson(r, &format!("{at}.lessons[{k}]."), given)).collect();
        VideoLessons { video, source: (!observed_only).then_some(source), lessons }
    };
    given.videos.into_iter().take(MAX_VIDEOS).enumerate().map(one).collect()
}

fn lesson(r: &mut Violations, at: &str, given: v1::Lesson) -> Lesson {
    let asked = given.question.map(|question| match question {
        v1::lesson::Question::Text(text) => v1::ask_request::Question::Text(text),
        v1::lesson::Question::Program(program) => v1::ask_request::Question::Program(program),
    });
    let question: Question = question(r, at, asked, given.choices);
    let answer = match given.correct.is_empty() {
        false => LessonAnswer::Choices(given.correct),
        true => LessonAnswer::Open(r.text(&format!("{at}answer"), given.answer)),
    };
    Lesson { question, answer }
}

fn examples(r: &mut Violations, given: v1::WordExamples) -> LearnRequest {
    let name = word(r, "examples.name", given.name);
    let kind = match v1::ConceptKind::try_from(given.kind) {
        Ok(v1::ConceptKind::Static) => WordKind::Static,
        Ok(v1::ConceptKind::Dynamic) => WordKind::Dynamic,
        Ok(v1::ConceptKind::Event) => WordKind::Event,
        Ok(v1::ConceptKind::Change) => {
            let quantity = quantity(r, "examples.quantity", given.quantity);
            if given.yes.is_empty() {
                r.add(
                    "examples.yes",
                    "is empty; give at least one object with the video in which it is changed",
                );
            }
            let yes = each(r, "examples.yes", given.yes, changed);
            let no = each(r, "examples.no", given.no, changed);
            return LearnRequest::ChangeExamples { name, quantity, yes, no };
        }
        _ => {
            r.add("examples.kind", "is missing; give static, dynamic, event or change");
            WordKind::Static
        }
    };
    let one = |r: &mut Violations, at: &str, example| named(r, at, kind, example);
    let yes = each(r, "examples.yes", given.yes, one);
    let no = each(r, "examples.no", given.no, one);
    LearnRequest::Word { name, kind, yes, no }
}

/// Reads each example of a list.
fn each<T>(
    r: &mut Violations,
    path: &str,
    given: Vec<v1::ConceptExample>,
    one: impl Fn(&mut Violations, &str, v1::ConceptExample) -> T,
) -> Vec<T> {
    if given.len() > MAX_LESSONS {
        r.add(path, format!("are {}; at most {MAX_LESSONS}", given.len()));
    }
    let given = given.into_iter().take(MAX_LESSONS).enumerate();
    given.map(|(k, example)| one(r, &format!("{path}[{k}]"), example)).collect()
}

/// An example of a change.
fn changed(r: &mut Violations, at: &str, given: v1::ConceptExample) -> NamedChange {
    if given.other_id.is_some() {
        r.add(format!("{at}.other_id"), "is given; only a word of events has two objects");
    }
    NamedChange {
        video: r.id(&format!("{at}.video"), &given.video, "videos"),
        object_id: given.object_id,
        changed_video: r.id(&format!("{at}.changed_video"), &given.changed_video, "videos"),
    }
}

fn named(r: &mut Violations, at: &str, kind: WordKind, given: v1::ConceptExample) -> NamedExample {
    let video = r.id(&format!("{at}.video"), &given.video, "videos");
    if !given.changed_video.is_empty() {
        r.add(format!("{at}.changed_video"), "is given; only a change has a second video");
    }
    let place = match (given.other_id, kind) {
        (Some(other), WordKind::Event) => {
            let objects = [given.object_id.min(other), given.object_id.max(other)];
            ExamplePlace::Encounter { objects, frame: given.frame as usize }
        }
        (None, WordKind::Event) => {
            r.add(
                format!("{at}.other_id"),
                "is missing; a word of events needs both objects of the encounter",
            );
            ExamplePlace::Object(given.object_id)
        }
        (Some(_), _) => {
            r.add(format!("{at}.other_id"), "is given; only a word of events has two objects");
            ExamplePlace::Object(given.object_id)
        }
        (None, _) => ExamplePlace::Object(given.object_id),
    };
    NamedExample { video, place }
}

fn quantity(r: &mut Violations, path: &str, given: i32) -> ChangedQuantity {
    match v1::ChangedQuantity::try_from(given) {
        Ok(v1::ChangedQuantity::Mass) => ChangedQuantity::Mass,
        Ok(v1::ChangedQuantity::Velocity) => ChangedQuantity::Velocity,
        Ok(v1::ChangedQuantity::Restitution) => ChangedQuantity::Restitution,
        Ok(v1::ChangedQuantity::Friction) => ChangedQuantity::Friction,
        _ => {
            r.add(path, "is missing; give mass, velocity, restitution or friction");
            ChangedQuantity::Mass
        }
    }
}

/// A new word: one token that the vocabulary has not.
fn word(r: &mut Violations, path: &str, name: String) -> String {
    let letters = |c: char| c.is_alphanumeric() || c == '-' || c == '_';
    let starts = name.chars().next().is_some_and(char::is_alphabetic);
    if !starts || !name.chars().all(letters) || name.len() > LONGEST_NAME {
        let rule = format!("a letter, then letters, digits, - and _, at most {LONGEST_NAME} bytes");
        r.add(path, format!("is {name:?}; give {rule}"));
    } else if Op::of(&name).is_some() {
        r.add(path, format!("is {name:?}, which is a word of the vocabulary; take another one"));
    }
    name
}

/// A lexicon from its content.
pub fn content(bytes: &[u8]) -> Result<Lexicon, EngineError> {
    if bytes.len() > MAX_CONTENT {
        let message = format!("has {} bytes; at most {MAX_CONTENT} are allowed", bytes.len());
        return Err(EngineError::invalid("content", message));
    }
    let read = serde_json::from_slice::<Lexicon>(bytes);
    read.map_err(|e| EngineError::invalid("content", format!("is no lexicon: {e}")))
}

/// Id of the video whose objects a word is described for, if one is named.
pub fn described_video(name: &str) -> Result<Option<String>, EngineError> {
    let mut r = Violations::default();
    let id = r.optional_id("video", name, "videos");
    r.finish(id)
}

/// Id of the lexicon that a field names.
pub fn lexicon_id(path: &str, name: &str) -> Result<String, EngineError> {
    let mut r = Violations::default();
    let id = r.id(path, name, "lexica");
    r.finish(id)
}

/// Size of a page, and the id after which it begins.
pub fn page(request: v1::ListLexicaRequest) -> Result<(usize, String), EngineError> {
    let mut r = Violations::default();
    let page = r.page(request.page_size, request.page_token);
    r.finish(page)
}

/// A lexicon without its content.
pub fn lexicon(id: &str, lexicon: &Lexicon) -> v1::Lexicon {
    v1::Lexicon {
        name: lexicon_name(id),
        words: lexicon.names(),
        videos: lexicon.videos as u64,
        questions: lexicon.questions as u64,
        content: vec![],
    }
}

/// A lexicon with its content.
pub fn whole_lexicon(found: &Lexicon) -> v1::Lexicon {
    // A lexicon holds finite numbers and texts, which always have a JSON form.
    let content = serde_json::to_vec(found).unwrap_or_default();
    v1::Lexicon { content, ..lexicon(&found.digest(), found) }
}

/// What all words of a lexicon mean.
pub fn concepts(lexicon: &Lexicon) -> Result<Vec<v1::Concept>, EngineError> {
    lexicon.names().iter().map(|word| Ok(concept(&describe(lexicon, word)?))).collect()
}

/// What a word means.
pub fn concept(word: &WordDescription) -> v1::Concept {
    let kind = word.kind.map_or(v1::ConceptKind::Unspecified, |kind| match kind {
        WordKind::Static => v1::ConceptKind::Static,
        WordKind::Dynamic => v1::ConceptKind::Dynamic,
        WordKind::Event => v1::ConceptKind::Event,
        WordKind::Change => v1::ConceptKind::Change,
    });
    let family = word.family.map_or("", WordFamily::name);
    let weight =
        |(feature, weight): &(String, f64)| v1::FeatureWeight { feature: feature.clone(), weight: *weight };
    let near = |(word, cosine): &(String, f64)| v1::NearWord { word: word.clone(), cosine: *cosine };
    let [factor, low, high] = word.factor.unwrap_or_default();
    v1::Concept {
        word: word.name.clone(),
        family: family.into(),
        kind: kind.into(),
        looks_at: word.looks_at.iter().map(weight).collect(),
        nearest: word.nearest.iter().map(near).collect(),
        examples: word.examples as u64,
        counter_examples: word.counter_examples as u64,
        calibration: word.calibration.as_ref().map(|c| v1::ConceptCalibration {
            answers: c.answers as u64,
            log_loss: c.log_loss,
            accuracy: c.accuracy,
            bins: c.bins.iter().map(bin).collect(),
            mistaken: c.mistaken,
        }),
        factor: word.factor.map(|_| factor),
        factor_low: low,
        factor_high: high,
        evidence: word.evidence,
        objects: vec![],
    }
}

fn bin(bin: &CalibrationBin) -> v1::CalibrationBin {
    let [accuracy_low, accuracy_high] = bin.interval;
    v1::CalibrationBin {
        answers: bin.answers as u64,
        probability: bin.probability,
        accuracy: bin.accuracy,
        accuracy_low,
        accuracy_high,
    }
}
