//! Tests of the question language on real questions: types, English, and answers on the true events.

use super::ask::doubt;
use super::context::{Halt, RolloutContext};
use super::describe::describe;
use super::events::{RolloutEvents, Scenario, SceneEvent, SceneEventKind, scenario};
use super::operations::ops;
use super::run::run;
use super::summary::{estimated_probability, summary};
use super::value::ProgramValue;
use super::*;
use crate::fit::{Estimate, ObjectEstimate};
use crate::num::{Vec2, never, vec2};
use crate::scene::{Object, Sample, Scene, Shape, Table, Track, WorldKind, parse};
use crate::world::{Ending, Event, EventKind, Intervention, Preset, Trace, trace};
use proptest::prelude::*;
use serde_json::Value as Json;
use std::path::{Path, PathBuf};

fn root() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR"))
}

/// The committed scenes, and the benchmark's where it lies beside the repository.
fn scenes() -> Vec<PathBuf> {
    let folders = ["tests/data/clevrer", "../shared/data/clevrer/dev", "../shared/data/clevrer/dev_bounce"];
    let entries =
        folders.iter().flat_map(|f| std::fs::read_dir(root().join(f)).into_iter().flatten().flatten());
    let mut scenes: Vec<PathBuf> =
        entries.map(|e| e.path()).filter(|p| p.join("questions.json").exists()).collect();
    scenes.sort();
    scenes
}

fn json(path: &Path) -> Json {
    serde_json::from_str(&std::fs::read_to_string(path).unwrap()).unwrap()
}

fn list(value: &Json) -> Vec<Json> {
    value.as_array().cloned().unwrap_or_default()
}

fn tokens(value: &Json) -> Vec<String> {
    list(value).iter().map(|t| t.as_str().unwrap().to_string()).collect()
}

fn observed(folder: &Path) -> Scene {
    parse("scene", &std::fs::read_to_string(folder.join("observed.json")).unwrap()).unwrap()
}

/// What is read about this scene, without a lexicon.
fn of_scene(scene: &Scene) -> ReadingContext<'_> {
    ReadingContext { scene: Some(scene), lexicon: &[] }
}

#[test]
fn every_program_of_the_data_type_checks() {
    let mut questions: Vec<Json> =
        scenes().iter().flat_map(|s| list(&json(&s.join("questions.json"))["questions"])).collect();
    let extra = std::fs::read_to_string(root().join("../shared/data/questions/explanatory.jsonl"))
        .unwrap_or_default();
    questions.extend(extra.lines().map(|l| serde_json::from_str::<Json>(l).unwrap()));
    for q in &questions {
        let program = QuestionProgram::parse(&tokens(&q["program"])).unwrap();
        let choices = list(&q["choices"]);
        for c in &choices {
            let mut stack = vec![];
            QuestionProgram::parse(&tokens(&c["program"])).unwrap().check(&mut stack).unwrap();
            program.check(&mut stack).unwrap();
            assert_eq!(stack, [Type::Bool]);
        }
        if choices.is_empty() {
            let mut stack = vec![];
            program.check(&mut stack).unwrap();
            assert_eq!(stack.len(), 1);
        }
    }
    println!("{} questions", questions.len());
}

#[test]
fn english_gives_the_programs_of_the_data() {
    let mut questions: Vec<Json> =
        scenes().iter().flat_map(|s| list(&json(&s.join("questions.json"))["questions"])).collect();
    let extra = std::fs::read_to_string(root().join("../shared/data/questions/explanatory.jsonl"))
        .unwrap_or_default();
    questions.extend(extra.lines().map(|l| serde_json::from_str::<Json>(l).unwrap()));
    let mut checked = 0;
    for q in &questions {
        let text = q["question"].as_str().unwrap();
        assert_eq!(question_program(text), Ok(tokens(&q["program"])), "{text}");
        for c in list(&q["choices"]) {
            let text = c["choice"].as_str().unwrap();
            let observed = q["question_type"] == "explanatory";
            assert_eq!(choice_program(text, observed), Ok(tokens(&c["program"])), "{text}");
        }
        checked += 1;
    }
    let extra = std::fs::read_to_string(root().join("../shared/data/questions/counterfactual.jsonl"))
        .unwrap_or_default();
    for line in extra.lines() {
        let q: Json = serde_json::from_str(line).unwrap();
        let text = q["question"].as_str().unwrap();
        let program = question_program(text).unwrap();
        assert_eq!(program.last().map(String::as_str) == Some("negate"), text.contains(" not "), "{text}");
        let mut fitting = list(&q["objects"]);
        for pair in program.windows(2) {
            let kind = pair[1].trim_start_matches("filter_");
            fitting.retain(|o| o.get(kind).is_none_or(|word| word == pair[0].as_str()));
        }
        assert_eq!(fitting.iter().map(|o| &o["id"]).collect::<Vec<_>>(), [&q["removed"][0]], "{text}");
        checked += 1;
    }
    println!("{checked} questions");
}

#[test]
fn english_is_lenient_but_never_guesses() {
    let same = |a: &str, b: &str| assert_eq!(question_program(a).unwrap(), question_program(b).unwrap());
    same(
        "WHAT WILL HAPPEN without the grey metallic ball",
        "What will happen without the gray metal sphere?",
    );
    same(
        "If the red block were much heavier, what would happen?",
        "What would happen if the red cube were heavier?",
    );
    same("Does the grey cube hit the ball?", "do the gray box collide with the sphere");
    for bad in [
        "what will happen if the red is removed and added?",
        "what will happen if the red cube is -2 times as heavy?",
        "why?",
        "how many red red cubes are there",
        "the",
        "Did the red cube not hit the ball?",
        "Did the red cube or the blue cube hit the ball?",
        "Will the red cube hit the ball twice?",
        "Did the red cube hit the ball first?",
        "Is the ball moving to the left?",
        "How fast is the ball?",
        "speed of the cube and the ball at the end",
        "Does the red cube hit the red cube?",
    ] {
        assert!(matches!(question_program(bad), Err(ReasonError::NotUnderstood { .. })), "{bad}");
    }
}

#[test]
fn changes_beyond_the_paper_have_programs() {
    let blue = "objects blue filter_color unique";
    let check = |text: &str, program: &str| {
        assert_eq!(question_program(text).unwrap().join(" "), program.replace("BLUE", blue), "{text}");
    };
    check(
        "What will happen if the blue object is 1.5 times as fast?",
        "all_events BLUE 1.5 scale_velocity filter_counterfact belong_to",
    );
    check(
        "What would not happen if the blue object were moving the other way?",
        "all_events BLUE reverse filter_counterfact belong_to negate",
    );
    check(
        "What will happen if the blue one is 25 cm to the right and the blue one is removed?",
        "all_events BLUE 0.25 right shift BLUE both filter_counterfact belong_to",
    );
    check(
        "What would happen if there were another red cube 30 cm to the left of the blue object?",
        "all_events objects red filter_color cube filter_shape BLUE 0.3 left add_another filter_counterfact belong_to",
    );
    check(
        "Would the blue ball hit the left side of the table if the blue object were at rest?",
        "BLUE at_rest filter_counterfact objects blue filter_color sphere filter_shape unique left filter_side exist",
    );
    check(
        "How many collisions would there be without the blue object?",
        "BLUE filter_counterfact objects filter_collision count",
    );
    check(
        "What color is the first cube to hit the blue object?",
        "events BLUE objects cube filter_shape filter_partner first filter_order BLUE query_collision_partner \
         query_color",
    );
}

