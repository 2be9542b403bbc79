//! `parse`: how a question is understood, and what a parser of one's own may write.

use super::ask::question_forms;
use super::asked::AskedArgs;
use crate::api::v1::{
    ParseQuestionRequest, ParseQuestionResponse, ReasoningListOperationsRequest,
    ReasoningListOperationsResponse, ask_request, parse_question_request,
};
use crate::cli::connection::{Connection, Target};
use crate::cli::error::Failure;
use crate::cli::{input, output};
use serde_json::{Value, json};
use std::path::PathBuf;

#[derive(clap::Args)]
#[command(
    after_help = question_forms(),
    group(clap::ArgGroup::new("wanted").args(["question", "program", "operations", "schema"]).required(true)),
)]
pub struct ParseArgs {
    /// Scene file or scene folder, whose objects are resolved; without it the text alone is read.
    #[arg(value_name = "SCENE")]
    scene: Option<PathBuf>,
    #[command(flatten)]
    asked: AskedArgs,
    /// Reads the words of this lexicon (`vrdp learn`), too.
    #[arg(long, value_name = "FILE")]
    lexicon: Option<PathBuf>,
    /// Lists the operations of programs, with signature, meaning and an example.
    #[arg(long)]
    operations: bool,
    /// Prints a grammar of programs, for a language model that writes them.
    #[arg(long, value_name = "FORM", value_enum)]
    schema: Option<Schema>,
    /// Writes the result as JSON too; `-`: to standard output, instead of the text.
    #[arg(long, value_name = "FILE")]
    json: Option<String>,
}

#[derive(Clone, Copy, clap::ValueEnum)]
enum Schema {
    /// JSON schema of {"program": [token, ...]}.
    Json,
    /// GBNF grammar, as llama.cpp reads it.
    Gbnf,
}

pub async fn run(target: &Target, args: ParseArgs) -> Result<(), Failure> {
    let json = args.json.as_deref();
    if let Some(file) = json {
        output::writable("--json", file.as_ref())?;
    }
    let connection = Connection::open(target).await?;
    if args.operations || args.schema.is_some() {
        let request = ReasoningListOperationsRequest {};
        let listed = connection.reasoning().list_operations(request).await?.into_inner();
        let text = match args.schema {
            None => operations(&listed),
            Some(Schema::Json) => listed.json_schema.clone() + "\n",
            Some(Schema::Gbnf) => listed.gbnf_grammar.clone(),
        };
        output::result(json, &text, || listed_json(&listed))?;
        return connection.close().await;
    }
    let asked = &args.asked;
    let video = match &args.scene {
        Some(scene) => connection.post(&input::scene(scene)?).await?,
        None => String::new(),
    };
    let (question, choices) = asked.question();
    let question = match question {
        ask_request::Question::Text(text) => parse_question_request::Question::Text(text),
        ask_request::Question::Program(program) => parse_question_request::Question::Program(program),
    };
    let (previous, words) = (asked.previous.clone(), asked.words()?);
    let lexicon = connection.lexicon(args.lexicon.as_deref()).await?;
    let request = ParseQuestionRequest { video, question: Some(question), choices, previous, words, lexicon };
    let reply = connection.reasoning().parse_question(request).await?.into_inner();
    output::result(json, &text(&reply), || to_json(&reply))?;
    connection.close().await
}

fn text(reply: &ParseQuestionResponse) -> String {
    let programs = reply.program.iter().chain(&reply.choices);
    let programs: String = programs.map(|p| format!("  {}\n", p.tokens.join(" "))).collect();
    let parser = match reply.parser.as_str() {
        "" => String::new(),
        name => format!(" (written by the language model {name})"),
    };
    format!("{programs}  Read as: {}{parser}.\n", reply.reading.trim_end_matches('?'))
}

fn to_json(reply: &ParseQuestionResponse) -> Value {
    json!({
        "program": reply.program.as_ref().map(|p| &p.tokens),
        "choices": reply.choices.iter().map(|p| &p.tokens).collect::<Vec<_>>(),
        "reading": reply.reading,
        "parser": reply.parser,
    })
}

fn operations(listed: &ReasoningListOperationsResponse) -> String {
    let one = |o: &crate::api::v1::ProgramOperation| {
        let also = match o.aliases.is_empty() {
            true => String::new(),
            false => format!("  (also {})", o.aliases.join(", ")),
        };
        let example = match o.example.is_empty() {
            true => String::new(),
            false => format!("    {}\n", o.example),
        };
        format!("{}{also}\n  {}\n  {}\n{example}", o.name, o.signature, o.doc)
    };
    listed.operations.iter().map(one).collect()
}

fn listed_json(listed: &ReasoningListOperationsResponse) -> Value {
    let one = |o: &crate::api::v1::ProgramOperation| {
        json!({
            "name": o.name,
            "aliases": o.aliases,
            "signature": o.signature,
            "doc": o.doc,
            "example": o.example,
        })
    };
    let schema: Value = serde_json::from_str(&listed.json_schema).unwrap_or_default();
    json!({
        "operations": listed.operations.iter().map(one).collect::<Vec<_>>(),
        "json_schema": schema,
        "gbnf_grammar": listed.gbnf_grammar,
    })
}
