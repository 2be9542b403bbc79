//! The soft programs of a video's lessons on a tape, their loss, and its gradient by the weights.

use crate::concepts::error::ConceptError;
use crate::concepts::lessons::{LessonItem, PreparedVideo, RecordedAnswer, RecordedLoss, RunItems};
use crate::concepts::lexicon::LearnedFamily;
use crate::concepts::soft::{SoftContext, SoftFamily, SoftRun};
use crate::concepts::soft_value::SoftValue;
use crate::concepts::tape::{ONE, Tape, Variable, ZERO};
use crate::num::Stop;
use crate::reason::{FUTURE_FRAMES, Halt, ProgramValue, RolloutContext};
use crate::world::Intervention;
use rayon::prelude::*;

/// Weight of what a question presupposes: less than one, as its phrases share words.
pub const PRESUPPOSED_WEIGHT: f64 = 0.5;

/// Loss and gradient of one video.
#[derive(Clone, Default)]
pub struct VideoLoss {
    pub loss: f64,
    pub questions: f64,
    /// Derivatives by the logits: family by family, object by object.
    pub logits: Vec<f64>,
}

impl VideoLoss {
    fn of(run: &RecordedLoss) -> VideoLoss {
        VideoLoss {
            loss: run.tape.value(run.loss),
            questions: run.questions,
            logits: run.tape.gradient(run.loss, &run.logits),
        }
    }
}

/// E W of a family, words x features, and E u: the logits of its words are linear in the features.
struct LogitMap {
    words: usize,
    weights: Vec<f64>,
    offsets: Vec<f64>,
}

impl LogitMap {
    fn of(family: &LearnedFamily, length: usize) -> LogitMap {
        let (n, words) = (family.dimension, family.words.len());
        let (mut weights, mut offsets) = (vec![0.0; words * length], vec![0.0; words]);
        for w in 0..words {
            let row = &mut weights[w * length..(w + 1) * length];
            for (c, e) in family.vectors[w * n..(w + 1) * n].iter().enumerate() {
                offsets[w] += e * family.offset[c];
                let map = &family.map[c * length..(c + 1) * length];
                row.iter_mut().zip(map).for_each(|(slot, x)| *slot += e * x);
            }
        }
        LogitMap { words, weights, offsets }
    }

    fn logit(&self, word: usize, features: &[f64]) -> f64 {
        let row = &self.weights[word * features.len()..(word + 1) * features.len()];
        self.offsets[word] + row.iter().zip(features).map(|(w, f)| w * f).sum::<f64>()
    }
}

/// Logits of all words of a video: family by family, object by object.
fn logits(maps: &[LogitMap], video: &PreparedVideo) -> Vec<f64> {
    let of_family = |m: &LogitMap| -> Vec<f64> {
        let of = |f: &Vec<f64>| (0..m.words).map(|w| m.logit(w, f)).collect::<Vec<f64>>();
        video.features.iter().flat_map(of).collect()
    };
    maps.iter().flat_map(of_family).collect()
}

/// Logits of all words of a video.
pub fn logits_of(families: &[LearnedFamily], video: &PreparedVideo) -> Vec<f64> {
    logits(&logit_maps(families, std::slice::from_ref(video)), video)
}

fn logit_maps(families: &[LearnedFamily], videos: &[PreparedVideo]) -> Vec<LogitMap> {
    families.iter().map(|f| LogitMap::of(f, feature_count(videos))).collect()
}

/// How many features an object has.
pub fn feature_count(videos: &[PreparedVideo]) -> usize {
    videos.iter().flat_map(|v| v.features.first()).map(Vec::len).next().unwrap_or(0)
}

