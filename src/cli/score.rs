//! `score`: answers the questions beside each scene and only then looks at the right answers.

use super::Target;
use super::ask::request;
use super::connect::Connection;
use super::error::Failure;
use super::{input, output, progress};
use crate::api::v1::{
    AskRequest, AskResponse, Choice, FitMethod, Program, ask_many_response, ask_request, choice,
};
use crate::num::elementary;
use futures_util::stream;
use serde_json::{Map, Value, json};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Name of the questions' file in a scene's folder.
const QUESTIONS: &str = "questions.json";
/// Normal quantile of a 95 % interval.
const Z: f64 = 1.959964;

#[derive(clap::Args)]
pub struct Args {
    /// Scene folders with a questions.json, or folders of such folders.
    #[arg(required = true, value_name = "SCENE")]
    scenes: Vec<PathBuf>,
    /// Runs each question's program instead of reading its English.
    #[arg(long)]
    programs: bool,
    /// Writes the answers as JSON; `-`: to standard output.
    #[arg(long, value_name = "FILE")]
    answers: Option<String>,
    /// Preset or model file [default: what suits the scene's world].
    #[arg(long, value_name = "NAME|FILE")]
    model: Option<String>,
}

pub async fn run(target: &Target, args: Args) -> Result<(), Failure> {
    let folders = folders(&args.scenes)?;
    let model = input::model(args.model.as_deref())?;
    let connection = Connection::open(target).await?;
    let bar = progress::bar(folders.len() as u64, "{msg:20} {bar:40} {pos}/{len} scenes, {eta} to go");
    let (mut answers, mut scores, mut refused) = (Map::new(), Scores::default(), vec![]);
    let mut unread = vec![];
    for folder in &folders {
        let path = folder.join(QUESTIONS);
        let read = input::scene(folder).and_then(|scene| Ok((scene, questions(&path)?)));
        let (scene, questions) = match read {
            Ok(read) => read,
            Err(error) => {
                unread.push(error);
                bar.inc(1);
                continue;
            }
        };
        bar.set_message(scene.name.clone());
        let video = connection.post(&scene).await.map_err(|e| e.at(&scene.name))?;
        let fitted = connection
            .fit(&video, model.clone(), FitMethod::Unspecified, |_| {})
            .await
            .map_err(|e| e.at(&scene.name))?;
        let mut requests = Vec::with_capacity(questions.len());
        for question in &questions {
            let wrong =
                |what| Failure::input(format!("{}: question {}: {what}", path.display(), question.id()));
            let asked = asked(video.clone(), &question.0, args.programs).map_err(wrong)?;
            let model = Some(crate::api::v1::ModelChoice {
                choice: Some(crate::api::v1::model_choice::Choice::Model(fitted.name.clone())),
            });
            requests.push(AskRequest { model, ..asked });
        }
        let (mut given, mut probabilities) = (Map::new(), BTreeMap::new());
        let mut replies = connection.reasoning().ask_many(stream::iter(requests)).await?.into_inner();
        for question in &questions {
            match replies.message().await?.and_then(|reply| reply.result) {
                Some(ask_many_response::Result::Response(reply)) => {
                    given.insert(question.id(), answer(&question.0, &reply));
                    probabilities.insert(question.id(), believed(&reply));
                }
                Some(ask_many_response::Result::Error(error)) => {
                    refused.push(format!("{} question {}: {}", scene.name, question.id(), error.message));
                }
                None => return Err(Failure::other(format!("{}: an answer is missing", scene.name))),
            }
        }
        for question in &questions {
            let probabilities = probabilities.get(&question.id()).map(Vec::as_slice);
            scores.add(&question.0, given.get(&question.id()), probabilities.unwrap_or_default());
        }
        answers.insert(scene.name, Value::Object(given));
        bar.inc(1);
    }
    bar.finish_and_clear();
    if let Some(target) = &args.answers {
        output::json(target, &Value::Object(answers))?;
    }
    let refused: String = refused.iter().map(|line| format!("  no answer: {line}\n")).collect();
    let text = format!("{}{}{refused}", scores.table(), scores.reliability());
    match args.answers.as_deref() {
        Some("-") => eprint!("{text}"),
        _ => output::print(&text)?,
    }
    connection.close().await?;
    Failure::of(unread, folders.len())
}

/// How probable each choice is to be correct; of an open question, the answer given.
fn believed(reply: &AskResponse) -> Vec<f64> {
    match reply.choices[..] {
        [] => vec![reply.probability],
        _ => reply.choices.iter().map(|c| c.probability).collect(),
    }
}

/// The folders with questions that the paths stand for.
fn folders(paths: &[PathBuf]) -> Result<Vec<PathBuf>, Failure> {
    let mut all = vec![];
    for path in paths {
        if path.join(QUESTIONS).is_file() {
            all.push(path.clone());
            continue;
        }
        let entries = std::fs::read_dir(path)
            .map_err(|e| Failure::input(format!("{}: {e}; give a scene folder", path.display())))?;
        let within = entries.flatten().map(|e| e.path()).filter(|p| p.join(QUESTIONS).is_file());
        let mut within: Vec<PathBuf> = within.collect();
        if within.is_empty() {
            let message = format!("{}: no {QUESTIONS} here or one folder below", path.display());
            return Err(Failure::input(message));
        }
        within.sort();
        all.extend(within);
    }
    Ok(all)
}

