//! A law of place that no library lists: a force or a drag that comes and goes along one direction, as a wave does. Less than a
//! whole wave across the region, or one about another mean than none, could stand in for a wind or a tilt.

use super::formula::{ResidualLaw, Search};
use super::screen::region;
use crate::num::Vec2;
use nalgebra::DMatrix;
use rayon::prelude::*;
use std::f64::consts::{FRAC_PI_2, FRAC_PI_4, PI};

/// Directions over half a turn that are tried, and how often the distance between two of them is halved.
const TURNS: usize = 12;
const HALVINGS: i32 = 6;
/// Fewest and most quarters of a wave across the region that are tried at first, and halves in the end.
const QUARTERS: [usize; 2] = [4, 12];
const HALVES: [f64; 2] = [2.0, 20.0];

/// What comes and goes.
#[derive(Clone, Copy, PartialEq)]
enum Push {
    /// A force along the wave's first axis.
    Along,
    /// Along its second.
    Across,
    /// A force along the velocity and in proportion to it.
    Drag,
}

const PUSHES: [Push; 3] = [Push::Along, Push::Across, Push::Drag];

/// A wave over the place along its own axes: what it is of their first one.
#[derive(Clone)]
struct Wave {
    /// Of the first axis, along which it changes, against x (rad).
    angle: f64,
    push: Push,
    /// Radians a metre.
    number: f64,
    /// Of cosine and sine.
    amplitudes: Vec<f64>,
    cost: f64,
}

/// The wave that explains most, if it proves itself.
pub fn wave(search: &Search) -> Option<ResidualLaw> {
    let none = search.unexplained()?;
    let area = region(search.lens.scenes);
    let half = PI / (area.high - area.low).norm().max(0.1);
    let [turn, step] = [PI / TURNS as f64, 0.5 * half];
    let [fewest, most] = QUARTERS;
    let lengths = most - fewest + 1;
    let of = |k: usize| {
        let (turns, quarters) = (k % TURNS, fewest + k / TURNS % lengths);
        fitted(search, turns as f64 * turn, PUSHES[k / (TURNS * lengths)], quarters as f64 * step)
    };
    let tried: Vec<Option<Wave>> = (0..PUSHES.len() * TURNS * lengths).into_par_iter().map(of).collect();
    let best = tried.into_iter().flatten().min_by(|a, b| a.cost.total_cmp(&b.cost))?;
    let axis = if best.angle.sin().abs() < FRAC_PI_4.sin() { 0.0 } else { FRAC_PI_2 };
    let upright = nearer(search, fitted(search, axis, best.push, best.number)?, 0.0, step, half);
    let best = nearer(search, best, turn, step, half);
    let best = if search.proves(upright.cost - best.cost, best.cost, 1) { best } else { upright };
    search.proves(none - best.cost, best.cost, best.numbers()).then(|| ResidualLaw {
        text: best.text(search.force),
        numbers: best.numbers(),
        cost: best.cost,
        elsewhere: search.elsewhere(&best.columns(search), &best.amplitudes),
        foreign: true,
    })
}

/// The wave along axes turned by `angle`, its amplitudes fitted.
fn fitted(search: &Search, angle: f64, push: Push, number: f64) -> Option<Wave> {
    let wave = Wave { angle, push, number, amplitudes: vec![], cost: 0.0 };
    let (cost, amplitudes) = search.lens.joint(search.projector, search.start, &wave.columns(search))?;
    Some(Wave { amplitudes: amplitudes.as_slice().to_vec(), cost, ..wave })
}

/// The same along axes that are turned further and with another length, by less and less, while the cost falls.
fn nearer(search: &Search, mut best: Wave, turn: f64, step: f64, half: f64) -> Wave {
    for halving in 0..=HALVINGS {
        let [turn, step] = [turn, step].map(|s| s * 0.5f64.powi(halving));
        let ways = [(turn, 0.0), (-turn, 0.0), (0.0, step), (0.0, -step)];
        for (turn, step) in ways.into_iter().cycle().take(2 * ways.len()).filter(|way| *way != (0.0, 0.0)) {
            let number = (best.number + step).clamp(HALVES[0] * half, HALVES[1] * half);
            if let Some(tried) = fitted(search, best.angle + turn, best.push, number)
                && tried.cost < best.cost
            {
                best = tried;
            }
        }
    }
    best
}

impl Wave {
    fn turned(&self) -> bool {
        self.angle != 0.0 && self.angle != FRAC_PI_2
    }

    /// Amplitudes, length, and direction.
    fn numbers(&self) -> usize {
        self.amplitudes.len() + 1 + usize::from(self.turned())
    }