#[test]
fn a_refusal_names_the_part_and_suggests_what_is_understood() {
    let scene = observed(&root().join("tests/data/clevrer/scene_00000"));
    let conversation = Conversation::default();
    for (text, part, near) in [
        ("What will happen without the frog?", "frog", "without"),
        ("How many cubes are moving when the frog enters?", "frog", "moving"),
        ("What will happen next week?", "week", "next"),
        ("What is the speed of the cube at tea time?", "tea", "speed"),
        ("How bright is the brown sphere?", "bright", "brown sphere"),
    ] {
        let Err(ReasonError::NotUnderstood { part: refused, nearest }) =
            read_question(text, of_scene(&scene), &conversation)
        else {
            panic!("{text}")
        };
        assert!(refused.contains(part) && nearest.contains(near), "{text}: {refused}; {nearest}");
        let again = read_question(&nearest, of_scene(&scene), &conversation).unwrap();
        // What is suggested is about objects of this scene.
        assert!(
            dry_run(
                Some(&scene),
                &Question::Program { program: again.program, choices: vec![] },
                &conversation,
                &[]
            )
            .is_ok()
        );
    }
}

#[test]
fn every_example_is_understood() {
    for text in examples() {
        let tokens = question_program(&text).or_else(|_| choice_program(&text, false)).unwrap();
        QuestionProgram::parse(&tokens)
            .unwrap()
            .check(&mut vec![])
            .or_else(|_| {
                // What asks about choices needs one on the stack.
                QuestionProgram::parse(&tokens).unwrap().check(&mut vec![Type::Event])
            })
            .unwrap_or_else(|e| panic!("{text}: {e}"));
    }
}

#[test]
fn billiards_ask_about_the_sides_of_the_table() {
    let tokens =
        question_program("Will the yellow billiard collide with the right side of the billiard table?");
    let expected =
        "unseen_events objects yellow filter_color sphere filter_shape unique right filter_side exist";
    assert_eq!(tokens.unwrap().join(" "), expected);
}

/// The true events of one scenario.
fn true_events(scene: &Scene, truth: &Json, collisions: &Json, plain: bool) -> RolloutEvents {
    let index = |v: &Json| scene.object_index(v.as_u64().unwrap() as u32).unwrap();
    let at = |frame: &Json| frame.as_u64().unwrap() as usize;
    let mut events: Vec<SceneEvent> = list(collisions)
        .iter()
        .map(|c| {
            let mut objects: Vec<usize> = list(&c["object_ids"]).iter().map(index).collect();
            objects.sort_unstable();
            SceneEvent {
                kind: SceneEventKind::Collision,
                frame: at(&c["frame_id"]),
                time: scene.time_of(at(&c["frame_id"])),
                objects,
            }
        })
        .collect();
    if plain {
        events.extend(list(&truth["in_out"]).iter().map(|e| SceneEvent {
            kind: if e["type"] == "in" { SceneEventKind::In } else { SceneEventKind::Out },
            frame: at(&e["frame_id"]),
            time: scene.time_of(at(&e["frame_id"])),
            objects: vec![index(&e["object_id"])],
        }));
    }
    events.sort_by_key(|e| e.frame);
    let moving = scene
        .tracks
        .iter()
        .enumerate()
        .map(|(i, track)| {
            (0..scene.times.len())
                .map(|f| {
                    let s = &truth["trajectory"][f][i];
                    let speed = s[3].as_f64()?.hypot(s[4].as_f64()?);
                    track.samples.iter().any(|s| s.frame == f).then_some(speed > MOVING_SPEED)
                })
                .collect()
        })
        .collect();
    RolloutEvents { events, moving, encounters: Encounters::default() }
}

#[test]
fn true_events_give_the_true_answers() {
    let (mut right, mut asked, mut wrong) = (0, 0, vec![]);
    for folder in scenes() {
        let (scene, truth) = (observed(&folder), json(&folder.join("truth.json")));
        let mut scenarios = vec![Scenario {
            interventions: vec![],
            frames: scene.times.len() + FUTURE_FRAMES,
            rollouts: vec![true_events(&scene, &truth, &truth["collisions"], true)],
        }];
        for c in list(&truth["counterfactuals"]) {
            let id = |v: &Json| v.as_u64().unwrap() as u32;
            let change = match c["mass_factor"].as_f64() {
                None => Intervention::Remove { id: id(&c["remove"]) },
                Some(factor) => Intervention::ScaleMass { id: id(&c["object"]), factor },
            };
            scenarios.push(Scenario {
                interventions: vec![change],
                frames: scene.times.len() + FUTURE_FRAMES,
                rollouts: vec![true_events(&scene, &truth, &c["collisions"], false)],
            });
        }
        let context = RolloutContext::of_scene(&scene, &scenarios);
        for q in list(&json(&folder.join("questions.json"))["questions"]) {
            let program = QuestionProgram::parse(&tokens(&q["program"])).unwrap();
            let choices = list(&q["choices"]);
            let ok = if choices.is_empty() {
                let out: Result<_, Halt> = run(&program, context, vec![]);
                out.is_ok_and(|(s, _)| describe(&scene, s.last().unwrap()) == q["answer"].as_str().unwrap())
            } else {
                choices.iter().all(|c| {
                    let (stack, _) =
                        run(&QuestionProgram::parse(&tokens(&c["program"])).unwrap(), context, vec![])
                            .unwrap();
                    let (stack, _) = run(&program, context, stack).unwrap();
                    (stack == [ProgramValue::Bool(true)]) == (c["answer"] == "correct")
                })
            };
            asked += 1;
            right += ok as usize;
            if !ok {
                wrong.push(format!("{} {}", folder.display(), q["question"]));
            }
        }
    }
    println!("{right}/{asked} right; {wrong:#?}");
    assert!(right == asked, "{right}/{asked}: {wrong:#?}");
}

#[test]
fn a_question_is_answered_from_english_and_from_its_program() {
    let scene = observed(&root().join("tests/data/clevrer/scene_00000"));
    let start = Preset::named("clevrer").unwrap().model(&scene);
    let options = crate::fit::FitOptions { max_iterations: 2, ..Default::default() };
    let fit = crate::fit::fit(std::slice::from_ref(&scene), &[start], &options, &never).unwrap();
    let asked = |question: &str, choices: &[&str]| {
        let choices = choices.iter().map(|c| c.to_string()).collect();
        let question = Question::English { question: question.to_string(), choices };
        ask(&scene, &fit, 0, &question, &AskOptions { rollouts: 3, seed: 1 }, &never)
    };
    let pair = "The cube and the brown sphere collide";
    let answer = asked("What will happen if the cube is removed?", &[pair, pair]).unwrap();
    assert_eq!((answer.choices.len(), answer.simulations.len()), (2, 1));
    // No rollout of three has it: not certain, but unlikely.
    assert!(!answer.choices[0].correct && answer.choices[0].probability == 0.125);
    let program = Question::Program {
        program: answer.program.clone(),
        choices: vec![choice_program(pair, false).unwrap()],
    };
    let again = ask(&scene, &fit, 0, &program, &AskOptions { rollouts: 3, seed: 1 }, &never).unwrap();
    assert_eq!(again.choices[0].derivation, answer.choices[0].derivation);
    assert!(asked("What will happen next?", &[]).unwrap().answer.is_some());
    assert!(matches!(
        asked("What will happen without the red object?", &[pair]),
        Err(ReasonError::NoSuchObject { .. })
    ));
    for (text, edits) in [
        ("What would happen if the cube were 3 times as heavy?", 1),
        ("What would happen without the cube and the brown sphere?", 2),
        // The friction of the ground, not that between objects.
        ("What would happen if there were no friction?", 1),
        ("What would happen if the cube moved twice as fast?", 1),
        ("If the cube did not move and the brown sphere were half as heavy, what would happen?", 2),
        ("What would happen if the cube were 25 cm further left?", 1),
        ("What would happen if the cube were 1.5 times as bouncy?", 1),
        ("What would happen if there were another cube 2 m to the right of the brown sphere?", 1),
    ] {
        let answer = asked(text, &[pair]).unwrap();
        assert_eq!(answer.simulations[0].interventions.len(), edits, "{text}");
    }
    let ambiguous = asked("What will happen without the cyan object?", &[pair]);
    assert!(
        matches!(ambiguous, Err(ReasonError::AmbiguousObject { candidates, .. }) if candidates.len() == 2)
    );
    // What never happened has no before, no after and no causes.
    for question in [
        "How many objects enter the scene after the collision between the cube and the brown sphere?",
        "How many collisions happen before the brown sphere exits the scene?",
        "What is responsible for the collision between the cube and the brown sphere?",
    ] {
        let refused = asked(question, &[]);
        assert!(matches!(refused, Err(ReasonError::NoSingleEvent { .. })), "{question}: {refused:?}");
    }
    // The list of what no longer happens.
    assert!(asked("What will not happen without the cube?", &[]).unwrap().answer.is_some());
    assert!(asked("What will not happen next?", &[]).is_err());
}