/// The losses of a batch, in its order; simulates first what its programs need.
pub fn batch(
    videos: &mut [PreparedVideo],
    batch: &[usize],
    families: &[LearnedFamily],
    items: RunItems,
    stop: Stop,
) -> Result<Vec<VideoLoss>, ConceptError> {
    let maps = logit_maps(families, videos);
    // A video that is in the batch twice is run once.
    let mut distinct = batch.to_vec();
    distinct.sort_unstable();
    distinct.dedup();
    let mut done: Vec<(usize, RecordedLoss)> = vec![];
    let mut losses: Vec<(usize, VideoLoss)> = vec![];
    let mut open = distinct;
    while !open.is_empty() {
        let recorded: Vec<Option<RecordedLoss>> = open.iter().map(|v| videos[*v].recorded.take()).collect();
        let ready: &[PreparedVideo] = videos;
        let runs: Vec<Result<(RecordedLoss, VideoLoss), Halt>> = open
            .par_iter()
            .zip(recorded)
            .map(|(v, last)| {
                let logits = logits(&maps, &ready[*v]);
                let run = run(&ready[*v], families, &logits, (items, last))?;
                let loss = VideoLoss::of(&run);
                Ok((run, loss))
            })
            .collect();
        let mut needs = vec![];
        for (v, run) in open.iter().zip(runs) {
            match run {
                Ok((run, loss)) => {
                    done.push((*v, run));
                    losses.push((*v, loss));
                }
                Err(Halt::NeedsSimulation(interventions, frames)) => {
                    needs.push((*v, interventions, frames));
                }
                Err(Halt::Undetermined(_)) => losses.push((*v, VideoLoss::default())),
                Err(Halt::Error(error)) => return Err(error.into()),
            }
        }
        open = needs.iter().map(|n| n.0).collect();
        for (v, interventions, frames) in needs {
            videos[v].simulate(&interventions, frames, stop)?;
        }
    }
    done.sort_by_key(|d| d.0);
    keep(videos, done);
    let of = |v: &usize| losses.iter().find(|l| l.0 == *v).map(|l| l.1.clone()).unwrap_or_default();
    Ok(batch.iter().map(of).collect())
}

/// The items of a video for these logits: the last run again if it took the path that this one takes, else on a new tape.
pub fn run(
    video: &PreparedVideo,
    families: &[LearnedFamily],
    logits: &[f64],
    (items, last): (RunItems, Option<RecordedLoss>),
) -> Result<RecordedLoss, Halt> {
    if let Some(mut last) = last.filter(|l| l.items == items) {
        let inputs = last.logits.iter().copied().zip(logits.iter().copied());
        if last.tape.replay(inputs) {
            return Ok(last);
        }
    }
    let mut tape = Tape::default();
    let (soft, inputs) = soft_families(video, families, logits, &mut tape);
    let context = context(video, &soft);
    let (mut loss, mut questions, mut answers) = (ZERO, 0.0, vec![]);
    let left_out = |i: &LessonItem| items == RunItems::Observed && i.needs_simulation;
    for item in video.items.iter().filter(|i| !left_out(i)) {
        let found = match answer_probability(&context, item, &mut tape) {
            Err(Halt::NeedsSimulation(..)) if items == RunItems::Simulated => None,
            found => found?,
        };
        let Some(answer) = found else { continue };
        let (log_answer, log_presupposed) = (tape.ln(answer.right), tape.ln(answer.presupposed));
        let given = tape.scale(log_presupposed, PRESUPPOSED_WEIGHT);
        let both = tape.add(log_answer, given);
        let weighted = tape.scale(both, -item.weight);
        loss = tape.add(loss, weighted);
        questions += item.weight;
        answers.push(answer);
    }
    tape.finish();
    Ok(RecordedLoss { tape, items, logits: inputs, loss, questions, answers })
}

/// Probabilities of words on the tape, and the logits that they come from.
fn soft_families<'f>(
    video: &PreparedVideo,
    families: &'f [LearnedFamily],
    logits: &[f64],
    tape: &mut Tape,
) -> (Vec<SoftFamily<'f>>, Vec<Variable>) {
    let inputs: Vec<Variable> = logits.iter().map(|l| tape.input(*l)).collect();
    let (mut soft, mut rest) = (vec![], &inputs[..]);
    for family in families {
        let mut probabilities = vec![];
        for _ in &video.features {
            let (row, others) = rest.split_at(family.words.len().min(rest.len()));
            probabilities.push(tape.softmax(row));
            rest = others;
        }
        soft.push(SoftFamily { family: family.family, words: &family.words, probabilities });
    }
    (soft, inputs)
}

fn context<'v>(video: &'v PreparedVideo, soft: &'v [SoftFamily<'v>]) -> SoftContext<'v> {
    let bodies =
        video.fit.and_then(|(fit, index)| fit.scenes.get(index)).map_or(&[][..], |s| &s.model.bodies);
    let exact = RolloutContext {
        scene: video.scene,
        bodies,
        effects: &video.effects,
        scenarios: &video.scenarios,
        simulations: &video.simulations,
        models: &video.models,
        fit: video.fit,
        future: FUTURE_FRAMES,
        rollout: 0,
        discovery: None,
        words: None,
    };
    SoftContext { exact, families: soft }
}

