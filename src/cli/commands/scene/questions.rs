//! Questions in CLEVRER's form: those of one scene beside it, or a file for many scenes such as `validation.json`.

use crate::api::v1::{Choice, Program, ask_request, choice};
use crate::cli::error::Failure;
use crate::cli::input;
use serde_json::Value;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Name of the questions' file in a scene's folder.
const QUESTIONS: &str = "questions.json";
/// Names of CLEVRER's files of questions for many scenes.
const FILES_OF_MANY: [&str; 3] = ["validation.json", "train.json", "test.json"];
/// How far above a scene such a file may lie.
const FOLDERS_ABOVE: usize = 2;

/// A question of a CLEVRER file.
pub struct ClevrerQuestion(pub Value);

impl ClevrerQuestion {
    pub fn id(&self) -> String {
        word(&self.0["question_id"])
    }
}

/// A scene to read, and its questions.
pub struct QuestionedScene {
    pub scene: PathBuf,
    /// The file of the questions.
    pub file: PathBuf,
    /// CLEVRER's number of the scene; null if the file gives none.
    pub index: Value,
    pub questions: Vec<ClevrerQuestion>,
}

/// The text of a JSON string; other values as JSON.
pub fn word(value: &Value) -> String {
    value.as_str().map_or_else(|| value.to_string(), str::to_string)
}

pub fn list(value: &Value) -> &[Value] {
    value.as_array().map(Vec::as_slice).unwrap_or_default()
}

/// A question of a CLEVRER file and its choices, without the answers; `programs`: as programs instead of English text.
pub fn asked(question: &Value, programs: bool) -> Result<(ask_request::Question, Vec<Choice>), &'static str> {
    let program = |of: &Value| -> Result<Program, &'static str> {
        let tokens: Option<Vec<String>> =
            list(&of["program"]).iter().map(|t| t.as_str().map(Into::into)).collect();
        Ok(Program { tokens: tokens.ok_or("a token of \"program\" is not a string")? })
    };
    let choice = |of: &Value| -> Result<Choice, &'static str> {
        let choice = match programs {
            true => choice::Choice::Program(program(of)?),
            false => {
                let text = of["choice"].as_str().ok_or("a choice lacks its text \"choice\"")?;
                choice::Choice::Text(text.into())
            }
        };
        Ok(Choice { choice: Some(choice) })
    };
    let asked = match programs {
        true => ask_request::Question::Program(program(question)?),
        false => {
            let text = question["question"].as_str().ok_or("the text \"question\" is missing")?;
            ask_request::Question::Text(text.into())
        }
    };
    Ok((asked, list(&question["choices"]).iter().map(choice).collect::<Result<_, _>>()?))
}

/// The scenes at these paths or below with their questions; a scene whose questions cannot be read is a failure of its own.
/// `file`: the questions of all of them; without it each folder's own, or CLEVRER's file in a folder above.
pub fn questioned(
    paths: &[PathBuf],
    file: Option<&Path>,
) -> Result<Vec<Result<QuestionedScene, Failure>>, Failure> {
    let mut found = vec![];
    // The files of many scenes are large: each is read once.
    let mut of_many: BTreeMap<PathBuf, BTreeMap<u64, Value>> = BTreeMap::new();
    for path in paths {
        let before = found.len();
        for scene in input::scene_paths(path)? {
            let own = scene.join(QUESTIONS);
            let shared = file.map(Path::to_path_buf).or_else(|| file_above(&scene));
            if own.is_file() && file.is_none() {
                found.push(beside(scene, own));
            } else if let Some(shared) = shared {
                if !of_many.contains_key(&shared) {
                    of_many.insert(shared.clone(), by_scene(&shared)?);
                }
                let number = number(&scene);
                let entry = number.and_then(|n| of_many.get(&shared)?.get(&n));
                found.extend(entry.map(|entry| questions_of(entry, scene, shared)));
            }
        }
        if found.len() == before {
            let name = file.map_or_else(|| "questions".into(), |f| f.display().to_string());
            return Err(Failure::input(format!(
                "{}: {name} has no questions for its scenes; give scene folders with a {QUESTIONS}, or CLEVRER's \
                 annotations with --questions validation.json",
                path.display()
            )));
        }
    }
    Ok(found)
}

