//! Tests of the room: soft programs against exact ones, words from synthetic lessons, new words from examples.

use super::soft::{SoftContext, SoftFamily, SoftRun};
use super::soft_value::SoftValue;
use super::tape::{ONE, Tape, ZERO};
use super::*;
use crate::num::{never, standard_normal, vec2};
use crate::reason::*;
use crate::scene::{Object, Sample, Scene, Shape, Track, WorldKind};
use rand_chacha::{ChaCha8Rng, rand_core::SeedableRng};

const LOOKS: [(&str, &str, &str); 4] = [
    ("red", "metal", "cube"),
    ("blue", "rubber", "sphere"),
    ("green", "metal", "cylinder"),
    ("red", "rubber", "cube"),
];

/// A scene of 20 frames; object 0 is at rest, the others move; features tell colour and material with a little noise.
fn scene(name: &str, looks: &[(&str, &str, &str)], random: &mut ChaCha8Rng) -> Scene {
    scene_with_noise(name, looks, 0.1, random)
}

/// The same with features of this noise, next to a difference of one.
fn scene_with_noise(name: &str, looks: &[(&str, &str, &str)], noise: f64, random: &mut ChaCha8Rng) -> Scene {
    let (mut objects, mut tracks) = (vec![], vec![]);
    for (k, (color, material, form)) in looks.iter().enumerate() {
        let shape = match *form {
            "cube" => Shape::Square { half_side: 0.2 },
            "sphere" => Shape::Ball { radius: 0.2 },
            _ => Shape::Disc { radius: 0.2 },
        };
        let mut near = |x: f64| (x + noise * standard_normal(random)) as f32;
        let flag = |is: bool| if is { 1.0 } else { 0.0 };
        let features = vec![
            near(flag(*color == "red")),
            near(flag(*color == "blue")),
            near(flag(*material == "metal")),
            near(flag(*form == "cube")),
            near(flag(*form == "sphere")),
        ];
        let (color, material) = (color.to_string(), material.to_string());
        objects.push(Object { id: k as u32, color, material, shape, mass: None, features });
        let from = 3 * (k % 2);
        let at = |f: usize| vec2(2.0 * k as f64 + 0.05 * k as f64 * f as f64, 0.0);
        let sample = |frame| Sample { frame, position: at(frame), yaw: None, covariance: None };
        tracks.push(Track { samples: (from..20).map(sample).collect() });
    }
    Scene {
        name: name.into(),
        setup: None,
        world: WorldKind::Clevrer,
        fps: 25.0,
        times: (0..20).map(|f| f as f64 / 25.0).collect(),
        camera: None,
        table: None,
        noise_sigma: None,
        objects,
        tracks,
        outliers: vec![],
        findings: vec![],
        feature_layout: Some("test".into()),
        absent: vec![],
    }
}

fn tokens(program: &str) -> Vec<String> {
    program.split_whitespace().map(str::to_string).collect()
}

/// Events with two collisions of a pair, as simulations have them.
fn scenario() -> Scenario {
    let event = |kind, frame, objects: &[usize]| SceneEvent {
        kind,
        frame,
        time: frame as f64 / 25.0,
        objects: objects.to_vec(),
    };
    let events = vec![
        event(SceneEventKind::In, 3, &[1]),
        event(SceneEventKind::In, 3, &[3]),
        event(SceneEventKind::Collision, 5, &[0, 1]),
        event(SceneEventKind::Collision, 8, &[1, 2]),
        event(SceneEventKind::Out, 12, &[2]),
        event(SceneEventKind::Collision, 15, &[0, 3]),
        event(SceneEventKind::Collision, 24, &[2, 3]),
    ];
    let moving = (0..4).map(|k| (0..20).map(|f| (f >= 3 * (k % 2)).then_some(k > 0)).collect()).collect();
    let rollouts = vec![RolloutEvents { events, moving, encounters: Encounters::default() }];
    Scenario { interventions: vec![], frames: 20 + FUTURE_FRAMES, rollouts }
}

const PROGRAMS: [&str; 27] = [
    "objects red filter_color count",
    "objects metal filter_material sphere filter_shape exist",
    "objects red filter_color metal filter_material unique query_shape",
    "objects blue filter_color unique query_material",
    "objects green filter_color unique query_color",
    "objects null filter_moving count",
    "objects events filter_start query_frame filter_stationary count",
    "objects cube filter_shape events filter_end query_frame filter_moving exist",
    "events objects filter_collision count",
    "events objects red filter_color filter_in count",
    "events objects blue filter_color unique filter_collision first filter_order objects blue filter_color unique query_collision_partner query_color",
    "events objects blue filter_color unique filter_collision last filter_order objects blue filter_color unique query_collision_partner query_shape",
    "events objects filter_in events objects blue filter_color unique filter_in unique filter_after count",
    "events objects filter_collision events objects green filter_color unique filter_out unique filter_before count",
    "events objects filter_in events filter_start filter_after first filter_order query_object query_color",
    "objects blue filter_color unique events events objects green filter_color unique filter_out unique filter_ancestor belong_to",
    "events objects metal filter_material cube filter_shape unique filter_collision objects blue filter_color unique filter_collision unique events events objects green filter_color unique filter_out unique filter_ancestor belong_to",
    "all_events objects blue filter_color unique filter_collision objects green filter_color unique filter_collision unique events belong_to negate",
    "all_events objects green filter_color unique filter_collision objects red filter_color rubber filter_material unique filter_collision unique unseen_events belong_to",
    "all_events objects green filter_color unique filter_out unique unseen_events belong_to",
    "events objects blue filter_color unique objects cylinder filter_shape filter_partner exist",
    "objects blue filter_color unique query_shape",
    "events objects sphere filter_shape filter_collision exist",
    "events objects blue filter_color unique filter_contact count",
    "objects red filter_color 0.4 at_time filter_moving count",
    "events objects filter_collision 0.3 at_time filter_after count",
    "events objects filter_in 5 filter_before count",
];

