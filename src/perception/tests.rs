//! Synthetic videos: bodies of uniform colour on a shaded ground, with exact coverage of each pixel.

use super::{PerceptionOptions, View};
use crate::media::VideoFrame;
use crate::num::{Vec2, elementary, vec2};
use crate::perception::image::evidence::{Evidence, IS_BODY};
use crate::perception::image::ground::Ground;
use crate::perception::outlines::contour_fit::{COARSE, FINE, FitTarget, PosePrior};
use crate::perception::outlines::depth_order::{Owners, Silhouette};
use crate::perception::outlines::outline::{BodyForm, FORMS, Outline, Pose};
use crate::perception::outlines::viewpoint::{Viewpoint, top_camera};
use crate::scene::{CLEVRER_CAMERA, WorldKind};

const SIZE: [usize; 2] = [480, 320];
/// Subpixels along each side of a pixel.
const FINER: usize = 4;

/// A pose and its linear colour.
type Painted = (Pose, [f64; 3]);

fn ground_light(u: f64, v: f64) -> f64 {
    0.25 * (1.0 - 0.3 * elementary::powi((u - 300.0) / 480.0, 2)) * (0.75 + 0.25 * v / 320.0)
}

fn coded(light: f64) -> u8 {
    let x =
        if light <= 0.003_130_8 { 12.92 * light } else { 1.055 * elementary::powf(light, 1.0 / 2.4) - 0.055 };
    (255.0 * x).round().clamp(0.0, 255.0) as u8
}

/// A frame of bodies, the nearest on top.
fn frame(view: &Viewpoint, index: usize, bodies: &[Painted]) -> VideoFrame {
    let mut fine = view.camera;
    for row in 0..2 {
        fine.matrix[row] = fine.matrix[row].map(|x| x * FINER as f64);
    }
    let fine = Viewpoint::new(fine);
    let mut order: Vec<&Painted> = bodies.iter().collect();
    order.sort_by(|a, b| view.depth(b.0.at).total_cmp(&view.depth(a.0.at)));
    let wide = [SIZE[0] * FINER, SIZE[1] * FINER];
    let mut owner = vec![0usize; wide[0] * wide[1]];
    for (k, (pose, _)) in order.iter().enumerate() {
        for (row, a, b) in Outline::new(&fine, pose).unwrap().spans().clipped(wide) {
            owner[row * wide[0] + a..row * wide[0] + b].fill(k + 1);
        }
    }
    let mut rgb = vec![];
    for v in 0..SIZE[1] {
        for u in 0..SIZE[0] {
            let mut sum = [0.0; 3];
            for s in 0..FINER * FINER {
                let at = (v * FINER + s / FINER) * wide[0] + u * FINER + s % FINER;
                let light = match owner[at] {
                    0 => [ground_light(u as f64, v as f64); 3],
                    k => order[k - 1].1,
                };
                (0..3).for_each(|c| sum[c] += light[c] / (FINER * FINER) as f64);
            }
            rgb.extend(sum.map(coded));
        }
    }
    VideoFrame { index, time: 0.04 * index as f64, size: SIZE, rgb }
}

fn pose(form: BodyForm, at: Vec2, yaw: f64) -> Pose {
    Pose { form, size: 0.2, at, yaw }
}

const RED: [f64; 3] = [0.4, 0.03, 0.03];
const BLUE: [f64; 3] = [0.03, 0.08, 0.55];
const DARK: [f64; 3] = [0.06, 0.06, 0.06];

