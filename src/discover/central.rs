//! A law about a centre that no library lists: what pulls, pushes or swirls by the distance from a place nobody told.

use super::formula::{FormulaSearch, ResidualLaw, Term};
use super::screen::region;
use crate::num::{Vec2, elementary, vec2};
use crate::world::Kinematics;
use nalgebra::DMatrix;

/// Centres that are tried along each coordinate, and how often the distance between two of them is halved.
const PLACES: usize = 7;
const HALVINGS: i32 = 8;
/// An amplitude and a place.
const NUMBERS: usize = 3;

/// Terms of the place against the centre, (X, Y), at the distance D.
const TERMS: [Term; 5] = [
    Term { x: "X/max(D, 0.05)", y: "Y/max(D, 0.05)", value: |k, _| k.position.scaled(1.0 / apart(k)) },
    Term {
        x: "X/max(D, 0.05)^2",
        y: "Y/max(D, 0.05)^2",
        value: |k, _| k.position.scaled(1.0 / elementary::powi(apart(k), 2)),
    },
    Term { x: "X*D", y: "Y*D", value: |k, _| k.position.scaled(k.position.norm()) },
    Term { x: "-Y", y: "X", value: |k, _| k.position.perp() },
    Term {
        x: "-Y/max(D, 0.05)^2",
        y: "X/max(D, 0.05)^2",
        value: |k, _| k.position.perp().scaled(1.0 / elementary::powi(apart(k), 2)),
    },
];

/// How many of the terms pull or push.
const RADIAL: usize = 3;

/// Other shapes over the distance: what they declare, and their sides.
const SHAPES: [(&str, &str, &str); 3] = [
    ("let n = -2 from -6 to 4", "X*max(D, 0.05)^n", "Y*max(D, 0.05)^n"),
    ("let w [m] = 1 from 0.05 to 20", "X*exp(-(D/w)^2)", "Y*exp(-(D/w)^2)"),
    // What is spread around the centre pulls in the plane like this.
    ("let w [m] = 0.3 from 0.05 to 20", "X/(D^2 + w^2)", "Y/(D^2 + w^2)"),
];

/// A formula has a value at the centre, too.
fn apart(k: &Kinematics<f64>) -> f64 {
    k.position.norm().max(0.05)
}

/// One term about a centre.
#[derive(Clone)]
struct Central {
    term: usize,
    centre: Vec2,
    amplitude: f64,
    cost: f64,
}

/// Each term about its best centre within the region of the data, if it proves itself. What pulls or pushes strongly bends the models'
/// numbers far: the search, which is linear, may miss its centre, and a `place` that is known is tried beside.
pub fn central_laws(search: &FormulaSearch, place: Option<Vec2>) -> Vec<ResidualLaw> {
    let Some(none) = search.unexplained() else { return vec![] };
    let area = region(search.lens.scenes);
    let step = (area.high - area.low).scaled(1.0 / (PLACES - 1) as f64);
    let place_of = |k: usize| {
        let (i, j) = ((k % PLACES) as f64, (k / PLACES) as f64);
        vec2(area.low.x + i * step.x, area.low.y + j * step.y)
    };
    let of_term = |term: usize| {
        let tried = (0..PLACES * PLACES).filter_map(|k| about(search, term, place_of(k)));
        let best = nearer_centre(search, tried.min_by(|a, b| a.cost.total_cmp(&b.cost))?, step);
        search.proves(none - best.cost, best.cost, NUMBERS).then_some(best)
    };
    let here = |term: usize| about(search, term, place?);
    let law = |best: Central| {
        let gain_without_best_track =
            search.gain_without_best_track(&column(search, best.term, best.centre), &[best.amplitude]);
        let text = best.text(search.force);
        ResidualLaw {
            text,
            numbers: NUMBERS,
            cost: best.cost,
            gain_without_best_track,
            not_in_library: true,
            in_library: false,
        }
    };
    let found: Vec<Central> = (0..TERMS.len()).filter_map(of_term).collect();
    // Where no centre explains anything, none does there.
    let radial = if found.is_empty() { 0 } else { RADIAL };
    found.into_iter().chain((0..radial).filter_map(here)).map(law).collect()
}

/// A law that pulls or pushes, with other shapes over the distance, each of one number more; none of another law.
pub fn other_shapes(law: &ResidualLaw) -> Vec<ResidualLaw> {
    let amplified = |[x, y]: [&str; 2]| [x, y].map(|side| format!("c1*({})", about_centre(side)));
    let radial = TERMS[..RADIAL].iter().map(|t| amplified([t.x, t.y]));
    let Some(own) = radial.into_iter().find(|own| own.iter().all(|side| law.text.contains(side))) else {
        return vec![];
    };
    let other = |(declared, x, y): &(&str, &str, &str)| {
        let sides = own.iter().zip(amplified([x, y]));
        let text = sides.fold(law.text.clone(), |text, (old, new)| text.replace(old, &new));
        ResidualLaw { text: format!("{declared}; {text}"), numbers: NUMBERS + 1, ..law.clone() }
    };
    SHAPES.iter().map(other).collect()
}

