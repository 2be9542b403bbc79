//! Tests: pictures without NaN, names that cannot inject markup, and a page that names the finding.

use super::chart::{dots, line, number, px};
use super::*;
use crate::discover::{FoundEffect, ParameterEstimate, ParameterValue, RankedEffect, Revision, Verdict};
use crate::fit::{FitOptions, fit};
use crate::media::VideoFrame;
use crate::num::{Stopped, never, vec2};
use crate::reason::{
    AskOptions, ChangeWord, ChangedQuantity, FamilyProbabilities, Question, WordFamily, WordProbabilities,
    ask,
};
use crate::scene::{Object, Sample, Shape, Track, WorldKind};
use crate::world::Preset;
use maud::Render;
use proptest::prelude::*;

const FRAMES: usize = 40;
/// A name that tries to inject a script.
const HOSTILE: &str = "</script><script>alert(1)</script>\"'&";

/// A disc that slides past a cube at rest; both have hostile names.
fn scene() -> Scene {
    let object = |id, shape| Object {
        id,
        color: HOSTILE.into(),
        material: "rubber".into(),
        shape,
        mass: None,
        features: vec![],
    };
    let track = |speed: f64, y: f64| {
        let sample = |frame| {
            let jitter = 0.004 * ((7 * frame + 3) % 5) as f64;
            let position = vec2(speed * frame as f64 / 25.0 + jitter, y - jitter);
            Sample { frame, position, yaw: Some(0.0), covariance: None }
        };
        Track { samples: (0..FRAMES).map(sample).collect() }
    };
    Scene {
        name: HOSTILE.into(),
        setup: None,
        world: WorldKind::Table,
        fps: 25.0,
        times: (0..FRAMES).map(|f| f as f64 / 25.0).collect(),
        camera: None,
        table: None,
        noise_sigma: None,
        objects: vec![object(0, Shape::Disc { radius: 0.2 }), object(1, Shape::Square { half_side: 0.2 })],
        tracks: vec![track(1.0, 0.0), track(0.0, 2.0)],
        outliers: vec![],
        findings: vec![],
        feature_layout: None,
        absent: vec![],
    }
}

fn made(verdict: Verdict, revisions: usize) -> (String, Vec<(String, String)>) {
    made_of(scene(), vec![], verdict, revisions)
}

