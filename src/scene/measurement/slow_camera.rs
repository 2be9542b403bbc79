//! A camera that moves slowly: drift, sway, zoom. Objects at rest show it, as they all move by one similarity transform.
//!
//! Objects that stay within their own size are at rest if one displacement d_f and one zoom z_f a frame leave noise of all of them:
//! p_if = P_i + d_f + z_f (P_i - P). That two of them, which do not touch, move together is a proof, but of a uniform force, too: it starts
//! all objects alike, on parabolas. So d and z must be straight lines in time, which a force leaves at once, or return at least twice. One
//! object alone is at rest if the others follow it: their paths, cubic in each window, leave less where its motion is taken
//! out. A turning table turns the places of objects against each other, which d and z do not.

use super::finding::{FindingKind, TrackFinding};
use super::position_sds;
use super::sides::{is_noise, proof};
use crate::num::{Vec2, vec2};
use crate::scene::observation::{Sample, Scene};
use nalgebra::{Matrix4, Vector4};

/// Fewest frames in which all objects at rest are seen.
const FEWEST: usize = 24;
/// Largest change of scale.
const LARGEST_ZOOM: f64 = 0.2;
/// Objects at rest are farther apart than so many times the sum of their sizes: what touches may stick.
const APART: f64 = 1.1;
/// Turns of a motion that no force on bodies at rest makes within their own size.
const TURNS: usize = 2;
/// Samples of a window in which an object's own path is a cubic.
const WINDOW: usize = 24;
/// Half-widths of the parabolas that smooth the camera's motion (frames): noise of the motion is at most half of that of a position.
const SMOOTH: [usize; 4] = [40, 20, 10, 5];

/// The camera's motion in one frame.
#[derive(Clone, Copy, Default)]
struct CameraMotion {
    /// m.
    shift: Vec2,
    zoom: f64,
}

/// Takes out the slow motion that objects at rest prove, and says so.
pub fn take_out_slow_motion(scene: &mut Scene, step: f64) -> Option<TrackFinding> {
    let noises = position_sds(scene, step);
    let mut at_rest: Vec<usize> = (0..scene.tracks.len()).filter(|&k| stays(scene, k, noises[k])).collect();
    let path = loop {
        let path = Path::of(scene, &at_rest, &noises)?;
        match path.worst {
            Some(worst) => at_rest.retain(|k| *k != worst),
            None => break path,
        }
    };
    let path = path.moving(scene.times.len())?;
    let proven = match at_rest[..] {
        [one] => path.turns() && followed(scene, one, &path, &noises),
        _ => are_apart(scene, &at_rest) && path.is_no_force(),
    };
    if !proven {
        return None;
    }
    let poses = path.smooth(scene.times.len());
    let (mut squares, mut count) = (0.0, 0.0);
    for s in scene.tracks.iter_mut().flat_map(|t| &mut t.samples) {
        let pose = poses[s.frame];
        let own = path.centre + (s.position - path.centre - pose.shift).scaled(1.0 / (1.0 + pose.zoom));
        (squares, count) = (squares + (own - s.position).norm_squared(), count + 1.0);
        s.position = own;
    }
    let objects = at_rest.iter().map(|k| scene.objects[*k].id).collect();
    let value = (squares / f64::max(count, 1.0)).sqrt();
    Some(TrackFinding { kind: FindingKind::DriftingCamera, objects, frames: vec![], value })
}

/// Whether an object stays within its own size for the whole video.
fn stays(scene: &Scene, track: usize, noise: f64) -> bool {
    let samples = &scene.tracks[track].samples;
    let size = scene.objects[track].shape.inscribed_radius() + 4.0 * noise;
    samples.len() >= FEWEST && {
        let mean = mean(samples.iter().map(|s| s.position));
        samples.iter().all(|s| (s.position - mean).norm() < size)
    }
}

fn mean(all: impl Iterator<Item = Vec2>) -> Vec2 {
    let (sum, count) = all.fold((Vec2::zero(), 0.0), |(sum, n), p| (sum + p, n + 1.0));
    sum.scaled(1.0 / f64::max(count, 1.0))
}

/// Whether any two of the objects do not touch.
fn are_apart(scene: &Scene, objects: &[usize]) -> bool {
    let place = |k: usize| mean(scene.tracks[k].samples.iter().map(|s| s.position));
    let size = |k: usize| scene.objects[k].shape.bounding_radius();
    let apart = |a: usize, b: usize| (place(a) - place(b)).norm() > APART * (size(a) + size(b));
    objects.iter().enumerate().any(|(i, a)| objects[..i].iter().any(|b| apart(*a, *b)))
}

/// The motion that objects at rest have in common.
struct Path {
    /// By frame; `None` where not all of them are seen.
    poses: Vec<Option<CameraMotion>>,
    /// Mean place of the objects (m).
    centre: Vec2,
    /// Deviations of a shift (m) and a zoom in one frame.
    noise: [f64; 2],
    /// The object that fits worst, if the motion does not leave noise.
    worst: Option<usize>,
}