#[test]
fn resting_bodies_are_not_learned_as_ground() {
    let view = Viewpoint::new(CLEVRER_CAMERA);
    let bodies = [
        (pose(BodyForm::Cube, vec2(0.0, 0.5), 0.4), RED),
        (pose(BodyForm::Cylinder, vec2(-1.0, -0.8), 0.0), DARK),
    ];
    let frames: Vec<VideoFrame> = (0..4).map(|k| frame(&view, k, &bodies)).collect();
    let ground = Ground::fit(&frames).unwrap();
    for (k, light) in ground.ln_light.iter().enumerate() {
        let expected = elementary::ln(ground_light((k % SIZE[0]) as f64, (k / SIZE[0]) as f64) + 0.002);
        assert!(light.iter().all(|l| (f64::from(*l) - expected).abs() < 0.15), "{k} {light:?} {expected}");
    }
    let evidence = Evidence::new(&frames[0], &ground);
    let mut inside = vec![false; evidence.codes.len()];
    for (pose, _) in &bodies {
        for (row, a, b) in Silhouette::new(&view, pose).spans.clipped(SIZE) {
            inside[row * SIZE[0] + a..row * SIZE[0] + b].fill(true);
        }
    }
    let wrong = inside.iter().zip(&evidence.codes).filter(|(i, c)| **i != (**c & IS_BODY != 0)).count();
    // Pixels of edges alone may be judged otherwise.
    assert!(wrong < 400, "{wrong}");
}

#[test]
fn outlines_are_fitted_to_a_twentieth_of_a_pixel() {
    let view = Viewpoint::new(CLEVRER_CAMERA);
    for form in FORMS {
        let truth = pose(form, vec2(0.7, -0.4), 0.3);
        let frame = frame(&view, 0, &[(truth, RED)]);
        let ground = Ground::of_picture(&self::frame(&view, 0, &[]));
        let evidence = Evidence::new(&frame, &ground);
        let mut owners = Owners::none(SIZE);
        let start = Pose { at: truth.at + vec2(0.04, -0.03), yaw: 0.4, ..truth };
        owners.paint(&[Silhouette::new(&view, &start)]);
        let target = FitTarget { view: &view, frame: &frame, evidence: &evidence, owners: &owners, own: 1 };
        let prior = PosePrior { pose: start, deviations: [0.5, 0.5, 1.0, 0.0] };
        let coarse = target.fit(&prior, &start, COARSE, 5).unwrap();
        let fit = target.fit(&prior, &coarse.pose, FINE, 8).unwrap();
        let at = |p: &Pose| view.pixel([p.at.x, p.at.y, p.size]).unwrap();
        let (a, b) = (at(&fit.pose), at(&truth));
        assert!(elementary::hypot(a[0] - b[0], a[1] - b[1]) < 0.05, "{form:?} {a:?} {b:?}");
        assert!(fit.support > 0.9 && fit.rms < 0.3, "{form:?} {fit:?}");
        if form == BodyForm::Cube {
            assert!((fit.pose.yaw - truth.yaw).abs() < 0.01, "{}", fit.pose.yaw);
        }
        // The covariance is of the order of the error and positive.
        let sigma = fit.covariance[(0, 0)].sqrt();
        assert!(sigma > 1e-4 && sigma < 0.01, "{sigma}");
    }
}

/// A video of pictures, as a user may give one.
fn video(frames: &[VideoFrame]) -> crate::media::Video {
    let encode = |f: &VideoFrame| {
        let mut bytes = vec![];
        let encoder = image::codecs::png::PngEncoder::new(&mut bytes);
        image::ImageEncoder::write_image(
            encoder,
            &f.rgb,
            SIZE[0] as u32,
            SIZE[1] as u32,
            image::ExtendedColorType::Rgb8,
        )
        .unwrap();
        bytes
    };
    let times: Vec<f64> = frames.iter().map(|f| f.time).collect();
    crate::media::Video::of_pictures(frames.iter().map(encode).collect(), &times).unwrap()
}

fn options(view: View) -> PerceptionOptions {
    PerceptionOptions {
        name: "synthetic".into(),
        view,
        size: Some(0.2),
        forms: FORMS.to_vec(),
        world: WorldKind::Clevrer,
        table: None,
        background: None,
    }
}

