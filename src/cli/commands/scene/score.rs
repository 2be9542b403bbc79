//! `score`: answers the questions of each scene, then compares with the right answers.

use super::accuracy::{Scores, same};
use super::ask::derivation;
use super::questions::{ClevrerQuestion, QuestionedScene, asked, list, questioned, word};
use crate::api::v1::{AskRequest, AskResponse, FitMethod, ModelChoice, ask_many_response, model_choice};
use crate::cli::connection::{Connection, Target};
use crate::cli::error::Failure;
use crate::cli::output::progress::TaskProgress;
use crate::cli::{input, output};
use crate::scene::Scene;
use futures_util::stream;
use serde_json::{Map, Value, json};
use std::collections::BTreeMap;
use std::path::PathBuf;

/// Share of a scene's time that its fit takes, about.
const FIT_SHARE: f64 = 0.5;

#[derive(clap::Args)]
pub struct ScoreArgs {
    /// Scene folders with a questions.json, CLEVRER's annotations (annotation_*.json), or folders of either.
    #[arg(required = true, value_name = "SCENE")]
    scenes: Vec<PathBuf>,
    /// CLEVRER's questions for many scenes, such as validation.json [default: questions.json of each scene, or CLEVRER's file in a folder above]
    #[arg(long, value_name = "FILE")]
    questions: Option<PathBuf>,
    /// Runs the program of each question instead of reading its English text.
    #[arg(long)]
    programs: bool,
    /// Lists each wrong answer: scene, question, what was said, what is right, and the steps that led to it.
    #[arg(long)]
    wrong: bool,
    /// Writes the answers as JSON, by scene and question; `-`: to standard output.
    #[arg(long, value_name = "FILE")]
    answers: Option<String>,
    /// Writes the answers in the form of CLEVRER's evaluation: a JSON list of scenes with their questions.
    #[arg(long, value_name = "FILE")]
    submission: Option<String>,
    /// Preset, id of a kept model (`vrdp show`), or model file [default: by the scene's world].
    #[arg(long, value_name = "NAME|ID|FILE")]
    model: Option<String>,
    /// Describes the objects by the words of this lexicon (`vrdp learn`), and not by the scene's own.
    #[arg(long, value_name = "FILE")]
    lexicon: Option<PathBuf>,
}

pub async fn run(target: &Target, args: ScoreArgs) -> Result<(), Failure> {
    for (flag, file) in [("--answers", &args.answers), ("--submission", &args.submission)] {
        file.iter().try_for_each(|file| output::writable(flag, file.as_ref()))?;
    }
    let scenes = questioned(&args.scenes, args.questions.as_deref())?;
    let model = input::model("--model", args.model.as_deref())?;
    let connection = Connection::open(target).await?;
    let lexicon = connection.lexicon(args.lexicon.as_deref()).await?;
    let (count, mut results, mut unread) = (scenes.len(), ScoreResults::default(), vec![]);
    let bar = TaskProgress::new(count);
    for (k, found) in scenes.into_iter().enumerate() {
        let read = found.and_then(|found| Ok((input::scene(&found.scene)?, found)));
        let (scene, found) = match read {
            Ok(read) => read,
            Err(error) => {
                unread.push(error);
                continue;
            }
        };
        let progress = |fraction: f64| bar.show(&scene.name, k, fraction);
        let of_fit = |fraction: f64| progress(FIT_SHARE * fraction);
        let requests = requests(&connection, (&scene, &found), model.as_ref(), args.programs, of_fit).await;
        let mut requests = requests.map_err(|e| e.at(&found.file.display().to_string()))?;
        requests.iter_mut().for_each(|r| r.lexicon.clone_from(&lexicon));
        let of_answers = |fraction: f64| progress(FIT_SHARE + (1.0 - FIT_SHARE) * fraction);
        let answered = answer_all(&connection, &scene, &found.questions, requests, of_answers).await?;
        results.add(scene.name, found, answered);
    }
    drop(bar);
    if let Some(target) = &args.answers {
        output::json(target, &Value::Object(std::mem::take(&mut results.answers)))?;
    }
    if let Some(target) = &args.submission {
        output::json(target, &Value::Array(std::mem::take(&mut results.submission)))?;
    }
    let next = match args.wrong {
        true => String::new(),
        false => output::next("score", &args.scenes, &["--wrong"]),
    };
    let text = results.text(args.wrong) + &next;
    match args.answers.as_deref() == Some("-") || args.submission.as_deref() == Some("-") {
        true => eprint!("{text}"),
        false => output::print(&text)?,
    }
    connection.close().await?;
    Failure::combined(unread, count)
}