/// A question as CLEVRER's files have it.
struct Question(Value);

impl Question {
    fn id(&self) -> String {
        word(&self.0["question_id"])
    }
}

/// A text as it stands, anything else as JSON.
fn word(value: &Value) -> String {
    value.as_str().map_or_else(|| value.to_string(), str::to_string)
}

fn list(value: &Value) -> &[Value] {
    value.as_array().map(Vec::as_slice).unwrap_or_default()
}

fn questions(path: &Path) -> Result<Vec<Question>, Failure> {
    let wrong = |what: String| Failure::input(format!("{}: {what}", path.display()));
    let text = std::fs::read_to_string(path).map_err(|e| wrong(e.to_string()))?;
    let file: Value = serde_json::from_str(&text).map_err(|e| wrong(e.to_string()))?;
    // CLEVRER's own files are lists of scenes; the folder holds one.
    let scene = file.get(0).unwrap_or(&file);
    let Some(questions) = scene["questions"].as_array() else {
        return Err(wrong("has no list \"questions\"".into()));
    };
    for (k, question) in questions.iter().enumerate() {
        let mut marks =
            list(&question["choices"]).iter().enumerate().map(|(c, choice)| (c, &choice["answer"]));
        let known = |mark: &Value| {
            mark.is_null() || ["correct", "wrong"].contains(&word(mark).to_lowercase().as_str())
        };
        if let Some((c, mark)) = marks.find(|(_, mark)| !known(mark)) {
            return Err(wrong(format!(
                "questions[{k}].choices[{c}].answer: is {mark}; give \"correct\" or \"wrong\""
            )));
        }
    }
    Ok(questions.iter().cloned().map(Question).collect())
}

/// The question without its answer.
fn asked(video: String, question: &Value, programs: bool) -> Result<AskRequest, &'static str> {
    let choices = list(&question["choices"]);
    if !programs {
        let text = question["question"].as_str().ok_or("has no text \"question\"")?;
        let choices: Option<Vec<&str>> = choices.iter().map(|c| c["choice"].as_str()).collect();
        return Ok(request(video, text, &choices.ok_or("a choice has no text \"choice\"")?));
    }
    let program = |of: &Value| -> Result<Program, &'static str> {
        let tokens: Option<Vec<String>> =
            list(&of["program"]).iter().map(|t| t.as_str().map(Into::into)).collect();
        Ok(Program { tokens: tokens.ok_or("a token of \"program\" is no text")? })
    };
    let choices = choices.iter().map(|c| Ok(Choice { choice: Some(choice::Choice::Program(program(c)?)) }));
    Ok(AskRequest {
        video,
        question: Some(ask_request::Question::Program(program(question)?)),
        choices: choices.collect::<Result<_, &str>>()?,
        ..Default::default()
    })
}

/// The reply in the words of CLEVRER's files.
fn answer(question: &Value, reply: &AskResponse) -> Value {
    let mark = |correct| if correct { "correct" } else { "wrong" };
    let ids = list(&question["choices"]).iter().map(|c| word(&c["choice_id"]));
    let marks: Map<String, Value> =
        ids.zip(&reply.choices).map(|(id, c)| (id, json!(mark(c.correct)))).collect();
    if marks.is_empty() { json!(reply.answer) } else { Value::Object(marks) }
}

/// Right and asked.
#[derive(Default, Clone, Copy)]
struct Share(usize, usize);

impl Share {
    fn add(&mut self, right: bool) {
        self.0 += right as usize;
        self.1 += 1;
    }

    /// With its Wilson interval of 95 %.
    fn text(self) -> String {
        let (n, p) = (self.1 as f64, self.0 as f64 / self.1 as f64);
        let centre = (p + Z * Z / (2.0 * n)) / (1.0 + Z * Z / n);
        let half = Z / (1.0 + Z * Z / n) * (p * (1.0 - p) / n + Z * Z / (4.0 * n * n)).sqrt();
        let [p, low, high] = [p, (centre - half).max(0.0), (centre + half).min(1.0)].map(|x| 100.0 * x);
        format!("{p:.1} % [{low:.1}, {high:.1}] of {}", self.1)
    }
}

/// Upper ends of the bins of the reliability table.
const BINS: [f64; 7] = [0.02, 0.1, 0.3, 0.7, 0.9, 0.98, 1.0];

/// By type of question: options and questions; and how well the probabilities hold.
#[derive(Default)]
struct Scores {
    by_type: BTreeMap<String, [Share; 2]>,
    /// What was said of an option's probability, and whether it came true.
    said: Vec<(f64, bool)>,
}

