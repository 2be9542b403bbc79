//! Finds where work computes for long without asking whether it should stop:
//!
//! `cargo run --release --example stop_gaps -- [--ms N] fit|simulate|ask|joint|compare|diagnose|discover|change|link DIR...`,
//! each DIR a scene folder; `link` needs none. It runs the work twice on one thread. The first run measures the CPU time between
//! two questions; the second prints, for each pause above N ms (default 20), the stacks before and after it, the longest first.

use std::backtrace::Backtrace;
use std::collections::BTreeMap;
use std::error::Error;
use std::sync::Mutex;
use std::time::{Duration, Instant};
use vrdp::discover::{DiscoverOptions, ModelChange, Origin, change, compare, diagnose, discover};
use vrdp::fit::{FitOptions, fit};
use vrdp::num::{Stop, Stopped, never};
use vrdp::reason::{AskOptions, PredictionRequest, Question, ask, predict};
use vrdp::scene::{BoundingBox, CLEVRER_CAMERA, Detection, LinkOptions, Scene, link, parse};
use vrdp::world::{Intervention, Model, Preset};

type Failure = Box<dyn Error + Send + Sync>;

/// Pauses that are printed.
const MOST_SHOWN: usize = 12;
/// Innermost functions of a stack that are printed.
const FRAMES: usize = 9;

/// CPU time of this thread; its resolution is a tick of the system.
fn cpu() -> Duration {
    let text = std::fs::read_to_string("/proc/thread-self/schedstat").unwrap_or_default();
    text.split(' ').next().and_then(|ns| ns.parse().ok()).map_or(Duration::ZERO, Duration::from_nanos)
}

/// Counts questions whether to stop, and the CPU time between them.
struct Pauses {
    number: usize,
    read: (Instant, Duration),
    /// By the number of the question after it.
    found: BTreeMap<usize, Duration>,
    stacks: BTreeMap<usize, String>,
    /// Whose stacks are wanted.
    wanted: Vec<usize>,
    least: Duration,
}

impl Pauses {
    fn new(least: Duration, wanted: Vec<usize>) -> Mutex<Pauses> {
        let (found, stacks) = (BTreeMap::new(), BTreeMap::new());
        Mutex::new(Pauses { number: 0, read: (Instant::now(), cpu()), found, stacks, wanted, least })
    }

    fn asked(&mut self) {
        self.number += 1;
        if self.read.0.elapsed() > Duration::from_millis(2) {
            let now = cpu();
            let used = now.saturating_sub(self.read.1);
            if used >= self.least {
                self.found.insert(self.number, used);
            }
            self.read = (Instant::now(), now);
        }
        if self.wanted.contains(&self.number) {
            self.stacks.insert(self.number, stack());
            self.read = (Instant::now(), cpu());
        }
    }
}

/// The project's functions that are active, innermost first.
fn stack() -> String {
    let text = Backtrace::force_capture().to_string();
    let mut lines = text.lines().map(str::trim).peekable();
    let mut out = vec![];
    while let Some(line) = lines.next() {
        let name = line.split_once(": ").map_or(line, |(_, name)| name);
        let place = lines.peek().and_then(|next| next.strip_prefix("at ")).unwrap_or_default();
        if name.contains("vrdp::") && place.contains("/src/") && !place.contains("/num/stop.rs") {
            out.push(format!("      {}", place.rsplit_once("/src/").map_or(place, |(_, end)| end)));
        }
    }
    out.dedup();
    out.truncate(FRAMES);
    out.join("\n")
}

