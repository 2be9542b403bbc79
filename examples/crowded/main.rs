//! Asks about crowded scenes (chains of hits, exits) whose truth is known, and tells how often the answers are right and how well
//! stated probabilities agree with what happens: `crowded [SCENES] [--noise M] [--objects N] [--first SEED] [--fits FOLDER]`.
//!
//! The scenes come from the simulator of the fit, with numbers drawn from the preset's priors: an easy case for the physics, and
//! the one in which probabilities must be right. FOLDER keeps the fits between runs.

mod generator;
mod questions;

use generator::{Crowd, crowded, near, true_events};
use questions::{Asked, collide, questions, value};
use rayon::prelude::*;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use vrdp::fit::{Fit, FitOptions, estimate, with_draws};
use vrdp::num::never;
use vrdp::reason::{
    FUTURE_FRAMES, PredictionRequest, ProgramValue, ReasonError, RolloutContext, Scenario, simulated,
};
use vrdp::world::{Intervention, Preset};

type Anyhow = Box<dyn std::error::Error + Send + Sync>;

/// Draws from the posterior.
const ROLLOUTS: usize = 32;
/// Models near the truth that must agree on an answer.
const NEAR: usize = 8;
/// Upper ends of the bins of stated probabilities.
const BINS: [f64; 9] = [0.02, 0.05, 0.15, 0.35, 0.65, 0.85, 0.95, 0.98, 1.0];

struct Arguments {
    scenes: u64,
    first: u64,
    noise: f64,
    objects: usize,
    fits: Option<PathBuf>,
}