#[test]
fn a_body_that_enters_and_one_that_rests_are_followed_past_each_other() {
    let view = Viewpoint::new(CLEVRER_CAMERA);
    let moving = |k: usize| vec2(0.6, -2.6 + 0.16 * k as f64);
    let resting = vec2(0.0, 0.3);
    let bodies =
        |k: usize| [(pose(BodyForm::Ball, moving(k), 0.0), BLUE), (pose(BodyForm::Cube, resting, 0.5), RED)];
    let frames: Vec<VideoFrame> = (0..30).map(|k| frame(&view, k, &bodies(k))).collect();
    let seen =
        super::perceive(&video(&frames), &options(View::Calibrated(CLEVRER_CAMERA)), &crate::num::never)
            .unwrap();
    let words: Vec<String> =
        seen.scene.objects.iter().map(|o| format!("{} {}", o.color, o.shape.word())).collect();
    assert_eq!(words.len(), 2, "{words:?}");
    for (object, track) in seen.scene.objects.iter().zip(&seen.scene.tracks) {
        let is_ball = object.shape.is_ball();
        assert_eq!(object.color, if is_ball { "blue" } else { "red" });
        for s in &track.samples {
            let truth = if is_ball { moving(s.frame) } else { resting };
            let [width, _] = SIZE;
            let whole = view
                .pixel([truth.x, truth.y, 0.2])
                .is_some_and(|p| p[0] > 30.0 && p[0] < width as f64 - 30.0);
            let limit = if whole { 0.01 } else { 0.05 };
            assert!(
                (s.position - truth).norm() < limit,
                "{} {} {:?} {truth:?}",
                object.color,
                s.frame,
                s.position
            );
        }
        if !is_ball {
            assert_eq!(track.samples.len(), 30);
        }
    }
    assert!(seen.report.merged > 0 && seen.report.warnings.is_empty(), "{:?}", seen.report.warnings);
}

#[test]
fn a_hand_is_reported_and_not_tracked() {
    let view = Viewpoint::new(CLEVRER_CAMERA);
    let mut frames: Vec<VideoFrame> =
        (0..16).map(|k| frame(&view, k, &[(pose(BodyForm::Cube, vec2(0.0, -0.6), 0.2), RED)])).collect();
    for (k, frame) in frames.iter_mut().enumerate() {
        // An arm from the right border with a fist: no body of the known size.
        let reach = 480 - 12 * k;
        for v in 150..185 {
            for u in reach..480 {
                let at = 3 * (v * 480 + u);
                frame.rgb[at..at + 3].copy_from_slice(&[200, 150, 120]);
            }
        }
    }
    let seen =
        super::perceive(&video(&frames), &options(View::Calibrated(CLEVRER_CAMERA)), &crate::num::never)
            .unwrap();
    assert_eq!(seen.scene.objects.len(), 1, "{:?}", seen.report.objects);
    assert!(seen.report.unexplained.iter().any(|r| r.pixels > 1000));
}

#[test]
fn the_scale_of_a_view_from_above_comes_from_the_balls() {
    let scale = 0.004;
    let view = Viewpoint::new(top_camera(scale, [480.0, 320.0]));
    let ball = |k: usize, x: f64| Pose {
        form: BodyForm::Ball,
        size: 0.03,
        at: vec2(x + 0.01 * k as f64, 0.1),
        yaw: 0.0,
    };
    let frames: Vec<VideoFrame> =
        (0..12).map(|k| frame(&view, k, &[(ball(k, -0.3), RED), (ball(0, 0.4), BLUE)])).collect();
    let seen = super::perceive(
        &video(&frames),
        &PerceptionOptions {
            size: Some(0.03),
            forms: vec![BodyForm::Ball],
            world: WorldKind::Billiards,
            ..options(View::Above { scale: None })
        },
        &crate::num::never,
    )
    .unwrap();
    assert_eq!(seen.scene.objects.len(), 2);
    let camera = seen.scene.camera.unwrap();
    assert!((1.0 / camera.matrix[0][0] / scale - 1.0).abs() < 0.02, "{:?}", camera.matrix);
}

#[test]
fn equal_videos_give_equal_bytes() {
    let view = Viewpoint::new(CLEVRER_CAMERA);
    let bodies = [(pose(BodyForm::Cylinder, vec2(0.2, 0.1), 0.0), BLUE)];
    let frames: Vec<VideoFrame> = (0..8).map(|k| frame(&view, k, &bodies)).collect();
    let text = || {
        let seen =
            super::perceive(&video(&frames), &options(View::Calibrated(CLEVRER_CAMERA)), &crate::num::never)
                .unwrap();
        crate::scene::observed_json(&seen.scene).to_string() + &serde_json::to_string(&seen.report).unwrap()
    };
    assert_eq!(text(), text());
}

