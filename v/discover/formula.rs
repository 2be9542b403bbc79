//! A law that no library lists: a sparse sum of generic terms that explains the residual acceleration.

use super::central::central_law;
use super::force::{Lens, Projector, Seen};
use super::free::Free;
use crate::num::{Vec2, vec2};
use crate::world::{Kinematics, Model};
use nalgebra::{DMatrix, DVector};
use std::f64::consts::FRAC_PI_2;

/// Most terms of a formula.
pub const MOST_TERMS: usize = 6;
/// Most terms of a formula that contradicts a law of the library: a longer one could imitate any.
pub const SIMPLE_TERMS: usize = 2;
/// Directions of a law's own axes that are tried, and how often the distance between two of them is halved.
const TURNS: usize = 9;
const HALVINGS: i32 = 6;
/// Fall of chi-square, in units of what remains, that a term must bring beyond its price.
pub(super) const PROOF: f64 = 20.0;

/// One generic term: its text along x and along y, and its value.
pub(super) struct Term {
    pub x: &'static str,
    pub y: &'static str,
    pub value: fn(&Kinematics<f64>, f64) -> Vec2,
}

impl Term {
    /// Whether it says something else along other axes: a law along one axis alone does.
    fn directed(&self) -> bool {
        self.x.is_empty() || self.y.is_empty()
    }
}

/// Terms of position, velocity and spin up to second order, by axis where the law may have no symmetry.
const TERMS: [Term; 21] = [
    Term { x: "1", y: "", value: |_, _| vec2(1.0, 0.0) },
    Term { x: "", y: "1", value: |_, _| vec2(0.0, 1.0) },
    Term { x: "x", y: "", value: |k, _| vec2(k.position.x, 0.0) },
    Term { x: "y", y: "", value: |k, _| vec2(k.position.y, 0.0) },
    Term { x: "", y: "x", value: |k, _| vec2(0.0, k.position.x) },
    Term { x: "", y: "y", value: |k, _| vec2(0.0, k.position.y) },
    Term { x: "vx", y: "vy", value: |k, _| k.velocity },
    Term { x: "-vy", y: "vx", value: |k, _| k.velocity.perp() },
    Term { x: "vx*speed", y: "vy*speed", value: |k, _| k.velocity.scaled(k.velocity.norm()) },
    Term { x: "vx*speed^2", y: "vy*speed^2", value: |k, _| k.velocity.scaled(k.velocity.norm_squared()) },
    // A formula has a value at rest, too.
    Term {
        x: "vx/max(speed, 0.01)",
        y: "vy/max(speed, 0.01)",
        value: |k, _| k.velocity.scaled(1.0 / k.velocity.norm().max(0.01)),
    },
    Term { x: "-vy*speed", y: "vx*speed", value: |k, _| k.velocity.perp().scaled(k.velocity.norm()) },
    Term { x: "-spin*vy", y: "spin*vx", value: |k, _| k.velocity.perp().scaled(k.spin) },
    Term { x: "vx", y: "", value: |k, _| vec2(k.velocity.x, 0.0) },
    Term { x: "", y: "vy", value: |k, _| vec2(0.0, k.velocity.y) },
    Term { x: "x^3", y: "", value: |k, _| vec2(k.position.x.powi(3), 0.0) },
    Term { x: "", y: "y^3", value: |k, _| vec2(0.0, k.position.y.powi(3)) },
    Term { x: "x^2", y: "", value: |k, _| vec2(k.position.x.powi(2), 0.0) },
    Term { x: "", y: "y^2", value: |k, _| vec2(0.0, k.position.y.powi(2)) },
    Term { x: "t", y: "", value: |_, t| vec2(t, 0.0) },
    Term { x: "", y: "t", value: |_, t| vec2(0.0, t) },
];

/// A sparse law and what it leaves.
#[derive(Debug, Clone, PartialEq)]
pub struct ResidualLaw {
    pub text: String,
    /// How many numbers it has: one a term, and the direction of its axes.
    pub numbers: usize,
    /// Chi-square that remains, with the priors' share.
    pub cost: f64,
    /// Fall of chi-square on all tracks but the one that gains most.
    pub elsewhere: f64,
}

