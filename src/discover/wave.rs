//! A law of place that no library lists: a force or a drag that comes and goes along one direction, as a wave does. A ridge or a
//! hollow that crosses the region is a part of one.

use super::formula::{FormulaSearch, ResidualLaw};
use super::screen::region;
use crate::num::{Vec2, elementary};
use nalgebra::DMatrix;
use rayon::prelude::*;
use std::f64::consts::{FRAC_PI_2, FRAC_PI_4, PI};

/// Directions over half a turn that are tried, and how often the distance between two of them is halved.
const TURNS: usize = 12;
const HALVINGS: i32 = 6;
/// Most quarters of a wave across the region that are tried, at first.
const QUARTERS: usize = 12;
/// Fewest and most halves of a wave across the region, in the end.
const FEWEST: f64 = 0.1;
const MOST: f64 = 20.0;

/// What comes and goes.
#[derive(Clone, Copy, PartialEq)]
enum WaveTerm {
    /// A force along the wave's first axis.
    Along,
    /// Along its second.
    Across,
    /// A force along the velocity and in proportion to it.
    Drag,
}

const PUSHES: [WaveTerm; 3] = [WaveTerm::Along, WaveTerm::Across, WaveTerm::Drag];

/// A wave over the place along its own axes: what it is of their first one.
#[derive(Clone)]
struct Wave {
    /// Of the first axis, along which it changes, against x (rad).
    angle: f64,
    push: WaveTerm,
    /// Whether it swings about another mean than none.
    mean: bool,
    /// Radians a metre.
    number: f64,
    /// Of cosine and sine, and the mean.
    amplitudes: Vec<f64>,
    cost: f64,
}

/// The wave that explains most, if it proves itself.
pub fn wave(search: &FormulaSearch) -> Option<ResidualLaw> {
    let none = search.unexplained()?;
    let area = region(search.lens.scenes);
    let half = PI / (area.high - area.low).norm().max(0.1);
    let [turn, step] = [PI / TURNS as f64, 0.5 * half];
    let of = |k: usize| {
        let (turns, quarters) = (k % TURNS, 1 + k / TURNS % QUARTERS);
        let push = PUSHES[k / (TURNS * QUARTERS)];
        fitted(search, turns as f64 * turn, push, true, quarters as f64 * step)
    };
    let tried: Vec<Option<Wave>> = (0..PUSHES.len() * TURNS * QUARTERS).into_par_iter().map(of).collect();
    let best = tried.into_iter().flatten().min_by(|a, b| a.cost.total_cmp(&b.cost))?;
    // A number that proves nothing is none: the direction, and the mean.
    let simpler = |best: Wave, other: Option<Wave>, turn: f64| match other {
        Some(other) => {
            let other = nearer(search, other, turn, step, half);
            if search.proves(other.cost - best.cost, best.cost, 1) { best } else { other }
        }
        None => best,
    };
    let axis = if elementary::sin(best.angle).abs() < elementary::sin(FRAC_PI_4) { 0.0 } else { FRAC_PI_2 };
    let upright = fitted(search, axis, best.push, true, best.number);
    let best = simpler(nearer(search, best, turn, step, half), upright, 0.0);
    let turn = if best.turned() { turn } else { 0.0 };
    let swinging = fitted(search, best.angle, best.push, false, best.number);
    let best = simpler(best, swinging, turn);
    search.proves(none - best.cost, best.cost, best.numbers()).then(|| ResidualLaw {
        text: best.text(search.force),
        numbers: best.numbers(),
        cost: best.cost,
        gain_without_best_track: search.gain_without_best_track(&best.columns(search), &best.amplitudes),
        not_in_library: true,
        in_library: false,
    })
}

/// The wave along axes turned by `angle`, its amplitudes fitted.
fn fitted(search: &FormulaSearch, angle: f64, push: WaveTerm, mean: bool, number: f64) -> Option<Wave> {
    let wave = Wave { angle, push, mean, number, amplitudes: vec![], cost: 0.0 };
    let (cost, amplitudes) = search.lens.joint(search.projector, search.start, &wave.columns(search))?;
    Some(Wave { amplitudes: amplitudes.as_slice().to_vec(), cost, ..wave })
}