/// The only rollout of these scenarios.
fn context<'a>(scene: &'a Scene, scenarios: &'a [Scenario]) -> RolloutContext<'a> {
    RolloutContext::of_scene(scene, scenarios)
}

/// The soft result of a program on certain words.
fn soft(program: &QuestionProgram, context: RolloutContext, tape: &mut Tape) -> Option<SoftValue> {
    let words: Vec<Vec<String>> =
        [["red", "blue", "green"], ["metal", "rubber", ""], ["cube", "sphere", "cylinder"]]
            .map(|w| w.iter().map(|w| w.to_string()).collect())
            .to_vec();
    let own = |k: usize, family: usize| [LOOKS[k].0, LOOKS[k].1, LOOKS[k].2][family];
    let families: Vec<SoftFamily> = (0..3)
        .map(|f| SoftFamily {
            family: WordFamily::ALL[f],
            words: &words[f],
            probabilities: (0..4)
                .map(|k| words[f].iter().map(|w| if w == own(k, f) { ONE } else { ZERO }).collect())
                .collect(),
        })
        .collect();
    let context = SoftContext { exact: context, families: &families };
    let mut run = SoftRun { context: &context, tape, stack: vec![], presupposed: ONE };
    run.run(program).ok()?;
    run.stack.pop()
}

#[test]
fn on_certain_words_each_soft_operation_is_the_exact_one() {
    let scene = scene("certain", &LOOKS, &mut ChaCha8Rng::seed_from_u64(1));
    let scenarios = [scenario()];
    let context = context(&scene, &scenarios);
    let mut compared = 0;
    for text in PROGRAMS {
        let program = QuestionProgram::parse(&tokens(text)).unwrap();
        let mut stack = vec![];
        for op in &program.ops {
            let value = step(op, context, &mut stack).unwrap();
            stack.push(value);
        }
        let exact = stack.pop().unwrap();
        let mut tape = Tape::default();
        let Some(SoftValue::Choice(choices)) = soft(&program, context, &mut tape) else { panic!("{text}") };
        let best = choices.iter().max_by(|a, b| tape.value(a.1).total_cmp(&tape.value(b.1))).unwrap();
        assert_eq!(best.0, exact, "{text}");
        assert!((tape.value(best.1) - 1.0).abs() < 1e-9, "{text}");
        compared += 1;
    }
    assert_eq!(compared, 27);
}

/// Lessons of random scenes, answered by the exact operations on the true words.
fn lessons(scene: &Scene) -> Vec<Lesson> {
    let asked = [
        "objects red filter_color count",
        "objects metal filter_material count",
        "objects cube filter_shape metal filter_material exist",
        "objects sphere filter_shape count",
        "objects blue filter_color rubber filter_material exist",
        "events objects filter_in first filter_order query_object query_color",
        "events objects filter_in first filter_order query_object query_material",
    ];
    let scenarios = [observed_scenario(scene)];
    let context = context(scene, &scenarios);
    let answer = |text: &&str| {
        let program = QuestionProgram::parse(&tokens(text)).unwrap();
        let mut stack = vec![];
        for op in &program.ops {
            let value = step(op, context, &mut stack).ok()?;
            stack.push(value);
        }
        let answer = match stack.pop()? {
            ProgramValue::Number(n) => n.to_string(),
            ProgramValue::Bool(b) => if b { "yes" } else { "no" }.to_string(),
            ProgramValue::Text(word) => word,
            _ => return None,
        };
        let question = Question::Program { program: tokens(text), choices: vec![] };
        Some(Lesson { question, answer: LessonAnswer::Open(answer) })
    };
    asked.iter().filter_map(answer).collect()
}

fn random_scenes(count: usize, seed: u64) -> Vec<Scene> {
    noisy_scenes(count, 0.1, seed)
}

fn noisy_scenes(count: usize, noise: f64, seed: u64) -> Vec<Scene> {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let pick = |random: &mut ChaCha8Rng, n: usize| (standard_normal(random).abs() * 1e6) as usize % n;
    let mut scenes = vec![];
    for k in 0..count {
        let looks: Vec<(&str, &str, &str)> = (0..4)
            .map(|_| {
                (
                    ["red", "blue", "green"][pick(&mut random, 3)],
                    ["metal", "rubber"][pick(&mut random, 2)],
                    ["cube", "sphere", "cylinder"][pick(&mut random, 3)],
                )
            })
            .collect();
        scenes.push(scene_with_noise(&format!("video {k}"), &looks, noise, &mut random));
    }
    scenes
}