/// The sparse law beside the models' own, as `let c1 = ...; ax = ...; ay = ...` with accelerations in m/s^2 (of a body that
/// does not roll) of at most `most` terms; `None` where no term proves itself.
pub fn residual_law(
    lens: &Lens,
    models: &[Model],
    free: &[Free],
    seen: &Seen,
    most: usize,
) -> Option<ResidualLaw> {
    let projector = lens.projector(models, free, &seen.values)?;
    let degrees = lens.degrees_of_freedom().max(1) as f64;
    let priced = |cost: f64, numbers: usize| cost + numbers as f64 * degrees.ln();
    let by_axes = |l: &Sparse| priced(l.cost, l.numbers());
    // The same law for all masses, or a force, along any axes or about any centre: the data say which.
    let laws = [false, true].map(|force| {
        let search = Search { lens, models, projector: &projector, start: seen.cost, force };
        let along_axes = search.select(0.0, most).map(|upright| {
            let step = FRAC_PI_2 / TURNS as f64;
            let others = (1..TURNS).filter_map(|k| search.select(k as f64 * step, most));
            let best = others.fold(upright.clone(), |a, b| if by_axes(&b) < by_axes(&a) { b } else { a });
            let best = search.turn(best, step);
            (if by_axes(&best) < by_axes(&upright) { best } else { upright }).law()
        });
        [along_axes, central_law(&search)]
    });
    let laws = laws.into_iter().flatten().flatten();
    laws.min_by(|a, b| priced(a.cost, a.numbers).total_cmp(&priced(b.cost, b.numbers)))
}

/// A sum of terms along axes of its own.
#[derive(Clone)]
struct Sparse {
    force: bool,
    /// Of the first axis against x (rad).
    angle: f64,
    /// Indices of the terms, and their amplitudes.
    terms: Vec<usize>,
    amplitudes: Vec<f64>,
    cost: f64,
    elsewhere: f64,
}

impl Sparse {
    fn directed(&self) -> bool {
        self.terms.iter().any(|&k| TERMS[k].directed())
    }

    fn numbers(&self) -> usize {
        self.terms.len() + usize::from(self.angle != 0.0 && self.directed())
    }

    fn law(&self) -> ResidualLaw {
        ResidualLaw { text: self.text(), numbers: self.numbers(), cost: self.cost, elsewhere: self.elsewhere }
    }

    fn text(&self) -> String {
        let turned = self.angle != 0.0 && self.directed();
        let side = |text: fn(&Term) -> &'static str| {
            let parts = self.terms.iter().enumerate().filter(|(_, k)| !text(&TERMS[**k]).is_empty());
            let name = |k: usize| {
                if turned { along_own_axes(text(&TERMS[k]), self.angle) } else { text(&TERMS[k]).into() }
            };
            let sum: Vec<String> = parts.map(|(i, k)| format!("c{}*({})", i + 1, name(*k))).collect();
            let sum = if sum.is_empty() { "0".to_string() } else { sum.join(" + ") };
            if self.force { format!("({sum})/m") } else { sum }
        };
        let (ax, ay) = (side(|t| t.x), side(|t| t.y));
        let amplitudes: String =
            self.amplitudes.iter().enumerate().map(|(i, a)| format!("let c{} = {a:.4e}; ", i + 1)).collect();
        if !turned {
            return format!("{amplitudes}ax = {ax}; ay = {ay}");
        }
        let (s, c) = self.angle.sin_cos();
        format!("{amplitudes}ax = {c:.4}*({ax}) - {s:.4}*({ay}); ay = {s:.4}*({ax}) + {c:.4}*({ay})")
    }
}

/// A term's text with x, y, vx, vy along the law's own axes, which are turned by `angle` (rad).
fn along_own_axes(text: &str, angle: f64) -> String {
    let (s, c) = angle.sin_cos();
    let renamed = |word: &str| match word {
        "x" | "vx" => format!("({c:.4}*{word} + {s:.4}*{})", word.replace('x', "y")),
        "y" | "vy" => format!("({c:.4}*{word} - {s:.4}*{})", word.replace('y', "x")),
        other => other.to_string(),
    };
    let (mut out, mut word) = (String::new(), String::new());
    for c in text.chars() {
        if c.is_ascii_alphabetic() {
            word.push(c);
        } else {
            out += &renamed(&word);
            word.clear();
            out.push(c);
        }
    }
    out + &renamed(&word)
}

/// What the terms are fitted to.
pub(super) struct Search<'a> {
    pub lens: &'a Lens<'a>,
    pub models: &'a [Model],
    pub projector: &'a Projector,
    pub start: f64,
    /// Whether it is a force, or the same acceleration for all masses.
    pub force: bool,
}