    fn columns(&self, search: &Search) -> DMatrix<f64> {
        let along = Vec2::from_angle(self.angle);
        let column = |value: fn(f64) -> f64| {
            search.lens.column(search.models, search.force, |k, _| {
                let push = match self.push {
                    Push::Along => along,
                    Push::Across => along.perp(),
                    Push::Drag => k.velocity,
                };
                push.scaled(value(self.number * along.dot(k.position)))
            })
        };
        DMatrix::from_columns(&[column(f64::cos), column(f64::sin)])
    }

    fn text(&self, force: bool) -> String {
        let amplitudes = self.amplitudes.iter().enumerate();
        let mut text: String = amplitudes.map(|(i, a)| format!("let c{} = {a:.4e}; ", i + 1)).collect();
        text += &format!("let q [rad/m] = {:.4e}; ", self.number);
        let place = match self.angle {
            0.0 => "x",
            FRAC_PI_2 => "y",
            _ => "(cos(turn)*x + sin(turn)*y)",
        };
        let (ax, ay) = match (self.push, place) {
            (Push::Drag, _) => ("vx*", "vy*"),
            (Push::Along, "x") => ("1*", ""),
            (Push::Along, "y") | (Push::Across, "x") => ("", "1*"),
            (Push::Across, "y") => ("-1*", ""),
            (Push::Along, _) => ("cos(turn)*", "sin(turn)*"),
            (Push::Across, _) => ("-sin(turn)*", "cos(turn)*"),
        };
        if self.turned() {
            text += &format!("let turn [rad] = {:.4}; ", self.angle);
        }
        let mass = if force { "/m" } else { "" };
        let wave = format!("(c1*cos(q*{place}) + c2*sin(q*{place})){mass}");
        let sides = [("ax", ax), ("ay", ay)].into_iter().filter(|(_, factor)| !factor.is_empty());
        let sides = sides.map(|(side, factor)| format!("{side} = {}{wave}", factor.trim_start_matches("1*")));
        text + &sides.collect::<Vec<_>>().join("; ")
    }
}

#[cfg(test)]
mod tests {
    use super::super::force::{Lens, fit_forces};
    use super::super::formula::{SIMPLE_TERMS, residual_law, tests::agrees};
    use super::super::tests::{CUBE, DISC, film_under, models};
    use super::*;
    use crate::effects::formula::Formula;
    use crate::num::vec2;
    use crate::world::ActiveEffect;

    #[test]
    fn a_wave_is_what_its_text_says_along_any_axes() {
        for angle in [0.0, FRAC_PI_2, 0.7, 2.5] {
            for push in PUSHES {
                let amplitudes = vec![0.5, -0.25];
                let wave = Wave { angle, push, number: 2.0, amplitudes: amplitudes.clone(), cost: 0.0 };
                let along = Vec2::from_angle((1e4 * angle).round() / 1e4);
                let along = if wave.turned() { along } else { Vec2::from_angle(angle) };
                agrees(&wave.text(false), vec2(0.7, -1.2), vec2(0.3, 0.1), |k, _| {
                    let phase = 2.0 * along.dot(k.position);
                    let size = amplitudes[0] * phase.cos() + amplitudes[1] * phase.sin();
                    let push = match push {
                        Push::Along => along,
                        Push::Across => along.perp(),
                        Push::Drag => k.velocity,
                    };
                    push.scaled(size)
                });
            }
        }
    }

    #[test]
    fn a_force_that_changes_along_one_direction_is_found() {
        let launches = [
            vec![(DISC, 0.6, [-1.5, 0.4], [0.9, 0.1]), (CUBE, 1.2, [1.4, -1.0], [-0.5, 0.5])],
            vec![(DISC, 0.6, [0.2, 1.6], [0.3, -0.8]), (CUBE, 1.2, [-1.2, -1.3], [0.6, 0.4])],
        ];
        for text in ["ax = 0.1*sin(3*x)", "ay = -0.1*abs(x)", "ax = -0.3*abs(x)*vx; ay = -0.3*abs(x)*vy"] {
            let scenes = film_under(&launches, |model| {
                let formula = Formula::new(text, vec![]).expect("it is one");
                let active = ActiveEffect::of_formula("wave", formula, &model.bodies);
                model.effects.push(active.expect("it is one"));
            });
            let (lens, models) = (Lens::new(&scenes), models(&scenes));
            let (free, seen) = fit_forces(&lens, &models);
            let law =
                residual_law(&lens, &models, &free, &seen, SIMPLE_TERMS, None).expect("it proves itself");
            assert!(law.text.contains("let q [rad/m]"), "{}", law.text);
            let degrees = lens.degrees_of_freedom() as f64;
            assert!(law.cost < 1.2 * degrees, "{} of {degrees}: {}", law.cost, law.text);
        }
    }
}
