//! `score`: answers the questions of each scene, then compares with the right answers.

use super::ask::request;
use crate::api::v1::{
    AskRequest, AskResponse, Choice, FitMethod, ModelChoice, Program, ask_many_response, ask_request, choice,
    model_choice,
};
use crate::cli::connection::Connection;
use crate::cli::connection::Target;
use crate::cli::error::Failure;
use crate::cli::output::progress;
use crate::cli::{input, output};
use crate::num::elementary;
use crate::scene::Scene;
use futures_util::stream;
use serde_json::{Map, Value, json};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Name of the questions' file in a scene's folder.
const QUESTIONS: &str = "questions.json";
/// Normal quantile of a 95 % interval.
const Z: f64 = 1.959964;

#[derive(clap::Args)]
pub struct ScoreArgs {
    /// Scene folders with a questions.json, or folders of such folders.
    #[arg(required = true, value_name = "SCENE")]
    scenes: Vec<PathBuf>,
    /// Runs the program of each question instead of reading its English text.
    #[arg(long)]
    programs: bool,
    /// Writes the answers as JSON; `-`: to standard output.
    #[arg(long, value_name = "FILE")]
    answers: Option<String>,
    /// Preset or model file [default: by the scene's world].
    #[arg(long, value_name = "NAME|FILE")]
    model: Option<String>,
}

pub async fn run(target: &Target, args: ScoreArgs) -> Result<(), Failure> {
    let folders = folders(&args.scenes)?;
    let model = input::model("--model", args.model.as_deref())?;
    let connection = Connection::open(target).await?;
    let bar = progress::bar(folders.len() as u64, "{msg:20} {bar:40} {pos}/{len} scenes, {eta} left");
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
        let requests = requests(&connection, &scene, &questions, model.clone(), args.programs).await;
        let requests = requests.map_err(|e| e.at(&path.display().to_string()))?;
        let answered = answer_all(&connection, &scene, &questions, requests).await?;
        refused.extend(answered.refused);
        for question in &questions {
            let probabilities = answered.probabilities.get(&question.id()).map(Vec::as_slice);
            scores.add(&question.0, answered.answers.get(&question.id()), probabilities.unwrap_or_default());
        }
        answers.insert(scene.name, Value::Object(answered.answers));
        bar.inc(1);
    }
    bar.finish_and_clear();
    if let Some(target) = &args.answers {
        output::json(target, &Value::Object(answers))?;
    }
    let refused: String = refused.iter().map(|line| format!("  not answered: {line}\n")).collect();
    let text = format!("{}{}{refused}", scores.table(), scores.reliability());
    match args.answers.as_deref() {
        Some("-") => eprint!("{text}"),
        _ => output::print(&text)?,
    }
    connection.close().await?;
    Failure::combined(unread, folders.len())
}

/// Fits the scene and makes a request for each question.
async fn requests(
    connection: &Connection,
    scene: &Scene,
    questions: &[ClevrerQuestion],
    model: Option<ModelChoice>,
    programs: bool,
) -> Result<Vec<AskRequest>, Failure> {
    let video = connection.post(scene).await?;
    let fitted = connection.fit(&video, model, FitMethod::Unspecified, |_| {}).await?;
    let request = |question: &ClevrerQuestion| -> Result<AskRequest, Failure> {
        let wrong = |what| Failure::input(format!("question {}: {what}", question.id()));
        let request = request_for(video.clone(), &question.0, programs).map_err(wrong)?;
        let model = Some(ModelChoice { choice: Some(model_choice::Choice::Model(fitted.name.clone())) });
        Ok(AskRequest { model, ..request })
    };
    questions.iter().map(request).collect()
}

/// The answers to the questions of one scene, by question id.
struct SceneAnswers {
    answers: Map<String, Value>,
    probabilities: BTreeMap<String, Vec<f64>>,
    /// A message for each question without an answer.
    refused: Vec<String>,
}