fn main() -> Result<(), Failure> {
    let mut arguments: Vec<String> = std::env::args().skip(1).collect();
    let mut least = Duration::from_millis(20);
    if arguments.first().is_some_and(|first| first == "--ms") {
        least = Duration::from_millis(arguments.get(1).ok_or("--ms needs a number")?.parse()?);
        arguments.drain(..2);
    }
    let (kind, folders) = arguments.split_first().ok_or("name the work")?;
    let mut scenes = vec![];
    for folder in folders {
        let text = std::fs::read_to_string(format!("{folder}/observed.json"))?;
        scenes.push(parse(folder, &text)?);
    }
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build()?;
    let run = |pauses: &Mutex<Pauses>| -> Result<(), Failure> {
        let stop = |_: f64| -> Result<(), Stopped> {
            pauses.lock().map_err(|_| Stopped)?.asked();
            Ok(())
        };
        pool.install(|| work(kind, &scenes, &stop))?;
        pauses.lock().map_err(|_| "a question panicked")?.asked();
        Ok(())
    };
    let (first, start) = (Pauses::new(least, vec![]), cpu());
    run(&first)?;
    let first = first.into_inner().map_err(|_| "a question panicked")?;
    let mut found: Vec<(usize, Duration)> = first.found.into_iter().collect();
    found.sort_by_key(|(_, used)| std::cmp::Reverse(*used));
    println!("{kind}: {} questions, {} pauses above {least:?}; {start:?}", first.number, found.len());
    found.truncate(MOST_SHOWN);
    let second = Pauses::new(Duration::MAX, found.iter().flat_map(|(k, _)| [k - 1, *k]).collect());
    run(&second)?;
    let stacks = second.into_inner().map_err(|_| "a question panicked")?.stacks;
    for (k, used) in found {
        let at = |k: usize| stacks.get(&k).map_or("      (start)", String::as_str);
        println!("  {:.0} ms between\n{}\n    and\n{}", used.as_secs_f64() * 1e3, at(k - 1), at(k));
    }
    Ok(())
}

fn work(kind: &str, scenes: &[Scene], stop: Stop) -> Result<(), Failure> {
    let options = FitOptions::default();
    let models: Vec<Model> = scenes.iter().map(|s| Preset::for_world(s.world).model(s)).collect();
    let first = scenes.first().zip(models.first());
    let fitted = || {
        let (scene, model) = first.ok_or("name a scene")?;
        let fit = fit(std::slice::from_ref(scene), std::slice::from_ref(model), &options, &never)?;
        Ok::<_, Failure>((scene, fit))
    };
    match kind {
        "fit" => {
            let (scene, model) = first.ok_or("name a scene")?;
            vrdp::discover::fit_passing_over_pushes(scene, model, &options, stop)?;
        }
        "joint" => drop(fit(scenes, &models, &options, stop)?),
        "simulate" => {
            let (scene, fit) = fitted()?;
            let interventions = vec![Intervention::Remove { id: scene.objects[0].id }];
            let frames = scene.times.len() + 60;
            let request = PredictionRequest { interventions, frames, rollouts: 1000, seed: 1 };
            predict(scene, &fit, 0, &request, stop)?;
        }
        "ask" => {
            let (scene, fit) = fitted()?;
            let question = "What will happen if the cube is removed?".to_string();
            let question = Question::English { question, choices: vec![] };
            ask(scene, &fit, 0, &question, &AskOptions { rollouts: 1000, seed: 1 }, stop)?;
        }
        "compare" => drop(compare(scenes, &fit(scenes, &models, &options, &never)?, &options, stop)?),
        "diagnose" => {
            let fit = fit(scenes, &models, &options, &never)?;
            diagnose(scenes, &fit, &[], &DiscoverOptions::default(), stop)?;
        }
        "discover" => drop(discover(scenes, &models, &DiscoverOptions::default(), stop)?),
        "change" => {
            let add = ModelChange::Add("coriolis".into());
            change(scenes, &Origin::Start(&models), &add, &DiscoverOptions::default().fit, stop)?;
        }
        "link" => {
            let options =
                LinkOptions { frames: 1600, fps: 25.0, camera: CLEVRER_CAMERA, size: 0.2, sigma: 0.5 };
            link(&detections(1600), &options, stop)?;
        }
        other => return Err(format!("there is no work {other:?}").into()),
    }
    Ok(())
}

/// A crowd of 125 bodies that stand still.
fn detections(frames: usize) -> Vec<Detection> {
    let of_frame = |frame: usize| {
        (0..125).map(move |k| {
            let (left, top) = (20.0 + 17.0 * (k % 25) as f64, 150.0 + 30.0 * (k / 25) as f64);
            let bounds = BoundingBox { left, top, right: left + 12.0, bottom: top + 12.0 };
            let (color, material, shape) = Default::default();
            Detection { frame, bounds, color, material, shape, score: 1.0, features: vec![] }
        })
    };
    (0..frames).flat_map(of_frame).collect()
}
