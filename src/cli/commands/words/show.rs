//! `words`: the words of a lexicon, and what one of them means.

use crate::api::v1::{Concept, ConceptKind, DescribeConceptRequest, ListConceptsRequest, WordOfObject};
use crate::cli::connection::{Connection, Target};
use crate::cli::error::Failure;
use crate::cli::{input, output};
use serde_json::{Value, json};
use std::path::PathBuf;

/// Features that a row of the table names.
const NAMED: usize = 3;

#[derive(clap::Args)]
pub struct WordsArgs {
    /// A lexicon that `learn` wrote.
    #[arg(value_name = "LEXICON")]
    lexicon: PathBuf,
    /// Says more of this word: what it looks at, and the words near it.
    #[arg(value_name = "WORD")]
    word: Option<String>,
    /// Says also how probable the word is of each object of this scene.
    #[arg(long, value_name = "SCENE", requires = "word")]
    scene: Option<PathBuf>,
    /// Writes the result as JSON too; `-`: to standard output, instead of the text.
    #[arg(long, value_name = "FILE")]
    json: Option<String>,
}

pub async fn run(target: &Target, args: WordsArgs) -> Result<(), Failure> {
    if let Some(file) = &args.json {
        output::writable("--json", file.as_ref())?;
    }
    let connection = Connection::open(target).await?;
    let lexicon = connection.lexicon(Some(&args.lexicon)).await?;
    let (text, concepts) = match args.word {
        Some(word) => {
            let video = match &args.scene {
                Some(scene) => connection.post(&input::scene(scene)?).await?,
                None => String::new(),
            };
            let asked = DescribeConceptRequest { lexicon, word, video };
            let found = connection.concepts().describe_concept(asked).await?.into_inner();
            (description(&found), vec![found])
        }
        None => {
            let asked = ListConceptsRequest { lexicon };
            let found = connection.concepts().list_concepts(asked).await?.into_inner().concepts;
            (table(&found), found)
        }
    };
    output::result(
        args.json.as_deref(),
        &text,
        || json!({ "words": concepts.iter().map(to_json).collect::<Vec<_>>() }),
    )?;
    connection.close().await
}

/// The words of a stored lexicon.
pub async fn table_of(connection: &Connection, lexicon: &str) -> Result<String, Failure> {
    let asked = ListConceptsRequest { lexicon: lexicon.into() };
    Ok(table(&connection.concepts().list_concepts(asked).await?.into_inner().concepts))
}

fn table(words: &[Concept]) -> String {
    let row = |c: &Concept| {
        let looks: Vec<&str> = c.looks_at.iter().take(NAMED).map(|f| f.feature.as_str()).collect();
        let meaning = match c.factor {
            Some(factor) => format!("factor {factor:.3} ({:.3} to {:.3})", c.factor_low, c.factor_high),
            None => looks.join(", "),
        };
        vec![c.word.clone(), kind(c).to_string(), c.examples.to_string(), meaning]
    };
    let rows: Vec<Vec<String>> = words.iter().map(row).collect();
    output::table(&["word", "of", "examples", "looks at"], &rows)
}

fn kind(c: &Concept) -> &str {
    match ConceptKind::try_from(c.kind) {
        Ok(ConceptKind::Static) => "looks",
        Ok(ConceptKind::Dynamic) => "motion",
        Ok(ConceptKind::Event) => "encounters",
        Ok(ConceptKind::Change) => "changes",
        _ => &c.family,
    }
}

fn description(c: &Concept) -> String {
    let mut text = table(std::slice::from_ref(c));
    for feature in &c.looks_at {
        text += &format!("  looks at {}: {:+.2}\n", feature.feature, feature.weight);
    }
    for near in &c.nearest {
        text += &format!("  near {}: cosine {:+.2}\n", near.word, near.cosine);
    }
    for of in &c.objects {
        let score = of.cosine_score.map_or(String::new(), |s| format!(", cosine score {s:+.2}"));
        text += &format!("  object {}: {:.1} %{score}\n", of.object_id, 100.0 * of.probability);
    }
    if let Some(known) = &c.calibration {
        let share = 100.0 * known.accuracy;
        let mistaken = 100.0 * known.mistaken;
        text += &format!(
            "  on left-out videos: {share:.1} % of {} answers right; {mistaken:.1} % wrong whatever the words\n",
            known.answers
        );
        for bin in &known.bins {
            let [p, right, low, high] =
                [bin.probability, bin.accuracy, bin.accuracy_low, bin.accuracy_high].map(|x| 100.0 * x);
            text += &format!(
                "    of {} with {p:.0} %: {right:.0} % right (95 %: {low:.0} to {high:.0})\n",
                bin.answers
            );
        }
    }
    text
}

/// How probable a word is of objects.
pub fn objects(found: &[WordOfObject]) -> Vec<Value> {
    let one = |w: &WordOfObject| {
        json!({
            "word": w.word, "object_id": w.object_id, "probability": w.probability,
            "cosine_score": w.cosine_score,
        })
    };
    found.iter().map(one).collect()
}

fn to_json(c: &Concept) -> Value {
    json!({
        "word": c.word,
        "of": kind(c),
        "examples": c.examples,
        "counter_examples": c.counter_examples,
        "looks_at": c.looks_at.iter().map(|f| json!({ "feature": f.feature, "weight": f.weight })).collect::<Vec<_>>(),
        "nearest": c.nearest.iter().map(|n| json!({ "word": n.word, "cosine": n.cosine })).collect::<Vec<_>>(),
        "calibration": c.calibration.as_ref().map(|k| json!({
            "answers": k.answers, "log_loss": k.log_loss, "accuracy": k.accuracy, "mistaken": k.mistaken,
            "bins": k.bins.iter().map(|b| json!({
                "answers": b.answers, "probability": b.probability, "accuracy": b.accuracy,
                "interval": [b.accuracy_low, b.accuracy_high],
            })).collect::<Vec<_>>(),
        })),
        "factor": c.factor.map(|f| json!([f, c.factor_low, c.factor_high])),
        "evidence": c.evidence,
        "objects": objects(&c.objects),
    })
}