#[test]
fn an_unsure_answer_says_what_the_video_leaves_open() {
    let scene = observed(&root().join("tests/data/clevrer/scene_00000"));
    let estimate = |identified| Estimate {
        scene: Some(0),
        name: String::new(),
        value: 1.0,
        sd: 1.0,
        unit: "1".to_string(),
        identified,
    };
    let object = |i: usize, mass, restitution| ObjectEstimate {
        id: scene.objects[i].id,
        mass: estimate(mass),
        restitution: estimate(restitution),
    };
    let said = doubt(&scene, [object(0, true, true), object(2, false, true)].iter());
    let expected = "the video does not determine the mass of the brown metal sphere.";
    assert!(said.ends_with(expected), "{said}");
    assert!(doubt(&scene, [object(0, true, true)].iter()).contains("noise"));
}

#[test]
fn a_pair_of_clevrer_collides_once_and_a_ball_meets_a_side_again() {
    let mut scene = observed(&root().join("tests/data/clevrer/scene_00000"));
    let ids: Vec<u32> = scene.objects.iter().map(|o| o.id).collect();
    let hit = |time, objects: &[u32], wall: Option<&str>| Event {
        kind: EventKind::Collision,
        time,
        objects: objects.to_vec(),
        position: crate::num::vec2(0.0, 0.0),
        normal: None,
        impulse: None,
        wall: wall.map(str::to_string),
    };
    let simulated = |scene: &Scene| {
        let request = PredictionRequest { interventions: vec![], frames: 2, rollouts: 0, seed: 0 };
        let start = Preset::named("clevrer").unwrap().model(scene);
        let options = crate::fit::FitOptions { max_iterations: 1, ..Default::default() };
        let fit = crate::fit::fit(std::slice::from_ref(scene), &[start], &options, &never).unwrap();
        predict(scene, &fit, 0, &request, &never).unwrap()
    };
    let mut prediction = simulated(&scene);
    let side = Some("left");
    prediction.best.events = vec![
        hit(0.5, &[ids[0], ids[1]], None),
        hit(1.0, &[ids[2]], side),
        hit(1.5, &[ids[1], ids[0]], None),
        hit(2.0, &[ids[2]], side),
    ];
    let count = |scene: &Scene, kind| {
        let events = &scenario(scene, &prediction, 0.0).rollouts[0].events;
        events.iter().filter(|e| e.kind == kind).count()
    };
    assert_eq!(
        (count(&scene, SceneEventKind::Collision), count(&scene, SceneEventKind::Side("left"))),
        (1, 2)
    );
    scene.world = WorldKind::Billiards;
    assert_eq!(count(&scene, SceneEventKind::Collision), 2);
}

fn fitted(scene: &Scene) -> crate::fit::Fit {
    let start = Preset::for_world(scene.world).model(scene);
    crate::fit::fit(std::slice::from_ref(scene), &[start], &Default::default(), &never).unwrap()
}

fn one_object(world: WorldKind, shape: Shape, at: impl Fn(f64) -> Vec2) -> Scene {
    let sample = |frame: usize| {
        let shake = vec2((37.0 * frame as f64).sin(), (53.0 * frame as f64).cos()).scaled(1e-3);
        Sample { frame, position: at(frame as f64 / 25.0) + shake, yaw: None, covariance: None }
    };
    Scene {
        name: "one".into(),
        setup: None,
        world,
        fps: 25.0,
        times: (0..60).map(|f| f as f64 / 25.0).collect(),
        camera: None,
        table: Some(Table { x: [-1.0, 9.0], y: [-1.0, 9.0] }),
        noise_sigma: None,
        objects: vec![Object {
            id: 4,
            color: "red".into(),
            material: "x".into(),
            shape,
            mass: Some(1.0),
            features: vec![],
        }],
        tracks: vec![Track { samples: (0..60).map(sample).collect() }],
        outliers: vec![],
        findings: vec![],
        feature_layout: None,
        absent: vec![],
    }
}

#[test]
fn a_prediction_starts_from_the_end_of_the_video_where_the_model_is_wrong() {
    // Nothing in the preset speeds an object up across its way.
    let at = |t: f64| vec2(0.8 * t, 0.15 * t * t);
    let scene = one_object(WorldKind::Table, Shape::Disc { radius: 0.1 }, at);
    let fit = fitted(&scene);
    assert!(!fit.scenes[0].adequate);
    let request = PredictionRequest { interventions: vec![], frames: 80, rollouts: 8, seed: 0 };
    let prediction = predict(&scene, &fit, 0, &request, &never).unwrap();
    let plain = trace(&fit.scenes[0].model, &prediction.best.times);
    for (a, b) in plain.states.iter().zip(&prediction.best.states).take(60) {
        let (a, b) = (a[0].unwrap(), b[0].unwrap());
        let off = (a.position - b.position).norm() + (a.velocity - b.velocity).norm();
        assert!(off < 1e-9, "the video itself stays as it was fitted: {off}");
    }
    let off = |t: &Trace| (t.states[79][0].unwrap().position - at(79.0 / 25.0)).norm();
    assert!(off(&prediction.best) < 0.5 * off(&plain), "{} {}", off(&prediction.best), off(&plain));
    assert_eq!(trace(&prediction.model, &prediction.best.times).states, prediction.best.states);
}

#[test]
fn what_a_change_does_not_reach_moves_as_observed() {
    let scene = observed(&root().join("tests/data/clevrer/scene_00022"));
    let fit = fitted(&scene);
    let run = |interventions| {
        let request = PredictionRequest { interventions, frames: scene.times.len(), rollouts: 2, seed: 0 };
        predict(&scene, &fit, 0, &request, &never).unwrap()
    };
    let factual = run(vec![]);
    assert!(factual.unreached.is_empty());
    let (mut kept, mut reached) = (0, 0);
    for id in scene.objects.iter().map(|o| o.id) {
        let prediction = run(vec![Intervention::Remove { id }]);
        for other in prediction.best.ids.iter().filter(|other| **other != id) {
            let path = |t: &Trace| {
                let body = t.ids.iter().position(|i| i == other).unwrap();
                t.states.iter().map(|row| row[body].map(|s| s.position)).collect::<Vec<_>>()
            };
            let (before, after) = (path(&factual.best), path(&prediction.best));
            let far =
                before.iter().zip(&after).any(|(a, b)| a.zip(*b).is_some_and(|(a, b)| (a - b).norm() > 1e-5));
            let unreached = prediction.unreached.contains(other);
            assert!(!(far && unreached), "{other} moves otherwise without {id}");
            (kept, reached) = (kept + usize::from(unreached), reached + usize::from(far));
        }
    }
    assert!(kept > 0 && reached > 0, "{kept} {reached}");
}

