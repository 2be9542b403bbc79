//! `effects`: lists the catalogue of physical effects.

use crate::api::v1::{Effect, ListEffectsRequest};
use crate::cli::connection::{Connection, Target};
use crate::cli::error::Failure;
use crate::cli::output;
use crate::effects::alike;
use serde_json::{Value, json};

#[derive(clap::Args)]
pub struct EffectsArgs {
    /// Names of the effects to show [default: all].
    #[arg(value_name = "EFFECT")]
    effects: Vec<String>,
    /// Writes the result as JSON too; `-`: to standard output, instead of the text.
    #[arg(long, value_name = "FILE")]
    json: Option<String>,
}

pub async fn run(target: &Target, args: EffectsArgs) -> Result<(), Failure> {
    let connection = Connection::open(target).await?;
    let mut effects = connection.models().list_effects(ListEffectsRequest {}).await?.into_inner().effects;
    if let Some(unknown) = args.effects.iter().find(|name| !effects.iter().any(|e| e.name == **name)) {
        return Err(Failure::input(format!(
            "{unknown} is not in the catalogue; did you mean {}? `vrdp effects` lists all",
            alike(unknown).join(", ")
        )));
    }
    effects.retain(|e| args.effects.is_empty() || args.effects.contains(&e.name));
    let value = || json!({ "effects": effects.iter().map(to_json).collect::<Vec<_>>() });
    output::result(args.json.as_deref(), &effects.iter().map(text).collect::<String>(), value)?;
    connection.close().await
}

fn text(e: &Effect) -> String {
    let mut text = format!("{}\n  {}\n  {}\n", e.name, e.description, e.source);
    for p in &e.parameters {
        text += &format!("    {} [{}], {} to {}: {}\n", p.name, p.unit, p.min, p.max, p.description);
    }
    text + "\n"
}

fn to_json(e: &Effect) -> Value {
    let parameter = |p: &crate::api::v1::EffectParameter| {
        json!({
            "name": p.name,
            "description": p.description,
            "unit": p.unit,
            "default": p.default_value,
            "min": p.min,
            "max": p.max,
            "scope": p.scope,
        })
    };
    json!({
        "name": e.name,
        "description": e.description,
        "source": e.source,
        "parameters": e.parameters.iter().map(parameter).collect::<Vec<_>>(),
    })
}