/// CLEVRER's number of a scene: the digits at the end of its name, as in `annotation_10007.json`.
fn number(scene: &Path) -> Option<u64> {
    let stem = scene.file_stem()?.to_str()?;
    let digits = stem.trim_end_matches(|c: char| c.is_ascii_digit()).len();
    stem[digits..].parse().ok()
}

/// The file of questions for many scenes in the nearest folder above.
fn file_above(scene: &Path) -> Option<PathBuf> {
    let folders = scene.ancestors().skip(1).take(1 + FOLDERS_ABOVE);
    let files = |folder: &Path| FILES_OF_MANY.map(|name| folder.join(name));
    folders.flat_map(files).find(|file| file.is_file())
}

fn read(file: &Path) -> Result<Value, Failure> {
    let text = input::text(file)?;
    serde_json::from_str(&text).map_err(|e| Failure::input(format!("{}: {e}; give JSON", file.display())))
}

/// The entries of a file of many scenes, by the scene's number.
fn by_scene(file: &Path) -> Result<BTreeMap<u64, Value>, Failure> {
    let Value::Array(entries) = read(file)? else {
        let message = "is not a list of scenes with `scene_index` and `questions`, as CLEVRER's files are";
        return Err(Failure::input(message).at(&file.display().to_string()));
    };
    Ok(entries.into_iter().filter_map(|entry| Some((entry["scene_index"].as_u64()?, entry))).collect())
}

fn beside(scene: PathBuf, file: PathBuf) -> Result<QuestionedScene, Failure> {
    let content = read(&file)?;
    // CLEVRER's own files are lists of scenes; the folder holds one.
    let entry = content.get(0).unwrap_or(&content);
    questions_of(entry, scene, file)
}

fn questions_of(entry: &Value, scene: PathBuf, file: PathBuf) -> Result<QuestionedScene, Failure> {
    let wrong = |what: String| Failure::input(format!("{}: {what}", file.display()));
    let Some(questions) = entry["questions"].as_array() else {
        return Err(wrong("the list \"questions\" is missing; add it".into()));
    };
    for (k, question) in questions.iter().enumerate() {
        let mut marks =
            list(&question["choices"]).iter().enumerate().map(|(c, choice)| (c, &choice["answer"]));
        let known = |mark: &Value| {
            mark.is_null() || ["correct", "wrong"].contains(&word(mark).to_lowercase().as_str())
        };
        if let Some((c, mark)) = marks.find(|(_, mark)| !known(mark)) {
            return Err(wrong(format!(
                "questions[{k}].choices[{c}].answer is {mark}; give \"correct\" or \"wrong\""
            )));
        }
    }
    let index = match &entry["scene_index"] {
        Value::Null => number(&scene).map_or(Value::Null, Value::from),
        given => given.clone(),
    };
    Ok(QuestionedScene {
        scene,
        file,
        index,
        questions: questions.iter().cloned().map(ClevrerQuestion).collect(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_number_of_a_scene_stands_at_the_end_of_its_name() {
        let of = |path: &str| number(Path::new(path));
        assert_eq!(
            [of("a/annotation_10007.json"), of("scene_00022"), of("video")],
            [Some(10007), Some(22), None]
        );
    }

    #[test]
    fn clevrers_own_folders_and_files_are_taken() {
        let folder = tempfile::tempdir().unwrap();
        let annotations = folder.path().join("annotation_validation/annotation_10000-11000");
        std::fs::create_dir_all(&annotations).unwrap();
        for number in [10000, 10002, 10001] {
            std::fs::write(annotations.join(format!("annotation_{number}.json")), "{}").unwrap();
        }
        let entry = |n: u32| format!(r#"{{"scene_index": {n}, "questions": [{{"question_id": 0}}]}}"#);
        let file = folder.path().join("validation.json");
        std::fs::write(&file, format!("[{}, {}, {}]", entry(10001), entry(10002), entry(17000))).unwrap();
        for (path, given) in
            [(folder.path().join("annotation_validation"), None), (annotations, Some(&*file))]
        {
            let found = questioned(&[path], given).unwrap();
            let numbers: Vec<Value> = found.into_iter().map(|scene| scene.unwrap().index).collect();
            assert_eq!(numbers, [10001, 10002], "those with questions, in order");
        }
        std::fs::write(&file, "{}").unwrap();
        let refused = questioned(&[folder.path().join("annotation_validation")], None).err().unwrap();
        assert!(refused.to_string().contains("is not a list of scenes"), "{refused}");
    }
}
