//! Crowded scenes with their exact truth: objects that are thrown among others, chains of hits, entrances and exits.

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};
use vrdp::effects::effect;
use vrdp::num::{Vec2, standard_normal, vec2};
use vrdp::reason::{
    FUTURE_FRAMES, MOVING_SPEED, Prediction, RolloutEvents, Scenario, SceneEventKind, ops, scenario,
};
use vrdp::scene::{CLEVRER_CAMERA, Object, Sample, Scene, Shape, Track, WorldKind};
use vrdp::world::{Intervention, Model, Preset, Trace, trace};

const FRAMES: usize = 128;
const FPS: f64 = 25.0;
/// Radius or half side (m), as in CLEVRER.
const SIZE: f64 = 0.2;
/// Standard deviation of a measured yaw (rad).
const YAW_NOISE: f64 = 0.01;
/// Fewest collisions before one of the video, on the way to it: a chain of three hits.
const CHAIN: usize = 2;
/// Fewest samples of an object.
const SAMPLES: usize = 10;

/// A scene with the model that moved its objects.
pub struct Crowd {
    pub scene: Scene,
    pub truth: Model,
    /// Standard deviation of a position (m).
    pub noise: f64,
}

struct Dice(ChaCha8Rng);

impl Dice {
    fn uniform(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * (self.0.next_u64() >> 11) as f64 / (1u64 << 53) as f64
    }

    fn below(&mut self, n: usize) -> usize {
        self.uniform(0.0, n as f64) as usize
    }

    fn normal(&mut self) -> f64 {
        standard_normal(&mut self.0)
    }
}

/// The crowded scene of a seed: the first draw of it that has a chain of hits, an exit and no object that is hardly seen.
pub fn crowded(seed: u64, objects: usize, noise: f64) -> Crowd {
    let mut dice = Dice(ChaCha8Rng::seed_from_u64(seed));
    loop {
        let (mut scene, mut truth) = drawn(&mut dice, objects);
        scene.name = format!("crowd_{seed:05}");
        let times: Vec<f64> = (0..FRAMES + FUTURE_FRAMES).map(|f| f as f64 / FPS).collect();
        let run = trace(&truth, &times);
        for (k, track) in scene.tracks.iter_mut().enumerate() {
            track.samples = samples(&mut dice, &scene.objects[k], (&run, k), noise);
        }
        scene.noise_sigma = Some(noise);
        if is_crowded(&scene, &truth) {
            truth.preset = "clevrer".into();
            return Crowd { scene, truth, noise };
        }
    }
}

/// Objects of different looks and a model whose numbers are drawn from the preset's priors.
fn drawn(dice: &mut Dice, count: usize) -> (Scene, Model) {
    let colors = ["gray", "red", "blue", "green", "brown", "cyan", "purple", "yellow"];
    let mut objects: Vec<Object> = vec![];
    while objects.len() < count {
        let shape = match dice.below(3) {
            0 => Shape::Ball { radius: SIZE },
            1 => Shape::Disc { radius: SIZE },
            _ => Shape::Square { half_side: SIZE },
        };
        let object = Object {
            id: objects.len() as u32,
            color: colors[dice.below(colors.len())].into(),
            material: ["metal", "rubber"][dice.below(2)].into(),
            shape,
            mass: None,
            features: vec![],
        };
        if objects.iter().all(|o| o.description() != object.description()) {
            objects.push(object);
        }
    }
    let first = Sample { frame: 0, position: vec2(0.0, 0.0), yaw: None, covariance: None };
    let scene = Scene {
        name: String::new(),
        setup: None,
        world: WorldKind::Clevrer,
        fps: FPS,
        times: (0..FRAMES).map(|f| f as f64 / FPS).collect(),
        camera: Some(CLEVRER_CAMERA),
        table: None,
        noise_sigma: None,
        tracks: vec![Track { samples: vec![first] }; count],
        objects,
        outliers: vec![],
        findings: vec![],
        feature_layout: None,
        absent: vec![],
    };
    let mut model = Preset::for_world(WorldKind::Clevrer).model(&scene);
    for active in &mut model.effects {
        let Some(entry) = effect(&active.name) else { continue };
        for (parameter, spec) in active.parameters.iter_mut().zip(entry.spec.params) {
            let prior = parameter.prior;
            let draw = |v: &mut f64| *v = (prior.mean + prior.sd * dice.normal()).clamp(spec.min, spec.max);
            parameter.values.iter_mut().for_each(draw);
        }
    }
    place(dice, &mut model);
    (scene, model)
}

