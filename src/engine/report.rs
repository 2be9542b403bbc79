//! Reports: a discovery, and answers to questions, as one page with its pictures and traces.

use super::{Choice, ChoiceKind, Engine, EngineError, Findings, Study, TraceFilter, TraceKind};
use crate::reason::{AskOptions, Question};
use crate::report::{Answered, Report, TraceLink, report};
use std::sync::Arc;

/// What a page is to answer.
#[derive(Debug, Clone)]
pub struct Query {
    pub video: String,
    /// Without a choice: the last model of the study, where it has the video.
    pub choice: Choice,
    pub question: Question,
    pub options: AskOptions,
}

/// A page with what belongs to it.
#[derive(Debug, Clone, PartialEq)]
pub struct Page {
    pub html: String,
    /// File names and SVG.
    pub pictures: Vec<(String, String)>,
    /// Ids of the traces that it stands on.
    pub traces: Vec<String>,
}

impl Engine {
    /// The page of a discovery. Traces are linked as `{prefix}{id}.mcap`, or only named.
    pub async fn page(
        self: &Arc<Self>,
        study: &Study,
        queries: Vec<Query>,
        prefix: Option<String>,
    ) -> Result<Page, EngineError> {
        let Findings::Discovery(found) = &study.findings else {
            return Err(EngineError::invalid("study", "is no discovery"));
        };
        let last = found.steps.last().map(|s| s.models.clone()).unwrap_or_default();
        let mut scenes = vec![];
        let (mut ids, mut links) = (vec![], vec![]);
        for (k, video) in study.videos.iter().enumerate() {
            let scene = self.video(video).await?;
            if let Some(model) = last.get(k) {
                let filter = TraceFilter { model: Some(model.clone()), ..TraceFilter::default() };
                for trace in self.traces(filter, "", MOST_TRACES).await? {
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
            let choice = match (&query.choice.kind, ours) {
                (ChoiceKind::Default, Some(id)) => {
                    Choice { kind: ChoiceKind::Fitted(id.clone()), ..query.choice }
                }
                _ => query.choice,
            };
            let text = match &query.question {
                Question::English { question, .. } => question.clone(),
                Question::Program { program, .. } => program.join(" "),
            };
            let done = self.ask(&video, &choice, query.question, query.options).await?;
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
                Some(Answered { question, scene, model, answer: &done.answer })
            });
            let answers: Vec<Answered> = answered.collect();
            let (html, pictures) = report(&Report {
                scenes: &scenes,
                discovery: &discovery,
                answers: &answers,
                traces: &linked,
            });
            Ok(Page { html, pictures, traces: ids })
        })
        .await
    }
}

/// Traces of one model that are looked through for its discovery's.
const MOST_TRACES: usize = 1000;
