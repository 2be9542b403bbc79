//! Learning: words are learned once from equal requests.

use crate::concepts::{
    ChangeExample, ChangeOptions, ConceptError, Example, ExampleNumber, ExampleOf, LearnOptions,
    LearnProgress, Lesson, LessonVideo, Lexicon, WordKind, learn, learn_change, learn_change_from_examples,
    learn_word,
};
use crate::engine::cache::JobHandle;
use crate::engine::error::EngineError;
use crate::engine::metric_names;
use crate::engine::model_source::ModelSource;
use crate::engine::pool::{JobContext, JobKind};
use crate::engine::progress::{Phase, Report};
use crate::engine::results::{StoredFit, result_digest};
use crate::engine::state::Engine;
use crate::engine::task::{Performed, ReportSink, Task};
use crate::engine::traces::file::TraceFile;
use crate::num::{Stop, progress_within};
use crate::reason::ChangedQuantity;
use crate::scene::Scene;
use serde::Serialize;
use std::sync::Arc;

/// Share of the progress of learning that fits have.
const FITS_SHARE: f64 = 0.7;

/// One video's questions with answers, and the model whose simulations give the events; `None`: events come from the tracks.
#[derive(Debug, Clone)]
pub struct VideoLessons {
    pub video: String,
    pub source: Option<ModelSource>,
    pub lessons: Vec<Lesson>,
}

/// Where an example is: an object, or an encounter of it with another about a frame. Ids are those of the video.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub enum ExamplePlace {
    Object(u32),
    Encounter { objects: [u32; 2], frame: usize },
}

/// An example of a word in a stored video.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct NamedExample {
    pub video: String,
    pub place: ExamplePlace,
}

/// An example of a change: an object of a stored video, and another one in which it is changed.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct NamedChange {
    pub video: String,
    pub object_id: u32,
    pub changed_video: String,
}

/// What words are learned from.
#[derive(Debug, Clone)]
pub enum LearnRequest {
    Families(Vec<VideoLessons>),
    Word { name: String, kind: WordKind, yes: Vec<NamedExample>, no: Vec<NamedExample> },
    Change { name: String, quantity: ChangedQuantity, videos: Vec<VideoLessons> },
    ChangeExamples { name: String, quantity: ChangedQuantity, yes: Vec<NamedChange>, no: Vec<NamedChange> },
}

/// A video with its fit, ready to learn from.
struct FittedVideo {
    scene: Arc<Scene>,
    fitted: Option<Arc<StoredFit>>,
    lessons: Vec<Lesson>,
}

impl FittedVideo {
    fn lesson(&self) -> LessonVideo<'_> {
        let fit = self.fitted.as_ref().map(|f| (&f.fit, 0));
        LessonVideo { scene: &self.scene, fit, lessons: &self.lessons }
    }
}

/// Learns words from prepared videos; `base` is the lexicon that a single word is added to.
struct LearningTask {
    base: Lexicon,
    from: PreparedRequest,
    seed: u64,
}

/// What words are learned from, with scenes and fits.
enum PreparedRequest {
    Families(Vec<FittedVideo>),
    Word { name: String, kind: WordKind, yes: Vec<PlacedExample>, no: Vec<PlacedExample> },
    Change { name: String, quantity: ChangedQuantity, videos: Vec<FittedVideo> },
    ChangeExamples { name: String, quantity: ChangedQuantity, yes: Vec<PlacedChange>, no: Vec<PlacedChange> },
}

impl Task for LearningTask {
    type Output = Lexicon;

    fn kind(&self) -> JobKind {
        match self.from {
            PreparedRequest::Word { .. } => JobKind::WordLearning,
            _ => JobKind::Learning,
        }
    }

    fn perform(self, report: ReportSink, stop: Stop) -> Result<(Lexicon, Vec<TraceFile>), EngineError> {
        report(Report::Phase(Phase::Learning));
        let stop: Stop = &progress_within(stop, [FITS_SHARE, 1.0]);
        let LearningTask { base, from, seed } = self;
        let learned: Result<Lexicon, ConceptError> = match from {
            PreparedRequest::Families(videos) => {
                let lessons: Vec<LessonVideo> = videos.iter().map(FittedVideo::lesson).collect();
                let progress = |at: LearnProgress| report(Report::Loss(at.loss));
                learn(&lessons, &LearnOptions { seed, ..LearnOptions::default() }, &progress, stop)
            }
            PreparedRequest::Change { name, quantity, videos } => {
                let lessons: Vec<LessonVideo> = videos.iter().map(FittedVideo::lesson).collect();
                learn_change(&base, &name, &lessons, &ChangeOptions { quantity, rollouts: 0, seed }, stop)
            }
            PreparedRequest::ChangeExamples { name, quantity, yes, no } => {
                let yes: Vec<ChangeExample> = yes.iter().map(PlacedChange::example).collect();
                let no: Vec<ChangeExample> = no.iter().map(PlacedChange::example).collect();
                learn_change_from_examples(&base, &name, quantity, (&yes, &no), stop)
            }
            PreparedRequest::Word { name, kind, yes, no } => {
                let yes: Vec<Example> = yes.iter().map(PlacedExample::example).collect();
                let no: Vec<Example> = no.iter().map(PlacedExample::example).collect();
                learn_word(&base, &name, kind, &yes, &no)
            }
        };
        Ok((learned?, vec![]))
    }
}

