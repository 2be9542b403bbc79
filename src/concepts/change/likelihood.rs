//! How well each factor of a change explains a video in which an object was changed.
//!
//! The physics is that of the fit of the video before the change, in its best model and in draws from its posterior. With the quantity of
//! the object multiplied by f, the start states of the second video are fitted, and nothing else: `ln p(f) = -C(f)/s^2`, C the cost of
//! that fit (Huber's loss of residuals in units of the second video's noise, so that one contact does not decide), s^2 the reduced
//! chi-square of the best factor where it is above 1: by so much the model errs. Each draw counts alike.
//!
//! A velocity is itself a start state: `-(1/2) sum (v - f v_0)^2/sd^2` over the coordinates, v that of the second video, v_0 that
//! of the first, and s^2 from the direction across v_0, in which a factor changes nothing.

use super::grid::largest;
use crate::concepts::error::ConceptError;
use crate::fit::{Fit, FitError, FitOptions, StartPoint, estimate_one, initial_model};
use crate::num::elementary::{exp, ln};
use crate::num::{Stop, Vec2, vec2};
use crate::reason::{ChangedQuantity, ReasonError};
use crate::scene::Scene;
use crate::world::{Intervention, Model, State};
use rayon::prelude::*;

/// Iterations of a fit of start states: from lines through the first frames it converges in about five.
const ITERATIONS: usize = 15;
/// Draws from the posterior of the first video beside its best model: how far they spread is known to a third.
const DRAWN_MODELS: usize = 3;

/// A video with an object changed, and the physics without the change.
pub struct ChangedVideo {
    /// The masses of its objects count as known: they are those of the model.
    scene: Scene,
    quantity: ChangedQuantity,
    /// The scene's id of the object.
    id: u32,
    /// The models of the video before the change, with the start states of this one: the best one and draws.
    models: Vec<Model>,
    /// The object's velocity before the change in each model (m/s).
    velocities: Vec<Vec2>,
    /// The start states that explain it best so far, for each model.
    starts: Vec<Option<Vec<State>>>,
    /// Of a velocity: what this video shows, with the physics of each model.
    measured: Vec<Option<MeasuredVelocity>>,
    /// s^2 of each model.
    scatter: Vec<f64>,
}

/// A velocity (m/s) with the standard deviation of each coordinate; infinite where it is not determined.
#[derive(Debug, Clone, Copy)]
struct MeasuredVelocity {
    value: Vec2,
    sd: Vec2,
}

/// What a fit of start states gives.
struct Explained {
    cost: f64,
    chi_square: f64,
    fit: Fit,
}

impl Explained {
    fn starts(&self) -> Vec<State> {
        let bodies = self.fit.scenes.first().map_or(&[][..], |s| &s.model.bodies);
        bodies.iter().map(|b| b.start.state).collect()
    }
}

/// The model with the objects of a scene only, in its order, as its first frames show them. Only start states are free in a fit.
fn model_of(scene: &Scene, mut model: Model) -> Model {
    let body = |id: u32| model.bodies.iter().find(|b| b.id == id).cloned();
    model.bodies = scene.objects.iter().filter_map(|o| body(o.id)).collect();
    model.effects.iter_mut().flat_map(|e| &mut e.parameters).for_each(|p| p.prior.sd = 0.0);
    for impulse in &mut model.impulses {
        (impulse.velocity_sd, impulse.spin_sd, impulse.delay_sd) = (0.0, 0.0, 0.0);
    }
    model.corrections.clear();
    initial_model(scene, &model)
}

impl ChangedVideo {
    /// `after` has objects of the fitted video `(fit, index)` only, which keep their ids.
    pub fn new(
        after: &Scene,
        (fit, index): (&Fit, usize),
        id: u32,
        quantity: ChangedQuantity,
    ) -> ChangedVideo {
        let best = fit.scenes.get(index).map(|s| s.model.clone());
        let drawn = fit.draw(index, DRAWN_MODELS, 0);
        let mut scene = after.clone();
        let (mut models, mut velocities) = (vec![], vec![]);
        for model in best.into_iter().chain(drawn) {
            let before = model.body_index(id).and_then(|b| model.bodies.get(b));
            velocities.push(before.map_or(Vec2::default(), |b| b.start.state.velocity));
            models.push(model_of(after, model));
        }
        for (object, body) in scene.objects.iter_mut().zip(models.first().map_or(&[][..], |m| &m.bodies)) {
            object.mass = Some(body.mass);
        }
        let count = models.len();
        let (starts, measured, scatter) = (vec![None; count], vec![None; count], vec![1.0; count]);
        ChangedVideo { scene, quantity, id, models, velocities, starts, measured, scatter }
    }

    /// Reduced chi-square of the best factor in the best model, 1 where it is less.
    pub fn chi_square(&self) -> f64 {
        self.scatter.first().copied().unwrap_or(1.0)
    }

    /// ln p(f) at these points of ln f, 0 at the largest of each model. The first call finds the start states and the scatter.
    pub fn log_likelihood(&mut self, points: &[f64], stop: Stop) -> Result<Vec<f64>, ConceptError> {
        let is_first = self.starts.iter().all(Option::is_none);
        // Draws differ by less than the first grid tells apart.
        let models = if is_first { 1 } else { self.models.len() };
        let mut all = vec![];
        for k in 0..models {
            stop(k as f64 / models as f64)?;
            all.push(match self.quantity {
                ChangedQuantity::Velocity => self.of_velocities(k, points, stop)?,
                _ => self.of_paths(k, points, stop)?,
            });
        }
        let at = |i: usize| {
            let each: Vec<f64> = all.iter().map(|log| log[i]).collect();
            let most = largest(&each);
            most + ln(each.iter().map(|l| exp(l - most)).sum::<f64>() / models as f64)
        };
        Ok((0..points.len()).map(at).collect())
    }

