//! Counts the derivatives that agree with central differences: `cargo run --release --example gradients -- FOLDER`, a folder
//! of folders with an `observed.json`. Fits each scene. For each model value on which the positions depend, it compares their
//! derivatives with differences over the best step: round-off spoils short steps, and long ones change the order of events.

use std::error::Error;
use std::path::{Path, PathBuf};
use vrdp::fit::{FitOptions, fit};
use vrdp::num::{Differential, Jet, LANES, Real, Vec2, never};
use vrdp::scene::parse;
use vrdp::world::{Model, Preset, Rollout, SimulationLimits, simulate};

/// Difference steps, relative to the larger of 1 and the value.
const STEPS: [f64; 6] = [1e-8, 1e-7, 1e-6, 1e-5, 1e-4, 1e-3];
/// Largest relative difference (2-norm over all positions) of derivatives that agree.
const TOLERANCE: f64 = 1e-4;
/// Positions whose derivative is smaller do not depend on the value (m per unit).
const DEPENDS: f64 = 1e-6;

fn main() -> Result<(), Box<dyn Error>> {
    let folder = std::env::args().nth(1).ok_or("give a folder of scenes")?;
    let mut scenes: Vec<PathBuf> =
        std::fs::read_dir(folder)?.map(|entry| Ok(entry?.path())).collect::<Result<_, std::io::Error>>()?;
    scenes.sort();
    let (mut good, mut all) = (0, 0);
    for scene in scenes.iter().filter(|s| s.join("observed.json").exists()) {
        let (agree, count) = agreement(scene)?;
        println!("{}: {agree} of {count}", scene.display());
        (good, all) = (good + agree, all + count);
    }
    println!("{good} of {all} agree: {:.2} %", 100.0 * good as f64 / all as f64);
    Ok(())
}

fn agreement(folder: &Path) -> Result<(usize, usize), Box<dyn Error>> {
    let text = std::fs::read_to_string(folder.join("observed.json"))?;
    let scene = parse(&folder.display().to_string(), &text)?;
    let start = Preset::for_world(scene.world).model(&scene);
    let found = fit(std::slice::from_ref(&scene), &[start], &FitOptions::default(), &never)?;
    let (model, times) = (&found.scenes[0].model, &scene.times);
    let base = model.flatten();
    let (mut good, mut all) = (0, 0);
    for first in (0..base.len()).step_by(LANES) {
        let lanes = first..(first + LANES).min(base.len());
        let jet = |(i, &v): (usize, &f64)| match lanes.contains(&i) {
            true => Jet::variable(v, i - first),
            false => Jet::constant(v),
        };
        let jets: Vec<Jet> = base.iter().enumerate().map(jet).collect();
        let exact = positions(&simulate(model, &jets, times, &SimulationLimits::default()));
        for i in lanes.clone() {
            let errors = STEPS.map(|step| off(model, times, &base, [i, i - first], step, &exact));
            let errors: Vec<f64> = errors.into_iter().flatten().collect();
            if errors.len() == STEPS.len() {
                all += 1;
                good += usize::from(errors.into_iter().fold(f64::INFINITY, f64::min) <= TOLERANCE);
            }
        }
    }
    Ok((good, all))
}

/// Relative difference of the derivatives by value `i`, which `exact` holds in `lane`; `None` if no position depends on it.
fn off(
    model: &Model,
    times: &[f64],
    base: &[f64],
    [i, lane]: [usize; 2],
    step: f64,
    exact: &[Vec2<Jet>],
) -> Option<f64> {
    let step = step * base[i].abs().max(1.0);
    let at = |by: f64| {
        let mut flat = base.to_vec();
        flat[i] += by;
        positions(&simulate(model, &flat, times, &SimulationLimits::default()))
    };
    let (up, down) = (at(step), at(-step));
    let (mut error, mut size) = (0.0, 0.0);
    for ((exact, up), down) in exact.iter().zip(&up).zip(&down) {
        let numeric = (*up - *down).scaled(0.5 / step);
        let exact = Vec2 { x: exact.x.derivative(lane), y: exact.y.derivative(lane) };
        error += (exact - numeric).norm_squared();
        size += numeric.norm_squared();
    }
    (size.sqrt() > DEPENDS).then(|| (error / size).sqrt())
}

fn positions<T: Real>(rollout: &Rollout<T>) -> Vec<Vec2<T>> {
    rollout.states.iter().flatten().flatten().map(|k| k.position).collect()
}