/// What all scenes gave.
#[derive(Default)]
struct ScoreResults {
    scores: Scores,
    /// By scene and question.
    answers: Map<String, Value>,
    /// In the form of CLEVRER's evaluation.
    submission: Vec<Value>,
    /// A message for each question without an answer.
    refused: Vec<String>,
    /// A paragraph for each wrong answer.
    wrong: Vec<String>,
}

impl ScoreResults {
    fn add(&mut self, scene: String, found: QuestionedScene, answered: SceneAnswers) {
        for question in &found.questions {
            let given = answered.answers.get(&question.id());
            let reply = answered.replies.get(&question.id());
            let stated = reply.map(choice_probabilities).unwrap_or_default();
            if self.scores.add(&question.0, given, &stated) == Some(false) {
                self.wrong.push(mistake(&scene, question, given, reply));
            }
        }
        self.submission.push(evaluation_entry(&found, &answered.answers));
        self.refused.extend(answered.refused);
        self.answers.insert(scene, Value::Object(answered.answers));
    }

    fn text(&self, with_wrong: bool) -> String {
        let refused: String = self.refused.iter().map(|line| format!("  not answered: {line}\n")).collect();
        let wrong = if with_wrong { self.wrong.concat() } else { String::new() };
        format!("{}{}{refused}{wrong}", self.scores.table(), self.scores.reliability())
    }
}

/// A wrong answer: the question, what was said, what is right, and the derivation.
fn mistake(
    scene: &str,
    question: &ClevrerQuestion,
    given: Option<&Value>,
    reply: Option<&AskResponse>,
) -> String {
    let of = &question.0;
    let kind = of["question_type"].as_str().unwrap_or("untyped");
    let text = of["question"].as_str().unwrap_or("(a program)");
    let mut lines = format!("\n{scene}, question {} ({kind}): {text}\n", question.id());
    let Some(given) = given else { return lines + "  said: nothing; see `not answered` above\n" };
    let choices = list(&of["choices"]);
    if choices.is_empty() {
        lines += &format!("  said: {}; right: {}\n", word(given), word(&of["answer"]));
        return lines + &reply.map_or(String::new(), |reply| derivation(&reply.derivation));
    }
    for (k, choice) in choices.iter().enumerate() {
        let (said, right) = (given.get(word(&choice["choice_id"])), word(&choice["answer"]));
        if same(said, &right) {
            continue;
        }
        let said = said.map_or("nothing".into(), word);
        let text = choice["choice"].as_str().unwrap_or("(a program)");
        lines += &format!("  {text}\n  said: {said}; right: {right}\n");
        let steps = reply.and_then(|reply| reply.choices.get(k)).map(|c| derivation(&c.derivation));
        lines += &steps.unwrap_or_default();
    }
    lines
}

/// The answers to one scene's questions as CLEVRER's evaluation takes them. A question without an answer has the commonest
/// one: an empty text, or all choices wrong.
fn evaluation_entry(found: &QuestionedScene, answers: &Map<String, Value>) -> Value {
    let one = |question: &ClevrerQuestion| {
        let given = answers.get(&question.id());
        let choices = list(&question.0["choices"]);
        if choices.is_empty() {
            let answer = given.map(word).unwrap_or_default();
            return json!({ "question_id": question.0["question_id"], "answer": answer });
        }
        let mark = |choice: &Value| {
            let said = given.and_then(|g| g.get(word(&choice["choice_id"])));
            json!({ "choice_id": choice["choice_id"], "answer": said.map_or("wrong".into(), word) })
        };
        let choices: Vec<Value> = choices.iter().map(mark).collect();
        json!({ "question_id": question.0["question_id"], "choices": choices })
    };
    let questions: Vec<Value> = found.questions.iter().map(one).collect();
    json!({ "scene_index": found.index, "questions": questions })
}

/// Fits the scene and makes a request for each question.
async fn requests(
    connection: &Connection,
    (scene, found): (&Scene, &QuestionedScene),
    model: Option<&input::ModelArgument>,
    programs: bool,
    progress: impl Fn(f64),
) -> Result<Vec<AskRequest>, Failure> {
    let video = connection.post(scene).await?;
    let name = match connection.choice(&video, model).await?.and_then(|m| m.choice) {
        Some(model_choice::Choice::Model(kept)) => kept,
        start => {
            let start = start.map(|choice| ModelChoice { choice: Some(choice) });
            connection.fit(&video, start, FitMethod::Unspecified, progress).await?.name
        }
    };
    let request = |question: &ClevrerQuestion| -> Result<AskRequest, Failure> {
        let wrong = |what| Failure::input(format!("question {}: {what}", question.id()));
        let request = request_for(video.clone(), &question.0, programs).map_err(wrong)?;
        let model = Some(ModelChoice { choice: Some(model_choice::Choice::Model(name.clone())) });
        Ok(AskRequest { model, ..request })
    };
    found.questions.iter().map(request).collect()
}

