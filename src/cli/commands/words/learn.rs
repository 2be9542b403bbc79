//! `learn`: words from questions and answers, or one word from examples; writes a lexicon.

use super::lessons::lesson;
use super::show::table_of;
use crate::api::v1::learn_concepts_request::Source;
use crate::api::v1::{
    ChangeLessons, ChangedQuantity, ConceptExample, ConceptKind, LearnConceptsRequest, LearnConceptsResponse,
    LessonVideo, Lessons, Lexicon, WordExamples, learn_concepts_response,
};
use crate::cli::commands::scene::questions::questioned;
use crate::cli::connection::stream::{StreamEvent, final_result};
use crate::cli::connection::{Connection, Target};
use crate::cli::error::Failure;
use crate::cli::output::progress::TaskProgress;
use crate::cli::{input, output};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Share of the work that reading the videos has.
const READING: f64 = 0.6;

#[derive(clap::Args)]
pub struct LearnArgs {
    /// Folders with a video.mp4 and a camera.json, or an observed.json, and a questions.json; labels of objects are not read.
    #[arg(value_name = "FOLDER", required_unless_present_any = ["yes", "no"])]
    folders: Vec<PathBuf>,
    /// The lexicon to write; a single word is added to it if it is there.
    #[arg(long, value_name = "FILE")]
    lexicon: PathBuf,
    /// Learns one new word: from --yes and --no, or a change (--quantity) also from the questions of the folders.
    #[arg(long, value_name = "NAME")]
    word: Option<String>,
    /// What the word is of [default: static]
    #[arg(long, value_enum, requires = "word")]
    kind: Option<ExampleKind>,
    /// An object that the word fits, by scene and id; an encounter as FILE:OBJECT:OTHER@FRAME; of a change (--quantity) as
    /// FILE:OBJECT=FILE, the second scene having the object changed. May be repeated.
    #[arg(long, value_name = "FILE:OBJECT", num_args = 1.., requires = "word", conflicts_with = "folders")]
    yes: Vec<String>,
    /// An object, or an encounter, that it does not fit.
    #[arg(long, value_name = "FILE:OBJECT", num_args = 1.., requires_all = ["word", "yes"])]
    no: Vec<String>,
    /// What the word multiplies, such as the mass for `heavier`.
    #[arg(long, value_enum, requires = "word", conflicts_with = "kind")]
    quantity: Option<MultipliedQuantity>,
    /// Takes events from the tracks: nothing is fitted, and questions that need simulations are left out.
    #[arg(long)]
    observed_only: bool,
    /// Reads the program of each question instead of its English text.
    #[arg(long)]
    programs: bool,
    /// CLEVRER's questions for many scenes [default: questions.json of each scene, or CLEVRER's file in a folder above]
    #[arg(long, value_name = "FILE")]
    questions: Option<PathBuf>,
    /// Seed of the start; the same seed gives the same lexicon.
    #[arg(long, value_name = "N", default_value_t = 0)]
    seed: u64,
}

#[derive(clap::ValueEnum, Clone, Copy, Debug, PartialEq, Eq)]
enum ExampleKind {
    /// The looks of an object, such as "shiny".
    Static,
    /// The motion of an object, such as "fast".
    Dynamic,
    /// An encounter of two objects, such as "glancing" or "near-miss".
    Event,
}

#[derive(clap::ValueEnum, Clone, Copy, Debug, PartialEq, Eq)]
enum MultipliedQuantity {
    Mass,
    Velocity,
    Restitution,
    Friction,
}

impl MultipliedQuantity {
    fn message(self) -> ChangedQuantity {
        match self {
            MultipliedQuantity::Mass => ChangedQuantity::Mass,
            MultipliedQuantity::Velocity => ChangedQuantity::Velocity,
            MultipliedQuantity::Restitution => ChangedQuantity::Restitution,
            MultipliedQuantity::Friction => ChangedQuantity::Friction,
        }
    }
}