/// Frames from above of a ball that moves over a ground, whose light is multiplied by `texture(u, v, frame)`.
fn textured_frames(texture: impl Fn(usize, usize, usize) -> f64) -> Vec<VideoFrame> {
    let view = Viewpoint::new(top_camera(0.004, [480.0, 320.0]));
    let ball =
        |k: usize| Pose { form: BodyForm::Ball, size: 0.06, at: vec2(-0.6 + 0.05 * k as f64, 0.1), yaw: 0.0 };
    let mut frames: Vec<VideoFrame> = (0..24).map(|k| frame(&view, k, &[(ball(k), RED)])).collect();
    for (k, frame) in frames.iter_mut().enumerate() {
        let mut inside = vec![false; SIZE[0] * SIZE[1]];
        for (row, a, b) in Silhouette::new(&view, &ball(k)).spans.clipped(SIZE) {
            inside[row * SIZE[0] + a..row * SIZE[0] + b].fill(true);
        }
        for (pixel, rgb) in frame.rgb.chunks_exact_mut(3).enumerate().filter(|(p, _)| !inside[*p]) {
            let factor = texture(pixel % SIZE[0], pixel / SIZE[0], k);
            rgb.iter_mut().for_each(|c| *c = (f64::from(*c) * factor) as u8);
        }
    }
    frames
}

fn above() -> PerceptionOptions {
    let view = View::Above { scale: Some(0.004) };
    PerceptionOptions {
        size: Some(0.06),
        forms: vec![BodyForm::Ball],
        world: WorldKind::Billiards,
        ..options(view)
    }
}

#[test]
fn a_ground_with_a_pattern_is_the_median_over_time_or_is_refused() {
    let pattern = |u: usize, v: usize| 0.4 + 0.1 * ((u / 7 * 31 + v / 5 * 17) % 7) as f64;
    let frames = textured_frames(|u, v, _| pattern(u, v));
    let seen = super::perceive(&video(&frames), &above(), &crate::num::never).unwrap();
    assert_eq!(seen.scene.objects.len(), 1, "{:?}", seen.report.objects);
    assert!(seen.report.warnings.iter().any(|w| w.contains("--background")), "{:?}", seen.report.warnings);
    let frames = textured_frames(|u, v, k| pattern(u + 5 * k, v));
    let refused = super::perceive(&video(&frames), &above(), &crate::num::never);
    assert!(matches!(refused, Err(super::PerceptionError::Pattern { .. })), "{refused:?}");
}

#[test]
fn a_title_is_no_part_of_the_scene() {
    let mut frames = textured_frames(|_, _, _| 1.0);
    for frame in &mut frames[..4] {
        frame.rgb.fill(12);
        (0..3000).for_each(|k| frame.rgb[150_000 + k] = 240);
    }
    let seen = super::perceive(&video(&frames), &above(), &crate::num::never).unwrap();
    assert_eq!(seen.scene.objects.len(), 1, "{:?}", seen.report.objects);
    assert!(seen.scene.tracks[0].samples.iter().all(|s| s.frame >= 4));
    assert!(seen.report.warnings[0].contains("another scene"), "{:?}", seen.report.warnings);
}

#[test]
fn evidence_of_a_part_is_that_of_the_whole_there() {
    let frames = textured_frames(|_, _, _| 1.0);
    let ground = Ground::fit(&frames).unwrap();
    let whole = Evidence::new(&frames[5], &ground);
    let part = Evidence::within(&frames[5], &ground, whole.exposure, [40, 30, 200, 190]);
    for k in 0..SIZE[0] * SIZE[1] {
        let inside = (40..200).contains(&(k % SIZE[0])) && (30..190).contains(&(k / SIZE[0]));
        let expected = if inside { (whole.codes[k], whole.luma[k]) } else { (0, 0.0) };
        assert_eq!((part.codes[k], part.luma[k]), expected);
    }
}