fn learned(scenes: &[Scene], threads: usize) -> Lexicon {
    let all: Vec<Vec<Lesson>> = scenes.iter().map(lessons).collect();
    let videos: Vec<LessonVideo> =
        scenes.iter().zip(&all).map(|(scene, lessons)| LessonVideo { scene, fit: None, lessons }).collect();
    let options = LearnOptions { steps: 150, folds: 2, ..LearnOptions::default() };
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
    pool.install(|| learn(&videos, &options, &|_| {}, &never)).unwrap()
}

#[test]
fn words_are_learned_from_answers_alone() {
    let lexicon = learned(&random_scenes(24, 5), 2);
    let (mut right, mut all) = (0, 0);
    for scene in random_scenes(20, 6) {
        let words = word_probabilities(&lexicon, &scene, None).unwrap();
        let draw = WordDraw::best(&words, scene.objects.len());
        let drawn = DrawnWords { words: &words, draw: &draw };
        for (k, object) in scene.objects.iter().enumerate() {
            right += usize::from(drawn.of_family(WordFamily::Color, k) == Some(object.color.as_str()));
            right += usize::from(drawn.of_family(WordFamily::Material, k) == Some(object.material.as_str()));
            all += 2;
        }
    }
    assert!(right as f64 >= 0.95 * all as f64, "{right} of {all}");
    let described = describe(&lexicon, "red").unwrap();
    assert_eq!(described.looks_at[0].0, "feature_0");
    assert!(described.calibration.unwrap().accuracy > 0.9);
    assert!(matches!(describe(&lexicon, "pink"), Err(ConceptError::UnknownWord { .. })));
}

/// How many tenths of probability have verdicts, and in how many of these the share that is right is off by more than its 95 % interval.
fn bins_that_are_off(verdicts: &[(f64, bool)]) -> [usize; 2] {
    let tenth = |p: f64| ((10.0 * p) as usize).min(9);
    let (mut all, mut off) = (0, 0);
    for k in 0..10 {
        let own: Vec<&(f64, bool)> = verdicts.iter().filter(|v| tenth(v.0) == k).collect();
        let right = own.iter().filter(|v| v.1).count();
        if !own.is_empty() {
            let mean = own.iter().map(|v| v.0).sum::<f64>() / own.len() as f64;
            let [low, high] = crate::num::share_interval(right, own.len());
            println!("  of {} with {mean:.3} right {right} ({low:.3} to {high:.3})", own.len());
            all += 1;
            off += usize::from(!(low..=high).contains(&mean));
        }
    }
    [all, off]
}

fn log_loss(verdicts: &[(f64, bool)]) -> f64 {
    let each = verdicts.iter().map(|v| -(if v.1 { v.0 } else { 1.0 - v.0 }).max(1e-6).ln());
    each.sum::<f64>() / verdicts.len() as f64
}

/// The most probable word of each family of each object, and whether it is the true one, by a lexicon and by its weights alone. Words that
/// no lesson names are left out.
fn verdicts(lexicon: &Lexicon, scenes: &[Scene], to: &mut [Vec<(f64, bool)>; 2]) {
    for scene in scenes {
        let looks = features::appearance(scene);
        for (object, looks) in scene.objects.iter().zip(&looks) {
            for family in &lexicon.families {
                let truth = match family.family {
                    WordFamily::Color => object.color.as_str(),
                    WordFamily::Material => object.material.as_str(),
                    WordFamily::Shape => object.shape.word(),
                };
                let Some(truth) = family.words.iter().position(|w| w == truth) else { continue };
                let x = lexicon.standardised(looks);
                let certain = LearnedFamily { information: None, temperature: 1.0, ..family.clone() };
                for (p, to) in [family.probabilities(&x), certain.probabilities(&x)].iter().zip(&mut *to) {
                    let best =
                        (0..p.len()).max_by(|a, b| p[*a].total_cmp(&p[*b])).expect("a family has words");
                    to.push((p[best], best == truth));
                }
            }
        }
    }
}

/// Lessons of few videos, whose features hardly tell the words apart, leave the weights uncertain.
#[test]
fn probabilities_of_words_are_calibrated_on_videos_that_were_left_out() {
    let (mut bins, mut point_bins) = ([0; 2], [0; 2]);
    for (videos, noise) in [(6, 0.3), (12, 0.3), (12, 0.45), (24, 0.45)] {
        let mut found = [vec![], vec![]];
        for seed in 0..4 {
            let lexicon = learned(&noisy_scenes(videos, noise, 100 + seed), 2);
            verdicts(&lexicon, &noisy_scenes(15, noise, 200 + seed), &mut found);
        }
        let [loss, point_loss] = [&found[0], &found[1]].map(|v| log_loss(v));
        println!("{videos} videos, noise {noise}: loss {loss:.3}, of the weights alone {point_loss:.3}");
        assert!(loss < point_loss, "{videos} {noise}: {loss} {point_loss}");
        for (bins, found) in [&mut bins, &mut point_bins].into_iter().zip(&found) {
            let [all, off] = bins_that_are_off(found);
            println!("{off} of {all} off");
            *bins = [bins[0] + all, bins[1] + off];
        }
    }
    println!("bins off: {bins:?}, of the weights alone {point_bins:?}");
    assert!(10 * bins[1] <= 2 * bins[0] && 2 * bins[1] < point_bins[1], "{bins:?} {point_bins:?}");
}

