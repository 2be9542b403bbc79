//! A law that no library lists: a sparse sum of generic terms that explains the residual acceleration.

use super::central::{central_laws, other_shapes};
use super::free::FreeParameter;
use super::user_formula::refitted;
use super::wave::wave;
use super::weak_form::{LensFit, Projector, WeakFormRegression};
use crate::effects::EFFECTS;
use crate::num::{Vec2, elementary, vec2};
use crate::world::{Kinematics, Model};
use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;
use std::f64::consts::FRAC_PI_2;

/// Most terms of a formula.
pub const MOST_TERMS: usize = 6;
/// Most terms of a formula that contradicts a law of the library: a longer one could imitate any.
pub const SIMPLE_TERMS: usize = 2;
/// Directions of a law's own axes that are tried, and how often the distance between two of them is halved.
const TURNS: usize = 9;
const HALVINGS: i32 = 6;
/// Fall of chi-square, in units of what remains, that a term must bring beyond its price.
const PROOF: f64 = 20.0;

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

    /// Whether it is an effect of the library by itself.
    fn is_in_library(&self) -> bool {
        EFFECTS.iter().any(|e| e.profile.formula_terms.contains(&[self.x, self.y]))
    }
}

/// Whether one effect of the library has all of these terms, given by their indices.
fn is_an_effect(terms: &[usize]) -> bool {
    let has = |own: &[[&str; 2]]| terms.iter().all(|&k| own.contains(&[TERMS[k].x, TERMS[k].y]));
    EFFECTS.iter().any(|e| has(e.profile.formula_terms))
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
    Term { x: "x^3", y: "", value: |k, _| vec2(elementary::powi(k.position.x, 3), 0.0) },
    Term { x: "", y: "y^3", value: |k, _| vec2(0.0, elementary::powi(k.position.y, 3)) },
    Term { x: "x^2", y: "", value: |k, _| vec2(elementary::powi(k.position.x, 2), 0.0) },
    Term { x: "", y: "y^2", value: |k, _| vec2(0.0, elementary::powi(k.position.y, 2)) },
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
    pub gain_without_best_track: f64,
    /// Whether the library has none of its terms.
    pub not_in_library: bool,
    /// Whether it is one effect of the library in other words.
    pub in_library: bool,
}

/// The sparse law beside the models' own, as `let c1 = ...; ax = ...; ay = ...` with accelerations in m/s^2 (of a body that
/// does not roll) of at most `most` terms, or about a centre, which `place` may be, or a wave if `waves` may be; `None` where
/// no term proves itself.
pub fn residual_law(
    lens: &WeakFormRegression,
    models: &[Model],
    free: &[FreeParameter],
    seen: &LensFit,
    most: usize,
    waves: bool,
    place: Option<Vec2>,
) -> Option<ResidualLaw> {
    let projector = lens.projector(models, free, &seen.values)?;
    let degrees = lens.degrees_of_freedom().max(1) as f64;
    let priced = |cost: f64, numbers: usize| cost + numbers as f64 * elementary::ln(degrees);
    let by_axes = |l: &Sparse| priced(l.cost, l.numbers());
    // The same law for all masses, or a force, along any axes or about any centre: the data say which.
    let [of_mass, of_force] = [false, true].map(|force| FormulaSearch {
        lens,
        models,
        projector: &projector,
        start: seen.cost,
        force,
    });
    let laws = [&of_mass, &of_force].map(|search| {
        let along_axes = search.select(0.0, most).map(|upright| {
            let step = FRAC_PI_2 / TURNS as f64;
            let others = (1..TURNS).filter_map(|k| search.select(k as f64 * step, most));
            let best = others.fold(upright.clone(), |a, b| if by_axes(&b) < by_axes(&a) { b } else { a });
            let best = search.thinned(search.turn(best, step));
            search.law(if by_axes(&best) < by_axes(&upright) { best } else { upright })
        });
        central_laws(search, place).into_iter().chain(along_axes).chain(waves.then(|| wave(search)).flatten())
    });
    let cheaper =
        |a: &ResidualLaw, b: &ResidualLaw| priced(a.cost, a.numbers).total_cmp(&priced(b.cost, b.numbers));
    let refitted = |laws: Vec<ResidualLaw>| -> Vec<ResidualLaw> {
        laws.par_iter().filter_map(|l| refitted(lens, models, l)).collect()
    };
    // Each by itself, so that both have their best shape.
    let laws = laws.map(|laws| {
        let mut laws = refitted(laws.collect());
        laws.sort_by(cheaper);
        let shaped = laws.iter().map(other_shapes).find(|shaped| !shaped.is_empty());
        (laws.into_iter().next(), shaped.unwrap_or_default())
    });
    let (plain, shaped): (Vec<_>, Vec<_>) = laws.into_iter().unzip();
    let plain = plain.into_iter().flatten().min_by(cheaper)?;
    let shaped = refitted(shaped.concat()).into_iter().min_by(cheaper);
    Some(shaped.filter(|s| of_force.proves(plain.cost - s.cost, s.cost, 1)).unwrap_or(plain))
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
}

