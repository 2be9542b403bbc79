//! The acceleration that a model lacks, piece by piece of the free motion: the force lens as a picture shows it.

use super::segment::{instants, integral};
use super::smooth_track::paths;
use crate::fit::estimate_noise;
use crate::num::Vec2;
use crate::scene::Scene;
use crate::world::{AccelerationField, Model};
use nalgebra::{Matrix3, Vector3};

/// Frames of one piece: with less than a second at 25 frames/s an acceleration drowns in the noise of positions.
const PIECE: usize = 24;

/// Mean acceleration that is measured and not in the model, over a piece of a free stretch.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct UnexplainedAcceleration {
    /// Index of the scene and of the object in it.
    pub scene: usize,
    pub object: usize,
    /// At the middle of the piece: time (s), place (m), velocity (m/s).
    pub time: f64,
    pub position: Vec2,
    pub velocity: Vec2,
    /// m/s^2, and its standard deviation, the same for both components.
    pub acceleration: Vec2,
    pub sd: f64,
}

/// All pieces of all scenes under their models. Measured positions are compared with the double integral of the model's
/// accelerations (weak form); what a parabola finds in the difference is lacking.
pub fn unexplained(scenes: &[Scene], models: &[Model]) -> Vec<UnexplainedAcceleration> {
    let mut found = vec![];
    for (index, (scene, model)) in scenes.iter().zip(models).enumerate() {
        let noise = estimate_noise(scene);
        let paths = paths(scene, &noise);
        let instants = instants(scene, &paths);
        let accelerations =
            AccelerationField::new(model, &model.flatten()).accelerations(&instants, None, None);
        let mut left = accelerations.into_iter();
        let accelerations: Vec<Vec<Vec2>> =
            instants.iter().map(|i| left.by_ref().take(i.bodies.len()).collect()).collect();
        for (object, path) in paths.iter().enumerate() {
            let acceleration = |f: usize| {
                let at = instants.get(f).and_then(|i| i.bodies.iter().position(|b| b.0 == object));
                at.and_then(|at| accelerations.get(f)?.get(at).copied()).unwrap_or(Vec2::zero())
            };
            let sigma = scene.tracks.get(object).map_or(noise.position, |t| noise.of_track(t).position);
            for stretch in &path.stretches {
                let pieces = stretch.len().div_ceil(PIECE).max(1);
                for k in 0..pieces {
                    let edge = |k: usize| stretch.start + k * stretch.len() / pieces;
                    let frames: Vec<usize> = (edge(k)..edge(k + 1)).collect();
                    let middle = frames.get(frames.len() / 2).copied().unwrap_or(stretch.start);
                    let Some(here) = path.motion.get(middle).copied().flatten() else { continue };
                    let integrated = integral(scene, &frames, frames.iter().map(|&f| acceleration(f)));
                    let time = scene.time_of(middle);
                    let differences = frames.iter().zip(&integrated).filter_map(|(&f, at)| {
                        let sample = scene.tracks.get(object)?.at(f)?;
                        Some((scene.time_of(f) - time, sample.position - *at))
                    });
                    if let Some((acceleration, sd)) = curvature(differences, sigma) {
                        let (position, velocity) = (here.position, here.velocity);
                        found.push(UnexplainedAcceleration {
                            scene: index,
                            object,
                            time,
                            position,
                            velocity,
                            acceleration,
                            sd,
                        });
                    }
                }
            }
        }
    }
    found
}

/// Second derivative of the parabola through the points, and its deviation.
fn curvature(points: impl Iterator<Item = (f64, Vec2)>, sigma: f64) -> Option<(Vec2, f64)> {
    let (mut normal, mut x, mut y) = (Matrix3::zeros(), Vector3::zeros(), Vector3::zeros());
    for (t, d) in points {
        let row = Vector3::new(1.0, t, 0.5 * t * t);
        normal += row * row.transpose();
        x += row * d.x;
        y += row * d.y;
    }
    let inverse = normal.cholesky()?.inverse();
    let sd = sigma * inverse[(2, 2)].sqrt();
    let found = Vec2 { x: (inverse * x)[2], y: (inverse * y)[2] };
    (sd.is_finite() && found.x.is_finite() && found.y.is_finite()).then_some((found, sd))
}