#[test]
fn equal_lessons_give_equal_bytes_on_any_number_of_threads() {
    let scenes = random_scenes(6, 9);
    let [one, two] = [1, 2].map(|threads| learned(&scenes, threads));
    assert_eq!(serde_json::to_string(&one).unwrap(), serde_json::to_string(&two).unwrap());
    assert_eq!(one.digest(), two.digest());
    let other = learned(&random_scenes(6, 10), 1);
    assert_ne!(one.digest(), other.digest());
}

fn of_metal(scenes: &[Scene], is: bool, count: usize) -> Vec<Example<'_>> {
    let all = scenes.iter().flat_map(|scene| (0..4).map(move |k| (scene, k)));
    let fitting = all.filter(|(scene, k)| (scene.objects[*k].material == "metal") == is);
    fitting.map(|(scene, k)| Example { scene, fit: None, of: ExampleOf::Object(k) }).take(count).collect()
}

#[test]
fn five_examples_of_each_kind_are_enough_for_a_new_word() {
    let scenes = random_scenes(8, 11);
    let (yes, no) = (of_metal(&scenes, true, 5), of_metal(&scenes, false, 5));
    let lexicon = learn_word(&Lexicon::default(), "gleaming", WordKind::Static, &yes, &no).unwrap();
    let (mut right, mut all) = (0, 0);
    for scene in random_scenes(25, 12) {
        let words = word_probabilities(&lexicon, &scene, None).unwrap();
        let draw = WordDraw::best(&words, 4);
        let drawn = DrawnWords { words: &words, draw: &draw };
        for (k, object) in scene.objects.iter().enumerate() {
            right += usize::from(drawn.holds("gleaming", k, None) == (object.material == "metal"));
            all += 1;
        }
    }
    assert!(right >= 97 * all / 100, "{right} of {all}");
    let known = learn_word(&lexicon, "gleaming", WordKind::Static, &yes, &no);
    assert!(matches!(known, Err(ConceptError::KnownWord { .. })));
}

#[test]
fn examples_that_contradict_or_show_nothing_are_refused() {
    let scenes = random_scenes(8, 13);
    let metal = of_metal(&scenes, true, 6);
    let word =
        |yes: &[Example], no: &[Example]| learn_word(&Lexicon::default(), "new", WordKind::Static, yes, no);
    match word(&metal[..3], &[metal[2], metal[3], metal[4]]) {
        Err(ConceptError::Contradiction { pairs, .. }) => assert_eq!(pairs.len(), 1),
        other => panic!("{other:?}"),
    }
    assert!(matches!(word(&metal[..3], &metal[3..6]), Err(ConceptError::NotSeparable { .. })));
    assert!(matches!(word(&metal[..1], &metal[3..6]), Err(ConceptError::TooFewExamples { .. })));
}

#[test]
fn a_lexicon_of_another_version_is_refused() {
    let lexicon = Lexicon { version: LEXICON_VERSION + 1, ..Lexicon::default() };
    let scene = scene("any", &LOOKS, &mut ChaCha8Rng::seed_from_u64(2));
    let refused = word_probabilities(&lexicon, &scene, None);
    assert_eq!(refused, Err(ConceptError::Version { found: LEXICON_VERSION + 1, expected: LEXICON_VERSION }));
}

/// What a client sends may have been cut.
#[test]
fn a_lexicon_that_lacks_numbers_is_refused() {
    let scenes = random_scenes(4, 3);
    let whole = learned(&scenes, 1);
    let breaks: [fn(&mut Lexicon); 4] = [
        |l| l.families[0].vectors.truncate(1),
        |l| l.families[0].map.truncate(1),
        |l| l.families[0].dimension = usize::MAX,
        |l| l.scale.truncate(1),
    ];
    for break_one in breaks {
        let mut lexicon = whole.clone();
        break_one(&mut lexicon);
        assert_eq!(word_probabilities(&lexicon, &scenes[0], None), Err(ConceptError::Incomplete));
    }
    assert_eq!(whole.check(), Ok(()));
}

/// A disc that strikes one at rest, and a third one `gap` beyond it, which is reached only if the push is strong enough; with its fit.
fn chain(gap: f64) -> (Scene, crate::fit::Fit) {
    chain_on_ground(gap, None)
}

/// The same on a ground with this coefficient of friction; `None`: the preset's.
fn chain_on_ground(gap: f64, friction: Option<f64>) -> (Scene, crate::fit::Fit) {
    let scene = chain_scene("chain", (gap, friction), None, [0.0; 3]);
    let model = crate::world::Preset::for_world(scene.world).model(&scene);
    let options = crate::fit::FitOptions::default();
    let fit = crate::fit::fit(std::slice::from_ref(&scene), &[model], &options, &never).expect("it fits");
    (scene, fit)
}