impl Scores {
    /// Counts what has a right answer; what was not answered is wrong.
    fn add(&mut self, question: &Value, given: Option<&Value>, probabilities: &[f64]) {
        let same = |given: Option<&Value>, right: &str| {
            given.is_some_and(|g| word(g).trim().eq_ignore_ascii_case(right.trim()))
        };
        let mut options = vec![];
        let mut said = probabilities.iter();
        for choice in list(&question["choices"]) {
            let Some(right) = choice["answer"].as_str() else { return };
            self.said.extend(said.next().map(|p| (*p, right.eq_ignore_ascii_case("correct"))));
            options.push(same(given.and_then(|g| g.get(word(&choice["choice_id"]))), right));
        }
        if options.is_empty() {
            if question["answer"].is_null() {
                return;
            }
            let right = same(given, &word(&question["answer"]));
            self.said.extend(said.next().map(|p| (*p, right)));
            options.push(right);
        }
        for name in [question["question_type"].as_str().unwrap_or("untyped"), "all"] {
            let [of_options, of_questions] = self.by_type.entry(name.to_string()).or_default();
            options.iter().for_each(|right| of_options.add(*right));
            of_questions.add(options.iter().all(|right| *right));
        }
    }

    fn table(&self) -> String {
        let (all, types): (Vec<_>, Vec<_>) = self.by_type.iter().partition(|(name, _)| *name == "all");
        let row =
            |(name, shares): (&String, &[Share; 2])| vec![name.clone(), shares[0].text(), shares[1].text()];
        let rows: Vec<Vec<String>> = types.into_iter().chain(all).map(row).collect();
        if rows.is_empty() {
            return "  the questions come without answers to compare with\n".into();
        }
        output::table(&["type", "per option [95 %]", "per question [95 %]"], &rows)
    }

    /// The reliability diagram as a table (DeGroot and Fienberg 1983), with the Brier score.
    fn reliability(&self) -> String {
        if self.said.is_empty() {
            return String::new();
        }
        let mut rows = vec![];
        let mut low = 0.0;
        for high in BINS {
            let within = |p: f64| p <= high && (p > low || low == 0.0);
            let bin: Vec<(f64, bool)> = self.said.iter().filter(|(p, _)| within(*p)).copied().collect();
            if !bin.is_empty() {
                let mut share = Share::default();
                bin.iter().for_each(|(_, came)| share.add(*came));
                let mean = bin.iter().map(|(p, _)| p).sum::<f64>() / bin.len() as f64;
                rows.push(vec![format!("{:.1} %", 100.0 * mean), share.text()]);
            }
            low = high;
        }
        let miss = |(p, came): &(f64, bool)| elementary::powi(p - f64::from(u8::from(*came)), 2);
        let brier = self.said.iter().map(miss).sum::<f64>() / self.said.len() as f64;
        let table = output::table(&["said", "came true [95 %]"], &rows);
        format!("\n{table}  Brier score {brier:.4}\n")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn answers_are_counted_by_option_and_by_question() {
        let choices = json!([{ "choice_id": 0, "answer": "correct" }, { "choice_id": 1, "answer": "wrong" }]);
        let several = json!({ "question_type": "predictive", "choices": choices });
        let open = json!({ "question_type": "descriptive", "answer": "2" });
        let mut scores = Scores::default();
        scores.add(&several, Some(&json!({ "0": "correct", "1": "correct" })), &[0.9, 0.6]);
        scores.add(&several, Some(&json!({ "0": "correct", "1": "wrong" })), &[0.9, 0.1]);
        scores.add(&open, Some(&json!("2")), &[1.0]);
        scores.add(&open, None, &[]);
        scores.add(&json!({ "question_type": "descriptive" }), Some(&json!("3")), &[1.0]);
        assert_eq!(scores.said, [(0.9, true), (0.6, false), (0.9, true), (0.1, false), (1.0, true)]);
        assert!(scores.reliability().ends_with("Brier score 0.0780\n"), "{}", scores.reliability());
        insta::assert_snapshot!(scores.table(), @r"
          type                per option [95 %]       per question [95 %]
          ───────────────────────────────────────────────────────────────
          descriptive   50.0 % [9.5, 90.5] of 2   50.0 % [9.5, 90.5] of 2
          predictive   75.0 % [30.1, 95.4] of 4   50.0 % [9.5, 90.5] of 2
          all          66.7 % [30.0, 90.3] of 6  50.0 % [15.0, 85.0] of 4
        ");
    }

    #[test]
    fn what_is_asked_holds_no_answer() {
        let question = json!({
            "question": "What will happen next?", "program": ["unseen_events", "belong_to"], "answer": "secret",
            "choices": [{ "choice_id": 0, "choice": "the cube exits", "program": ["objects"], "answer": "secret" }],
        });
        for programs in [false, true] {
            let asked = asked("videos/1".into(), &question, programs).unwrap();
            assert_eq!(asked.choices.len(), 1);
            assert!(!format!("{asked:?}").contains("secret"));
        }
        assert!(asked("videos/1".into(), &json!({ "choices": [] }), false).is_err());
    }
}