/// The answers to the questions of one scene, by question id.
#[derive(Default)]
struct SceneAnswers {
    answers: Map<String, Value>,
    replies: BTreeMap<String, AskResponse>,
    /// A message for each question without an answer.
    refused: Vec<String>,
}

async fn answer_all(
    connection: &Connection,
    scene: &Scene,
    questions: &[ClevrerQuestion],
    requests: Vec<AskRequest>,
    progress: impl Fn(f64),
) -> Result<SceneAnswers, Failure> {
    let mut all = SceneAnswers::default();
    let mut replies = connection.reasoning().ask_many(stream::iter(requests)).await?.into_inner();
    for (k, question) in questions.iter().enumerate() {
        progress(k as f64 / questions.len() as f64);
        match replies.message().await?.and_then(|reply| reply.result) {
            Some(ask_many_response::Result::Response(reply)) => {
                all.answers.insert(question.id(), answer(&question.0, &reply));
                all.replies.insert(question.id(), reply);
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

/// A request for the question; it never holds the right answer.
fn request_for(video: String, question: &Value, programs: bool) -> Result<AskRequest, &'static str> {
    let (question, choices) = asked(question, programs)?;
    Ok(AskRequest { video, question: Some(question), choices, ..Default::default() })
}

/// The reply in the format of CLEVRER's files.
fn answer(question: &Value, reply: &AskResponse) -> Value {
    let mark = |correct| if correct { "correct" } else { "wrong" };
    let ids = list(&question["choices"]).iter().map(|c| word(&c["choice_id"]));
    let marks: Map<String, Value> =
        ids.zip(&reply.choices).map(|(id, c)| (id, json!(mark(c.correct)))).collect();
    if marks.is_empty() { json!(reply.answer) } else { Value::Object(marks) }
}

#[cfg(test)]
mod tests {
    use super::*;

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

    #[test]
    fn answers_have_the_form_of_clevrers_evaluation_and_mistakes_are_explained() {
        let questions = [
            json!({ "question_id": 3, "question": "How many?", "question_type": "descriptive", "answer": "2" }),
            json!({ "question_id": 4, "question": "What next?", "question_type": "predictive", "choices": [
                { "choice_id": 0, "choice": "the cube exits", "answer": "correct" },
                { "choice_id": 1, "choice": "the ball exits", "answer": "wrong" },
            ] }),
            json!({ "question_id": 5, "question": "Why?", "choices": [{ "choice_id": 7, "answer": "wrong" }] }),
        ];
        let found = QuestionedScene {
            scene: "annotation_10007.json".into(),
            file: "validation.json".into(),
            index: json!(10007),
            questions: questions.into_iter().map(ClevrerQuestion).collect(),
        };
        let mut answered = SceneAnswers::default();
        answered.answers.insert("3".into(), json!("1"));
        answered.answers.insert("4".into(), json!({ "0": "wrong", "1": "wrong" }));
        let step = crate::api::v1::Step { token: "count".into(), text: "1".into() };
        answered.replies.insert("3".into(), AskResponse { derivation: vec![step], ..Default::default() });
        let mut results = ScoreResults::default();
        results.add("annotation_10007".into(), found, answered);
        assert_eq!(
            Value::Array(results.submission.clone()),
            json!([{ "scene_index": 10007, "questions": [
                { "question_id": 3, "answer": "1" },
                { "question_id": 4, "choices": [
                    { "choice_id": 0, "answer": "wrong" }, { "choice_id": 1, "answer": "wrong" },
                ] },
                { "question_id": 5, "choices": [{ "choice_id": 7, "answer": "wrong" }] },
            ] }])
        );
        let text = results.text(true);
        for line in [
            "annotation_10007, question 3 (descriptive): How many?\n  said: 1; right: 2\n      count  1\n",
            "annotation_10007, question 4 (predictive): What next?\n  the cube exits\n  said: wrong; right: correct\n",
            "said: nothing; see `not answered` above",
        ] {
            assert!(text.contains(line), "{line}: {text}");
        }
        assert!(!text.contains("the ball exits"));
        assert!(!results.text(false).contains("said:"));
    }
}