fn made_of(
    scene: Scene,
    stills: Vec<Still>,
    verdict: Verdict,
    revisions: usize,
) -> (String, Vec<(String, String)>) {
    let scenes = [scene];
    let model = Preset::for_world(WorldKind::Table).model(&scenes[0]);
    let fitted = fit(&scenes, &[model], &FitOptions::default(), &never).unwrap();
    let revision = |k: usize| Revision {
        effect: (k > 0).then(|| HOSTILE.to_string()),
        fit: fitted.clone(),
        rmse: 0.03 / (k + 1) as f64,
        held_out_rmse: f64::NAN,
        left_out_rmse: f64::INFINITY,
        reduced_chi_square: 2.0,
        unpooled: vec![],
    };
    let number = |v: f64| ParameterValue::Number(v);
    let parameter = ParameterEstimate {
        name: HOSTILE.into(),
        unit: "1/m".into(),
        value: number(f64::NAN),
        low: number(0.0),
        high: number(1.0),
        sd: vec![0.3],
        owner: None,
    };
    let parameters = vec![parameter];
    let effect = FoundEffect {
        kind: "vortex".into(),
        effect: "vortex".into(),
        parameters,
        text: None,
        deviations: vec![],
        uncertain: false,
    };
    let ranked = RankedEffect {
        kind: HOSTILE.into(),
        effect: "x".into(),
        log_evidence: Some(f64::NAN),
        contact_log_evidence: None,
        held_out_rmse: Some(0.0),
    };
    let discovery = Discovery {
        verdict,
        effects: if revisions > 1 { vec![effect] } else { vec![] },
        ranked: vec![ranked],
        ambiguous: vec![vec![HOSTILE.into()]],
        experiment: None,
        formula: Some(HOSTILE.into()),
        smallest: vec![],
        noise_sigma: 0.0,
        revisions: (0..revisions).map(revision).collect(),
        reason: HOSTILE.into(),
    };
    let question =
        Question::English { question: "What will happen if the cube is removed?".into(), choices: vec![] };
    let answer =
        ask(&scenes[0], &fitted, 0, &question, &AskOptions { rollouts: 2, seed: 0 }, &never).unwrap();
    let model = &fitted.scenes[0].model;
    let answers = [AnsweredQuestion { question: HOSTILE, scene: &scenes[0], model, answer: &answer }];
    let words = [WordProbabilities {
        families: vec![FamilyProbabilities {
            family: WordFamily::Color,
            words: vec!["reddish".into(), HOSTILE.into()],
            probabilities: scenes[0].objects.iter().map(|_| vec![0.83, f64::NAN]).collect(),
            cosine_scores: vec![],
        }],
        concepts: vec![],
        changes: vec![ChangeWord {
            name: "slippery".into(),
            quantity: ChangedQuantity::Friction,
            factor: 0.25,
        }],
    }];
    let href = Some(HOSTILE.to_string());
    let traces = [TraceLink { name: HOSTILE.into(), href, about: HOSTILE.into() }];
    let steps: Vec<String> =
        discovery.revisions.iter().map(|r| step_words(r.effect.as_deref(), None)).collect();
    let (discovery, steps, kept) = (&discovery, &steps, None);
    let stills = &[stills];
    let data = ReportData {
        scenes: &scenes,
        stills,
        discovery,
        steps,
        kept,
        answers: &answers,
        words: &words,
        traces: &traces,
    };
    assert_eq!(report(&data, &|_| Err(Stopped)), Err(Stopped));
    report(&data, &never).unwrap()
}

#[test]
fn a_page_says_what_was_missing_and_shows_both_models() {
    let (html, pictures) = made(Verdict::EffectFound, 2);
    assert!(html.contains("<h1>Missing: vortex</h1>") && html.contains("without vortex"));
    for text in
        ["Where the first model failed", "What was missing", "How far the error fell", "class=\"off\""]
    {
        assert!(html.contains(text), "{text}");
    }
    // Two objects on three sides: before, after, and the answer without a change.
    assert_eq!(html.matches("class=\"dots thin measured\"").count(), 2 * 3);
    assert_eq!(html.matches("class=\"ghost\"").count(), 2 * 3);
    assert_eq!(html.matches("type=\"range\"").count(), 2);
    assert_eq!(html.matches("aria-label=\"83 %\"").count(), 2);
    assert!(html.contains("<th>slippery</th><td>friction</td><td>0.250</td>"));
    for name in [
        "ladder",
        "residual-time-1",
        "residual-map-2",
        "residual-acceleration-2",
        "autocorrelation",
        "cause-speed",
    ] {
        assert!(pictures.iter().any(|p| p.0 == format!("{name}.svg")), "{name}");
    }
    assert!(pictures.iter().any(|p| p.0 == "prediction-1.svg"));
    assert!(pictures.iter().any(|p| p.0 == "answer-1-counterfactual-1.svg"));
    let (html, _) = made(Verdict::Adequate, 1);
    assert!(html.contains("<h1>Nothing is missing</h1>") && !html.contains("Error before"));
    assert!(!html.contains("Largest residual"));
    // No model was fitted.
    assert!(made(Verdict::NotIdentifiable, 0).0.contains("These videos do not suffice"));
}

