//! Short films, each fitted by itself: what one film's own fit does not follow, no value that films share will mend.

use super::revise::{chi_squares, sum};
use super::segment::unseen_turn;
use super::windows::ContactWindows;
use crate::fit::{Fit, FitError, FitOptions, Method, SceneFit, StartPoint, estimate_each, estimate_one};
use crate::num::Stop;
use crate::scene::Scene;
use crate::world::{EventKind, Model, trace};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

/// A short film that nothing follows better than this (reduced chi-square) tells nothing.
pub const FOLLOWED: f64 = 4.0;
/// A film that the base fits this well needs no new beginning (reduced chi-square).
pub const AT_NOISE: f64 = 1.5;
/// Most objects of a film in which chaos has no time to lead a fit astray.
const FEW: usize = 3;
/// How the fit of one short film begins.
pub const OPTIONS: FitOptions = FitOptions {
    max_iterations: 40,
    method: Method::GaussNewton,
    start_point: StartPoint::YawSearched,
    budget_fraction: 1.0,
    single_precision: true,
};

/// The films with a fit of each.
#[derive(Serialize, Deserialize)]
pub struct WindowFits {
    pub films: ContactWindows,
    pub fits: Vec<Fit>,
}

impl WindowFits {
    pub fn of(films: &ContactWindows, stop: Stop) -> Result<WindowFits, FitError> {
        let films = turned(films, stop)?;
        let fits = estimate_each(&films.scenes, &films.models, &OPTIONS, stop)?;
        Ok(WindowFits { films, fits })
    }

    /// Chi-square of all films; one that its fit does not follow counts as if it were just followed, as how far chaos leads
    /// astray tells nothing.
    pub fn cost(&self) -> f64 {
        (0..self.fits.len()).map(|k| self.bounded(k)).sum()
    }

    /// Whether all films are followed to their noise.
    pub fn at_noise(&self) -> bool {
        (0..self.fits.len()).all(|k| self.chi_square(k) < AT_NOISE)
    }

    /// Whether most films in which a few objects meet are lost: the law of contact is another.
    pub fn meetings_lost(&self) -> bool {
        let few = (0..self.fits.len()).filter(|&k| (2..=FEW).contains(&self.films.scenes[k].objects.len()));
        let (lost, followed): (Vec<usize>, Vec<usize>) = few.partition(|&k| self.chi_square(k) > FOLLOWED);
        lost.len() > followed.into_iter().filter(|&k| self.meet(k)).count()
    }

    /// Whether a film shows many objects pressing on each other and is not followed: what happened first decides all the
    /// rest there, so that it tells little of any law, and takes longest.
    pub fn is_heap(&self, film: usize) -> bool {
        match self.films.scenes[film].objects.len() {
            0..=2 => false,
            3 => self.chi_square(film) >= FOLLOWED,
            _ => self.chi_square(film) >= AT_NOISE,
        }
    }

    /// Without the heaps, but with the meetings of two in them; and what the heaps cost beyond what noise makes of those.
    pub fn without_heaps(&self, stop: Stop) -> Result<(WindowFits, f64), FitError> {
        let (heaps, rest): (Vec<usize>, Vec<usize>) = (0..self.fits.len()).partition(|&k| self.is_heap(k));
        let mut lost: f64 = heaps.iter().map(|&k| self.bounded(k)).sum();
        let mut films = self.films.only(|film| rest.contains(&film));
        let mut fits: Vec<Fit> = rest.iter().map(|&k| self.fits[k].clone()).collect();
        let meetings = heaps.iter().flat_map(|&k| self.films.meetings[k].clone());
        let (scenes, models): (Vec<Scene>, Vec<Model>) = meetings.unzip();
        let meetings = vec![vec![]; scenes.len()];
        let meetings = WindowFits::of(&ContactWindows { scenes, models, meetings, jumps: vec![] }, stop)?;
        let counted = meetings.fits.iter().flat_map(|f| &f.scenes).map(|s| s.degrees_of_freedom as f64);
        lost -= counted.sum::<f64>();
        films.scenes.extend(meetings.films.scenes);
        films.models.extend(meetings.films.models);
        films.meetings.extend(meetings.films.meetings);
        fits.extend(meetings.fits);
        Ok((WindowFits { films, fits }, lost))
    }

    fn chi_square(&self, film: usize) -> f64 {
        self.fits[film].scenes.iter().map(|s| s.reduced_chi_square).sum()
    }

    fn bounded(&self, film: usize) -> f64 {
        let of = |s: &SceneFit| s.reduced_chi_square.min(FOLLOWED) * s.degrees_of_freedom as f64;
        self.fits[film].scenes.iter().map(of).sum()
    }

    /// Whether two objects touch, as the fit has it.
    fn meet(&self, film: usize) -> bool {
        self.fits[film].scenes.iter().any(|s| meet(&s.model, &self.films.scenes[film].times))
    }
}

/// Whether two objects touch, as a model has it.
pub fn meet(model: &Model, times: &[f64]) -> bool {
    let events = trace(model, times).events;
    events.iter().any(|e| e.kind == EventKind::Collision && e.objects.len() > 1)
}

/// The films with yaws that nobody measured as each film by itself has them: together they would be searched over and over.
fn turned(films: &ContactWindows, stop: Stop) -> Result<ContactWindows, FitError> {
    let options = FitOptions { start_point: StartPoint::Models, ..OPTIONS };
    let unseen = |scene: &Scene| (0..scene.objects.len()).any(|object| unseen_turn(scene, object));
    let one = |(scene, model): (&Scene, &Model)| -> Result<Model, FitError> {
        let mut model = model.clone();
        if unseen(scene) {
            let alone = estimate_one(scene, &model, &options, stop)?;
            for (body, found) in
                model.bodies.iter_mut().zip(alone.scenes.iter().flat_map(|s| &s.model.bodies))
            {
                body.start.state.yaw = found.start.state.yaw;
                body.start.state.spin = found.start.state.spin;
            }
        }
        Ok(model)
    };
    let models: Result<Vec<Model>, FitError> = films.scenes.par_iter().zip(&films.models).map(one).collect();
    let (scenes, meetings, jumps) = (films.scenes.clone(), films.meetings.clone(), films.jumps.clone());
    Ok(ContactWindows { scenes, models: models?, meetings, jumps })
}

/// Whether the short films are nearer to models in which objects stick; also where there is no film to tell.
pub fn films_stick(films: &ContactWindows, stuck: &[Model], stop: Stop) -> Result<bool, FitError> {
    if films.scenes.is_empty() {
        return Ok(true);
    }
    let options = FitOptions { start_point: StartPoint::Models, ..OPTIONS };
    // Each film by itself: what it shares with the others says nothing here.
    let cost = |models: &[Model]| -> Result<f64, FitError> {
        let fits = estimate_each(&films.scenes, models, &options, stop)?;
        Ok(fits.iter().map(|f| sum(&chi_squares(f))).sum())
    };
    Ok(cost(stuck)? < cost(&films.models)?)
}