impl Engine {
    /// Learns words, unless an equal request was just answered; the lexicon is stored before it is returned. `base` is the lexicon
    /// that a single word is added to.
    pub async fn learn(
        self: &Arc<Self>,
        base: Option<&str>,
        request: LearnRequest,
        seed: u64,
    ) -> Result<JobHandle<Lexicon>, EngineError> {
        match &request {
            LearnRequest::Word { yes, no, .. } => check_distinct(yes, no)?,
            LearnRequest::ChangeExamples { yes, no, .. } => check_distinct(yes, no)?,
            LearnRequest::Families(_) | LearnRequest::Change { .. } => {}
        }
        let key = self.result_prefix(&videos_of(&request));
        let digest = result_digest("lexicon", &(base, digest_of(&request), seed));
        let base = match base {
            Some(id) => self.lexicon(id).await?,
            None => Lexicon::default(),
        };
        let first = videos_of(&request).first().map(ToString::to_string).unwrap_or_default();
        let engine = self.clone();
        let work = move |context| async move { engine.run_learning(base, request, seed, context).await };
        Ok(self.lexica.join(format!("{key}{digest}"), &first, self.deadline(), work).await)
    }

    async fn run_learning(
        self: &Arc<Self>,
        base: Lexicon,
        request: LearnRequest,
        seed: u64,
        context: JobContext,
    ) -> Result<Lexicon, EngineError> {
        metric_names::count_result("lexicon", "made");
        let report = context.progress.clone();
        report(Report::Phase(Phase::Fitting));
        let from = match request {
            LearnRequest::Families(videos) => {
                PreparedRequest::Families(self.prepared(videos, &*report).await?)
            }
            LearnRequest::Change { name, quantity, videos } => {
                let videos = self.prepared(videos, &*report).await?;
                PreparedRequest::Change { name, quantity, videos }
            }
            LearnRequest::ChangeExamples { name, quantity, yes, no } => {
                let yes = self.changes("examples.yes", yes, &*report).await?;
                let no = self.changes("examples.no", no, &*report).await?;
                PreparedRequest::ChangeExamples { name, quantity, yes, no }
            }
            LearnRequest::Word { name, kind, yes, no } => {
                let yes = self.examples("examples.yes", yes, kind).await?;
                let no = self.examples("examples.no", no, kind).await?;
                PreparedRequest::Word { name, kind, yes, no }
            }
        };
        let task = LearningTask { base, from, seed };
        let Performed { output: lexicon, slot: _slot, .. } = self.perform(task, context).await?;
        report(Report::Phase(Phase::Storing));
        self.store.put_lexicon(&lexicon.digest(), &lexicon).await?;
        Ok(lexicon)
    }

    /// The videos with their fits, where they are asked for.
    async fn prepared(
        self: &Arc<Self>,
        videos: Vec<VideoLessons>,
        report: ReportSink<'_>,
    ) -> Result<Vec<FittedVideo>, EngineError> {
        let (mut prepared, count) = (vec![], videos.len().max(1) as f64);
        for (k, VideoLessons { video, source, lessons }) in videos.into_iter().enumerate() {
            let scene = self.video(&video).await?;
            let fitted = match source {
                Some(source) => Some(self.drawn(&video, &scene, &source).await?),
                None => None,
            };
            prepared.push(FittedVideo { scene, fitted, lessons });
            report(Report::Fraction(FITS_SHARE * (k + 1) as f64 / count));
        }
        Ok(prepared)
    }