async fn answer_all(
    connection: &Connection,
    scene: &Scene,
    questions: &[ClevrerQuestion],
    requests: Vec<AskRequest>,
) -> Result<SceneAnswers, Failure> {
    let mut all = SceneAnswers { answers: Map::new(), probabilities: BTreeMap::new(), refused: vec![] };
    let mut replies = connection.reasoning().ask_many(stream::iter(requests)).await?.into_inner();
    for question in questions {
        match replies.message().await?.and_then(|reply| reply.result) {
            Some(ask_many_response::Result::Response(reply)) => {
                all.answers.insert(question.id(), answer(&question.0, &reply));
                all.probabilities.insert(question.id(), choice_probabilities(&reply));
            }
            Some(ask_many_response::Result::Error(error)) => {
                all.refused.push(format!("{} question {}: {}", scene.name, question.id(), error.message));
            }
            None => {
                let message = "the service sent too few answers; try again";
                return Err(Failure::other(message).at(&scene.name));
            }
        }
    }
    Ok(all)
}

/// The probability that each choice is correct; for an open question, of its answer.
fn choice_probabilities(reply: &AskResponse) -> Vec<f64> {
    match reply.choices[..] {
        [] => vec![reply.probability],
        _ => reply.choices.iter().map(|c| c.probability).collect(),
    }
}

/// The scene folders with questions at these paths or one level below.
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
            let message = format!(
                "{}: neither this folder nor its subfolders hold a {QUESTIONS}; give a scene folder that has one",
                path.display()
            );
            return Err(Failure::input(message));
        }
        within.sort();
        all.extend(within);
    }
    Ok(all)
}

/// A question of a CLEVRER file.
struct ClevrerQuestion(Value);

impl ClevrerQuestion {
    fn id(&self) -> String {
        word(&self.0["question_id"])
    }
}

/// The text of a JSON string; other values as JSON.
fn word(value: &Value) -> String {
    value.as_str().map_or_else(|| value.to_string(), str::to_string)
}

fn list(value: &Value) -> &[Value] {
    value.as_array().map(Vec::as_slice).unwrap_or_default()
}

fn questions(path: &Path) -> Result<Vec<ClevrerQuestion>, Failure> {
    let wrong = |what: String| Failure::input(format!("{}: {what}", path.display()));
    let text = std::fs::read_to_string(path).map_err(|e| wrong(e.to_string()))?;
    let file: Value = serde_json::from_str(&text).map_err(|e| wrong(e.to_string()))?;
    // CLEVRER's own files are lists of scenes; the folder holds one.
    let scene = file.get(0).unwrap_or(&file);
    let Some(questions) = scene["questions"].as_array() else {
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
    Ok(questions.iter().cloned().map(ClevrerQuestion).collect())
}

/// A request for the question; it never holds the right answer.
fn request_for(video: String, question: &Value, programs: bool) -> Result<AskRequest, &'static str> {
    let choices = list(&question["choices"]);
    if !programs {
        let text = question["question"].as_str().ok_or("the text \"question\" is missing")?;
        let choices: Option<Vec<&str>> = choices.iter().map(|c| c["choice"].as_str()).collect();
        return Ok(request(video, text, &choices.ok_or("a choice lacks its text \"choice\"")?));
    }
    let program = |of: &Value| -> Result<Program, &'static str> {
        let tokens: Option<Vec<String>> =
            list(&of["program"]).iter().map(|t| t.as_str().map(Into::into)).collect();
        Ok(Program { tokens: tokens.ok_or("a token of \"program\" is not a string")? })
    };
    let choices = choices.iter().map(|c| Ok(Choice { choice: Some(choice::Choice::Program(program(c)?)) }));
    Ok(AskRequest {
        video,
        question: Some(ask_request::Question::Program(program(question)?)),
        choices: choices.collect::<Result<_, &str>>()?,
        ..Default::default()
    })
}

/// The reply in the format of CLEVRER's files.
fn answer(question: &Value, reply: &AskResponse) -> Value {
    let mark = |correct| if correct { "correct" } else { "wrong" };
    let ids = list(&question["choices"]).iter().map(|c| word(&c["choice_id"]));
    let marks: Map<String, Value> =
        ids.zip(&reply.choices).map(|(id, c)| (id, json!(mark(c.correct)))).collect();
    if marks.is_empty() { json!(reply.answer) } else { Value::Object(marks) }
}

/// Number of right answers, and of all.
#[derive(Default, Clone, Copy)]
struct Share(usize, usize);

