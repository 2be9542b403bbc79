//! Reports: a discovery, and answers to questions, as one page with its pictures and traces.

use super::error::EngineError;
use super::model_source::{ModelSource, ModelSourceKind};
use super::results::{Findings, Study};
use super::state::Engine;
use super::traces::file::TraceKind;
use super::traces::stored::TraceFilter;
use crate::reason::{AskOptions, Question};
use crate::report::{AnsweredQuestion, ReportData, TraceLink, report};
use std::sync::Arc;

/// A question that the page answers.
#[derive(Debug, Clone)]
pub struct ReportQuestion {
    pub video: String,
    /// The default means the last model of the study, if the study has the video.
    pub source: ModelSource,
    pub question: Question,
    pub options: AskOptions,
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
    /// The page of a discovery. Traces are linked as `{prefix}{id}.mcap`; without a prefix they are only named.
    pub async fn page(
        self: &Arc<Self>,
        study: &Study,
        queries: Vec<ReportQuestion>,
        prefix: Option<String>,
    ) -> Result<ReportPage, EngineError> {
        let Findings::Discovery(found) = &study.findings else {
            return Err(EngineError::invalid("study", "is no discovery"));
        };
        let last = found.records.last().map(|r| r.models.clone()).unwrap_or_default();
        let mut scenes = vec![];
        let (mut ids, mut links) = (vec![], vec![]);
        for (k, video) in study.videos.iter().enumerate() {
            let scene = self.video(video).await?;
            if let Some(model) = last.get(k) {
                let filter = TraceFilter { model: Some(model.clone()), ..TraceFilter::default() };
                for trace in self.traces(filter, "", MOST_MODEL_TRACES).await? {
                    if trace.kind == TraceKind::Discovery {
                        links.push((trace.id, format!("{}: without and with what was added", scene.name)));
                    }
                }
            }
            scenes.push(scene);
        }
        let mut answers = vec![];
        for query in queries {
            let video = query.video;
            let ours = study.videos.iter().position(|v| *v == video).and_then(|k| last.get(k));
            let source = match (&query.source.kind, ours) {
                (ModelSourceKind::Default, Some(id)) => {
                    ModelSource { kind: ModelSourceKind::Fitted(id.clone()), ..query.source }
                }
                _ => query.source,
            };
            let text = match &query.question {
                Question::English { question, .. } => question.clone(),
                Question::Program { program, .. } => program.join(" "),
            };
            let done = self.ask(&video, &source, query.question, query.options).await?;
            let model = self.model(&video, &done.model).await?;
            links.extend(done.traces.iter().map(|id| (id.clone(), format!("“{text}”"))));
            answers.push((text, self.video(&video).await?, model, done));
        }
        let mut linked = vec![];
        for (id, about) in links {
            if !ids.contains(&id) {
                let href = prefix.as_ref().map(|prefix| format!("{prefix}{id}.mcap"));
                linked.push(TraceLink { name: format!("traces/{id}"), href, about });
                ids.push(id);
            }
        }
        let discovery = found.discovery.clone();
        self.compute(move || {
            let scenes: Vec<_> = scenes.iter().map(|s| s.as_ref().clone()).collect();
            let answered = answers.iter().filter_map(|(question, scene, model, done)| {
                let model = &model.fit.scenes.first()?.model;
                Some(AnsweredQuestion { question, scene, model, answer: &done.answer })
            });
            let answers: Vec<AnsweredQuestion> = answered.collect();
            let (html, pictures) = report(&ReportData {
                scenes: &scenes,
                discovery: &discovery,
                answers: &answers,
                traces: &linked,
            });
            Ok(ReportPage { html, pictures, traces: ids })
        })
        .await
    }
}

/// Traces of one model among which those of its discovery are searched.
const MOST_MODEL_TRACES: usize = 1000;