/// The same along axes that are turned further and with another length, by less and less, while the cost falls.
fn nearer(search: &FormulaSearch, mut best: Wave, turn: f64, step: f64, half: f64) -> Wave {
    for halving in 0..=HALVINGS {
        let [turn, step] = [turn, step].map(|s| s * elementary::powi(0.5f64, halving));
        let ways = [(turn, 0.0), (-turn, 0.0), (0.0, step), (0.0, -step)];
        for (turn, step) in ways.into_iter().cycle().take(2 * ways.len()).filter(|way| *way != (0.0, 0.0)) {
            let number = (best.number + step).clamp(FEWEST * half, MOST * half);
            if let Some(tried) = fitted(search, best.angle + turn, best.push, best.mean, number)
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

    fn columns(&self, search: &FormulaSearch) -> DMatrix<f64> {
        let along = Vec2::from_angle(self.angle);
        let column = |value: fn(f64) -> f64, number: f64| {
            search.lens.column(search.models, search.force, |k, _| {
                let push = match self.push {
                    WaveTerm::Along => along,
                    WaveTerm::Across => along.perp(),
                    WaveTerm::Drag => k.velocity,
                };
                push.scaled(value(number * along.dot(k.position)))
            })
        };
        let mut columns = vec![column(elementary::cos, self.number), column(elementary::sin, self.number)];
        if self.mean {
            columns.push(column(|_| 1.0, 0.0));
        }
        DMatrix::from_columns(&columns)
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
            (WaveTerm::Drag, _) => ("vx*", "vy*"),
            (WaveTerm::Along, "x") => ("1*", ""),
            (WaveTerm::Along, "y") | (WaveTerm::Across, "x") => ("", "1*"),
            (WaveTerm::Across, "y") => ("-1*", ""),
            (WaveTerm::Along, _) => ("cos(turn)*", "sin(turn)*"),
            (WaveTerm::Across, _) => ("-sin(turn)*", "cos(turn)*"),
        };
        if self.turned() {
            text += &format!("let turn [rad] = {:.4}; ", self.angle);
        }
        let mean = if self.mean { " + c3" } else { "" };
        let mass = if force { "/m" } else { "" };
        let wave = format!("(c1*cos(q*{place}) + c2*sin(q*{place}){mean}){mass}");
        let sides = [("ax", ax), ("ay", ay)].into_iter().filter(|(_, factor)| !factor.is_empty());
        let sides = sides.map(|(side, factor)| format!("{side} = {}{wave}", factor.trim_start_matches("1*")));
        text + &sides.collect::<Vec<_>>().join("; ")
    }
}

#[cfg(test)]
mod tests {
    use super::super::formula::{SIMPLE_TERMS, residual_law, tests::agrees};
    use super::super::tests::{CUBE, DISC, film_under, models};
    use super::super::weak_form::{WeakFormRegression, fit_forces};
    use super::*;
    use crate::effects::formula::Formula;
    use crate::num::vec2;
    use crate::world::ActiveEffect;

    #[test]
    fn a_wave_is_what_its_text_says_along_any_axes() {
        for angle in [0.0, FRAC_PI_2, 0.7, 2.5] {
            for (push, mean) in [(WaveTerm::Along, true), (WaveTerm::Across, false), (WaveTerm::Drag, true)] {
                let amplitudes = if mean { vec![0.5, -0.25, 0.125] } else { vec![0.5, -0.25] };
                let wave = Wave { angle, push, mean, number: 2.0, amplitudes: amplitudes.clone(), cost: 0.0 };
                let along = Vec2::from_angle((1e4 * angle).round() / 1e4);
                let along = if wave.turned() { along } else { Vec2::from_angle(angle) };
                agrees(&wave.text(false), vec2(0.7, -1.2), vec2(0.3, 0.1), |k, _| {
                    let phase = 2.0 * along.dot(k.position);
                    let swing = amplitudes[0] * phase.cos() + amplitudes[1] * phase.sin();
                    let size = swing + amplitudes.get(2).unwrap_or(&0.0);
                    let push = match push {
                        WaveTerm::Along => along,
                        WaveTerm::Across => along.perp(),
                        WaveTerm::Drag => k.velocity,
                    };
                    push.scaled(size)
                });
            }
        }
    }

    /// The others are no waves but parts of one: a ridge, and a drag that grows from a line.
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
            let (lens, models) = (WeakFormRegression::new(&scenes), models(&scenes));
            let (free, seen) = fit_forces(&lens, &models);
            let law = residual_law(&lens, &models, &free, &seen, SIMPLE_TERMS, true, None)
                .expect("it proves itself");
            assert!(law.text.contains("let q [rad/m]"), "{}", law.text);
            let degrees = lens.degrees_of_freedom() as f64;
            assert!(law.cost < 1.2 * degrees, "{} of {degrees}: {}", law.cost, law.text);
        }
    }
}