/// What is seen of the chain, with starts moved by so much (m), and after a change.
fn chain_scene(
    name: &str,
    (gap, friction): (f64, Option<f64>),
    change: Option<&crate::world::Intervention>,
    moved: [f64; 3],
) -> Scene {
    let mut random = ChaCha8Rng::seed_from_u64(3 + name.len() as u64);
    let looks = [("red", "rubber", "disc"), ("blue", "rubber", "disc"), ("green", "rubber", "disc")];
    let mut scene = scene(name, &looks, &mut random);
    (scene.world, scene.times) = (WorldKind::Table, (0..80).map(|f| f as f64 / 25.0).collect());
    let mut model = crate::world::Preset::for_world(scene.world).model(&scene);
    let starts = [(-1.0, 1.6), (0.0, 0.0), (0.4 + gap, 0.0)];
    for ((body, (x, v)), moved) in model.bodies.iter_mut().zip(starts).zip(moved) {
        (body.start.time, body.start.state.position) = (0.0, vec2(x + moved, 0.3 * moved));
        body.start.state.velocity = vec2(v, 0.0);
    }
    for active in &mut model.effects {
        let role = Some(crate::effects::ParamRole::GroundFriction);
        let is_friction: Vec<bool> = active.parameters.iter().map(|p| active.role_of(p) == role).collect();
        let own = active.parameters.iter_mut().zip(is_friction).filter(|(_, is)| *is);
        own.flat_map(|(p, _)| &mut p.values).for_each(|v| *v = friction.unwrap_or(*v));
    }
    let model = change.map_or(Ok(model.clone()), |c| c.apply(&model)).expect("it applies");
    let run = crate::world::trace(&model, &scene.times);
    for (k, track) in scene.tracks.iter_mut().enumerate() {
        let sample = |(frame, row): (usize, &Vec<Option<crate::world::State>>)| {
            let noise = vec2(0.002 * standard_normal(&mut random), 0.002 * standard_normal(&mut random));
            let position = row[k].expect("it is there from the start").position + noise;
            Sample { frame, position, yaw: Some(0.0), covariance: None }
        };
        track.samples = run.states.iter().enumerate().map(sample).collect();
    }
    scene
}

/// What happens under a change of each object that meets another, which is called "ponderous": which pairs collide.
fn change_lessons(
    scene: &Scene,
    fit: &crate::fit::Fit,
    change: &dyn Fn(u32) -> crate::world::Intervention,
) -> Vec<Lesson> {
    let events = |interventions: Vec<crate::world::Intervention>| {
        let frames = scene.times.len();
        let request = PredictionRequest { interventions, frames, rollouts: 0, seed: 0 };
        let found = predict(scene, fit, 0, &request, &never).expect("it is simulated");
        crate::reason::scenario(scene, &found, 0.0).rollouts.remove(0).events
    };
    let meets = |all: &[SceneEvent], pair: &[usize]| {
        all.iter().any(|e| e.kind == SceneEventKind::Collision && pair.iter().all(|o| e.objects.contains(o)))
    };
    let (all, colour) = (events(vec![]), |o: usize| scene.objects[o].color.as_str());
    let lesson = |o: usize| {
        let changed = events(vec![change(scene.objects[o].id)]);
        let pairs = (0..scene.objects.len()).flat_map(|b| (0..b).map(move |a| [a, b]));
        let choice = |[a, b]: [usize; 2]| {
            let of = |o| format!("objects {} filter_color unique filter_collision", colour(o));
            (tokens(&format!("all_events {} {} unique", of(a), of(b))), meets(&changed, &[a, b]))
        };
        let leaves = |o: usize| {
            let exit = format!("all_events objects {} filter_color unique filter_out unique", colour(o));
            (tokens(&exit), changed.iter().any(|e| e.kind == SceneEventKind::Out && e.objects == [o]))
        };
        let (choices, correct) = pairs.map(choice).chain((0..scene.objects.len()).map(leaves)).unzip();
        let program = format!(
            "all_events objects {} filter_color unique ponderous apply filter_counterfact belong_to",
            colour(o)
        );
        let question = Question::Program { program: tokens(&program), choices };
        Lesson { question, answer: LessonAnswer::Choices(correct) }
    };
    (0..scene.objects.len()).filter(|o| meets(&all, &[*o])).map(lesson).collect()
}