impl Sparse {
    fn directed(&self) -> bool {
        self.terms.iter().any(|&k| TERMS[k].directed())
    }

    fn numbers(&self) -> usize {
        self.terms.len() + usize::from(self.angle != 0.0 && self.directed())
    }

    fn text(&self) -> String {
        let turned = self.angle != 0.0 && self.directed();
        let own = |text: &str| if turned { along_own_axes(text) } else { text.to_string() };
        // What acts along one axis, if anything does.
        let side = |text: fn(&Term) -> &'static str| {
            let terms = self.terms.iter().enumerate().map(|(i, &k)| (i + 1, text(&TERMS[k])));
            let sum: Vec<String> =
                terms.filter(|t| !t.1.is_empty()).map(|(i, text)| format!("c{i}*({})", own(text))).collect();
            let sum = (!sum.is_empty()).then(|| sum.join(" + "))?;
            Some(if self.force { format!("({sum})/m") } else { sum })
        };
        let (along, across) = (side(|t| t.x), side(|t| t.y));
        let part = |factor: &str, of: &Option<String>| of.as_ref().map(|of| format!("{factor}*({of})"));
        let (ax, ay) = match turned {
            false => (along, across),
            true => (
                sum_of([part("cos(turn)", &along), part("-sin(turn)", &across)]),
                sum_of([part("sin(turn)", &along), part("cos(turn)", &across)]),
            ),
        };
        let amplitudes = self.amplitudes.iter().enumerate();
        let mut text: String = amplitudes.map(|(i, a)| format!("let c{} = {a:.4e}; ", i + 1)).collect();
        if turned {
            text += &format!("let turn [rad] = {:.4}; ", self.angle);
        }
        let sides = [("ax", ax), ("ay", ay)].into_iter();
        text + &sides
            .filter_map(|(name, of)| Some(format!("{name} = {}", of?)))
            .collect::<Vec<_>>()
            .join("; ")
    }
}

fn sum_of(parts: [Option<String>; 2]) -> Option<String> {
    let parts: Vec<String> = parts.into_iter().flatten().collect();
    (!parts.is_empty()).then(|| parts.join(" + "))
}

