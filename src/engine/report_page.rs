//! Reports: a discovery, and answers to questions, as one page with its pictures and traces.

use super::error::EngineError;
use super::model_source::{ModelSource, ModelSourceKind};
use super::pool::JobKind;
use super::questions::AskedQuestion;
use super::results::{Findings, StoredFit, Study};
use super::state::Engine;
use super::traces::file::TraceKind;
use super::traces::stored::TraceFilter;
use crate::discover::{Discovery, FoundEffect, Revision, SceneComparison, Verdict};
use crate::fit::Fit;
use crate::reason::{AskOptions, Question, WordProbabilities};
use crate::report::{AnsweredQuestion, KeptModels, ReportData, TraceLink, report, step_words};
use std::sync::Arc;

/// A question that the page answers.
#[derive(Debug, Clone)]
pub struct ReportQuestion {
    pub video: String,
    /// The default means the last model of the study, if the study has the video.
    pub source: ModelSource,
    pub asked: AskedQuestion,
    pub options: AskOptions,
}

/// What a page shows beside its models.
#[derive(Debug, Clone, Default)]
pub struct ReportContents {
    pub questions: Vec<ReportQuestion>,
    /// Traces are linked as `{prefix}{id}.mcap`; without it they are only named.
    pub prefix: Option<String>,
    /// Id of the lexicon whose words the page shows, and with which its questions are answered.
    pub lexicon: Option<String>,
}

/// A page with its pictures and traces.
#[derive(Debug, Clone, PartialEq)]
pub struct ReportPage {
    pub html: String,
    /// File names and SVG.
    pub pictures: Vec<(String, String)>,
    /// Ids of the traces that it shows.
    pub traces: Vec<String>,
}

impl Engine {
    /// The page of kept models and those beside them. Without others it is of their history.
    pub async fn models_page(
        self: &Arc<Self>,
        models: Vec<StoredFit>,
        against: Option<Vec<StoredFit>>,
        contents: ReportContents,
    ) -> Result<ReportPage, EngineError> {
        let beside = against.is_some();
        let mut chain = vec![models];
        match against {
            Some(others) => chain.insert(0, others),
            None => {
                while let Some(parents) = self.parents_of(chain.first().map_or(&[], Vec::as_slice)).await? {
                    chain.insert(0, parents);
                }
            }
        }
        let (mut revisions, mut steps) = (vec![], vec![]);
        for fits in &chain {
            revisions.push(self.revision_of(fits).await?);
            steps.push(step_of(fits, beside));
        }
        let last = chain.last().map_or(&[][..], Vec::as_slice);
        let videos = last.iter().map(|f| f.video.clone()).collect();
        let squares = last.iter().filter_map(|f| f.fit.scenes.first()).map(|s| s.noise_sigma * s.noise_sigma);
        let noise_sigma = (squares.sum::<f64>() / last.len().max(1) as f64).sqrt();
        let kept = kept_words(&steps, last, beside);
        let discovery =
            Discovery { effects: effects_of(&chain, beside), noise_sigma, revisions, ..no_discovery() };
        let models = last.iter().map(|f| f.id.clone()).collect();
        let subject = ReportSubject { videos, models, discovery, steps, kept: Some(kept) };
        self.subject_page(subject, contents).await
    }

    /// The models of the parent revision, if it is kept.
    async fn parents_of(&self, fits: &[StoredFit]) -> Result<Option<Vec<StoredFit>>, EngineError> {
        let mut parents = vec![];
        for fit in fits {
            let id = fit.record.as_ref().and_then(|r| {
                let at = r.videos.iter().position(|v| *v == fit.video)?;
                r.parents.get(at)
            });
            let Some(id) = id else { return Ok(None) };
            match self.model(&fit.video, id).await {
                Ok(parent) => parents.push(parent),
                Err(EngineError::NotFound { .. }) => return Ok(None),
                Err(error) => return Err(error),
            }
        }
        Ok((!parents.is_empty()).then_some(parents))
    }