#[test]
fn a_simulation_that_ends_early_says_so() {
    let scene = one_object(WorldKind::Billiards, Shape::Ball { radius: 0.03 }, |_| vec2(0.0, 0.0));
    let mut fit = fitted(&scene);
    let model = &mut fit.scenes[0].model;
    model.effects.retain(|e| e.name == "cushion");
    for p in &mut model.effects[0].parameters {
        p.values = vec![if p.name == "restitution" { 1.0 } else { 0.0 }];
    }
    model.walls[0].from = vec2(-0.1, -5.0);
    model.walls[0].to = vec2(-0.1, 5.0);
    model.walls[1].from = vec2(0.1, -5.0);
    model.walls[1].to = vec2(0.1, 5.0);
    let velocity = vec2(5000.0, 0.0);
    let request = PredictionRequest {
        interventions: vec![Intervention::SetVelocity { id: 4, velocity }],
        frames: 200,
        rollouts: 0,
        seed: 0,
    };
    let prediction = predict(&scene, &fit, 0, &request, &never).unwrap();
    let cut = prediction.cut_short.unwrap();
    assert_eq!((cut.rollouts, cut.why), (1, Ending::EventLimit));
    let frame = cut.frame.unwrap();
    assert!(prediction.best.states[frame][0].is_none() && prediction.best.states[frame - 1][0].is_some());
    assert!(cut.why.to_string().contains("fewer frames"));
}

/// One word of a text replaced.
fn replaced(text: &str, changes: &[(&str, &str)]) -> String {
    let words = text.split(' ').map(|word| {
        let bare = word.trim_end_matches(['?', ',', '.']);
        let found = changes.iter().find(|(from, _)| *from == bare).map(|(_, to)| *to);
        format!("{}{}", found.unwrap_or(bare), &word[bare.len()..])
    });
    words.collect::<Vec<_>>().join(" ")
}

/// The text with two letters of its n-th long word exchanged, or one left out.
fn misspelt(text: &str, n: usize) -> String {
    let long = text.split(' ').filter(|w| w.chars().filter(|c| c.is_alphabetic()).count() > 5).count();
    let (mut at, mut out) = (0, vec![]);
    for word in text.split(' ') {
        let mut letters: Vec<char> = word.chars().collect();
        if letters.iter().filter(|c| c.is_alphabetic()).count() > 5 {
            if at == n % long.max(1) {
                match n % 2 {
                    0 => letters.swap(2, 3),
                    _ => drop(letters.remove(3)),
                }
            }
            at += 1;
        }
        out.push(letters.into_iter().collect::<String>());
    }
    out.join(" ")
}

/// Light rewordings of a question.
fn rewordings(text: &str, n: usize) -> Vec<String> {
    let lower = text.to_lowercase();
    let synonyms = [
        ("cube", "block"),
        ("sphere", "ball"),
        ("cylinder", "disc"),
        ("spheres", "balls"),
        ("gray", "grey"),
        ("metal", "metallic"),
        ("color", "colour"),
        ("enters", "comes into"),
        ("enter", "come into"),
        ("exits", "leaves"),
        ("exit", "leave"),
        ("collides", "crashes"),
        ("collide", "bump"),
        ("collisions", "crashes"),
        ("object", "thing"),
        ("objects", "things"),
        ("removed", "taken away"),
        ("happen", "occur"),
        ("video", "clip"),
    ];
    let past = [
        ("is", "was"),
        ("are", "were"),
        ("enters", "entered"),
        ("exits", "exited"),
        ("collides", "collided"),
        ("begins", "began"),
        ("ends", "ended"),
        ("do", "did"),
    ];
    vec![
        format!("Please tell me: {lower}"),
        format!("Could you tell me {}, please?", lower.trim_end_matches('?')),
        format!("hey, {}", lower.trim_end_matches('?')),
        replaced(&lower, &synonyms),
        replaced(&lower, &past),
        replaced(&lower, &[("the", "a")]),
        replaced(&lower, &[("the", "that")]),
        lower.replace(" the ", " "),
        misspelt(&lower, n),
        misspelt(&replaced(&lower, &synonyms), n + 1),
    ]
}

#[test]
fn light_rewording_changes_no_program() {
    let questions: Vec<Json> =
        scenes().iter().flat_map(|s| list(&json(&s.join("questions.json"))["questions"])).collect();
    let (mut same, mut other, mut asked, mut refused) = (0, vec![], 0, vec![]);
    // A fifth of the questions has every kind.
    for (n, q) in questions.iter().enumerate().step_by(5) {
        let text = q["question"].as_str().unwrap();
        let program = question_program(text).unwrap();
        for reworded in rewordings(text, n) {
            asked += 1;
            match question_program(&reworded) {
                Ok(found) if found == program => same += 1,
                Ok(found) => other.push(format!("{reworded}: {}", found.join(" "))),
                Err(_) => refused.push(reworded),
            }
        }
    }
    println!(
        "{same} of {asked} the same; refused: {:#?}",
        refused.iter().step_by(9).take(20).collect::<Vec<_>>()
    );
    assert!(other.is_empty(), "{} differ: {:#?}", other.len(), other.iter().take(30).collect::<Vec<_>>());
    assert!(same as f64 >= 0.95 * asked as f64, "{same} of {asked}");
}

fn event(kind: SceneEventKind, time: f64, objects: &[usize]) -> SceneEvent {
    SceneEvent { kind, frame: (25.0 * time) as usize, time, objects: objects.to_vec() }
}

#[test]
fn a_hit_in_the_same_frame_is_a_cause_of_the_next_one() {
    let (first, second) =
        (event(SceneEventKind::Collision, 1.802, &[0, 1]), event(SceneEventKind::Collision, 1.830, &[1, 2]));
    assert_eq!(first.frame, second.frame);
    let events = [first.clone(), second.clone()];
    assert_eq!(ops::ancestors(&events, &second), std::slice::from_ref(&first));
    assert_eq!(ops::filter_time(&events, Some(&second), false), std::slice::from_ref(&first));
    assert_eq!(ops::order(&events, usize::MAX), Some(second));
    // An entrance is known to the frame only: it is neither before nor after.
    let enters = event(SceneEventKind::In, 1.80, &[1]);
    assert!(!enters.is_before(&first) && !first.is_before(&enters));
}

#[test]
fn a_group_of_effects_has_one_meaning() {
    let names = ["sliding_friction", "rolling_resistance", "contact_friction", "damping", "restitution"];
    let effects = names.map(str::to_string);
    let off = |law: &str| -> Vec<String> {
        let name = |i: Intervention| match i {
            Intervention::SwitchEffect { name, on: false } => name,
            other => panic!("{other:?}"),
        };
        ops::switch_off(&effects, law).unwrap().into_iter().map(name).collect()
    };
    assert_eq!(off("friction"), ["sliding_friction", "rolling_resistance"]);
    assert_eq!(off("object_friction"), ["contact_friction"]);
    assert_eq!(off("drag"), ["damping"]);
}

#[test]
fn an_event_counts_whatever_its_frame() {
    let scene = observed(&root().join("tests/data/clevrer/scene_00000"));
    let hit = |time: f64| event(SceneEventKind::Collision, time, &[0, 1]);
    let times = [1.78, 1.80, 1.82, 1.85, 1.90];
    let single: Vec<ProgramValue> = times.iter().map(|t| ProgramValue::Event(hit(*t))).collect();
    let lists: Vec<ProgramValue> = times.iter().map(|t| ProgramValue::Events(vec![hit(*t)])).collect();
    for values in [single, lists] {
        let (text, probability) = summary(&scene, &values, true);
        assert!(text.contains("frame 45"), "{text}");
        assert!((probability - 5.5 / 6.0).abs() < 1e-12, "{probability}");
    }
}