/// A term's text with x, y, vx, vy along the law's own axes, which are turned by the parameter `turn`.
fn along_own_axes(text: &str) -> String {
    let renamed = |word: &str| match word {
        "x" | "vx" => format!("(cos(turn)*{word} + sin(turn)*{})", word.replace('x', "y")),
        "y" | "vy" => format!("(cos(turn)*{word} - sin(turn)*{})", word.replace('y', "x")),
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
pub(super) struct FormulaSearch<'a> {
    pub lens: &'a WeakFormRegression<'a>,
    pub models: &'a [Model],
    pub projector: &'a Projector,
    pub start: f64,
    /// Whether it is a force, or the same acceleration for all masses.
    pub force: bool,
}

impl FormulaSearch<'_> {
    /// The column of a term along axes turned by `angle`.
    fn column(&self, term: &Term, angle: f64) -> DVector<f64> {
        let (s, c) = elementary::sin_cos(angle);
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
        let unexplained = self.unexplained()?;
        let joined =
            |with: &[usize]| DMatrix::from_columns(&with.iter().map(|&c| all[c].clone()).collect::<Vec<_>>());
        let mut chosen: Vec<usize> = vec![];
        let mut best = 0.0;
        while chosen.len() < most {
            let tried = (0..TERMS.len()).filter(|k| !chosen.contains(k)).filter_map(|k| {
                let with: Vec<usize> = chosen.iter().copied().chain([k]).collect();
                Some((unexplained - self.lens.joint(self.projector, self.start, &joined(&with))?.0, k))
            });
            let Some((gain, k)) = tried.max_by(|a, b| a.0.total_cmp(&b.0)) else { break };
            if !self.proves(gain - best, unexplained - gain, 1) {
                break;
            }
            chosen.push(k);
            best = gain;
        }
        if chosen.is_empty() { None } else { self.fitted(chosen, angle) }
    }

    /// Whether a fall of chi-square to `left` proves so many numbers.
    pub fn proves(&self, fall: f64, left: f64, numbers: usize) -> bool {
        let degrees = self.lens.degrees_of_freedom().max(1) as f64;
        fall / (left / degrees).max(1.0) >= PROOF + numbers as f64 * elementary::ln(degrees)
    }

    fn columns(&self, terms: &[usize], angle: f64) -> DMatrix<f64> {
        DMatrix::from_columns(&terms.iter().map(|&k| self.column(&TERMS[k], angle)).collect::<Vec<_>>())
    }

    /// Some terms along axes turned by `angle`.
    fn fitted(&self, terms: Vec<usize>, angle: f64) -> Option<Sparse> {
        let (cost, amplitudes) = self.lens.joint(self.projector, self.start, &self.columns(&terms, angle))?;
        let amplitudes = amplitudes.as_slice().to_vec();
        Some(Sparse { force: self.force, angle, terms, amplitudes, cost })
    }

    fn law(&self, law: Sparse) -> ResidualLaw {
        let gain_without_best_track =
            self.gain_without_best_track(&self.columns(&law.terms, law.angle), &law.amplitudes);
        let not_in_library = !law.terms.iter().any(|k| TERMS[*k].is_in_library());
        // Between bodies of one mass, a force and an acceleration are the same law.
        let in_library = (self.force || self.has_one_mass()) && is_an_effect(&law.terms);
        ResidualLaw {
            text: law.text(),
            numbers: law.numbers(),
            cost: law.cost,
            gain_without_best_track,
            not_in_library,
            in_library,
        }
    }

    /// The same terms along axes that are turned further, by less and less, while the cost falls.
    fn turn(&self, mut best: Sparse, step: f64) -> Sparse {
        for halving in 1..=HALVINGS {
            for side in [-1.0, 1.0] {
                let angle = best.angle + side * step * elementary::powi(0.5f64, halving);
                let turned = self.fitted(best.terms.clone(), angle).filter(|turned| turned.cost < best.cost);
                best = turned.unwrap_or(best);
            }
        }
        best
    }

    /// Without the terms that prove nothing beside the others: the axes at which they were chosen were not the law's yet.
    fn thinned(&self, mut law: Sparse) -> Sparse {
        while law.terms.len() > 1 {
            let without = |k: usize| {
                let mut terms = law.terms.clone();
                terms.remove(k);
                self.fitted(terms, law.angle)
            };
            let fewer = (0..law.terms.len()).filter_map(without).min_by(|a, b| a.cost.total_cmp(&b.cost));
            let Some(fewer) = fewer else { break };
            if self.proves(fewer.cost - law.cost, law.cost, 1) {
                break;
            }
            law = fewer;
        }
        law
    }

    /// Whether all bodies of all models have the same mass.
    fn has_one_mass(&self) -> bool {
        let mut masses = self.models.iter().flat_map(|m| &m.bodies).map(|b| b.mass);
        masses.next().is_none_or(|first| masses.all(|mass| mass == first))
    }

    pub fn unexplained(&self) -> Option<f64> {
        let none = DMatrix::zeros(self.projector.residual.len(), 0);
        Some(self.lens.joint(self.projector, self.start, &none)?.0)
    }

    /// Fall of chi-square on all tracks but the one that gains most.
    pub fn gain_without_best_track(&self, columns: &DMatrix<f64>, amplitudes: &[f64]) -> f64 {
        let none = DMatrix::zeros(self.projector.residual.len(), 0);
        let before = self.lens.by_track(&self.projector.moved(&none, &[]));
        let after = self.lens.by_track(&self.projector.moved(columns, amplitudes));
        let falls: Vec<f64> = before.iter().zip(&after).map(|(b, a)| b.0 - a.0).collect();
        falls.iter().sum::<f64>() - falls.iter().copied().fold(0.0, f64::max)
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::super::tests::{CUBE, DISC, film_under, models};
    use super::super::weak_form::fit_forces;
    use super::*;
    use crate::body::{Body, Wrench};
    use crate::effects::formula::Formula;
    use crate::scene::Shape;
    use crate::world::ActiveEffect;

    /// As the terms of the library say of themselves: wind, drag, lateral force, friction, Magnus.
    #[test]
    fn terms_of_the_library_are_terms_of_the_search() {
        for known in [0, 1, 6, 7, 8, 10, 12] {
            assert!(TERMS[known].is_in_library(), "{}", TERMS[known].x);
        }
        assert!(!TERMS[11].is_in_library(), "a lateral force by speed");
        for [x, y] in EFFECTS.iter().flat_map(|e| e.profile.formula_terms) {
            assert!(TERMS.iter().any(|t| (t.x, t.y) == (*x, *y)), "{x} {y}");
        }
    }

    #[test]
    fn a_drag_by_its_terms_is_the_effect_of_the_library() {
        assert!(is_an_effect(&[6]) && is_an_effect(&[0, 1]));
        assert!(!is_an_effect(&[6, 8]), "two drags are two effects");
        assert!(!is_an_effect(&[13]), "drag along one axis alone");
        let launches = [vec![(DISC, 1.0, [-1.5, 0.4], [0.9, 0.1]), (DISC, 1.0, [1.4, -1.0], [-0.2, 0.8])]];
        let scenes = film_under(&launches, |_| {});
        let lens = WeakFormRegression::new(&scenes);
        for (mass, is_one) in [(1.0, true), (2.0, false)] {
            let mut models = models(&scenes);
            models[0].bodies[1].mass = mass;
            let (free, seen) = fit_forces(&lens, &models);
            let projector = &lens.projector(&models, &free, &seen.values).expect("it is determined");
            for force in [true, false] {
                let search =
                    FormulaSearch { lens: &lens, models: &models, projector, start: seen.cost, force };
                let drag = search.law(search.fitted(vec![6], 0.0).expect("it is determined"));
                assert_eq!(drag.in_library, is_one || force, "mass {mass}, a force: {force}");
            }
        }
    }

    #[test]
    fn a_law_along_axes_of_its_own_is_what_its_text_says() {
        let angle: f64 = 0.7;
        let (position, velocity) = (vec2(1.1, -0.4), vec2(0.3, -0.7));
        for terms in [vec![6, 13], vec![3], vec![14, 19, 20]] {
            let amplitudes: Vec<f64> = terms.iter().map(|&k| 0.5 + k as f64).collect();
            let sum = |k: &Kinematics<f64>, t: f64| {
                let own = |v: Vec2| v.unrotated(Vec2::from_angle(angle));
                let k = Kinematics { position: own(k.position), velocity: own(k.velocity), ..*k };
                let each = terms.iter().zip(&amplitudes).map(|(&n, a)| (TERMS[n].value)(&k, t).scaled(*a));
                each.fold(Vec2::zero(), |a, b| a + b).rotated(Vec2::from_angle(angle))
            };
            let law = Sparse {
                force: false,
                angle,
                terms: terms.clone(),
                amplitudes: amplitudes.clone(),
                cost: 0.0,
            };
            agrees(&law.text(), position, velocity, sum);
        }
    }

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

    #[test]
    fn a_drag_along_one_axis_needs_no_term_beside_it() {
        let launches = [
            vec![(DISC, 0.6, [-1.5, 0.4], [0.9, 0.1]), (CUBE, 1.2, [1.4, -1.0], [-0.2, 0.8])],
            vec![(DISC, 0.6, [0.2, 1.6], [0.4, -0.6]), (CUBE, 1.2, [-1.2, -1.3], [0.7, 0.2])],
        ];
        let across = "(cos(0.58)*vy - sin(0.58)*vx)";
        let text = format!("fx = 0.2*sin(0.58)*{across}; fy = -0.2*cos(0.58)*{across}");
        let scenes = film_under(&launches, |model| {
            let formula = Formula::new(&text, vec![]).expect("it is one");
            let active = ActiveEffect::of_formula("drag", formula, &model.bodies);
            model.effects.push(active.expect("it is one"));
        });
        let (lens, models) = (WeakFormRegression::new(&scenes), models(&scenes));
        let (free, seen) = fit_forces(&lens, &models);
        let projector = &lens.projector(&models, &free, &seen.values).expect("it is determined");
        let search = FormulaSearch { lens: &lens, models: &models, projector, start: seen.cost, force: true };
        let [drag, beside] = [14, 7];
        let law = search.thinned(search.fitted(vec![drag, beside], 0.58).expect("it is determined"));
        assert_eq!(law.terms, [drag], "{}", law.text());
        let turned = search.thinned(search.fitted(vec![drag, 13], 0.9).expect("it is determined"));
        assert_eq!(turned.terms, [drag, 13], "along other axes both are needed: {}", turned.text());
    }
}