#[test]
fn a_lexicon_that_cannot_be_used_is_refused() {
    let whole = learned(&random_scenes(6, 10), 1);
    let changed = |change: &dyn Fn(&mut Lexicon)| {
        let mut lexicon = whole.clone();
        change(&mut lexicon);
        lexicon.check()
    };
    assert_eq!(changed(&|_| ()), Ok(()));
    let incomplete: [&dyn Fn(&mut Lexicon); 5] = [
        &|l| l.layout.as_mut().expect("of appearance").length = 1_000_000_000_000_000,
        &|l| l.mean[0] = f64::NAN,
        &|l| l.scale[0] = 0.0,
        &|l| l.families[0].temperature = 0.0,
        &|l| l.families[0].map[0] = f64::INFINITY,
    ];
    for change in incomplete {
        assert_eq!(changed(change), Err(ConceptError::Incomplete));
    }
    let word = |name: &str, factor: f64, kind| LearnedWord {
        name: name.into(),
        kind,
        meaning: Meaning::Change { quantity: ChangedQuantity::Mass, factor, interval: [1.0, 9.0] },
        yes: 1,
        no: 0,
        evidence: 5.0,
    };
    assert_eq!(changed(&|l| l.words.push(word("denser", 3.0, WordKind::Change))), Ok(()));
    let negative = changed(&|l| l.words.push(word("denser", -5.0, WordKind::Change)));
    assert_eq!(negative, Err(ConceptError::Incomplete));
    let unusable: [&dyn Fn(&mut Lexicon); 5] = [
        &|l| l.words.push(word("the", 3.0, WordKind::Change)),
        &|l| l.words.push(word("", 3.0, WordKind::Change)),
        &|l| l.words.push(word(&"n".repeat(70_000), 3.0, WordKind::Change)),
        &|l| l.words.push(word("denser", 3.0, WordKind::Event)),
        &|l| l.words.extend((0..1000).map(|k| word(&format!("n{k}"), 3.0, WordKind::Change))),
    ];
    for change in unusable {
        assert!(matches!(changed(change), Err(ConceptError::UnusableWord { .. })));
    }
}

/// The factor of a change that is learned from the answers under the true one, with its interval.
fn learned_factor(
    videos: &[(Scene, crate::fit::Fit)],
    quantity: ChangedQuantity,
    change: &dyn Fn(u32) -> crate::world::Intervention,
) -> [f64; 3] {
    let lessons: Vec<Vec<Lesson>> = videos.iter().map(|(s, f)| change_lessons(s, f, change)).collect();
    let all = videos.iter().zip(&lessons);
    let all = all.map(|((scene, fit), lessons)| LessonVideo { scene, fit: Some((fit, 0)), lessons });
    let options = ChangeOptions { quantity, rollouts: 0, seed: 0 };
    let lexicon = learn_change(&Lexicon::default(), "ponderous", &all.collect::<Vec<_>>(), &options, &never);
    describe(&lexicon.expect("the answers tell it"), "ponderous")
        .expect("it is there")
        .factor
        .expect("a change")
}

#[test]
fn the_factor_of_a_change_is_learned_from_what_would_happen() {
    let videos: Vec<_> = (0..4).map(|k| chain(0.15 + 0.3 * f64::from(k))).collect();
    for factor in [5.0, 0.2] {
        let heavier = |id| crate::world::Intervention::ScaleMass { id, factor };
        let [found, low, high] = learned_factor(&videos, ChangedQuantity::Mass, &heavier);
        assert!((low..=high).contains(&factor), "{factor}: {found} ({low} to {high})");
        assert!((found / factor).ln().abs() < 0.7, "{factor}: {found}");
    }
    // What meets nothing says nothing.
    let alone = LessonVideo { scene: &videos[0].0, fit: Some((&videos[0].1, 0)), lessons: &[] };
    let options = ChangeOptions { quantity: ChangedQuantity::Mass, rollouts: 0, seed: 0 };
    let refused = learn_change(&Lexicon::default(), "ponderous", &[alone], &options, &never);
    assert_eq!(refused, Err(ConceptError::NoQuestions));
}

/// "Slippery": the ground brakes an object less.
#[test]
fn the_factor_of_friction_is_learned_from_what_would_happen() {
    let videos: Vec<_> = (0..4).map(|k| chain_on_ground(0.1 + 0.18 * f64::from(k), Some(0.1))).collect();
    let slippery = |id| crate::world::Intervention::ScaleFriction { id, factor: 0.3 };
    let [found, low, high] = learned_factor(&videos, ChangedQuantity::Friction, &slippery);
    assert!((low..=high).contains(&0.3), "{found} ({low} to {high})");
    assert!((found / 0.3).ln().abs() < 0.7, "{found}");
}

use crate::world::Intervention::{ScaleFriction, ScaleMass, ScaleRestitution, ScaleVelocity};

type Changed = fn(u32, f64) -> crate::world::Intervention;

const CHANGES: [(ChangedQuantity, Changed); 4] = [
    (ChangedQuantity::Mass, |id, factor| ScaleMass { id, factor }),
    (ChangedQuantity::Friction, |id, factor| ScaleFriction { id, factor }),
    (ChangedQuantity::Velocity, |id, factor| ScaleVelocity { id, factor }),
    (ChangedQuantity::Restitution, |id, factor| ScaleRestitution { id, factor }),
];

/// The word "altered" from pairs of videos, in which object 0 of the chain is changed by these factors.
fn altered(
    before: &(Scene, crate::fit::Fit),
    (quantity, change): (ChangedQuantity, Changed),
    (yes, no): (&[f64], &[f64]),
) -> Result<Lexicon, ConceptError> {
    let after = |(k, factor): (usize, &f64)| {
        let start = 0.02 * (k as f64 + 1.0);
        chain_scene(
            &format!("{factor} {k}"),
            (0.15, Some(0.05)),
            Some(&change(0, *factor)),
            [-start, start, 0.0],
        )
    };
    let all = |factors: &[f64]| factors.iter().enumerate().map(after).collect::<Vec<Scene>>();
    let (yes, no) = (all(yes), all(no));
    let fit = (&before.1, 0);
    let example = |after| ChangeExample { before: &before.0, fit, object: 0, after };
    let [yes, no] = [&yes, &no].map(|all| all.iter().map(example).collect::<Vec<_>>());
    learn_change_from_examples(&Lexicon::default(), "altered", quantity, (&yes, &no), &never)
}