    /// The examples with their scenes; those of events with fits, as simulations say how objects met.
    async fn examples(
        self: &Arc<Self>,
        path: &'static str,
        named: Vec<NamedExample>,
        kind: WordKind,
    ) -> Result<Vec<PlacedExample>, EngineError> {
        let mut placed = vec![];
        for (k, NamedExample { video, place }) in named.into_iter().enumerate() {
            let scene = self.video(&video).await?;
            let index = |id: u32| index_of(&scene, id, || format!("{path}[{k}].object_id"));
            let of = match place {
                ExamplePlace::Object(id) => ExampleOf::Object(index(id)?),
                ExamplePlace::Encounter { objects: [a, b], frame } => {
                    ExampleOf::Encounter { objects: [index(a)?, index(b)?], frame }
                }
            };
            let fitted = match kind {
                WordKind::Event => Some(self.drawn(&video, &scene, &ModelSource::default_of("model")).await?),
                _ => None,
            };
            placed.push(PlacedExample { scene, fitted, of });
        }
        Ok(placed)
    }

    /// The examples of a change with their scenes, and the fits of those before the change.
    async fn changes(
        self: &Arc<Self>,
        path: &'static str,
        named: Vec<NamedChange>,
        report: ReportSink<'_>,
    ) -> Result<Vec<PlacedChange>, EngineError> {
        let (mut placed, count) = (vec![], named.len().max(1) as f64);
        for (k, NamedChange { video, object_id, changed_video }) in named.into_iter().enumerate() {
            let (before, after) = (self.video(&video).await?, self.video(&changed_video).await?);
            let object = index_of(&before, object_id, || format!("{path}[{k}].object_id"))?;
            let fitted = self.drawn(&video, &before, &ModelSource::default_of("model")).await?;
            placed.push(PlacedChange { before, fitted, object, after });
            report(Report::Fraction(FITS_SHARE * (k + 1) as f64 / count));
        }
        Ok(placed)
    }
}

/// Refuses an example that is given twice: it would count as two.
fn check_distinct<T: PartialEq>(yes: &[T], no: &[T]) -> Result<(), EngineError> {
    let all: Vec<&T> = yes.iter().chain(no).collect();
    for (k, example) in all.iter().enumerate() {
        if let Some(first) = all[..k].iter().position(|other| other == example) {
            let [first, second] = [first, k].map(|index| ExampleNumber::of(index, yes.len()).to_string());
            return Err(EngineError::invalid(second, format!("is {first} again; give each example once")));
        }
    }
    Ok(())
}

/// The index of an object in a scene; the refusal names the path.
fn index_of(scene: &Scene, id: u32, path: impl Fn() -> String) -> Result<usize, EngineError> {
    scene.object_index(id).ok_or_else(|| {
        let ids: Vec<String> = scene.objects.iter().map(|o| o.id.to_string()).collect();
        EngineError::invalid(path(), format!("is {id}; the video has the objects {}", ids.join(", ")))
    })
}

/// An example of a change with its scenes.
struct PlacedChange {
    before: Arc<Scene>,
    fitted: Arc<StoredFit>,
    object: usize,
    after: Arc<Scene>,
}

impl PlacedChange {
    fn example(&self) -> ChangeExample<'_> {
        let fit = (&self.fitted.fit, 0);
        ChangeExample { before: &self.before, fit, object: self.object, after: &self.after }
    }
}

/// An example with its scene.
struct PlacedExample {
    scene: Arc<Scene>,
    fitted: Option<Arc<StoredFit>>,
    of: ExampleOf,
}

impl PlacedExample {
    fn example(&self) -> Example<'_> {
        let fit = self.fitted.as_ref().map(|f| (&f.fit, 0));
        Example { scene: &self.scene, fit, of: self.of }
    }
}

/// What a request is known by: equal ones have equal digests.
fn digest_of(request: &LearnRequest) -> String {
    let lessons = |videos: &[VideoLessons]| -> Vec<String> {
        videos.iter().map(|v| format!("{} {:?} {:?}", v.video, v.source, v.lessons)).collect()
    };
    match request {
        LearnRequest::Families(videos) => result_digest("families", &lessons(videos)),
        LearnRequest::Word { name, kind, yes, no } => result_digest("word", &(name, kind, yes, no)),
        LearnRequest::Change { name, quantity, videos } => {
            result_digest("change", &(name, quantity, lessons(videos)))
        }
        LearnRequest::ChangeExamples { name, quantity, yes, no } => {
            result_digest("change examples", &(name, quantity, yes, no))
        }
    }
}

fn videos_of(request: &LearnRequest) -> Vec<&str> {
    match request {
        LearnRequest::Families(videos) | LearnRequest::Change { videos, .. } => {
            videos.iter().map(|v| v.video.as_str()).collect()
        }
        LearnRequest::Word { yes, no, .. } => yes.iter().chain(no).map(|e| e.video.as_str()).collect(),
        LearnRequest::ChangeExamples { yes, no, .. } => {
            yes.iter().chain(no).flat_map(|e| [e.video.as_str(), e.changed_video.as_str()]).collect()
        }
    }
}