/// A side of a term in the variables of a formula.
fn about_centre(side: &str) -> String {
    side.replace('D', "sqrt(X^2 + Y^2)").replace('X', "(x - cx)").replace('Y', "(y - cy)")
}

impl Central {
    fn text(&self, force: bool) -> String {
        let (Central { centre, amplitude, .. }, term) = (self, &TERMS[self.term]);
        let side = |text: &str| {
            let text = about_centre(text);
            if force { format!("c1*({text})/m") } else { format!("c1*({text})") }
        };
        format!(
            "let c1 = {amplitude:.4e}; let cx [m] = {:.4}; let cy [m] = {:.4}; ax = {}; ay = {}",
            centre.x,
            centre.y,
            side(term.x),
            side(term.y)
        )
    }
}

fn column(search: &FormulaSearch, term: usize, centre: Vec2) -> DMatrix<f64> {
    let value = |k: &Kinematics<f64>, t: f64| {
        (TERMS[term].value)(&Kinematics { position: k.position - centre, ..*k }, t)
    };
    DMatrix::from_columns(&[search.lens.column(search.models, search.force, value)])
}

fn about(search: &FormulaSearch, term: usize, centre: Vec2) -> Option<Central> {
    let (cost, amplitudes) =
        search.lens.joint(search.projector, search.start, &column(search, term, centre))?;
    Some(Central { term, centre, amplitude: amplitudes[0], cost })
}

/// The same term about centres that are nearer and nearer, while the cost falls.
fn nearer_centre(search: &FormulaSearch, mut best: Central, step: Vec2) -> Central {
    for halving in 1..=HALVINGS {
        let step = step.scaled(elementary::powi(0.5f64, halving));
        let ways = [vec2(step.x, 0.0), vec2(-step.x, 0.0), vec2(0.0, step.y), vec2(0.0, -step.y)];
        for way in ways.into_iter().cycle().take(2 * ways.len()) {
            if let Some(tried) = about(search, best.term, best.centre + way)
                && tried.cost < best.cost
            {
                best = tried;
            }
        }
    }
    best
}

#[cfg(test)]
mod tests {
    use super::super::formula::{SIMPLE_TERMS, residual_law, tests::agrees};
    use super::super::tests::{CUBE, DISC, film_under, models};
    use super::super::weak_form::{WeakFormRegression, fit_forces};
    use super::*;
    use crate::effects::formula::Formula;
    use crate::world::ActiveEffect;

    #[test]
    fn a_pull_that_falls_with_the_distance_is_found_with_its_centre() {
        let launches = [
            vec![(DISC, 0.6, [-1.5, 0.4], [0.7, 0.1]), (CUBE, 1.2, [1.4, -1.0], [-0.2, 0.5])],
            vec![(DISC, 0.6, [0.2, 1.6], [0.3, -0.3]), (CUBE, 1.2, [-1.2, -1.3], [0.4, 0.1])],
        ];
        let near = "max((0.4 - x)^2 + (-0.3 - y)^2, 0.0025)";
        let shapes = [
            (near.to_string(), None),
            (format!("{near}^1.5"), Some(("n", -3.0, 0.15))),
            (format!("({near} + 0.09)"), Some(("w", 0.3, 0.02))),
        ];
        for (over, shape) in shapes {
            let pull = |side: &str| format!("0.2*({side})/{over}");
            let text = format!("fx = {}; fy = {}", pull("0.4 - x"), pull("-0.3 - y"));
            let scenes = film_under(&launches, |model| {
                let formula = Formula::new(&text, vec![]).expect("it is one");
                let active = ActiveEffect::of_formula("pull", formula, &model.bodies);
                model.effects.push(active.expect("it is one"));
            });
            let (lens, models) = (WeakFormRegression::new(&scenes), models(&scenes));
            let (free, seen) = fit_forces(&lens, &models);
            let law = residual_law(&lens, &models, &free, &seen, SIMPLE_TERMS, true, None)
                .expect("it proves itself");
            let found = Formula::new(&law.text, vec![]).expect("it is one").parameters;
            let number = |name: &str| found.iter().find(|p| p.name == name).expect(&law.text).default;
            for (name, truth) in [("c1", -0.2), ("cx", 0.4), ("cy", -0.3)] {
                assert!((number(name) - truth).abs() < 0.02, "{}", law.text);
            }
            assert_eq!(law.numbers, NUMBERS + usize::from(shape.is_some()), "{}", law.text);
            assert!(
                shape.is_none_or(|(name, truth, off)| (number(name) - truth).abs() < off),
                "{}",
                law.text
            );
        }
    }

    #[test]
    fn what_a_term_is_fitted_as_is_what_its_text_says_at_the_centre_too() {
        for (term, Term { value, .. }) in TERMS.iter().enumerate() {
            for offset in [vec2(0.4, -0.9), vec2(0.01, 0.02), Vec2::zero()] {
                let centre = vec2(0.7, 0.5);
                let law = Central { term, centre, amplitude: 1.0, cost: 0.0 }.text(false);
                agrees(&law, centre + offset, vec2(0.3, 0.1), |k, t| {
                    value(&Kinematics { position: k.position - centre, ..*k }, t)
                });
            }
        }
    }
}