#[test]
fn the_factor_of_a_change_is_learned_from_pairs_of_videos() {
    let before = chain_on_ground(0.15, Some(0.05));
    for (change, name) in CHANGES.into_iter().zip(["mass", "friction", "velocity", "restitution"]) {
        // No restitution is above 1.
        let factors: &[f64] = if name == "restitution" { &[0.5] } else { &[3.0, 0.3] };
        for &factor in factors {
            let no: &[f64] = if factor > 1.0 && name != "friction" { &[1.0] } else { &[] };
            let yes = if factor > 1.0 { vec![factor; 2] } else { vec![factor] };
            let learned = altered(&before, change, (&yes, no)).expect(name);
            let word = describe(&learned, "altered").expect("it is there");
            let [found, low, high] = word.factor.expect("a change");
            println!("{name} {factor}: {found} ({low} to {high})");
            assert!((found / factor).ln().abs() < 0.18, "{name} {factor}: {found}");
            assert!((low..=high).contains(&factor), "{name} {factor}: {found} ({low} to {high})");
            assert_eq!((word.examples, word.counter_examples), (yes.len(), no.len()));
        }
    }
}

#[test]
fn pairs_that_contradict_each_other_or_show_no_change_are_refused() {
    let before = chain_on_ground(0.15, Some(0.05));
    let [mass, _, velocity, _] = CHANGES;
    let pairs = |refused: Result<Lexicon, ConceptError>| match refused {
        Err(ConceptError::ContradictoryChanges { pairs, .. }) => pairs,
        other => panic!("{other:?}"),
    };
    let different = pairs(altered(&before, velocity, (&[3.0, 0.3], &[])));
    assert!(different.len() == 1 && different[0].contains("object 0 of chain in 0.3 1"), "{different:?}");
    let counter = pairs(altered(&before, mass, (&[3.0], &[1.0, 3.0])));
    assert!(counter.len() == 1 && counter[0].contains("in 3 1 (a counter-example)"), "{counter:?}");
    let unchanged = altered(&before, velocity, (&[1.0], &[]));
    assert!(matches!(unchanged, Err(ConceptError::NotSeparable { .. })), "{unchanged:?}");
    // The third disc is far away and meets nothing.
    let alone = chain_on_ground(5.0, Some(0.05));
    let after = chain_scene("after", (5.0, Some(0.05)), Some(&ScaleMass { id: 2, factor: 3.0 }), [0.0; 3]);
    let example = ChangeExample { before: &alone.0, fit: (&alone.1, 0), object: 2, after: &after };
    let learn = |example: ChangeExample| {
        let examples: (&[ChangeExample], &[ChangeExample]) = (&[example], &[]);
        learn_change_from_examples(&Lexicon::default(), "heavy", ChangedQuantity::Mass, examples, &never)
    };
    assert!(matches!(learn(example), Err(ConceptError::Undetermined { .. })));
    let mut fewer = after.clone();
    fewer.objects.truncate(2);
    fewer.tracks.truncate(2);
    let refused = learn(ChangeExample { after: &fewer, ..example });
    assert!(
        matches!(
            refused,
            Err(ConceptError::OtherObjects { example: ExampleNumber { fits: true, index: 0 }, .. })
        ),
        "{refused:?}"
    );
}

/// A disc that passes a second one at rest, `offset` beside its centre, at a speed: with its fit, in which the model is exact.
fn passing(like: &(Scene, crate::fit::Fit), offset: f64, speed: f64) -> (Scene, crate::fit::Fit) {
    let (mut scene, mut fit) = like.clone();
    let model = &mut fit.scenes[0].model;
    let starts = [(vec2(-1.0, offset), speed), (vec2(0.0, 0.0), 0.0), (vec2(0.0, 5.0), 0.0)];
    for (body, (position, v)) in model.bodies.iter_mut().zip(starts) {
        body.start.state = crate::world::State { position, velocity: vec2(v, 0.0), ..Default::default() };
    }
    let run = crate::world::trace(model, &scene.times);
    for (k, track) in scene.tracks.iter_mut().enumerate() {
        let position = |row: &[Option<crate::world::State>]| row[k].expect("it is there").position;
        let sample = |(frame, row): (usize, &Vec<Option<crate::world::State>>)| Sample {
            frame,
            position: position(row),
            yaw: Some(0.0),
            covariance: None,
        };
        track.samples = run.states.iter().enumerate().map(sample).collect();
    }
    (scene, fit)
}