/// Adds dL/dW = E^T G, dL/du = E^T h and dL/dE = G W^T + h u^T, with G = sum_o g_o f_o^T and h = sum_o g_o over all objects.
pub fn add_gradient(
    families: &[LearnedFamily],
    videos: &[PreparedVideo],
    (batch, losses): (&[usize], &[VideoLoss]),
    gradient: &mut [Vec<f64>],
) {
    let mut first: Vec<usize> = vec![0; batch.len()];
    for (k, family) in families.iter().enumerate() {
        let (words, n) = (family.words.len(), family.dimension);
        let length = family.map.len() / n.max(1);
        let (mut of_features, mut of_words) = (vec![0.0; words * length], vec![0.0; words]);
        for ((v, loss), first) in batch.iter().zip(losses).zip(&mut first) {
            for f in &videos[*v].features {
                let own = loss.logits.get(*first..*first + words).unwrap_or_default();
                for (w, g) in own.iter().enumerate().filter(|(_, g)| **g != 0.0) {
                    of_words[w] += g;
                    let row = &mut of_features[w * length..(w + 1) * length];
                    row.iter_mut().zip(f).for_each(|(slot, x)| *slot += g * x);
                }
                *first += words;
            }
        }
        for w in 0..words {
            let row = &of_features[w * length..(w + 1) * length];
            for c in 0..n {
                let (e, map) = (family.vectors[w * n + c], &family.map[c * length..(c + 1) * length]);
                gradient[3 * k + 1][c] += e * of_words[w];
                let of_map = &mut gradient[3 * k][c * length..(c + 1) * length];
                of_map.iter_mut().zip(row).for_each(|(slot, g)| *slot += e * g);
                let along: f64 = row.iter().zip(map).map(|(g, x)| g * x).sum();
                gradient[3 * k + 2][w * n + c] += along + of_words[w] * family.offset[c];
            }
        }
    }
}

/// The probabilities of the answers of an item; `None` where its program has no result for these events.
fn answer_probability(
    context: &SoftContext,
    item: &LessonItem,
    tape: &mut Tape,
) -> Result<Option<RecordedAnswer>, Halt> {
    let exact = &context.exact;
    let can_simulate =
        |needed: &[Intervention], frames| exact.fit.is_some() && !exact.is_simulated(needed, frames);
    let mut run = SoftRun { context, tape, stack: vec![], presupposed: ONE };
    for program in &item.programs {
        match run.run(program) {
            Ok(()) => {}
            Err(Halt::NeedsSimulation(needed, frames)) if can_simulate(&needed, frames) => {
                return Err(Halt::NeedsSimulation(needed, frames));
            }
            // Events that were missed leave the question without a meaning.
            Err(_) => return Ok(None),
        }
    }
    let presupposed = run.presupposed;
    let Some(SoftValue::Choice(choices)) = run.stack.pop() else { return Ok(None) };
    let is_answer = |value: &ProgramValue| match (value, &item.target) {
        (ProgramValue::Word(a), ProgramValue::Text(b)) => a == b,
        (a, b) => a == b,
    };
    let (right, others): (Vec<_>, Vec<_>) = choices.into_iter().partition(|(value, _)| is_answer(value));
    let right = right.first().map_or(ZERO, |c| c.1);
    let others = others.into_iter().map(|c| c.1).collect();
    Ok(Some(RecordedAnswer { right, others, presupposed, weight: item.weight }))
}

/// Keeps runs to be replayed, up to [`MOST_KEPT`] entries.
fn keep(videos: &mut [PreparedVideo], runs: Vec<(usize, RecordedLoss)>) {
    let mut kept: usize = videos.iter().filter_map(|v| v.recorded.as_ref()).map(|r| r.tape.length()).sum();
    for (v, run) in runs {
        kept += run.tape.length();
        if kept <= MOST_KEPT {
            videos[v].recorded = Some(run);
        }
    }
}

/// Most entries of all tapes that are kept: 20 bytes each.
const MOST_KEPT: usize = 8 << 20;