impl Share {
    fn add(&mut self, right: bool) {
        self.0 += right as usize;
        self.1 += 1;
    }

    /// The share with its 95 % Wilson interval.
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

/// Accuracy by type of question, per option and per question, and the stated probabilities.
#[derive(Default)]
struct Scores {
    by_type: BTreeMap<String, [Share; 2]>,
    /// The stated probability of each option, and whether the option was right.
    stated: Vec<(f64, bool)>,
}

impl Scores {
    /// Counts a question that has a right answer; a missing answer counts as wrong.
    fn add(&mut self, question: &Value, given: Option<&Value>, probabilities: &[f64]) {
        let same = |given: Option<&Value>, right: &str| {
            given.is_some_and(|g| word(g).trim().eq_ignore_ascii_case(right.trim()))
        };
        let mut options = vec![];
        let mut stated = probabilities.iter();
        for choice in list(&question["choices"]) {
            let Some(right) = choice["answer"].as_str() else { return };
            self.stated.extend(stated.next().map(|p| (*p, right.eq_ignore_ascii_case("correct"))));
            options.push(same(given.and_then(|g| g.get(word(&choice["choice_id"]))), right));
        }
        if options.is_empty() {
            if question["answer"].is_null() {
                return;
            }
            let right = same(given, &word(&question["answer"]));
            self.stated.extend(stated.next().map(|p| (*p, right)));
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
            return "  the questions have no right answers, so nothing is scored\n".into();
        }
        output::table(&["type", "per option [95 %]", "per question [95 %]"], &rows)
    }

    /// The reliability diagram as a table (DeGroot and Fienberg 1983), with the Brier score: the mean squared
    /// difference between stated probability and outcome.
    fn reliability(&self) -> String {
        if self.stated.is_empty() {
            return String::new();
        }
        let mut rows = vec![];
        let mut low = 0.0;
        for high in BINS {
            let within = |p: f64| p <= high && (p > low || low == 0.0);
            let bin: Vec<(f64, bool)> = self.stated.iter().filter(|(p, _)| within(*p)).copied().collect();
            if !bin.is_empty() {
                let mut share = Share::default();
                bin.iter().for_each(|(_, came)| share.add(*came));
                let mean = bin.iter().map(|(p, _)| p).sum::<f64>() / bin.len() as f64;
                rows.push(vec![format!("{:.1} %", 100.0 * mean), share.text()]);
            }
            low = high;
        }
        let miss = |(p, came): &(f64, bool)| elementary::powi(p - f64::from(u8::from(*came)), 2);
        let brier = self.stated.iter().map(miss).sum::<f64>() / self.stated.len() as f64;
        let table = output::table(&["stated probability", "came true [95 %]"], &rows);
        format!("\n{table}  Brier score {brier:.4} (0: perfect; 0.25: guessing)\n")
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
        assert_eq!(scores.stated, [(0.9, true), (0.6, false), (0.9, true), (0.1, false), (1.0, true)]);
        assert!(
            scores.reliability().ends_with("Brier score 0.0780 (0: perfect; 0.25: guessing)\n"),
            "{}",
            scores.reliability()
        );
        insta::assert_snapshot!(scores.table(), @r"
          type                per option [95 %]       per question [95 %]
          ───────────────────────────────────────────────────────────────
          descriptive   50.0 % [9.5, 90.5] of 2   50.0 % [9.5, 90.5] of 2
          predictive   75.0 % [30.1, 95.4] of 4   50.0 % [9.5, 90.5] of 2
          all          66.7 % [30.0, 90.3] of 6  50.0 % [15.0, 85.0] of 4
        ");
    }

    #[test]
    fn a_request_never_holds_the_right_answer() {
        let question = json!({
            "question": "What will happen next?", "program": ["unseen_events", "belong_to"], "answer": "secret",
            "choices": [{ "choice_id": 0, "choice": "the cube exits", "program": ["objects"], "answer": "secret" }],
        });
        for programs in [false, true] {
            let request = request_for("videos/1".into(), &question, programs).unwrap();
            assert_eq!(request.choices.len(), 1);
            assert!(!format!("{request:?}").contains("secret"));
        }
        assert!(request_for("videos/1".into(), &json!({ "choices": [] }), false).is_err());
    }
}