impl Path {
    fn of(scene: &Scene, objects: &[usize], noises: &[f64]) -> Option<Path> {
        if objects.is_empty() {
            return None;
        }
        let places: Vec<Vec2> =
            objects.iter().map(|k| mean(scene.tracks[*k].samples.iter().map(|s| s.position))).collect();
        let weights: Vec<f64> = objects.iter().map(|k| 1.0 / (noises[*k] * noises[*k])).collect();
        let total: f64 = weights.iter().sum();
        let weighted = |p: &dyn Fn(usize) -> Vec2| {
            (0..objects.len()).fold(Vec2::zero(), |sum, i| sum + p(i).scaled(weights[i] / total))
        };
        let centre = weighted(&|i| places[i]);
        let spread: f64 = (0..objects.len()).map(|i| weights[i] * (places[i] - centre).norm_squared()).sum();
        let zooms = objects.len() > 2;
        let (mut chi_square, mut frames) = (vec![0.0; objects.len()], 0.0);
        let mut poses = vec![None; scene.times.len()];
        for (frame, pose) in poses.iter_mut().enumerate() {
            let seen: Option<Vec<Vec2>> = (0..objects.len())
                .map(|i| Some(scene.tracks[objects[i]].at(frame)?.position - places[i]))
                .collect();
            let Some(off) = seen else { continue };
            let shift = weighted(&|i| off[i]);
            let along: f64 = (0..objects.len()).map(|i| weights[i] * off[i].dot(places[i] - centre)).sum();
            let zoom = if zooms { along / spread } else { 0.0 };
            for i in 0..objects.len() {
                let left = off[i] - shift - (places[i] - centre).scaled(zoom);
                chi_square[i] += weights[i] * left.norm_squared();
            }
            frames += 1.0;
            *pose = Some(CameraMotion { shift, zoom });
        }
        if frames < FEWEST as f64 {
            return None;
        }
        let numbers = 2.0 * objects.len() as f64 - if zooms { 3.0 } else { 2.0 };
        let fits = objects.len() == 1 || is_noise(chi_square.iter().sum(), numbers * (frames - 1.0));
        let worst = (0..objects.len()).max_by(|a, b| chi_square[*a].total_cmp(&chi_square[*b]));
        Some(Path {
            poses,
            centre,
            noise: [1.0 / total.sqrt(), if zooms { 1.0 / spread.sqrt() } else { 0.0 }],
            worst: worst.filter(|_| !fits).map(|i| objects[i]),
        })
    }

    /// Three series of the frames that are known: two shifts and the zoom, in their deviations.
    fn series(&self) -> Vec<Vec<(f64, f64)>> {
        let one = |of: fn(&CameraMotion) -> f64, noise: f64| {
            let known = self.poses.iter().enumerate();
            known.filter_map(|(f, pose)| Some((f as f64, of(&pose.as_ref().copied()?) / noise))).collect()
        };
        let mut all = vec![one(|p| p.shift.x, self.noise[0]), one(|p| p.shift.y, self.noise[0])];
        if self.noise[1] > 0.0 {
            all.push(one(|p| p.zoom, self.noise[1]));
        }
        all
    }

    /// Itself, without the zoom if that is noise; `None` if all is noise.
    fn moving(mut self, frames: usize) -> Option<Path> {
        let moves = |series: &[(f64, f64)]| {
            let smooth = smoothed(series, SMOOTH[1], frames);
            let square: f64 = series.iter().map(|(f, _)| smooth[*f as usize] * smooth[*f as usize]).sum();
            let left: f64 = series.iter().map(|(_, v)| v * v).sum();
            // What is slow is far more than the part that chance gives it.
            square > proof(frames) + 0.3 * series.len() as f64 && left > series.len() as f64
        };
        let moving: Vec<bool> = self.series().iter().map(|s| moves(s)).collect();
        let largest = self.poses.iter().flatten().map(|p| p.zoom.abs()).fold(0.0, f64::max);
        if largest > LARGEST_ZOOM {
            return None;
        }
        if moving.get(2) != Some(&true) {
            self.noise[1] = 0.0;
            self.poses.iter_mut().flatten().for_each(|p| p.zoom = 0.0);
        }
        moving.contains(&true).then_some(self)
    }

    /// Whether no uniform force makes this motion of objects that do not touch: it is straight, or it turns.
    fn is_no_force(&self) -> bool {
        self.series().iter().all(|s| is_noise(left_by(s, 2), s.len() as f64)) || self.turns()
    }

    /// Whether the largest of the motions turns back and forth.
    fn turns(&self) -> bool {
        let frames = self.poses.len();
        let all = self.series();
        let size = |s: &Vec<(f64, f64)>| s.iter().map(|(_, v)| v * v).sum::<f64>();
        let Some(largest) = all.iter().max_by(|a, b| size(a).total_cmp(&size(b))) else { return false };
        let smooth = smoothed(largest, SMOOTH[3], frames);
        let (mut turns, mut extreme, mut rising) = (0, smooth[0], None);
        // A turn is a way back by six deviations of the smoothed value (0.5 of a position's).
        let far = 3.0;
        for v in smooth {
            match rising {
                Some(true) if v > extreme => extreme = v,
                Some(false) if v < extreme => extreme = v,
                _ if (v - extreme).abs() > far => {
                    turns += usize::from(rising.is_some());
                    (rising, extreme) = (Some(v > extreme), v);
                }
                _ => {}
            }
        }
        turns >= TURNS
    }

