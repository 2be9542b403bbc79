//! `ask`: answers a question about a scene, with probability and explanation.

use super::Target;
use super::connect::Connection;
use super::error::Failure;
use super::{input, output, progress};
use crate::api::v1::{AskRequest, AskResponse, Choice, Step, ask_request, choice};
use crate::reason::examples;
use serde_json::{Value, json};
use std::path::PathBuf;

#[derive(clap::Args)]
#[command(after_help = forms())]
pub struct Args {
    #[arg(value_name = "SCENE")]
    scene: PathBuf,
    /// The question, in English; such as below.
    #[arg(long, value_name = "TEXT")]
    question: String,
    /// A choice to judge; may be repeated. None: an open answer.
    #[arg(long, value_name = "TEXT")]
    choice: Vec<String>,
    /// Preset or model file [default: what suits the scene's world].
    #[arg(long, value_name = "NAME|FILE")]
    model: Option<String>,
    /// Writes the result as JSON; `-`: to standard output.
    #[arg(long, value_name = "FILE")]
    json: Option<String>,
}

fn forms() -> String {
    format!("Questions and choices such as:\n  {}", examples().join("\n  "))
}

pub async fn run(target: &Target, args: Args) -> Result<(), Failure> {
    if let Some(file) = &args.json {
        output::writable("--json", file.as_ref())?;
    }
    let scene = input::scene(&args.scene)?;
    let model = input::model(args.model.as_deref())?;
    let connection = Connection::open(target).await?;
    let video = connection.post(&scene).await?;
    let request = AskRequest { model, ..request(video, &args.question, &args.choice) };
    let mut reply = progress::during("thinks", connection.reasoning().ask(request)).await?.into_inner();
    if !connection.keeps_traces() {
        reply.traces.clear();
    }
    match args.json.as_deref() {
        Some(target) => output::json(target, &to_json(&scene.name, &reply))?,
        None => output::print(&text(&reply))?,
    }
    connection.close().await
}

/// A question in English.
pub fn request(video: String, question: &str, choices: &[impl AsRef<str>]) -> AskRequest {
    let choice = |text: &str| Choice { choice: Some(choice::Choice::Text(text.into())) };
    AskRequest {
        video,
        question: Some(ask_request::Question::Text(question.into())),
        choices: choices.iter().map(|text| choice(text.as_ref())).collect(),
        ..Default::default()
    }
}

/// The answer as a person reads it.
pub fn text(reply: &AskResponse) -> String {
    let mut text = String::new();
    if let Some(answer) = &reply.answer {
        // Several events have each their own.
        let own = answer.ends_with(" %)");
        let probability = if own { String::new() } else { format!("  ({:.0} %)", 100.0 * reply.probability) };
        text += &format!("  {answer}{probability}\n{}", trail(&reply.derivation));
    }
    for choice in &reply.choices {
        let (mark, probability) =
            if choice.correct { ('✓', choice.probability) } else { ('✗', 1.0 - choice.probability) };
        text += &format!("  {mark} {}  ({:.0} % sure)\n", choice.choice, 100.0 * probability);
        text += &trail(&choice.derivation);
    }
    if !reply.explanation.is_empty() {
        text += &format!("  {}\n", reply.explanation);
    }
    text
}

/// Steps but for the words of the question, such as `red`, that stand for themselves.
fn trail(steps: &[Step]) -> String {
    let steps: Vec<&Step> = steps.iter().filter(|s| s.token != s.text).collect();
    let width = steps.iter().map(|s| s.token.chars().count()).max().unwrap_or(0);
    steps.iter().map(|s| format!("      {:<width$}  {}\n", s.token, s.text)).collect()
}

fn to_json(scene: &str, reply: &AskResponse) -> Value {
    let steps = |trail: &[Step]| -> Vec<Value> {
        trail.iter().map(|s| json!({ "token": s.token, "text": s.text })).collect()
    };
    let choices: Vec<Value> = reply
        .choices
        .iter()
        .map(|c| {
            json!({
                "choice": c.choice, "correct": c.correct,
                "probability": c.probability, "trail": steps(&c.derivation),
            })
        })
        .collect();
    json!({
        "scene": scene,
        "answer": reply.answer,
        "probability": reply.probability,
        "choices": choices,
        "trail": steps(&reply.derivation),
        "program": reply.program.as_ref().map(|p| &p.tokens),
        "explanation": reply.explanation,
        "traces": reply.traces,
    })
}
