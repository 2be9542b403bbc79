//! `convert`: writes tables of other programs, annotations and scene files as our CSV.

use crate::cli::error::Failure;
use crate::cli::output::progress;
use crate::cli::{input, output};
use crate::scene::{SceneFile, TableDefaults, read_scene, written_csv};
use serde_json::{Map, json};
use std::path::{Path, PathBuf};

#[derive(clap::Args)]
pub struct ConvertArgs {
    /// Files of tracks, in any format that `import` reads but detections.
    #[arg(required = true, value_name = "FILE")]
    files: Vec<PathBuf>,
    /// Folder for the CSV files, NAME.csv each.
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    #[command(flatten)]
    stated: super::import::StatedArgs,
    /// Writes the result as JSON too; `-`: to standard output, instead of the text.
    #[arg(long, value_name = "FILE")]
    json: Option<String>,
}

pub fn run(args: ConvertArgs) -> Result<(), Failure> {
    if let Some(file) = &args.json {
        output::writable("--json", file.as_ref())?;
    }
    std::fs::create_dir_all(&args.out).map_err(|e| Failure::other(format!("{}: {e}", args.out.display())))?;
    let (mut lines, mut failures, mut done) = (String::new(), vec![], Map::new());
    for path in &args.files {
        match one(path, &args.out, &args.stated.defaults(), &done) {
            Ok((name, file)) => {
                lines += &format!("{file}\n");
                done.insert(name, json!({ "file": file }));
            }
            Err(failure) => failures.push(failure.at(&path.display().to_string())),
        }
    }
    if let Some(first) = done.keys().next().filter(|_| !progress::is_quiet()) {
        lines += &output::next("fit", &[args.out.join(format!("{first}.csv"))], &[]);
    }
    output::result(args.json.as_deref(), &lines, || json!({ "scenes": done }))?;
    Failure::combined(failures, args.files.len())
}

/// Converts one file; returns the name of its scene and the new file.
fn one(
    path: &Path,
    out: &Path,
    defaults: &TableDefaults,
    done: &Map<String, serde_json::Value>,
) -> Result<(String, String), Failure> {
    let name = super::import::name(path);
    if done.contains_key(&name) {
        let message =
            format!("another of these files also becomes {name}.csv; rename one, or use another --out");
        return Err(Failure::input(message));
    }
    let bad = |e: crate::scene::SceneError| Failure::input(e.to_string());
    let SceneFile { scene, assumed, .. } = read_scene(&name, &input::bytes(path)?, defaults).map_err(bad)?;
    let file = out.join(format!("{name}.csv"));
    if file.canonicalize().ok().is_some_and(|f| path.canonicalize().is_ok_and(|p| p == f)) {
        let message =
            format!("the result would overwrite the input; use another --out than {}", out.display());
        return Err(Failure::input(message));
    }
    output::file(&file, written_csv(&scene).map_err(bad)?.as_bytes())?;
    output::assumptions::add(&scene, assumed);
    Ok((name, file.display().to_string()))
}