#[test]
fn no_number_of_rollouts_proves_that_something_is_certain() {
    assert!((estimated_probability(0, 32, true) - 0.5 / 33.0).abs() < 1e-12);
    assert!((estimated_probability(32, 32, true) - 32.5 / 33.0).abs() < 1e-12);
    // What is read from the scene is.
    assert!((estimated_probability(32, 32, false) - 1.0).abs() < 1e-12);
}

#[test]
fn objects_that_look_alike_have_numbers() {
    let mut scene = observed(&root().join("tests/data/clevrer/scene_00000"));
    let (first, second) = (scene.objects[0].clone(), scene.objects[1].id);
    scene.objects[1] = Object { id: second, ..first.clone() };
    let names = [ops::name(&scene, 0), ops::name(&scene, 1)];
    assert!(names[0] != names[1] && names[1].ends_with(&format!("(object {second})")), "{names:?}");
    let question = |text: String| Question::English { question: text, choices: vec![] };
    let run = |text: String| dry_run(Some(&scene), &question(text), &Conversation::default(), &[]);
    let Err(ReasonError::AmbiguousObject { candidates, .. }) =
        run(format!("Does the {} enter the scene?", first.description()))
    else {
        panic!("two look alike")
    };
    assert_eq!(candidates, names);
    let read = run(format!("Does {} enter the scene?", names[1])).unwrap();
    assert_eq!(read.program.join(" "), format!("events {second} object_number filter_in exist"));
}

#[test]
fn a_stranger_of_a_collision_has_no_partner_in_it() {
    let hit = event(SceneEventKind::Collision, 1.0, &[0, 1]);
    assert_eq!(ops::partner(&hit, 0), Ok(1));
    assert!(matches!(ops::partner(&hit, 2), Err(ReasonError::NoSingleEvent { .. })));
}

fn checked(program: &str) -> Result<Vec<Type>, ReasonError> {
    let tokens: Vec<String> = program.split(' ').map(str::to_string).collect();
    let mut stack = vec![];
    QuestionProgram::parse(&tokens)?.check(&mut stack)?;
    Ok(stack)
}

#[test]
fn changes_chain_and_repeat() {
    let red = "objects red filter_color unique";
    for program in [
        format!("{red} apply_heavier apply_heavier filter_counterfact"),
        format!("{red} apply_heavier {red} apply_lighter filter_counterfact"),
        format!("all_events {red} remove {red} remove counterfactual_simulation"),
    ] {
        assert_eq!(checked(&program), Ok(vec![Type::Events]), "{program}");
    }
    let twice = vec![Intervention::Remove { id: 1 }, Intervention::Remove { id: 1 }];
    assert_eq!(ops::joined_changes(twice), [Intervention::Remove { id: 1 }]);
    let heavier = Intervention::ScaleMass { id: 1, factor: 5.0 };
    assert_eq!(
        ops::joined_changes(vec![heavier.clone(), heavier]),
        [Intervention::ScaleMass { id: 1, factor: 25.0 }]
    );
}

#[test]
fn frames_are_numbers_in_programs() {
    for program in ["events 100 filter_before count", "events 100 at_frame filter_before count"] {
        assert_eq!(checked(program), Ok(vec![Type::Number]), "{program}");
    }
    assert_eq!(checked("3 object_number 0 speed"), Ok(vec![Type::Quantity]));
    assert_eq!(checked("objects 2.5 at_time filter_moving"), Ok(vec![Type::Objects]));
}

#[test]
fn a_question_about_the_video_simulates_no_future() {
    let scene = observed(&root().join("tests/data/clevrer/scene_00000"));
    let fit = fitted(&scene);
    let options = AskOptions { rollouts: 2, seed: 0 };
    let asked = |text: &str| {
        let question = Question::English { question: text.to_string(), choices: vec![] };
        ask(&scene, &fit, 0, &question, &options, &never).unwrap()
    };
    let past = asked("How many collisions happen?");
    assert_eq!(past.simulations[0].best.times.len(), scene.times.len());
    assert!(!past.explanation.contains("beyond"), "{}", past.explanation);
    let future = asked("What will happen next?");
    assert_eq!(future.simulations[0].best.times.len(), scene.times.len() + FUTURE_FRAMES);
    // Without choices, a program that asks about some gives the list; negated, what does not happen.
    for end in [vec!["belong_to"], vec!["belong_to", "negate"]] {
        let program = ["all_events", "objects", "cube", "filter_shape", "unique", "filter_counterfact"];
        let program = program.iter().chain(&end).map(|t| t.to_string()).collect();
        let question = Question::Program { program, choices: vec![] };
        assert!(ask(&scene, &fit, 0, &question, &options, &never).unwrap().answer.is_some());
    }
    // A quantity has its unit and its deviation.
    let fast = asked("How fast is the brown sphere at the end of the video?").answer.unwrap();
    assert!(fast.ends_with(" m/s"), "{fast}");
}

#[test]
fn what_creeps_below_the_noise_rests() {
    let scene = one_object(WorldKind::Table, Shape::Disc { radius: 0.1 }, |_| vec2(0.0, 0.0));
    let fit = fitted(&scene);
    let request = PredictionRequest { interventions: vec![], frames: 60, rollouts: 0, seed: 0 };
    let mut prediction = predict(&scene, &fit, 0, &request, &never).unwrap();
    let mut moves = |length: f64| {
        for (frame, row) in prediction.best.states.iter_mut().enumerate() {
            let t = (frame as f64 / 25.0).min(0.2);
            let state = row[0].as_mut().unwrap();
            state.position = vec2(length * t / 0.2, 0.0);
            state.velocity = vec2(if frame < 5 { length / 0.2 } else { 0.0 }, 0.0);
        }
        scenario(&scene, &prediction, 0.005).rollouts[0].moving[0].contains(&Some(true))
    };
    assert!(!moves(0.004) && moves(0.1));
}

#[test]
fn what_was_asked_before_says_what_is_meant() {
    let scene = observed(&root().join("tests/data/clevrer/scene_00000"));
    let after = |previous: &[&str], text: &str| {
        let previous = previous.iter().map(|q| q.to_string()).collect();
        let conversation = Conversation { previous, words: vec![] };
        read_question(text, of_scene(&scene), &conversation).map(|r| r.program.join(" "))
    };
    let brown = "objects brown filter_color sphere filter_shape unique";
    let next = ["What will the brown sphere hit next?"];
    assert_eq!(
        after(&next, "And when?"),
        Ok(format!("unseen_events {brown} filter_collision first filter_order get_time"))
    );
    assert_eq!(after(&next, "How fast is it at the end?"), Ok(format!("{brown} end speed")));
    let moved = "objects cyan filter_color cube filter_shape unique";
    assert_eq!(
        after(&["Does the brown sphere move?"], "And the cyan cube?"),
        Ok(format!("{moved} video moves"))
    );
    // Of two objects, "it" is asked back; of none, refused.
    let both = ["Does the brown sphere hit the cyan cube?"];
    assert!(matches!(after(&both, "Does it move?"), Err(ReasonError::AmbiguousObject { .. })));
    assert!(matches!(after(&[], "Does it move?"), Err(ReasonError::NotUnderstood { .. })));
    // A caller's own words.
    let words = vec![OwnWord { word: "rocky".into(), means: "brown sphere".into() }];
    let conversation = Conversation { previous: vec![], words };
    let read = read_question("Does Rocky move?", of_scene(&scene), &conversation).unwrap();
    assert_eq!(read.program.join(" "), format!("{brown} video moves"));
}

