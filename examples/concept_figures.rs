//! Learns words from videos with questions and scores them on videos that were left out:
//! `concept_figures PERCEIVED QUESTIONS [SPLITS]`.
//!
//! PERCEIVED has NAME.perceived.json (`{"scene": ...}`, what `perceive` made of a video), QUESTIONS has NAME/questions.json and
//! NAME/observed.json, whose labels are read for scoring only. Splits are by video. With NAME.fit.json beside, its simulations give
//! the events; else the tracks do.

use std::collections::BTreeMap;
use std::path::Path;
use std::time::Instant;
use vrdp::concepts::{
    LearnOptions, Lesson, LessonAnswer, LessonVideo, Lexicon, WordCalibration, learn, word_probabilities,
};
use vrdp::fit::Fit;
use vrdp::num::{never, share_interval};
use vrdp::reason::{
    AskOptions, DrawnWords, Question, WordDraw, WordFamily, WordProbabilities, WordedScene, ask_with_words,
};
use vrdp::scene::{Scene, parse};

type Anyhow = Box<dyn std::error::Error>;

struct Case {
    scene: Scene,
    labelled: Scene,
    fit: Option<Fit>,
    lessons: Vec<Lesson>,
    kinds: Vec<String>,
}

fn main() -> Result<(), Anyhow> {
    let args: Vec<String> = std::env::args().skip(1).collect();
    let [perceived, questions, rest @ ..] = &args[..] else {
        return Err("usage: concept_figures PERCEIVED QUESTIONS [SPLITS]".into());
    };
    let splits: usize = rest.first().map_or(Ok(4), |s| s.parse())?;
    let cases = cases(Path::new(perceived), Path::new(questions))?;
    println!("{} videos, {} questions", cases.len(), cases.iter().map(|c| c.lessons.len()).sum::<usize>());
    let mut sizes = vec![3, 5, 8, 10, 20, 28];
    sizes.retain(|n| n + 2 <= cases.len());
    for size in sizes {
        let mut score = Score::default();
        for split in 0..splits {
            let order: Vec<usize> = (0..cases.len()).map(|k| (k * 7 + split * 5) % cases.len()).collect();
            one_split(&cases, &order, size, &mut score)?;
        }
        score.print(size);
    }
    Ok(())
}

fn cases(perceived: &Path, questions: &Path) -> Result<Vec<Case>, Anyhow> {
    let mut cases = vec![];
    let mut files: Vec<_> = std::fs::read_dir(perceived)?.filter_map(|e| Some(e.ok()?.path())).collect();
    files.sort();
    for file in files {
        let name = file.file_name().unwrap_or_default().to_string_lossy().to_string();
        let Some(name) = name.strip_suffix(".perceived.json") else { continue };
        let value: serde_json::Value = serde_json::from_slice(&std::fs::read(&file)?)?;
        let mut scene: Scene = serde_json::from_value(value["scene"].clone())?;
        for object in &mut scene.objects {
            (object.color, object.material) = (String::new(), String::new());
        }
        let folder = questions.join(name);
        let labelled = parse(name, &std::fs::read_to_string(folder.join("observed.json"))?)?;
        let fit = std::fs::read(perceived.join(format!("{name}.fit.json"))).ok();
        let fit = fit.map(|bytes| serde_json::from_slice(&bytes)).transpose()?;
        let value: serde_json::Value =
            serde_json::from_slice(&std::fs::read(folder.join("questions.json"))?)?;
        let (lessons, kinds) = read_lessons(&value["questions"])?;
        cases.push(Case { scene, labelled, fit, lessons, kinds });
    }
    Ok(cases)
}

fn read_lessons(all: &serde_json::Value) -> Result<(Vec<Lesson>, Vec<String>), Anyhow> {
    let (mut lessons, mut kinds) = (vec![], vec![]);
    for entry in all.as_array().into_iter().flatten() {
        let kind = entry["question_type"].as_str().unwrap_or_default().to_string();
        let program: Vec<String> = serde_json::from_value(entry["program"].clone())?;
        let mut choices = vec![];
        let mut correct = vec![];
        for choice in entry["choices"].as_array().into_iter().flatten() {
            choices.push(serde_json::from_value(choice["program"].clone())?);
            correct.push(choice["answer"] == "correct");
        }
        let answer = match entry["answer"].as_str() {
            Some(text) if choices.is_empty() => LessonAnswer::Open(text.to_string()),
            _ => LessonAnswer::Choices(correct),
        };
        lessons.push(Lesson { question: Question::Program { program, choices }, answer });
        kinds.push(kind);
    }
    Ok((lessons, kinds))
}

#[derive(Default)]
struct Score {
    /// Right and all, by name.
    counts: BTreeMap<String, [usize; 2]>,
    /// The most probable words: their probability, and whether they are right.
    words: Vec<(f64, bool)>,
    /// Of each lexicon, on the videos that were left out of its own training.
    left_out: Vec<WordCalibration>,
    seconds: f64,
    questions: usize,
    runs: usize,
}

impl Score {
    fn add(&mut self, name: &str, right: bool) {
        let entry = self.counts.entry(name.to_string()).or_default();
        entry[0] += usize::from(right);
        entry[1] += 1;
    }