/// Half of the objects rest in view; the others are thrown from the rim at one of them.
fn place(dice: &mut Dice, model: &mut Model) {
    let resting = model.bodies.len() / 2;
    let mut places: Vec<Vec2> = vec![];
    let free = |places: &[Vec2], p: Vec2| places.iter().all(|q| (p - *q).norm() > 3.2 * SIZE);
    for (k, body) in model.bodies.iter_mut().enumerate() {
        let mass_sd = model.mass_sd * dice.normal();
        body.mass = vrdp::num::elementary::exp(mass_sd);
        let state = &mut body.start.state;
        state.yaw = dice.uniform(-3.0, 3.0);
        loop {
            let angle = dice.uniform(0.0, std::f64::consts::TAU);
            let radius = if k < resting { dice.uniform(0.0, 1.6) } else { dice.uniform(2.0, 7.0) };
            let (sine, cosine) = vrdp::num::elementary::sin_cos(angle);
            state.position = vec2(radius * cosine, radius * sine);
            if free(&places, state.position) {
                break;
            }
        }
        places.push(state.position);
        if k >= resting {
            let aim = places[dice.below(resting.max(1))] + vec2(dice.normal(), dice.normal()).scaled(0.15);
            let way = aim - state.position;
            let velocity = way.scaled(dice.uniform(1.2, 3.0) / way.norm());
            body.set_velocity(velocity);
        }
    }
}

/// What a camera measures of an object.
fn samples(dice: &mut Dice, object: &Object, (run, k): (&Trace, usize), noise: f64) -> Vec<Sample> {
    let mut samples = vec![];
    for frame in 0..FRAMES {
        let Some(state) = run.states[frame][k] else { continue };
        if !CLEVRER_CAMERA.sees(state.position, object.shape.centre_height()) {
            continue;
        }
        let position = state.position + vec2(dice.normal(), dice.normal()).scaled(noise);
        let yaw = (!object.shape.is_ball()).then(|| state.yaw + YAW_NOISE * dice.normal());
        samples.push(Sample { frame, position, yaw, covariance: None });
    }
    samples
}

fn is_crowded(scene: &Scene, truth: &Model) -> bool {
    if scene.tracks.iter().any(|t| t.samples.len() < SAMPLES) {
        return false;
    }
    let all = true_events(scene, truth, &[], 0.0);
    let video: Vec<_> = all.events.iter().filter(|e| e.frame < FRAMES).cloned().collect();
    let is_hit = |e: &&vrdp::reason::SceneEvent| e.kind == SceneEventKind::Collision;
    let chained =
        video.iter().filter(is_hit).any(|e| ops::ancestors(&video, e).iter().filter(is_hit).count() >= CHAIN);
    chained && all.events.iter().any(|e| e.kind == SceneEventKind::Out)
}

/// The true events under changes; `noise` (m) is what hides a slow motion.
pub fn true_events(scene: &Scene, truth: &Model, changes: &[Intervention], noise: f64) -> RolloutEvents {
    let edited = changes.iter().try_fold(truth.clone(), |m, change| change.apply(&m));
    let model = edited.unwrap_or_else(|_| truth.clone());
    let future = if changes.is_empty() { FUTURE_FRAMES } else { 0 };
    let times: Vec<f64> = (0..FRAMES + future).map(|f| f as f64 / FPS).collect();
    let prediction = Prediction {
        interventions: changes.to_vec(),
        observed_frames: FRAMES,
        best: trace(&model, &times),
        model,
        ensemble: vec![],
        sd: vec![],
        events: vec![],
        unreached: vec![],
        cut_short: None,
    };
    let Scenario { rollouts, .. } = scenario(scene, &prediction, noise);
    rollouts.into_iter().next().unwrap_or_default()
}

/// Models near the truth, as far apart as a careful measurement of the video could leave them.
pub fn near(crowd: &Crowd, count: usize) -> Vec<Model> {
    let mut dice = Dice(ChaCha8Rng::seed_from_u64(17));
    let mut near = vec![crowd.truth.clone()];
    for _ in 1..count {
        let mut model = crowd.truth.clone();
        for state in model.bodies.iter_mut().map(|b| &mut b.start.state) {
            let mut off = |sd: f64| vec2(dice.normal(), dice.normal()).scaled(sd * crowd.noise);
            state.position += off(0.3);
            if state.velocity.norm() > MOVING_SPEED {
                state.velocity += off(0.5);
            }
        }
        near.push(model);
    }
    near
}