/// Grey frames of a camera straight above with 10 mm per pixel: the scene, and one still for each of these frames.
fn seen(frames: &[usize]) -> (Scene, Vec<Still>) {
    let size = [640, 480];
    let camera = Some(crate::perception::top_camera(0.01, [640.0, 480.0]));
    let rgb = vec![128; 3 * size[0] * size[1]];
    let still = |&index: &usize| Still::of(&VideoFrame { index, time: 0.0, size, rgb: rgb.clone() }).unwrap();
    (Scene { camera, ..scene() }, frames.iter().map(still).collect())
}

#[test]
fn frames_of_a_video_show_outlines_tracks_and_residuals() {
    let (scene, stills) = seen(&[0, 20, 39]);
    let (html, pictures) = made_of(scene.clone(), stills.clone(), Verdict::Adequate, 1);
    assert!(html.contains("What was seen") && html.contains("img-src data:"));
    assert_eq!(html.matches("<image href=\"data:image/jpeg;base64,").count(), 3);
    // Two objects in each.
    assert_eq!(html.matches("class=\"seen outline\"").count(), 2 * 3);
    assert_eq!(html.matches("class=\"seen residual only\"").count(), 2 * 3);
    assert!(html.contains("0.80 s: frame 20 with the outlines of 2 objects"));
    let (_, svg) = pictures.iter().find(|p| p.0 == "still-1-2.svg").unwrap();
    // The disc is at x = 0.8 m and something: 320 + 80 px of 640, which are shown as 480.
    let read = roxmltree::Document::parse(svg).unwrap();
    let centres: Vec<f64> = read
        .descendants()
        .filter(|n| n.attribute("class") == Some("seen centre"))
        .filter_map(|n| n.attribute("cx")?.parse().ok())
        .collect();
    let position = scene.tracks[0].samples[20].position.x;
    assert!((centres[0] - 0.75 * (320.0 + 100.0 * position)).abs() < 0.1, "{centres:?}");
    // Residuals of jitter are small, and said to be magnified.
    assert!(html.contains("times as long") && html.matches(" px</text>").count() >= 2 * 3);
    // Two models: a residual of each.
    let (html, _) = made_of(scene.clone(), stills.clone(), Verdict::EffectFound, 2);
    for class in ["before", "after"] {
        assert_eq!(html.matches(&format!("class=\"seen residual {class}\"")).count(), 2 * 3, "{class}");
    }
    // Without a model the outlines are there all the same; without a camera nothing is.
    let (html, _) = made_of(scene.clone(), stills.clone(), Verdict::NotIdentifiable, 0);
    assert!(html.matches("class=\"seen outline\"").count() == 6 && !html.contains("seen residual"));
    let (html, _) = made_of(Scene { camera: None, ..scene }, stills, Verdict::Adequate, 1);
    assert!(!html.contains("What was seen"));
}

#[test]
fn names_stay_text_and_pictures_are_whole() {
    let (html, pictures) = made(Verdict::EffectFound, 2);
    assert!(!html.contains("<script>alert") && html.contains("&lt;script&gt;alert"));
    // One script runs; the others are numbers, one for each player among them.
    assert_eq!(html.matches("<script>").count(), 1);
    assert_eq!(html.matches("class=\"motion\"").count(), 2);
    for (name, svg) in [("page".to_string(), html)].iter().chain(&pictures) {
        let drawn = svg.split("<script").next().unwrap_or_default();
        for wrong in ["NaN", "\"inf", " inf", "-inf"] {
            assert!(!drawn.contains(wrong), "{name}: {wrong}");
        }
    }
    for (name, svg) in &pictures {
        let read = roxmltree::Document::parse(svg);
        assert!(read.is_ok(), "{name}: {read:?}");
    }
}

proptest! {
    #[test]
    fn no_number_becomes_nan(x in proptest::num::f64::ANY, y in proptest::num::f64::ANY) {
        let drawn = [px(x).render().into_string(), line([Some((x, y)), None, Some((1.0, y))].into_iter()),
            dots([(x, y)].into_iter()), number(x)];
        for text in drawn {
            prop_assert!(!text.contains("NaN") && !text.contains("inf"), "{text}");
        }
    }
}
