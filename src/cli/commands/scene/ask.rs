//! `ask`: answers a question about a scene, with probability and explanation.

use super::asked::AskedArgs;
use crate::api::v1::{AskRequest, AskResponse, Choice, Step, ask_request, choice};
use crate::cli::connection::{Connection, Target};
use crate::cli::error::Failure;
use crate::cli::output::progress;
use crate::cli::{input, output};
use crate::reason::examples;
use serde_json::{Value, json};
use std::path::PathBuf;

#[derive(clap::Args)]
#[command(after_help = question_forms(), group(clap::ArgGroup::new("asked").args(["question", "program"]).required(true)))]
pub struct AskArgs {
    /// Scene file or scene folder.
    #[arg(value_name = "SCENE")]
    scene: PathBuf,
    #[command(flatten)]
    asked: AskedArgs,
    /// Number of rollouts, each with parameters drawn from the posterior, 1 to 32 [default: 32]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=32))]
    rollouts: Option<u32>,
    /// Seed of the draws; the same seed gives the same result.
    #[arg(long, value_name = "N", default_value_t = 0)]
    seed: u64,
    /// Preset, id of a kept model (`vrdp show`), or model file [default: by the scene's world].
    #[arg(long, value_name = "NAME|ID|FILE")]
    model: Option<String>,
    /// Describes the objects by the words of this lexicon (`vrdp learn`), and not by the scene's own.
    #[arg(long, value_name = "FILE")]
    lexicon: Option<PathBuf>,
    /// Writes the result as JSON too; `-`: to standard output, instead of the text.
    #[arg(long, value_name = "FILE")]
    json: Option<String>,
}

pub fn question_forms() -> String {
    format!("Examples of questions and choices:\n  {}", examples().join("\n  "))
}

pub async fn run(target: &Target, args: AskArgs) -> Result<(), Failure> {
    if let Some(file) = &args.json {
        output::writable("--json", file.as_ref())?;
    }
    let scene = input::scene(&args.scene)?;
    let model = input::model("--model", args.model.as_deref())?;
    let connection = Connection::open(target).await?;
    let video = connection.post(&scene).await?;
    let model = connection.choice(&video, model.as_ref()).await?;
    let (rollouts, seed) = (args.rollouts, args.seed);
    let lexicon = connection.lexicon(args.lexicon.as_deref()).await?;
    let (question, choices) = args.asked.question();
    let request = AskRequest {
        video,
        model,
        question: Some(question),
        choices,
        rollouts,
        seed,
        lexicon,
        previous: args.asked.previous.clone(),
        words: args.asked.words()?,
        ..Default::default()
    };
    let mut reply = progress::during("answering", connection.reasoning().ask(request)).await?.into_inner();
    if !connection.keeps_traces() {
        reply.traces.clear();
    }
    let next = output::next("simulate", std::slice::from_ref(&args.scene), &[]);
    let text = text(&reply) + &next;
    output::result(args.json.as_deref(), &text, || to_json(&scene.name, &reply))?;
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

/// The answer as text.
pub fn text(reply: &AskResponse) -> String {
    let mut text = String::new();
    if let Some(answer) = &reply.answer {
        // An answer of several events already has a probability for each.
        let has_own = answer.ends_with(" %)");
        let probability =
            if has_own { String::new() } else { format!("  ({:.0} %)", 100.0 * reply.probability) };
        text += &format!("  {answer}{probability}\n{}", derivation(&reply.derivation));
    }
    for choice in &reply.choices {
        let (mark, probability) =
            if choice.correct { ('✓', choice.probability) } else { ('✗', 1.0 - choice.probability) };
        text += &format!("  {mark} {}  ({:.0} % sure)\n", choice.choice, 100.0 * probability);
        text += &derivation(&choice.derivation);
    }
    if !reply.explanation.is_empty() {
        text += &format!("  {}\n", reply.explanation);
    }
    text
}

/// The steps of the program, without those whose result repeats the word, such as `red`.
pub fn derivation(steps: &[Step]) -> String {
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
        "reading": reply.reading,
        "parser": reply.parser,
        "explanation": reply.explanation,
        "words": crate::cli::commands::words::show::objects(&reply.words),
        "traces": reply.traces,
    })
}