/// Right answers and all, by kind of question: where models near the truth agree, and everywhere.
#[derive(Default)]
struct Figures {
    right: BTreeMap<(&'static str, bool), [usize; 2]>,
    /// Stated probability that two objects collide, and whether they do.
    stated: Vec<(f64, bool)>,
    seconds: f64,
}

fn main() -> Result<(), Anyhow> {
    let arguments = arguments()?;
    let seeds: Vec<u64> = (arguments.first..arguments.first + arguments.scenes).collect();
    let each: Vec<Result<Figures, Anyhow>> = seeds.par_iter().map(|seed| one(*seed, &arguments)).collect();
    let mut all = Figures::default();
    for figures in each {
        let Figures { right, stated, seconds } = figures?;
        all.seconds += seconds;
        all.stated.extend(stated);
        for (kind, [of, asked]) in right {
            let sum = all.right.entry(kind).or_default();
            *sum = [sum[0] + of, sum[1] + asked];
        }
    }
    println!("{} scenes, {:.1} s of draws each", seeds.len(), all.seconds / seeds.len() as f64);
    for ((kind, determined), [right, asked]) in &all.right {
        let which = if *determined { "determined" } else { "all" };
        println!("{kind:30} {which:10} {right} of {asked}: {:.1} %", 100.0 * *right as f64 / *asked as f64);
    }
    reliability(&all.stated);
    Ok(())
}

fn arguments() -> Result<Arguments, Anyhow> {
    let mut found = Arguments { scenes: 100, first: 0, noise: 0.005, objects: 6, fits: None };
    let mut words = std::env::args().skip(1);
    while let Some(word) = words.next() {
        let mut next = || words.next().ok_or_else(|| format!("{word} needs a value"));
        match word.as_str() {
            "--noise" => found.noise = next()?.parse()?,
            "--objects" => found.objects = next()?.parse()?,
            "--first" => found.first = next()?.parse()?,
            "--fits" => found.fits = Some(next()?.into()),
            number => found.scenes = number.parse()?,
        }
    }
    Ok(found)
}

/// The fit of a scene without draws, from the folder if it is there.
fn fitted(crowd: &Crowd, folder: Option<&Path>) -> Result<Fit, Anyhow> {
    let Crowd { scene, noise, .. } = crowd;
    let count = scene.objects.len();
    let file = folder.map(|f| f.join(format!("{}_{count}_{noise}.cbor", scene.name)));
    if let Some(bytes) = file.as_ref().and_then(|f| std::fs::read(f).ok()) {
        return Ok(ciborium::from_reader(&bytes[..])?);
    }
    let start = Preset::for_world(scene.world).model(scene);
    let fit = estimate(std::slice::from_ref(scene), &[start], &FitOptions::default(), &never)?;
    if let Some(file) = file {
        let mut bytes = vec![];
        ciborium::into_writer(&fit, &mut bytes)?;
        std::fs::write(file, bytes)?;
    }
    Ok(fit)
}

/// The figures of one scene.
fn one(seed: u64, arguments: &Arguments) -> Result<Figures, Anyhow> {
    let crowd = crowded(seed, arguments.objects, arguments.noise);
    let scene = &crowd.scene;
    let fit = fitted(&crowd, arguments.fits.as_deref())?;
    let begin = std::time::Instant::now();
    let fit = with_draws(std::slice::from_ref(scene), fit, &never)?;
    let mut figures = Figures { seconds: begin.elapsed().as_secs_f64(), ..Figures::default() };
    let mut changes = vec![vec![]];
    for id in scene.objects.iter().map(|o| o.id) {
        changes.push(vec![Intervention::Remove { id }]);
        changes.extend([5.0, 0.2].map(|factor| vec![Intervention::ScaleMass { id, factor }]));
    }
    let stated = |changes: &Vec<Intervention>| -> Result<Scenario, ReasonError> {
        let future = if changes.is_empty() { FUTURE_FRAMES } else { 0 };
        let frames = scene.times.len() + future;
        let request =
            PredictionRequest { interventions: changes.clone(), frames, rollouts: ROLLOUTS, seed: 0 };
        Ok(simulated(scene, (&fit, 0), &request, &never)?.0)
    };
    let scenarios: Vec<Scenario> = changes.iter().map(stated).collect::<Result<_, _>>()?;
    let near = near(&crowd, NEAR);
    // Rollout k is that of model k; a slow motion counts in one of them with the noise, so that what hangs by it is undetermined.
    let truth = |changes: &Vec<Intervention>| {
        let noise = |k: usize| if k == 1 { crowd.noise } else { 0.0 };
        let rollouts = near.iter().enumerate().map(|(k, m)| true_events(scene, m, changes, noise(k)));
        let frames = scene.times.len() + if changes.is_empty() { FUTURE_FRAMES } else { 0 };
        Scenario { interventions: changes.clone(), frames, rollouts: rollouts.collect() }
    };
    let true_scenarios: Vec<Scenario> = changes.iter().map(truth).collect();
    for (stated, truth) in scenarios.iter().zip(&true_scenarios) {
        figures.stated.extend(collisions(stated, truth, scene.objects.len()));
    }
    for asked in questions(scene, &true_scenarios[0].rollouts[0]) {
        let contexts = |of| RolloutContext::of_scene(scene, of);
        judge(&asked, contexts(&scenarios), contexts(&true_scenarios), &mut figures);
    }
    Ok(figures)
}

/// The stated probability of each pair's collision, with the truth.
fn collisions(stated: &Scenario, truth: &Scenario, objects: usize) -> Vec<(f64, bool)> {
    let removed = stated.interventions.iter().find_map(|i| match i {
        Intervention::Remove { id } => Some(*id as usize),
        _ => None,
    });
    let pairs = (0..objects).flat_map(|b| (0..b).map(move |a| [a, b]));
    let of = |pair: [usize; 2]| {
        let ensemble = stated.rollouts.iter().skip(1);
        let k = ensemble.filter(|r| collide(r, pair, stated.frames)).count();
        let probability = (k as f64 + 0.5) / (ROLLOUTS as f64 + 1.0);
        (probability, collide(&truth.rollouts[0], pair, truth.frames))
    };
    pairs.filter(|p| removed.is_none_or(|r| !p.contains(&r))).map(of).collect()
}

/// Whether a question is answered rightly: the most frequent value, or each choice.
fn judge(asked: &Asked, stated: RolloutContext, truth: RolloutContext, figures: &mut Figures) {
    let at = |context: RolloutContext, rollout, choice: Option<&String>| {
        let programs: Vec<&str> = choice.iter().map(|c| c.as_str()).chain([asked.program.as_str()]).collect();
        value(&programs, RolloutContext { rollout, ..context })
    };
    let choices: Vec<Option<&String>> = match &asked.choices[..] {
        [] => vec![None],
        some => some.iter().map(Some).collect(),
    };
    let (mut right, mut settled) = (true, true);
    for choice in choices {
        let wanted = at(truth, 0, choice);
        let Some(wanted) = wanted else { return };
        let agree = (1..NEAR).all(|k| at(truth, k, choice).as_ref() == Some(&wanted));
        let values: Vec<ProgramValue> = (1..=ROLLOUTS).filter_map(|k| at(stated, k, choice)).collect();
        let often = |v: &ProgramValue| values.iter().filter(|w| *w == v).count();
        let most = values.iter().rev().max_by_key(|v| often(v));
        let ok = most == Some(&wanted);
        (right, settled) = (right && ok, settled && agree);
        if choice.is_some() && asked.kind == "explanatory" {
            count(figures, "explanatory, each cause", agree, ok);
        }
        if std::env::var("SHOW").is_ok() && agree && !ok {
            let scene = &stated.scene.name;
            println!("{scene} {}: {} {choice:?}: {most:?} not {wanted:?}", asked.kind, asked.program);
        }
    }
    count(figures, asked.kind, settled, right);
}

fn count(figures: &mut Figures, kind: &'static str, settled: bool, right: bool) {
    for determined in [false, true] {
        if settled || !determined {
            let of = figures.right.entry((kind, determined)).or_default();
            *of = [of[0] + usize::from(right), of[1] + 1];
        }
    }
}

/// What is stated against what happens, by bins, with Wilson's 95 % interval of the share.
fn reliability(stated: &[(f64, bool)]) {
    let mut low = 0.0;
    for high in BINS {
        let inside: Vec<_> = stated.iter().filter(|(p, _)| *p > low && *p <= high).collect();
        let n = inside.len() as f64;
        if n > 0.0 {
            let mean = inside.iter().map(|(p, _)| p).sum::<f64>() / n;
            let share = inside.iter().filter(|(_, is)| *is).count() as f64 / n;
            let z = 1.96;
            let centre = (share + z * z / (2.0 * n)) / (1.0 + z * z / n);
            let half = z * (share * (1.0 - share) / n + z * z / (4.0 * n * n)).sqrt() / (1.0 + z * z / n);
            let inside = mean >= centre - half && mean <= centre + half;
            println!(
                "stated {low:.2} to {high:.2}: {n:6} pairs, mean {mean:.4}, happens {share:.4} [{:.4}, {:.4}] {}",
                centre - half,
                centre + half,
                if inside { "" } else { "off" }
            );
        }
        low = high;
    }
    let loss = |(p, is): &(f64, bool)| -vrdp::num::elementary::ln(if *is { *p } else { 1.0 - p });
    let total: f64 = stated.iter().map(loss).sum();
    println!("log loss {:.4} over {} pairs", total / stated.len() as f64, stated.len());
}