#[test]
fn the_table_of_operations_makes_schema_and_grammar() {
    let listed = list_operations();
    assert_eq!(listed.len(), OPERATIONS.len());
    let schema = json_schema().to_string();
    let grammar = gbnf_grammar();
    for operation in OPERATIONS {
        let quoted = format!("\"{}\"", operation.token);
        assert!(schema.contains(&quoted) && grammar.contains(&quoted), "{quoted}");
        let operands = operation.reads.matches('{').count();
        assert!(operands <= operation.takes.len(), "{quoted}: {}", operation.reads);
        let same = |o: &&Operation| o.token == operation.token || o.aliases.contains(&operation.token);
        assert_eq!(OPERATIONS.iter().filter(same).count(), 1, "{quoted} has one row");
    }
    // The names of Table 1 of the paper.
    for name in ["Counterfactual_simulation", "Predictive_simulation", "Apply_heavier", "Apply_lighter"] {
        assert!(Op::of(name).is_some(), "{name}");
    }
}

/// Words for the objects of a scene: its colors end in "ish", object 0 alone is shiny, object 1 is fast in frames 10 to 19, every
/// collision is hard, and heavy ones have 5 times the mass.
fn learned_words(scene: &Scene) -> WordProbabilities {
    let n = scene.objects.len();
    let mut words: Vec<String> = scene.objects.iter().map(|o| format!("{}ish", o.color)).collect();
    words.sort();
    words.dedup();
    let row = |o: &Object| {
        words.iter().map(|w| f64::from(u8::from(*w == format!("{}ish", o.color)))).collect::<Vec<f64>>()
    };
    let probabilities = scene.objects.iter().map(row).collect();
    let only = |of: usize| (0..n).map(|k| f64::from(u8::from(k == of))).collect::<Vec<f64>>();
    let frames = |k: usize| {
        let fast = |f: usize| k == 1 && (10..20).contains(&f);
        (0..scene.times.len()).map(|f| f64::from(u8::from(fast(f)))).collect::<Vec<f64>>()
    };
    let hard = LogisticWord {
        columns: vec![0],
        mean: vec![0.0],
        scale: vec![1.0],
        weights: vec![0.0, 100.0],
        covariance: vec![0.0; 4],
    };
    let concept = |name: &str, holds| ConceptProbabilities { name: name.into(), holds };
    WordProbabilities {
        families: vec![FamilyProbabilities {
            family: WordFamily::Color,
            words,
            probabilities,
            cosine_scores: vec![],
        }],
        concepts: vec![
            concept("shiny", ConceptTruth::Objects(only(0))),
            concept("fast", ConceptTruth::Motion { whole: only(1), frames: (0..n).map(frames).collect() }),
            concept("hard", ConceptTruth::Encounters(hard)),
        ],
        changes: vec![ChangeWord { name: "heavy".into(), quantity: ChangedQuantity::Mass, factor: 5.0 }],
    }
}

#[test]
fn words_of_a_lexicon_select_objects_and_collisions_and_stand_for_changes() {
    let scene = observed(&root().join("tests/data/clevrer/scene_00000"));
    let (fit, words) = (fitted(&scene), learned_words(&scene));
    let options = AskOptions { rollouts: 3, seed: 1 };
    let program = |text: &str| Question::Program {
        program: text.split(' ').map(str::to_string).collect(),
        choices: vec![],
    };
    let worded = WordedScene { scene: &scene, words: &words };
    let asked = |text: &str| ask_with_words(worded, &fit, 0, &program(text), &options, &never);
    let said = |text: &str| asked(text).unwrap_or_else(|e| panic!("{text}: {e}")).answer.unwrap();
    let (color, n) = (&scene.objects[0].color, scene.objects.len().to_string());
    let alike = scene.objects.iter().filter(|o| o.color == *color).count().to_string();
    assert_eq!(said("objects shiny filter_concept count"), "1");
    assert_eq!(said(&format!("objects {color}ish filter_color count")), alike);
    assert_eq!(said(&format!("objects {color}ish filter_concept count")), alike);
    assert_eq!(said("objects shiny filter_concept unique query_color"), format!("{color}ish"));
    for (moment, count) in [("", "1"), ("15 ", "1"), ("0.6 at_time ", "1"), ("30 ", "0"), ("start ", "0")] {
        assert_eq!(said(&format!("objects fast {moment}filter_concept count")), count, "{moment}");
    }
    let collisions = said("events objects filter_collision count");
    assert_eq!(said("events objects filter_collision hard filter_concept count"), collisions);
    // Draws of words are no proof either; with simulations, theirs is the number.
    let [still, moving] = ["objects count", "events objects filter_in count"].map(|t| asked(t).unwrap());
    assert_eq!((still.answer, still.probability), (Some(n), 48.5 / 49.0));
    assert_eq!(moving.probability, 3.5 / 4.0);
    // The word for a change is that change, also beside another one.
    let changed = |change: &str| {
        let text = format!("objects shiny filter_concept unique {change} filter_counterfact");
        let answer = asked(&text).unwrap();
        (answer.answer, answer.simulations.iter().map(|s| s.interventions.clone()).collect::<Vec<_>>())
    };
    assert_eq!(changed("heavy apply"), changed("5 scale_mass"));
    assert_eq!(changed("at_rest heavy apply"), changed("at_rest 5 scale_mass"));
    // Words that it lacks, and none without it.
    let unknown = asked(&format!("objects {color} filter_color count"));
    assert!(
        matches!(unknown, Err(ReasonError::UnknownWord { known, .. }) if known == words.families[0].words)
    );
    assert!(matches!(
        asked("objects shiny filter_concept unique fast apply"),
        Err(ReasonError::UnknownWord { .. })
    ));
    let bare = ask(&scene, &fit, 0, &program("objects shiny filter_concept count"), &options, &never);
    assert!(matches!(bare, Err(ReasonError::UnknownToken { .. })), "{bare:?}");
    // English has the most probable words of the scene, and the reading says them.
    let question = format!("How many {color}ish objects are there?");
    let question = Question::English { question, choices: vec![] };
    let answer = ask_with_words(worded, &fit, 0, &question, &options, &never).unwrap();
    assert_eq!(answer.answer, Some(alike));
    let in_english = |text: &str| {
        let question = Question::English { question: text.to_string(), choices: vec![] };
        ask_with_words(worded, &fit, 0, &question, &options, &never).unwrap_or_else(|e| panic!("{text}: {e}"))
    };
    assert_eq!(in_english("How many shiny objects are there?").answer.as_deref(), Some("1"));
    let hard = in_english("How many hard collisions are there?");
    assert_eq!(hard.answer, Some(collisions));
    // An answer says how probable the words that it uses are.
    let shiny = in_english("Which shape is the shiny object?").words;
    let expected: Vec<(u32, f64)> =
        scene.objects.iter().enumerate().map(|(k, o)| (o.id, f64::from(u8::from(k == 0)))).collect();
    assert_eq!(shiny.iter().map(|w| (w.object_id, w.probability)).collect::<Vec<_>>(), expected);
    assert!(shiny.iter().all(|w| w.word == "shiny") && hard.words.is_empty());
    assert_eq!(
        asked("objects fast 30 filter_concept count").unwrap().reading,
        "number of: fast objects at 30"
    );
}

#[test]
fn words_of_a_lexicon_have_a_type_of_their_own() {
    let words = ["shiny".to_string(), "unique".to_string(), "red".to_string()];
    let checked = |text: &str| {
        let tokens: Vec<String> = text.split(' ').map(str::to_string).collect();
        let mut stack = vec![];
        QuestionProgram::parse_with(&tokens, &words).and_then(|p| p.check(&mut stack)).map(|()| stack)
    };
    assert_eq!(checked("objects shiny filter_concept"), Ok(vec![Type::Objects]));
    assert_eq!(checked("events shiny filter_concept"), Ok(vec![Type::Events]));
    assert_eq!(checked("objects shiny null filter_concept unique"), Ok(vec![Type::Object]));
    assert_eq!(checked("objects shiny filter_shape unique shiny apply"), Ok(vec![Type::Change]));
    // Operations and words of the vocabulary go before those of the lexicon.
    assert_eq!(checked("objects unique"), Ok(vec![Type::Object]));
    assert_eq!(checked("red"), Ok(vec![Type::Color]));
    assert!(matches!(checked("objects 3 filter_concept"), Err(ReasonError::ProgramType { .. })));
    assert!(matches!(checked("shiny filter_moving"), Err(ReasonError::ProgramType { .. })));
}