    /// The motion of each frame, smoothed.
    fn smooth(&self, frames: usize) -> Vec<CameraMotion> {
        let all: Vec<Vec<f64>> = self
            .series()
            .iter()
            .map(|series| {
                let left = |half: usize| {
                    let smooth = smoothed(series, half, frames);
                    series
                        .iter()
                        .map(|(f, v)| (v - smooth[*f as usize]) * (v - smooth[*f as usize]))
                        .sum::<f64>()
                };
                let half = SMOOTH.into_iter().find(|half| is_noise(left(*half), series.len() as f64));
                smoothed(series, half.unwrap_or(SMOOTH[3]), frames)
            })
            .collect();
        let pose = |f: usize| CameraMotion {
            shift: vec2(all[0][f], all[1][f]).scaled(self.noise[0]),
            zoom: all.get(2).map_or(0.0, |z| z[f] * self.noise[1]),
        };
        (0..frames).map(pose).collect()
    }
}

/// A series of frames and values, smoothed by parabolas over `half` frames on each side, in each frame.
fn smoothed(series: &[(f64, f64)], half: usize, frames: usize) -> Vec<f64> {
    let value = |frame: usize| {
        let at = frame as f64;
        let first = series.partition_point(|(f, _)| *f < at - half as f64);
        let end = series.partition_point(|(f, _)| *f <= at + half as f64);
        // At the ends, and in gaps, the window keeps its samples.
        let (first, end) = (first.min(series.len().saturating_sub(half)), end.max(half.min(series.len())));
        let near: Vec<(f64, f64)> =
            series[first..end].iter().map(|(f, v)| ((f - at) / half as f64, *v)).collect();
        coefficients(&near, 3).map_or(0.0, |c| c[0])
    };
    (0..frames).map(value).collect()
}

/// What a polynomial of `count` coefficients, at most four, leaves of a series.
fn left_by(series: &[(f64, f64)], count: usize) -> f64 {
    let (Some(first), Some(last)) = (series.first(), series.last()) else { return 0.0 };
    let unit = f64::max(last.0 - first.0, 1.0);
    let scaled: Vec<(f64, f64)> =
        series.iter().map(|(f, v)| (2.0 * (f - first.0) / unit - 1.0, *v)).collect();
    let Some(c) = coefficients(&scaled, count) else { return f64::INFINITY };
    let left = |(x, v): &(f64, f64)| v - (c[0] + x * (c[1] + x * (c[2] + x * c[3])));
    scaled.iter().map(|point| left(point) * left(point)).sum()
}

/// Least squares by powers 0 to `count` - 1.
fn coefficients(points: &[(f64, f64)], count: usize) -> Option<Vector4<f64>> {
    let (mut normal, mut right) = (Matrix4::zeros(), Vector4::zeros());
    for (x, v) in points {
        let row = Vector4::from_fn(|k, _| if k < count { [1.0, *x, x * x, x * x * x][k] } else { 0.0 });
        normal += row * row.transpose();
        right += row * *v;
    }
    (count..4).for_each(|k| normal[(k, k)] = 1.0);
    (0..4).for_each(|k| normal[(k, k)] *= 1.0 + 1e-12);
    Some(normal.cholesky()?.solve(&right))
}

/// Whether the other objects move as the one at rest, on top of their own motion.
fn followed(scene: &Scene, at_rest: usize, path: &Path, noises: &[f64]) -> bool {
    let poses = path.smooth(scene.times.len());
    let (mut fall, mut against) = (0.0, 0.0);
    for (track, noise) in
        scene.tracks.iter().zip(noises).enumerate().filter(|(k, _)| *k != at_rest).map(|(_, t)| t)
    {
        for window in track.samples.chunks_exact(WINDOW) {
            let left = |share: f64| -> f64 {
                let of = |axis: fn(Vec2) -> f64| {
                    let value = |s: &Sample| axis(s.position - poses[s.frame].shift.scaled(share)) / noise;
                    let from = value(&window[0]);
                    let series: Vec<(f64, f64)> =
                        window.iter().map(|s| (scene.time_of(s.frame), value(s) - from)).collect();
                    left_by(&series, 4)
                };
                of(|p| p.x) + of(|p| p.y)
            };
            let (without, with) = (left(0.0), left(1.0));
            // A window with a contact says nothing.
            if is_noise(without.min(with), 2.0 * WINDOW as f64 - 8.0) {
                fall += (without - with).max(0.0);
                against += (with - without).max(0.0);
            }
        }
    }
    fall > proof(scene.times.len()) && fall > 10.0 * against
}