impl Search<'_> {
    /// The column of a term along axes turned by `angle`.
    fn column(&self, term: &Term, angle: f64) -> DVector<f64> {
        let (s, c) = angle.sin_cos();
        let into = |v: Vec2| vec2(c * v.x + s * v.y, c * v.y - s * v.x);
        self.lens.column(self.models, self.force, |k, t| {
            let own = Kinematics { position: into(k.position), velocity: into(k.velocity), ..*k };
            let value = (term.value)(&own, t);
            vec2(c * value.x - s * value.y, s * value.x + c * value.y)
        })
    }

    /// Forward selection along axes turned by `angle`.
    fn select(&self, angle: f64, most: usize) -> Option<Sparse> {
        let all: Vec<_> = TERMS.iter().map(|t| self.column(t, angle)).collect();
        let degrees = self.lens.degrees_of_freedom().max(1) as f64;
        let unexplained = self.unexplained()?;
        let joined =
            |with: &[usize]| DMatrix::from_columns(&with.iter().map(|&c| all[c].clone()).collect::<Vec<_>>());
        let mut chosen: Vec<usize> = vec![];
        let mut best = (0.0, vec![]);
        while chosen.len() < most {
            let tried = (0..TERMS.len()).filter(|k| !chosen.contains(k)).filter_map(|k| {
                let with: Vec<usize> = chosen.iter().copied().chain([k]).collect();
                let (cost, amplitudes) = self.lens.joint(self.projector, self.start, &joined(&with))?;
                Some((unexplained - cost, amplitudes.as_slice().to_vec(), k))
            });
            let Some((gain, amplitudes, k)) = tried.max_by(|a, b| a.0.total_cmp(&b.0)) else { break };
            let remains = ((unexplained - gain) / degrees).max(1.0);
            if (gain - best.0) / remains < PROOF + degrees.ln() {
                break;
            }
            chosen.push(k);
            best = (gain, amplitudes);
        }
        if chosen.is_empty() {
            return None;
        }
        let elsewhere = self.elsewhere(&joined(&chosen), &best.1);
        let (force, cost) = (self.force, unexplained - best.0);
        Some(Sparse { force, angle, terms: chosen, amplitudes: best.1, cost, elsewhere })
    }

    /// The same terms along axes that are turned further, by less and less, while the cost falls.
    fn turn(&self, mut best: Sparse, step: f64) -> Sparse {
        for halving in 1..=HALVINGS {
            for side in [-1.0, 1.0] {
                let angle = best.angle + side * step * 0.5f64.powi(halving);
                let columns: Vec<_> = best.terms.iter().map(|&k| self.column(&TERMS[k], angle)).collect();
                let columns = DMatrix::from_columns(&columns);
                let Some((cost, amplitudes)) = self.lens.joint(self.projector, self.start, &columns) else {
                    continue;
                };
                if cost < best.cost {
                    let amplitudes = amplitudes.as_slice().to_vec();
                    let elsewhere = self.elsewhere(&columns, &amplitudes);
                    best = Sparse { angle, amplitudes, cost, elsewhere, ..best };
                }
            }
        }
        best
    }

    pub fn unexplained(&self) -> Option<f64> {
        let none = DMatrix::zeros(self.projector.residual.len(), 0);
        Some(self.lens.joint(self.projector, self.start, &none)?.0)
    }

    /// Fall of chi-square on all tracks but the one that gains most.
    pub fn elsewhere(&self, columns: &DMatrix<f64>, amplitudes: &[f64]) -> f64 {
        let none = DMatrix::zeros(self.projector.residual.len(), 0);
        let before = self.lens.by_track(&self.projector.moved(&none, &[]));
        let after = self.lens.by_track(&self.projector.moved(columns, amplitudes));
        let falls: Vec<f64> = before.iter().zip(&after).map(|(b, a)| b.0 - a.0).collect();
        falls.iter().sum::<f64>() - falls.iter().copied().fold(0.0, f64::max)
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::TERMS;
    use crate::body::{Body, Wrench};
    use crate::effects::formula::Formula;
    use crate::num::{Vec2, vec2};
    use crate::scene::Shape;
    use crate::world::Kinematics;

    /// Asserts that a law's text gives the acceleration that it was fitted as.
    pub fn agrees(text: &str, position: Vec2, velocity: Vec2, value: impl Fn(&Kinematics<f64>, f64) -> Vec2) {
        let k = Kinematics { position, velocity, yaw: 0.2, spin: 0.9, roll: Vec2::zero() };
        let body = Body {
            shape: Shape::Disc { radius: 0.2 },
            mass: 1.0,
            position: k.position,
            yaw: k.yaw,
            velocity,
            spin: k.spin,
            roll: k.roll,
        };
        let formula = Formula::new(text, vec![]).expect("it is one");
        let parameters: Vec<f64> = formula.parameters.iter().map(|p| p.default).collect();
        let law = formula.read().expect("it is one");
        let mut out = Wrench::zero();
        assert!(law.force(&parameters, 1.7, &body, &mut out), "{text} at {position:?}, {velocity:?}");
        assert!((out.force - value(&k, 1.7)).norm() < 1e-12, "{text} at {position:?}, {velocity:?}");
    }

    #[test]
    fn what_a_term_is_fitted_as_is_what_its_text_says_at_rest_too() {
        for velocity in [vec2(0.3, -0.7), vec2(0.004, 0.001), Vec2::zero()] {
            for term in &TERMS {
                let side = |text: &str| if text.is_empty() { "0".to_string() } else { text.to_string() };
                let text = format!("ax = {}; ay = {}", side(term.x), side(term.y));
                agrees(&text, vec2(1.1, -0.4), velocity, term.value);
            }
        }
    }
}