/// The spellings of the table, inflected and misspelled: "pleases" once corrected itself without end.
fn spellings_of_table() -> Vec<String> {
    let table = include_str!("reader/words.txt");
    let words: std::collections::BTreeSet<&str> = table.split(|c: char| !c.is_alphanumeric()).collect();
    let ends = ["", "s", "es", "ed", "ing", "x"];
    words.into_iter().flat_map(|word| ends.map(|end| format!("{word}{end}"))).collect()
}

#[test]
fn any_spelling_is_read_or_refused() {
    let lexicon = [LexiconWord { word: "Shiny".into(), of: WordUse::Objects }];
    let about = ReadingContext { scene: None, lexicon: &lexicon };
    for word in spellings_of_table().iter().map(String::as_str).chain(["shiny", "Shinyy"]) {
        let text = format!("How many {word} cubes are there?");
        let _ = read_question(&text, about, &Conversation::default());
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(32))]

    /// A text may have 2,000 bytes.
    #[test]
    fn any_text_is_read_or_refused(words in prop::collection::vec(prop::sample::select(spellings_of_table()), 0..300)) {
        let text: String = words.join(" ").chars().take(2000).collect();
        let _ = read_question(&text, ReadingContext::default(), &Conversation::default());
        let _ = read_choice(&text, true, ReadingContext::default(), &Conversation::default());
    }
}

#[test]
fn a_moment_beyond_all_frames_has_no_answer() {
    let scene = one_object(WorldKind::Table, Shape::Disc { radius: 0.2 }, |t| vec2(0.5 * t, 0.0));
    let fit = fitted(&scene);
    let options = AskOptions { rollouts: 2, seed: 1 };
    for text in ["How fast is object 4 at 1e300 s?", "How fast is object 4 in frame 99999999999999999999999?"]
    {
        let question = Question::English { question: text.to_string(), choices: vec![] };
        let answer = ask(&scene, &fit, 0, &question, &options, &never).unwrap().answer.unwrap();
        assert!(answer.contains("beyond the simulation") && answer.len() < 100, "{text}: {answer}");
    }
}

/// What a word means is not replaced again: each of these stood for two of the next.
#[test]
fn own_words_are_replaced_once() {
    let next = |k: usize| format!("qa{}", (b'a' + k as u8) as char);
    let own = |k: usize| OwnWord { word: next(k), means: format!("{0} {0}", next(k + 1)) };
    let doubling = Conversation { words: (0..20).map(own).collect(), ..Conversation::default() };
    assert!(read_question("qaa", ReadingContext::default(), &doubling).is_err());
    let longer = |word: &str, means: &str| OwnWord { word: word.into(), means: means.repeat(50) };
    let long = Conversation { words: vec![longer("q", "w "), longer("w", "z ")], ..Conversation::default() };
    assert!(read_question(&"q ".repeat(1000), ReadingContext::default(), &long).is_err());
    let target = OwnWord { word: "target".into(), means: "blue cube".into() };
    let known = Conversation { words: vec![target], ..Conversation::default() };
    let read = read_question("Is the target moving?", ReadingContext::default(), &known).expect("read");
    assert_eq!(read.program, question_program("Is the blue cube moving?").expect("read"));
}

#[test]
fn words_that_questions_need_are_no_names_for_words_of_a_lexicon() {
    for name in ["heavier", "fast", "spinning", "shiny", "red", "glancing", "near-miss", "nearly touches"] {
        assert!(can_be_learned(name), "{name}");
    }
    for name in
        ["the", "is", "removed", "object", "collision", "is removed", "seconds", "twice", "half", "!", ""]
    {
        assert!(!can_be_learned(name), "{name}");
    }
}

#[test]
fn words_that_look_like_others_or_begin_phrases_leave_questions_as_they_are() {
    let word = |word: &str| LexiconWord { word: word.into(), of: WordUse::Objects };
    let others = ["doe", "ha", "going", "run", "tell", "most"].map(word);
    let about = ReadingContext { scene: None, lexicon: &others };
    for text in [
        "Does the red ball hit the blue cube?",
        "Has the red ball hit the blue cube?",
        "Is the red ball going to hit the blue cube?",
        "Did the red ball run into the blue cube?",
        "Tell me, does the red ball hit the blue cube?",
        "Which object is the most massive?",
    ] {
        let read = read_question(text, about, &Conversation::default()).map(|read| read.program);
        assert_eq!(read.ok(), Some(question_program(text).expect(text)), "{text}");
    }
}

#[test]
fn english_has_the_words_of_a_lexicon() {
    let word = |word: &str, of| LexiconWord { word: word.into(), of };
    let lexicon = [
        word("shiny", WordUse::Objects),
        word("fast", WordUse::Objects),
        word("teal", WordUse::Family(WordFamily::Color)),
        word("glancing", WordUse::Encounters),
        word("nearly-touches", WordUse::Encounters),
        word("near-miss", WordUse::Encounters),
        word("slippery", WordUse::Change),
        word("heavier", WordUse::Change),
    ];
    let about = ReadingContext { scene: None, lexicon: &lexicon };
    let read = |text: &str| {
        let read = read_question(text, about, &Conversation::default());
        read.unwrap_or_else(|e| panic!("{text}: {e}"))
    };
    // As with a word of the table.
    for (text, known, own, own_program) in [
        ("Is the shiny ball moving?", "red", "shiny", "shiny filter_concept"),
        ("What shape is the teal object?", "red", "teal", "color:teal filter_color"),
        ("How many shiny objects are there?", "red", "shiny", "shiny filter_concept"),
        ("If the shiny ball is removed, what will happen?", "red", "shiny", "shiny filter_concept"),
    ] {
        let expected = question_program(&text.replace(own, known)).unwrap().join(" ");
        let expected = expected.replace("red filter_color", own_program);
        assert_eq!(read(text).program.join(" "), expected, "{text}");
    }
    let ball = "objects red filter_color sphere filter_shape unique";
    let cube = "objects blue filter_color cube filter_shape unique";
    let pass = format!("{ball} filter_approach {cube} filter_approach nearly-touches filter_concept");
    for (text, expected) in [
        ("Is the red ball fast?", format!("{ball} fast has_word")),
        ("Is the red ball not shiny?", format!("{ball} shiny has_word negate")),
        ("Is the red ball fast at the end of the video?", format!("{ball} fast end has_word")),
        (
            "Which color is the shiny fast object?",
            "objects shiny filter_concept fast filter_concept unique query_color".to_string(),
        ),
        (
            "Are there any glancing collisions?",
            "events objects filter_collision glancing filter_concept exist".to_string(),
        ),
        (
            "How many glancing collisions are there?",
            "events objects filter_collision glancing filter_concept count".to_string(),
        ),
        (
            "Is the collision between the red ball and the blue cube glancing?",
            format!("events {ball} filter_collision {cube} filter_collision glancing filter_concept exist"),
        ),
        ("Does the red ball nearly touch the blue cube?", format!("video approaches {pass} exist")),
        ("How many near misses are there?", "video approaches near-miss filter_concept count".to_string()),
        (
            "What will happen if the red ball is slippery?",
            format!("all_events {ball} slippery apply filter_counterfact belong_to"),
        ),
        (
            "If the red ball had twice the friction, would it collide with the blue cube?",
            format!(
                "{ball} 2 scale_friction filter_counterfact {ball} filter_collision {cube} filter_collision exist"
            ),
        ),
        (
            "If the blue cube were slippery, would the red ball nearly touch it?",
            format!("{cube} slippery apply suppose video approaches {pass} exist"),
        ),
        (
            "If the red ball were slippery, would it collide with the blue cube?",
            format!(
                "{ball} slippery apply filter_counterfact {ball} filter_collision {cube} filter_collision exist"
            ),
        ),
        (
            "If the red ball were heavier, would it collide with the blue cube?",
            format!(
                "{ball} heavier apply filter_counterfact {ball} filter_collision {cube} filter_collision exist"
            ),
        ),
        (
            "What will happen if the red ball is much heavier?",
            format!("all_events {ball} heavier apply filter_counterfact belong_to"),
        ),
        (
            "What will happen if the red ball is slipery?",
            format!("all_events {ball} slippery apply filter_counterfact belong_to"),
        ),
        ("How fast is the red ball at the end?", format!("{ball} end speed")),
    ] {
        let found = read(text);
        assert_eq!(found.program.join(" "), expected, "{text}");
        assert!(!found.reading.is_empty(), "{text}");
        let words = super::words::spellings(&lexicon);
        let parsed = QuestionProgram::parse_with(&found.program, &words).unwrap();
        // A question about choices finds the event of one below it.
        let mut stack = if parsed.calls(&["belong_to"]) { vec![Type::Event] } else { vec![] };
        parsed.check(&mut stack).unwrap_or_else(|e| panic!("{text}: {e}"));
    }
    // Without the lexicon they are refused.
    for text in ["Is the red ball shiny?", "Does the red ball nearly touch the blue cube?"] {
        assert!(read_question(text, ReadingContext::default(), &Conversation::default()).is_err(), "{text}");
    }
}