    /// Kept models as one revision: its recorded errors where they are of these videos, else computed.
    async fn revision_of(self: &Arc<Self>, fits: &[StoredFit]) -> Result<Revision, EngineError> {
        let all: Vec<&Fit> = fits.iter().map(|f| &f.fit).collect();
        let Some(fit) = Fit::joined(&all) else {
            return Err(EngineError::invalid("study.models", "are none; give one a video"));
        };
        let record = fits.first().and_then(|f| f.record.as_ref()).filter(|r| r.videos.len() == fits.len());
        let effect = record.and_then(|r| r.added.as_ref()).map(|added| added.effect.clone());
        if let Some(r) = record {
            let (rmse, reduced_chi_square) = (r.rmse, r.reduced_chi_square);
            let [held_out_rmse, left_out_rmse] =
                [r.prediction_errors.held_out_rmse, r.prediction_errors.left_out_rmse];
            let unpooled = vec![];
            return Ok(Revision {
                effect,
                fit,
                rmse,
                held_out_rmse,
                left_out_rmse,
                reduced_chi_square,
                unpooled,
            });
        }
        let (_, found) = self.side_comparison(fits).await?;
        let pooled = |of: &dyn Fn(&SceneComparison) -> f64| {
            let squares: f64 = found.scenes.iter().map(|s| of(s) * of(s)).sum();
            (squares / found.scenes.len().max(1) as f64).sqrt()
        };
        let degrees: f64 = found.scenes.iter().map(|s| s.degrees_of_freedom as f64).sum();
        let chi: f64 = found.scenes.iter().map(|s| s.reduced_chi_square * s.degrees_of_freedom as f64).sum();
        Ok(Revision {
            effect,
            fit,
            rmse: pooled(&|s| s.rmse),
            held_out_rmse: pooled(&|s| s.held_out_rmse),
            left_out_rmse: f64::NAN,
            reduced_chi_square: chi / degrees.max(1.0),
            unpooled: vec![],
        })
    }

    /// The page of a discovery.
    pub async fn page(
        self: &Arc<Self>,
        study: &Study,
        contents: ReportContents,
    ) -> Result<ReportPage, EngineError> {
        let Findings::Discovery(found) = &study.findings else {
            return Err(EngineError::invalid("study", "is no discovery"));
        };
        let models = found.records.last().map(|r| r.models.clone()).unwrap_or_default();
        let step = |r: &Revision| step_words(r.effect.as_deref(), None);
        let steps = found.discovery.revisions.iter().map(step).collect();
        let (videos, discovery) = (study.videos.clone(), found.discovery.clone());
        let subject = ReportSubject { videos, models, discovery, steps, kept: None };
        self.subject_page(subject, contents).await
    }

    /// How probable the words of a lexicon are, for each video; none without a lexicon.
    async fn words_of_videos(
        self: &Arc<Self>,
        lexicon: Option<&str>,
        videos: &[String],
    ) -> Result<Vec<WordProbabilities>, EngineError> {
        let mut words = vec![];
        if let Some(lexicon) = lexicon {
            for video in videos {
                words.push(self.words_of_video(lexicon, video).await?.1);
            }
        }
        Ok(words)
    }

    async fn subject_page(
        self: &Arc<Self>,
        subject: ReportSubject,
        contents: ReportContents,
    ) -> Result<ReportPage, EngineError> {
        let last = &subject.models;
        let (mut scenes, mut stills, mut ids, mut links) = (vec![], vec![], vec![], vec![]);
        for (k, video) in subject.videos.iter().enumerate() {
            let scene = self.video(video).await?;
            if let Some(model) = last.get(k) {
                let filter = TraceFilter { model: Some(model.clone()), ..TraceFilter::default() };
                for trace in self.traces(filter, "", MOST_MODEL_TRACES).await? {
                    if trace.kind == TraceKind::Discovery {
                        links.push((trace.id, format!("{}: without and with what was added", scene.name)));
                    }
                }
            }
            stills.push(self.stills(video).await?);
            scenes.push(scene);
        }
        let mut answers = vec![];
        let words = self.words_of_videos(contents.lexicon.as_deref(), &subject.videos).await?;
        for query in contents.questions {
            let video = query.video;
            let ours = subject.videos.iter().position(|v| *v == video).and_then(|k| last.get(k));
            let source = match (&query.source.kind, ours) {
                (ModelSourceKind::Default, Some(id)) => {
                    ModelSource { kind: ModelSourceKind::Fitted(id.clone()), ..query.source }
                }
                _ => query.source,
            };
            let text = match &query.asked.question {
                Question::English { question, .. } => question.clone(),
                Question::Program { program, .. } => program.join(" "),
            };
            let asked = query.asked.or_with(contents.lexicon.as_ref());
            let done = self.ask(&video, &source, asked, query.options).await?;
            let model = self.model(&video, &done.model).await?;
            links.extend(done.traces.iter().map(|id| (id.clone(), format!("“{text}”"))));
            answers.push((text, self.video(&video).await?, model, done));
        }
        let mut linked = vec![];
        for (id, about) in links {
            if !ids.contains(&id) {
                let href = contents.prefix.as_ref().map(|prefix| format!("{prefix}{id}.mcap"));
                linked.push(TraceLink { name: format!("traces/{id}"), href, about });
                ids.push(id);
            }
        }
        self.compute_as(JobKind::Page, move |stop| {
            let scenes: Vec<_> = scenes.iter().map(|s| s.as_ref().clone()).collect();
            let answered = answers.iter().filter_map(|(question, scene, model, done)| {
                let model = &model.fit.scenes.first()?.model;
                Some(AnsweredQuestion { question, scene, model, answer: &done.answer })
            });
            let data = ReportData {
                scenes: &scenes,
                stills: &stills,
                discovery: &subject.discovery,
                steps: &subject.steps,
                kept: subject.kept.as_ref(),
                answers: &answered.collect::<Vec<_>>(),
                words: &words,
                traces: &linked,
            };
            let (html, pictures) = report(&data, stop)?;
            Ok(ReportPage { html, pictures, traces: ids })
        })
        .await
    }
}