    fn of_paths(&mut self, k: usize, points: &[f64], stop: Stop) -> Result<Vec<f64>, ConceptError> {
        let mut all = self.explained(k, points, stop)?;
        let best = |all: &[Explained]| {
            let costs = all.iter().enumerate().filter(|(_, e)| e.cost.is_finite());
            costs.min_by(|a, b| a.1.cost.total_cmp(&b.1.cost)).map(|(i, _)| i)
        };
        if self.starts[k].is_none()
            && let Some(i) = best(&all)
        {
            // Contacts that lines through the first frames miss are met from where another factor meets them.
            self.starts[k] = Some(all[i].starts());
            for (known, again) in all.iter_mut().zip(self.explained(k, points, stop)?) {
                if again.cost < known.cost {
                    *known = again;
                }
            }
        }
        if let Some(i) = best(&all) {
            self.scatter[k] = all[i].chi_square.max(1.0);
            self.starts[k] = Some(all[i].starts());
            // Draws start where the best model ends.
            for start in self.starts.iter_mut().filter(|s| s.is_none()) {
                *start = Some(all[i].starts());
            }
        }
        let log: Vec<f64> = all.iter().map(|e| -e.cost / self.scatter[k]).collect();
        let most = largest(&log);
        Ok(log.into_iter().map(|l| l - most).collect())
    }

    /// The fit of the start states for each factor.
    fn explained(&self, k: usize, points: &[f64], stop: Stop) -> Result<Vec<Explained>, ConceptError> {
        let of = |x: &f64| self.start_states(k, Some(exp(*x)), stop);
        points.par_iter().map(of).collect()
    }

    /// The fit of the start states of one model, with the quantity multiplied by a factor.
    fn start_states(&self, k: usize, factor: Option<f64>, stop: Stop) -> Result<Explained, ConceptError> {
        let (id, mut model) = (self.id, self.models[k].clone());
        if let Some(factor) = factor {
            let change = match self.quantity {
                ChangedQuantity::Mass => Intervention::ScaleMass { id, factor },
                ChangedQuantity::Velocity => Intervention::ScaleVelocity { id, factor },
                ChangedQuantity::Restitution => Intervention::ScaleRestitution { id, factor },
                ChangedQuantity::Friction => Intervention::ScaleFriction { id, factor },
            };
            model = change.apply(&model).map_err(ReasonError::from)?;
        }
        for (body, state) in model.bodies.iter_mut().zip(self.starts[k].iter().flatten()) {
            // A body at rest has no velocity to be fitted.
            let rests = body.start.state.velocity == Vec2::default();
            if !rests || state.velocity == Vec2::default() {
                body.start.state = *state;
            }
        }
        let options = FitOptions {
            max_iterations: ITERATIONS,
            start_point: StartPoint::NearOptimum,
            ..FitOptions::default()
        };
        // One of many fits is no share of the work.
        let fitted = match estimate_one(&self.scene, &model, &options, &|_| stop(0.0)) {
            Ok(fitted) => fitted,
            Err(FitError::Stopped(stopped)) => return Err(stopped.into()),
            Err(error) => return Err(ConceptError::Fit(error)),
        };
        Ok(Explained {
            cost: fitted.losses.last().copied().unwrap_or(f64::INFINITY),
            chi_square: fitted.scenes.first().map_or(1.0, |s| s.reduced_chi_square),
            fit: fitted,
        })
    }

    fn of_velocities(&mut self, k: usize, points: &[f64], stop: Stop) -> Result<Vec<f64>, ConceptError> {
        let measured = match self.measured[k] {
            Some(known) => known,
            None => self.velocity(k, stop)?,
        };
        self.measured[k] = Some(measured);
        let (v, before) = (measured.value, self.velocities[k]);
        let across = before.perp().scaled(1.0 / before.norm().max(f64::MIN_POSITIVE));
        let sd = (0.5 * measured.sd.norm_squared()).sqrt();
        let off = v.dot(across) / sd;
        self.scatter[k] = (off * off).max(1.0);
        let at = |x: &f64| {
            let off = v - before.scaled(exp(*x));
            let (a, b) = (off.x / measured.sd.x, off.y / measured.sd.y);
            -0.5 * (a * a + b * b) / self.scatter[k]
        };
        let log: Vec<f64> = points.iter().map(at).collect();
        let most = largest(&log);
        Ok(log.into_iter().map(|l| l - most).collect())
    }

    /// The object's velocity at its first frame, as the whole video shows it.
    fn velocity(&mut self, k: usize, stop: Stop) -> Result<MeasuredVelocity, ConceptError> {
        let found = self.start_states(k, None, stop)?;
        let sd = |axis: &str| {
            let name = format!("objects[{}].{axis}", self.id);
            let estimate = found.fit.posterior.estimates.iter().find(|e| e.name == name);
            estimate.map_or(f64::INFINITY, |e| e.sd * found.chi_square.max(1.0).sqrt())
        };
        let body = self.models[k].body_index(self.id);
        let value = body.and_then(|b| found.starts().get(b).map(|s| s.velocity)).unwrap_or_default();
        let sd = vec2(sd("vx"), sd("vy"));
        self.starts[k] = Some(found.starts());
        Ok(MeasuredVelocity { value, sd })
    }
}