#[test]
fn usual_units_are_read_and_written() {
    let blue = "objects blue filter_color cube filter_shape unique";
    for (text, program) in [
        (
            "Is the blue cube faster than 3 km/h at the end?",
            format!("{blue} end speed 3 km/h of_unit greater"),
        ),
        ("Is the blue cube moving slower than 10 cm/s at 2 s?", {
            format!("10 cm/s of_unit {blue} 2 at_time speed greater")
        }),
        ("How fast is the blue cube at the end in mph?", format!("{blue} end speed mph in_unit")),
        ("How fast is the blue cube at 0.05 minutes?", format!("{blue} 3 at_time speed")),
        ("Does the blue cube move further than 2 feet?", {
            format!("{blue} video path_length 2 foot of_unit greater")
        }),
    ] {
        assert_eq!(question_program(text).map(|p| p.join(" ")), Ok(program), "{text}");
    }
    let scene = observed(&root().join("tests/data/clevrer/scene_00000"));
    let context = RolloutContext::of_scene(&scene, &[]);
    let value = |text: &str| {
        let tokens: Vec<String> = text.split(' ').map(str::to_string).collect();
        run(&QuestionProgram::parse(&tokens).unwrap(), context, vec![])
            .map(|(mut stack, _)| stack.pop().unwrap())
    };
    assert_eq!(value("36 km/h of_unit"), Ok(ProgramValue::Quantity(10.0, "m/s")));
    assert_eq!(value("36 km/h of_unit km/h in_unit"), Ok(ProgramValue::Quantity(36.0, "km/h")));
    assert_eq!(value("1 m of_unit 90 cm of_unit greater"), Ok(ProgramValue::Bool(true)));
    // Lengths are not compared with masses.
    assert!(matches!(value("1 m of_unit 1 kg of_unit greater"), Err(Halt::Undetermined(_))));
    assert!(matches!(value("1 m of_unit km/h in_unit"), Err(Halt::Undetermined(_))));
    for unit in UNITS {
        assert!((unit.of_base(unit.in_base(7.0)) - 7.0).abs() < 1e-12, "{}", unit.name);
    }
}

#[test]
fn what_the_model_lacks_comes_from_a_discovery() {
    let scene = observed(&root().join("tests/data/clevrer/scene_00000"));
    let start = Preset::named("clevrer").unwrap().model(&scene);
    let options = crate::fit::FitOptions { max_iterations: 2, ..Default::default() };
    let fit = crate::fit::fit(std::slice::from_ref(&scene), &[start], &options, &never).unwrap();
    let asked = |discovery: Option<&StoredDiscovery>| {
        let question =
            Question::English { question: "Is something missing in the model?".into(), choices: vec![] };
        let known = KnownOfScene { scene: &scene, words: None, discovery };
        let options = AskOptions { rollouts: 2, seed: 0 };
        ask_knowing(known, (&fit, 0), &question, &Conversation::default(), &options, &never).unwrap()
    };
    // Without a discovery the fit says whether, and the answer says how to learn what.
    let alone = asked(None).answer.unwrap();
    assert!(alone.starts_with("no") || alone.contains("discover"), "{alone}");
    let mut found = StoredDiscovery {
        finding: MissingPart::Effects,
        effects: vec!["quadratic_drag c = 0.120 +- 0.004 kg/m".into()],
        alternatives: vec![],
        formula: None,
        reason: "it explains what the model left".into(),
        videos: 3,
    };
    let answer = asked(Some(&found));
    let text = answer.answer.unwrap();
    assert!(text.starts_with("yes: quadratic_drag c = 0.120") && text.contains("3 videos"), "{text}");
    assert!(answer.simulations.is_empty());
    found.finding = MissingPart::Nothing;
    assert!(asked(Some(&found)).answer.unwrap().starts_with("no"));
    found.finding = MissingPart::OneOfSeveral;
    found.alternatives = vec![vec!["tilt".into(), "uniform_force".into()]];
    assert!(asked(Some(&found)).answer.unwrap().contains("tilt or uniform_force"));
    found.finding = MissingPart::Undetermined;
    assert!(asked(Some(&found)).answer.unwrap().contains("not determined"));
}

#[test]
fn an_object_that_has_not_entered_is_reported() {
    let mut scene = observed(&root().join("tests/data/clevrer/scene_00000"));
    // The sphere enters in frame 63: the clip ends before.
    scene.times.truncate(60);
    scene.tracks.iter_mut().for_each(|t| t.samples.retain(|s| s.frame < 60));
    let late = scene.tracks.iter().position(|t| t.samples.is_empty()).unwrap();
    let name = scene.objects[late].description();
    let scene = scene.validate().unwrap();
    assert_eq!((scene.absent.len(), scene.objects.len()), (1, 3));
    let fit = fitted(&scene);
    let asked = |text: String| {
        let question = Question::English { question: text, choices: vec![] };
        ask(&scene, &fit, 0, &question, &AskOptions { rollouts: 2, seed: 0 }, &never).unwrap()
    };
    let answer = asked(format!("How fast is the {name} at the end?")).answer.unwrap();
    assert!(answer.contains("no frame of the video shows") && answer.contains(&name), "{answer}");
    let next = asked("What will happen next?".into());
    assert!(next.explanation.contains("may enter later"), "{}", next.explanation);
    // What the scene is written to still has it.
    let again = parse("scene", &crate::scene::observed_json(&scene).to_string()).unwrap();
    assert_eq!(again.absent, scene.absent);
}

#[test]
fn an_object_that_is_hardly_seen_is_reported() {
    let mut scene = observed(&root().join("tests/data/clevrer/scene_00000"));
    let first = scene.tracks[3].samples[0].frame;
    scene.tracks[3].samples.truncate(2);
    assert!(first > 0);
    let fit = fitted(&scene);
    let question = Question::English { question: "How many collisions happen?".into(), choices: vec![] };
    let answer = ask(&scene, &fit, 0, &question, &AskOptions { rollouts: 2, seed: 0 }, &never).unwrap();
    assert!(answer.explanation.contains("in 2 frames only"), "{}", answer.explanation);
}
