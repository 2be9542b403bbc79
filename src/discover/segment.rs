//! Free stretches: frames in which a body moves undisturbed, as rows of the force lens, what is nobody's concern projected out.

use super::smooth_track::SmoothTrack;
use crate::num::Vec2;
use crate::scene::Scene;
use crate::world::Snapshot;
use nalgebra::DVector;
use std::ops::Range;

/// One free stretch of one body; its rows hold x, then y.
pub struct FreeSegment {
    pub scene: usize,
    pub body: usize,
    pub frames: Vec<usize>,
    /// What was measured in each of them.
    pub measured: Vec<SegmentSample>,
    pub first_row: usize,
    /// Orthonormal constant and line over the frames: place and velocity at the start are nobody's concern.
    basis: [Vec<f64>; 2],
    /// Unit vector over the rows that does not count either: the friction of a foot that nobody saw turn, as what turns
    /// brakes less.
    braked: Option<DVector<f64>>,
}

/// One sample of a stretch.
pub struct SegmentSample {
    /// Index of the body among all of the scene's instants, one after the other; `None` where its motion is not known.
    pub at: Option<usize>,
    /// m.
    pub position: Vec2,
    /// Which its place is told with (rad): how a ball turns about the vertical no trajectory follows.
    pub yaw: f64,
}

impl FreeSegment {
    /// Those of all bodies of scene `scene`, whose rows begin at `row`, which goes on.
    pub fn all(
        scene: usize,
        film: &Scene,
        paths: &[SmoothTrack],
        instants: &[Snapshot],
        row: &mut usize,
    ) -> Vec<FreeSegment> {
        let next = |next: &mut usize, instant: &Snapshot| {
            Some(std::mem::replace(next, *next + instant.bodies.len()))
        };
        let firsts: Vec<usize> = instants.iter().scan(0, next).collect();
        let mut all = vec![];
        for (body, path) in paths.iter().enumerate() {
            let turns = !film.objects[body].shape.is_ball();
            let seen = |f: usize| {
                let position = film.tracks[body].at(f)?.position;
                let bodies = &instants[f].bodies;
                let at = bodies.iter().position(|b| b.0 == body);
                let yaw = at.filter(|_| turns).map_or(0.0, |at| bodies[at].1.yaw);
                Some((f, SegmentSample { at: at.map(|at| firsts[f] + at), position, yaw }))
            };
            for range in &path.stretches {
                let (frames, measured): (Vec<usize>, Vec<SegmentSample>) =
                    range.clone().filter_map(seen).unzip();
                let basis = line_basis(film, &frames);
                let braked = unseen_turn(film, body).then(|| braked(film, path, &frames, &basis)).flatten();
                let first_row = *row;
                *row += 2 * frames.len();
                all.push(FreeSegment { scene, body, frames, measured, first_row, basis, braked });
            }
        }
        all
    }

    /// Differences (m) in deviations, what is nobody's concern projected out.
    pub fn rows(&self, differences: impl Iterator<Item = Vec2>, sigma: f64) -> DVector<f64> {
        let mut rows = bent(&self.basis, differences.map(|d| d.scaled(1.0 / sigma)));
        if let Some(braked) = &self.braked {
            rows -= braked * braked.dot(&rows);
        }
        rows
    }

    /// Its rows among all.
    pub fn span(&self) -> Range<usize> {
        self.first_row..self.first_row + 2 * self.frames.len()
    }

    pub fn degrees_of_freedom(&self) -> usize {
        (2 * self.frames.len()).saturating_sub(4 + usize::from(self.braked.is_some()))
    }
}

/// All bodies that are seen, frame by frame.
pub fn instants(scene: &Scene, paths: &[SmoothTrack]) -> Vec<Snapshot> {
    let bodies = |f: usize| {
        let seen = paths.iter().enumerate();
        seen.filter_map(|(i, p)| Some((i, (*p.motion.get(f)?)?))).collect()
    };
    scene.times.iter().enumerate().map(|(f, &time)| Snapshot { time, bodies: bodies(f) }).collect()
}

/// Double integral of a piecewise linear acceleration from rest at the first frame.
pub fn integral(scene: &Scene, frames: &[usize], mut accelerations: impl Iterator<Item = Vec2>) -> Vec<Vec2> {
    let (mut place, mut velocity) = (Vec2::zero(), Vec2::zero());
    let mut a = accelerations.next().unwrap_or_default();
    let mut all = Vec::with_capacity(frames.len());
    all.push(place);
    for (pair, b) in frames.windows(2).zip(accelerations) {
        let h = scene.times[pair[1]] - scene.times[pair[0]];
        place += velocity.scaled(h) + (a.scaled(2.0) + b).scaled(h * h / 6.0);
        velocity += (a + b).scaled(0.5 * h);
        all.push(place);
        a = b;
    }
    all
}

/// Differences as rows, x then y, constant and line projected out.
fn bent(basis: &[Vec<f64>; 2], differences: impl Iterator<Item = Vec2>) -> DVector<f64> {
    let (mut x, mut y): (Vec<f64>, Vec<f64>) = differences.map(|d| (d.x, d.y)).unzip();
    for values in [&mut x, &mut y] {
        for base in basis {
            let share: f64 = base.iter().zip(values.iter()).map(|(b, v)| b * v).sum();
            values.iter_mut().zip(base).for_each(|(v, b)| *v -= share * b);
        }
    }
    x.append(&mut y);
    DVector::from_vec(x)
}

/// Whether an object has a foot that may turn, and nobody measured how it does.
pub fn unseen_turn(scene: &Scene, object: usize) -> bool {
    !scene.objects[object].shape.is_ball() && scene.tracks[object].samples.iter().all(|s| s.yaw.is_none())
}

/// What friction of any constant size does over the frames, as a unit vector.
fn braked(
    scene: &Scene,
    path: &SmoothTrack,
    frames: &[usize],
    basis: &[Vec<f64>; 2],
) -> Option<DVector<f64>> {
    let against = |f: usize| path.motion[f].map_or(Vec2::zero(), |k| -k.velocity.unit());
    bent(basis, integral(scene, frames, frames.iter().map(|&f| against(f))).into_iter()).try_normalize(1e-9)
}

fn line_basis(scene: &Scene, frames: &[usize]) -> [Vec<f64>; 2] {
    let n = frames.len() as f64;
    let mean = frames.iter().map(|&f| scene.times[f]).sum::<f64>() / n;
    let mut line: Vec<f64> = frames.iter().map(|&f| scene.times[f] - mean).collect();
    let norm = line.iter().map(|t| t * t).sum::<f64>().sqrt().max(1e-12);
    line.iter_mut().for_each(|t| *t /= norm);
    [vec![1.0 / n.sqrt(); frames.len()], line]
}