pub async fn run(target: &Target, args: LearnArgs) -> Result<(), Failure> {
    output::writable("--lexicon", &args.lexicon)?;
    let connection = Connection::open(target).await?;
    let bar = TaskProgress::new(1);
    let before = std::fs::read(&args.lexicon).ok();
    let reading = |share: f64| bar.show("reading", 0, READING * share);
    let request = request(&connection, &args, reading).await?;
    let learning = |share: f64| bar.show("learning", 0, READING + (1.0 - READING) * share);
    let lexicon = learned(&connection, request, learning).await?;
    drop(bar);
    if args.word.is_some() && std::fs::read(&args.lexicon).ok() != before {
        let message =
            "was changed by another program meanwhile, whose words would be lost; run the command again";
        return Err(Failure::input(format!("--lexicon: {} {message}", args.lexicon.display())));
    }
    output::file(&args.lexicon, &lexicon.content)?;
    let words = table_of(&connection, &lexicon.name).await?;
    let next = format!("  next: vrdp words {}\n", args.lexicon.display());
    output::print(&format!("{words}{next}"))?;
    connection.close().await
}

async fn request(
    connection: &Connection,
    args: &LearnArgs,
    progress: impl Fn(f64),
) -> Result<LearnConceptsRequest, Failure> {
    let known = match (&args.word, args.lexicon.is_file()) {
        (Some(_), true) => connection.lexicon(Some(&args.lexicon)).await?,
        _ => String::new(),
    };
    let source = match (&args.word, args.yes.is_empty()) {
        (None, _) => Source::Lessons(lessons(connection, args, progress).await?),
        (Some(name), true) => {
            let message = "--word needs examples (--yes and --no), or --quantity for a change";
            let quantity = args.quantity.ok_or_else(|| Failure::input(message))?.message();
            let lessons = Some(lessons(connection, args, progress).await?);
            Source::Change(ChangeLessons { name: name.clone(), quantity: quantity.into(), lessons })
        }
        (Some(name), false) => {
            let kind = match (args.kind, args.quantity) {
                (_, Some(_)) => ConceptKind::Change,
                (None | Some(ExampleKind::Static), None) => ConceptKind::Static,
                (Some(ExampleKind::Dynamic), None) => ConceptKind::Dynamic,
                (Some(ExampleKind::Event), None) => ConceptKind::Event,
            };
            let quantity = args.quantity.map_or(ChangedQuantity::Unspecified, MultipliedQuantity::message);
            let mut posted = BTreeMap::new();
            let yes = examples(connection, (&args.yes, kind), &mut posted).await?;
            let no = examples(connection, (&args.no, kind), &mut posted).await?;
            let (name, kind, quantity) = (name.clone(), kind.into(), quantity.into());
            Source::Examples(WordExamples { name, kind, yes, no, quantity })
        }
    };
    Ok(LearnConceptsRequest { base: known, source: Some(source), seed: args.seed, ..Default::default() })
}

/// Posts the scenes, and reads their questions with the answers.
async fn lessons(
    connection: &Connection,
    args: &LearnArgs,
    progress: impl Fn(f64),
) -> Result<Lessons, Failure> {
    let found = questioned(&args.folders, args.questions.as_deref())?;
    let (count, mut videos) = (found.len(), vec![]);
    for (k, one) in found.into_iter().enumerate() {
        let one = one?;
        let scene = input::scene(&one.scene)?;
        let video = connection.post(&scene).await?;
        let read = one.questions.iter().map(|q| lesson(q, args.programs));
        let lessons: Result<Vec<_>, Failure> = read.collect();
        let lessons = lessons.map_err(|e| e.at(&one.file.display().to_string()))?;
        videos.push(LessonVideo { video, model: None, lessons });
        progress((k + 1) as f64 / count as f64);
    }
    Ok(Lessons { videos, observed_only: args.observed_only })
}