/// What a page is of.
struct ReportSubject {
    videos: Vec<String>,
    /// Ids of its last models, one a video.
    models: Vec<String>,
    discovery: Discovery,
    /// What each revision changes.
    steps: Vec<String>,
    kept: Option<KeptModels>,
}

/// Digits of an id in words.
const ID_DIGITS: usize = 8;

fn short_id(fits: &[StoredFit]) -> String {
    fits.first().map_or(String::new(), |f| f.id.chars().take(ID_DIGITS).collect())
}

/// What a revision changes; of one that stands beside another also which it is.
fn step_of(fits: &[StoredFit], beside: bool) -> String {
    let record = fits.first().and_then(|f| f.record.as_ref());
    let added = record.and_then(|r| r.added.as_ref()).map(|a| a.effect.as_str());
    let step = step_words(added, record.and_then(|r| r.removed.as_deref()));
    let preset = fits.first().and_then(|f| f.fit.scenes.first()).map_or("", |s| s.model.preset.as_str());
    let step = if record.is_none() { "fit".to_string() } else { step };
    if beside { format!("{preset} {step} ({})", short_id(fits)) } else { step }
}

/// Effects that were added on the way and are still there; of two models side by side that of the last.
fn effects_of(chain: &[Vec<StoredFit>], beside: bool) -> Vec<FoundEffect> {
    let from = if beside { chain.len().saturating_sub(1) } else { 0 };
    let records = chain[from..].iter().filter_map(|fits| fits.first()?.record.as_ref());
    let last = chain.last().and_then(|fits| fits.first()).and_then(|f| f.fit.scenes.first());
    let added = records.filter_map(|r| r.added.clone());
    added.filter(|found| last.is_some_and(|s| s.model.effect(&found.effect).is_some())).collect()
}

fn kept_words(steps: &[String], last: &[StoredFit], beside: bool) -> KeptModels {
    let ends = [steps.first(), steps.last()].map(|step| step.cloned().unwrap_or_default());
    let headline = match beside {
        true => format!("{} beside {}", ends[1], ends[0]),
        false => format!("Model {}: {}", short_id(last), steps.join(", ")),
    };
    let sentence = match (beside, steps.len()) {
        (true, _) => "Two models of the same videos, side by side.",
        (false, 1) => "A fitted model, as it is.",
        (false, _) => "A revision, beside the first one of its history.",
    };
    KeptModels { headline, sentence: sentence.into(), names: ends }
}

/// A discovery that searched nothing.
fn no_discovery() -> Discovery {
    Discovery {
        verdict: Verdict::Adequate,
        effects: vec![],
        ranked: vec![],
        ambiguous: vec![],
        experiment: None,
        formula: None,
        smallest: vec![],
        noise_sigma: 0.0,
        revisions: vec![],
        reason: String::new(),
    }
}

/// Traces of one model among which those of its discovery are searched.
const MOST_MODEL_TRACES: usize = 1000;