/// Learns a word of events from five examples and five counter-examples at these offsets (in sums of radii); gives which of a hundred
/// fresh events at random offsets it fits: `(offset, P(word))`.
fn word_of_offsets(name: &str, yes: [f64; 5], no: [f64; 5], fresh: [f64; 2]) -> Vec<(f64, f64)> {
    const RADII: f64 = 0.4;
    let like = chain(5.0);
    let mut random = ChaCha8Rng::seed_from_u64(21);
    let mut between = |a: f64, b: f64| {
        let u = 0.5 * (1.0 + libm::erf(standard_normal(&mut random) / std::f64::consts::SQRT_2));
        a + (b - a) * u
    };
    let mut all = |offsets: [f64; 5]| offsets.map(|x| passing(&like, RADII * x, between(0.9, 2.0)));
    let (yes, no) = (all(yes), all(no));
    let of = ExampleOf::Encounter { objects: [1, 0], frame: 20 };
    let example = |(scene, fit)| Example { scene, fit: Some((fit, 0)), of };
    let yes: Vec<Example> = yes.iter().map(|(s, f)| example((s, f))).collect();
    let no: Vec<Example> = no.iter().map(|(s, f)| example((s, f))).collect();
    let lexicon = learn_word(&Lexicon::default(), name, WordKind::Event, &yes, &no).expect("they differ");
    let probability = |offset: f64, speed: f64| {
        let (scene, fit) = passing(&like, RADII * offset, speed);
        let words = word_probabilities(&lexicon, &scene, Some((&fit, 0))).expect("it has no words of looks");
        let request = PredictionRequest { interventions: vec![], frames: 80, rollouts: 0, seed: 0 };
        let (found, seen) = simulated(&scene, (&fit, 0), &request, &never).expect("it is simulated");
        let ConceptTruth::Encounters(word) = &words.concepts[0].holds else { panic!("a word of events") };
        let met = found.rollouts[0].encounters.of(&scene, &seen.best);
        assert_eq!(met.len(), 1, "at {offset}: {met:?}");
        word.probability(&met[0].features)
    };
    let draws: Vec<(f64, f64)> = (0..100).map(|_| (between(fresh[0], fresh[1]), between(0.9, 2.0))).collect();
    draws.into_iter().map(|(offset, speed)| (offset, probability(offset, speed))).collect()
}

/// A collision is glancing from an angle of 45 degrees on: sqrt(1/2) of the radii beside the centre.
#[test]
fn glancing_collisions_are_learned() {
    let found =
        word_of_offsets("glancing", [0.8, 0.85, 0.9, 0.93, 0.96], [0.05, 0.2, 0.3, 0.45, 0.6], [0.0, 0.98]);
    let right = found.iter().filter(|(x, p)| (*p > 0.5) == (*x > 0.5f64.sqrt())).count();
    println!("glancing: {right} of {}", found.len());
    assert!(right >= 90, "{right} of 100: {found:?}");
}

/// Pairs that pass each other without touching: near ones have a gap below 0.275 of their width.
#[test]
fn near_misses_are_learned() {
    let found = word_of_offsets(
        "near-miss",
        [1.03, 1.06, 1.1, 1.15, 1.2],
        [1.35, 1.45, 1.6, 1.75, 1.9],
        [1.02, 1.98],
    );
    let right = found.iter().filter(|(x, p)| (*p > 0.5) == (*x < 1.275)).count();
    println!("near-miss: {right} of {}", found.len());
    assert!(right >= 90, "{right} of 100: {found:?}");
}

/// A pair beyond its own width is not near, one that touches collides, and one at rest does not come nearer.
#[test]
fn approaches_are_passes_within_the_width_of_the_objects() {
    let like = chain(5.0);
    let request = PredictionRequest { interventions: vec![], frames: 80, rollouts: 0, seed: 0 };
    let collides = |offset: f64, speed: f64| -> Vec<bool> {
        let (scene, fit) = passing(&like, 0.4 * offset, speed);
        let (found, seen) = simulated(&scene, (&fit, 0), &request, &never).expect("it is simulated");
        found.rollouts[0].encounters.of(&scene, &seen.best).iter().map(|e| e.is_collision).collect()
    };
    assert_eq!(collides(0.5, 1.5), [true]);
    assert_eq!(collides(1.5, 1.5), [false]);
    assert!(collides(2.05, 1.5).is_empty());
    assert!(collides(1.5, 0.0).is_empty());
    // The programs see them, and no other operation does.
    let (scene, fit) = passing(&like, 0.6, 1.5);
    let asked = |text: &str| {
        let question = Question::Program { program: tokens(text), choices: vec![] };
        let options = AskOptions { rollouts: 0, seed: 0 };
        ask(&scene, &fit, 0, &question, &options, &never).expect(text).answer.expect(text)
    };
    assert_eq!(asked("video approaches objects red filter_color filter_approach count"), "1");
    assert_eq!(asked("video approaches objects green filter_color filter_approach count"), "0");
    assert_eq!(asked("video approaches objects filter_collision count"), "0");
    assert_eq!(asked("events objects filter_approach count"), "0");
    assert_eq!(asked("objects red filter_color unique 0 scale_velocity suppose video approaches count"), "0");
    let near = "video approaches objects filter_approach first filter_order";
    assert_eq!(
        asked(&format!("{near} objects red filter_color unique query_collision_partner query_color")),
        "blue"
    );
}