/// Posts the scenes of examples, each file once: `posted` has their names.
async fn examples(
    connection: &Connection,
    (given, kind): (&[String], ConceptKind),
    posted: &mut BTreeMap<String, String>,
) -> Result<Vec<ConceptExample>, Failure> {
    let mut found = vec![];
    for text in given {
        let refused = |form: &str| Failure::input(format!("{text:?} is no example; give {form}"));
        if kind == ConceptKind::Change {
            let form = "FILE:OBJECT=FILE, the second scene having the object changed";
            let (before, object_id, after) = changed(text).ok_or_else(|| refused(form))?;
            let video = posted_once(connection, before, posted).await?;
            let changed_video = posted_once(connection, after, posted).await?;
            found.push(ConceptExample { video, object_id, changed_video, ..Default::default() });
            continue;
        }
        let form =
            "FILE:OBJECT, or FILE:OBJECT:OTHER@FRAME for an encounter; with --quantity FILE:OBJECT=FILE";
        let (file, place) = place(text).ok_or_else(|| refused(form))?;
        let video = posted_once(connection, file, posted).await?;
        found.push(ConceptExample { video, ..place });
    }
    Ok(found)
}

/// The name of the scene of a file, which is posted unless it was.
async fn posted_once(
    connection: &Connection,
    file: &str,
    posted: &mut BTreeMap<String, String>,
) -> Result<String, Failure> {
    if let Some(known) = posted.get(file) {
        return Ok(known.clone());
    }
    let video = connection.post(&input::scene(Path::new(file))?).await?;
    posted.insert(file.to_string(), video.clone());
    Ok(video)
}

/// The file of an example of a change, its object, and the file in which it is changed.
fn changed(text: &str) -> Option<(&str, u32, &str)> {
    let of = |(at, _): (usize, &str)| {
        let (before, after) = (text.get(..at)?, text.get(at + 1..)?);
        let (file, object) = before.rsplit_once(':')?;
        Some((file, object.parse().ok()?, after))
    };
    text.match_indices('=').find_map(of).filter(|(before, _, after)| !before.is_empty() && !after.is_empty())
}

/// The file of an example, and its object or collision.
fn place(text: &str) -> Option<(&str, ConceptExample)> {
    let (before, last) = text.rsplit_once(':')?;
    match last.split_once('@') {
        None => {
            let object_id = last.parse().ok()?;
            Some((before, ConceptExample { object_id, ..Default::default() }))
        }
        Some((other, frame)) => {
            let (file, object) = before.rsplit_once(':')?;
            let (object_id, other_id) = (object.parse().ok()?, Some(other.parse().ok()?));
            let frame = frame.parse().ok()?;
            Some((file, ConceptExample { object_id, other_id, frame, ..Default::default() }))
        }
    }
}

async fn learned(
    connection: &Connection,
    request: LearnConceptsRequest,
    progress: impl Fn(f64),
) -> Result<Lexicon, Failure> {
    let open = async || connection.concepts().learn_concepts(request.clone()).await;
    let event = |m: LearnConceptsResponse| match m.event? {
        learn_concepts_response::Event::Progress(fraction) => Some(StreamEvent::Progress(fraction)),
        learn_concepts_response::Event::Lexicon(lexicon) => Some(StreamEvent::Result(lexicon)),
    };
    final_result(open, event, progress).await
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn examples_are_objects_or_collisions() {
        let (file, object) = place("a:b/scene:3").unwrap();
        assert_eq!((file, object.object_id, object.other_id), ("a:b/scene", 3, None));
        let (file, hit) = place("scene:3:5@40").unwrap();
        assert_eq!((file, hit.object_id, hit.other_id, hit.frame), ("scene", 3, Some(5), 40));
        assert_eq!(changed("a:b/scene:3=other=1"), Some(("a:b/scene", 3, "other=1")));
        assert_eq!(changed("mu=0.1/scene:3=other"), Some(("mu=0.1/scene", 3, "other")));
        for wrong in ["scene:3", "scene=other", "scene:red=other", "scene:3="] {
            assert_eq!(changed(wrong), None, "{wrong}");
        }
        for wrong in ["scene", "scene:", "scene:red", "scene:3@4", "scene:3:5@"] {
            assert!(place(wrong).is_none(), "{wrong}");
        }
    }
}