    fn print(&self, size: usize) {
        let seconds = self.seconds / self.runs.max(1) as f64;
        println!(
            "{size} training videos, {} questions, {seconds:.2} s of training",
            self.questions / self.runs.max(1)
        );
        for (name, [right, all]) in &self.counts {
            println!("  {name:24} {:5.1} % of {all}", 100.0 * *right as f64 / (*all).max(1) as f64);
        }
        println!("  P(word):");
        for k in 0..10 {
            let own: Vec<_> = self.words.iter().filter(|v| ((10.0 * v.0) as usize).min(9) == k).collect();
            let right = own.iter().filter(|v| v.1).count();
            print_bin(own.len(), own.iter().map(|v| v.0).sum::<f64>(), right);
        }
        println!("  P(answer) on left-out videos:");
        let bins: Vec<_> = self.left_out.iter().flat_map(|c| &c.bins).collect();
        for k in 0..10 {
            let own = || bins.iter().filter(|b| ((10.0 * b.probability) as usize).min(9) == k);
            let count = own().map(|b| b.answers).sum();
            let probability = own().map(|b| b.probability * b.answers as f64).sum();
            let right = own().map(|b| b.accuracy * b.answers as f64).sum::<f64>().round() as usize;
            print_bin(count, probability, right);
        }
    }
}

/// Verdicts of about one probability, of which the sum is given.
fn print_bin(count: usize, probability: f64, right: usize) {
    if count > 0 {
        let [low, high] = share_interval(right, count).map(|x| 100.0 * x);
        let [mean, share] = [probability, right as f64].map(|x| 100.0 * x / count as f64);
        println!("    of {count} with {mean:.1} %: {share:.1} % right (95 %: {low:.1} to {high:.1})");
    }
}

fn one_split(cases: &[Case], order: &[usize], size: usize, score: &mut Score) -> Result<(), Anyhow> {
    let (train, test) = order.split_at(size);
    let videos: Vec<LessonVideo> = train
        .iter()
        .map(|k| LessonVideo {
            scene: &cases[*k].scene,
            fit: cases[*k].fit.as_ref().map(|f| (f, 0)),
            lessons: &cases[*k].lessons,
        })
        .collect();
    let start = Instant::now();
    let lexicon = learn(&videos, &LearnOptions::default(), &|_| {}, &never)?;
    score.seconds += start.elapsed().as_secs_f64();
    score.runs += 1;
    score.questions += lexicon.questions;
    score.left_out.extend(lexicon.families.first().and_then(|f| f.calibration.clone()));
    for k in test {
        score_case(&cases[*k], &lexicon, score)?;
    }
    Ok(())
}

fn score_case(case: &Case, lexicon: &Lexicon, score: &mut Score) -> Result<(), Anyhow> {
    let fit = case.fit.as_ref().map(|f| (f, 0));
    let words = word_probabilities(lexicon, &case.scene, fit)?;
    score_words(case, &words, score);
    let Some((fit, index)) = fit else { return Ok(()) };
    let worded = WordedScene { scene: &case.scene, words: &words };
    let options = AskOptions { rollouts: 8, seed: 0 };
    for (lesson, kind) in case.lessons.iter().zip(&case.kinds) {
        let answer = ask_with_words(worded, fit, index, &lesson.question, &options, &never);
        let right = answer.is_ok_and(|a| match &lesson.answer {
            LessonAnswer::Open(text) => a.answer.as_deref() == Some(text),
            LessonAnswer::Choices(correct) => a.choices.iter().map(|c| c.correct).eq(correct.iter().copied()),
        });
        score.add(&format!("question {kind}"), right);
    }
    Ok(())
}

fn score_words(case: &Case, words: &WordProbabilities, score: &mut Score) {
    let draw = WordDraw::best(words, case.scene.objects.len());
    let drawn = DrawnWords { words, draw: &draw };
    for k in 0..case.scene.objects.len() {
        // The labelled object that is nearest over the frames that both have.
        let distance = |j: &usize| {
            let pairs = case.scene.tracks[k]
                .samples
                .iter()
                .filter_map(|s| Some((case.labelled.tracks[*j].at(s.frame)?.position - s.position).norm()));
            let all: Vec<f64> = pairs.collect();
            if all.is_empty() { f64::INFINITY } else { all.iter().sum::<f64>() / all.len() as f64 }
        };
        let nearest = (0..case.labelled.objects.len()).min_by(|a, b| distance(a).total_cmp(&distance(b)));
        let Some(j) = nearest.filter(|j| distance(j) < 0.2) else {
            score.add("objects not matched", false);
            continue;
        };
        let truth = &case.labelled.objects[j];
        for (family, word) in [
            (WordFamily::Color, truth.color.as_str()),
            (WordFamily::Material, truth.material.as_str()),
            (WordFamily::Shape, truth.shape.word()),
        ] {
            let right = drawn.of_family(family, k) == Some(word);
            score.add(&format!("word {family:?}"), right);
            let Some(all) = words.family(family) else { continue };
            let p = all.probabilities[k].iter().copied().fold(0.0, f64::max);
            score.words.push((p, right));
        }
    }
}
