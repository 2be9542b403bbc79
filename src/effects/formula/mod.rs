//! The user's own law: formulas for accelerations, forces and torque, read from text.

mod error;
mod hint;
mod parameter;
mod parser;
mod program;
mod unit;
mod units_check;

pub use error::{FormulaError, MOST_PARAMETERS};
pub use parameter::FormulaParameter;
pub use program::{ForceAndTorque, FormulaProgram};
use unit::is_unit;
use units_check::with_units;

use error::LONGEST;
use parser::Parser;
use serde::{Deserialize, Serialize};

/// A law as its user writes it: `ax = -k * vx * speed; ay = -k * vy * speed`.
///
/// Left of `=` stand `ax`, `ay` (m/s^2), `fx`, `fy` (N) or `torque` (N m); right of it numbers, `pi`, parameters, the
/// variables x y (m), vx vy speed (m/s), yaw (rad), spin (rad/s), t (s), m (kg), r (m, of the circle around the shape),
/// `+ - * / ^`, and the functions sin cos tan exp ln sqrt tanh abs sign min max. Lines or `;` part the formulas,
/// and what follows a `#` on its line is a comment. A text
/// may declare its parameters itself, before it uses them: `let k [1/m] = 0.1 from 0 to 5` (unit, start and bounds may
/// be left out). A unit is made of SI symbols with * / and ^; one that is left out follows from the formula, and one that
/// contradicts it is an error.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Formula {
    pub text: String,
    /// Without any, the numbers in the text stay as they are.
    pub parameters: Vec<FormulaParameter>,
}

impl Formula {
    /// The law of a text with these parameters and those that the text declares.
    pub fn new(text: &str, given: Vec<FormulaParameter>) -> Result<Formula, FormulaError> {
        let mut formula = Formula { text: text.to_string(), parameters: given };
        let (program, declared) = formula.parse(true)?;
        if let Some(p) = formula.parameters.iter().find(|p| !is_unit(&p.unit)) {
            return Err(FormulaError::Unit { name: p.name.clone(), unit: p.unit.clone() });
        }
        if let Some(p) = declared.iter().find(|p| formula.parameters.iter().any(|q| q.name == p.name)) {
            let problem = "is declared in the text and beside it; declare it once";
            return Err(FormulaError::Parameter { name: p.name.clone(), problem });
        }
        formula.parameters.extend(declared);
        formula.check_count()?;
        formula.parameters = with_units(&program, formula.parameters)?;
        Ok(formula)
    }

    /// Reads the text and checks the parameters, which are all given. Units are those that it was made with.
    pub fn read(&self) -> Result<FormulaProgram, FormulaError> {
        let (program, declared) = self.parse(false)?;
        match declared.into_iter().find(|p| self.parameters.iter().all(|q| q.name != p.name)) {
            Some(p) => Err(FormulaError::Parameter { name: p.name, problem: "is not among the parameters" }),
            None => Ok(program),
        }
    }

    fn check_count(&self) -> Result<(), FormulaError> {
        match self.parameters.len() {
            0..=MOST_PARAMETERS => Ok(()),
            count => Err(FormulaError::Count { count }),
        }
    }

    /// The program, and the parameters that the text declares; whether their units are units is asked of a `new` text only.
    fn parse(&self, new: bool) -> Result<(FormulaProgram, Vec<FormulaParameter>), FormulaError> {
        self.check_count()?;
        for (i, p) in self.parameters.iter().enumerate() {
            if let Some(problem) = p.problem(&self.parameters[..i]) {
                return Err(FormulaError::Parameter { name: p.name.clone(), problem });
            }
        }
        if self.text.len() > LONGEST {
            return Err(FormulaError::TooLong { bytes: self.text.len() });
        }
        Parser::new(&self.text, &self.parameters, new).program().map_err(|(at, problem)| {
            let before = self.text.get(..at).unwrap_or(&self.text);
            let line = before.matches('\n').count() + 1;
            let column = before.rsplit('\n').next().unwrap_or_default().chars().count() + 1;
            FormulaError::Text { line, column, problem }
        })
    }
}

#[cfg(test)]
mod tests {
    use super::parameter::BOUND;
    use super::program::VARIABLES;
    use super::*;
    use crate::body::{Body, Wrench};
    use crate::num::{Differential, Jet, LANES, Real, Vec2, vec2};
    use crate::scene::Shape;
    use proptest::prelude::*;

    /// x, y, yaw, vx, vy, spin, mass, then k and n.
    const AT: [f64; 9] = [0.4, -0.3, 0.2, 1.2, -0.5, 0.8, 2.0, 0.7, 1.5];
    const TIME: f64 = 0.25;

    fn formula(text: &str) -> Formula {
        let own = |name: &str| FormulaParameter {
            name: name.into(),
            unit: "1".into(),
            default: 0.0,
            min: -9.0,
            max: 9.0,
        };
        Formula { text: text.into(), parameters: vec![own("k"), own("n")] }
    }

    /// Force and torque of a program, if it has a value there.
    fn wrench<T: Real>(program: &FormulaProgram, at: &[T; 9]) -> Option<[T; 3]> {
        let [x, y, yaw, vx, vy, spin, mass, k, n] = *at;
        let body = Body {
            shape: Shape::Disc { radius: 0.2 },
            mass,
            position: vec2(x, y),
            yaw,
            velocity: vec2(vx, vy),
            spin,
            roll: Vec2::zero(),
        };
        let mut out = Wrench::zero();
        let defined = program.force(&[k, n], T::constant(TIME), &body, &mut out);
        defined.then_some([out.force.x, out.force.y, out.torque])
    }

    #[test]
    fn formulas_have_the_values_of_algebra() {
        let check = |text: &str, expected: f64| {
            let program = formula(&format!("fx = {text}")).read().expect(text);
            let found = wrench(&program, &AT).expect(text)[0];
            assert!((found - expected).abs() < 1e-12, "{text}: {found} {expected}");
        };
        check("1 + 2 * 3 - 4 / 8", 6.5);
        check("-2^2 + 2^-1 + 2^3^2", -4.0 + 0.5 + 512.0);
        check("8 - 4 - 2 + 8 / 4 / 2", 3.0);
        check("(1 + 2) * -3e-1 * 1.5E+1", -13.5);
        check("-k * vx * speed", -0.7 * 1.2 * 1.3);
        check("sin(pi / 2) + cos(0) + exp(ln(2)) + sqrt(4) + abs(-1) + tanh(0) + sign(-3)", 6.0);
        check("min(x, y) + max(t, m) + r + yaw * spin + n *\n 2", -0.3 + 2.0 + 0.2 + 0.16 + 3.0);
        let all = formula("ax = 1; ay = x\nfx = 0.5\n\n; torque = spin ;").read().expect("it is right");
        assert_eq!(wrench(&all, &AT), Some([2.5, 0.8, 0.8]));
    }

    #[test]
    fn errors_say_where_and_what() {
        let check = |text: &str, expected: &str| {
            let found = formula(text).read().expect_err(text).to_string();
            assert!(found.starts_with(expected), "{text}: {found}");
        };
        check(
            "ax = -k * wx",
            "line 1, column 11: \"wx\" is no name here (did you mean vx?); known: k n x y vx",
        );
        check(
            "az = 1",
            "line 1, column 1: \"az\" is no left side (did you mean ax?); known: ax ay fx fy torque",
        );
        check("ax = 1\nay = (2 + 3", "line 2, column 12: expected ')', found the end");
        check("ax = 2 3", "line 1, column 8: expected an operator, ';' or the end, found '3'");
        check("ax = ; ay = 1", "line 1, column 6: expected a number, a name or '(', found ';'");
        check("ax = min(1)", "line 1, column 6: min takes 2 arguments, not 1");
        check("ax = 1; ax = 2", "line 1, column 9: ax is given twice");
        check("ax = 1.2.3", "line 1, column 6: expected a number, found '1'");
        check("é = 1", "line 1, column 1: \"'é'\" is no left side");
        check("", "line 1, column 1: expected a formula, such as ax = -0.1*vx, found the end");
        check(&format!("ax = {}1", "(".repeat(500)), "line 1, column 71: nested deeper than 64");
        check(&"ax = 1;".repeat(999), "the formula has 6993 bytes");
        let named = |name: &str| {
            let mut f = formula("ax = 1");
            f.parameters[0].name = name.into();
            f.read().map_err(|e| e.to_string())
        };
        for (name, ok) in [("drag", true), ("speed", false), ("n", false), ("2k", false), ("", false)] {
            assert_eq!(named(name).is_ok(), ok, "{name}");
        }
    }

    #[test]
    fn a_text_may_declare_its_parameters() {
        let declared = |text: &str| Formula::new(text, vec![]).map_err(|e| e.to_string());
        let law =
            declared("let c [1/m] = 0.5 from 0 to 5; let n\nax = -c * vx * speed^n").expect("it is right");
        let own: Vec<_> = law
            .parameters
            .iter()
            .map(|p| (p.name.as_str(), p.unit.as_str(), p.default, p.min, p.max))
            .collect();
        assert_eq!(own, [("c", "1/m", 0.5, 0.0, 5.0), ("n", "1", 0.0, -BOUND, BOUND)]);
        assert_eq!(Formula::new(&law.text, law.parameters.clone()).ok(), None, "each is declared once");
        let beside = Formula { text: "ax = -c * vx * speed^n".into(), ..law.clone() };
        assert_eq!(law.read().map(|p| p.steps), beside.read().map(|p| p.steps));
        let starts = |text: &str| declared(text).map(|l| l.parameters[0].default);
        assert_eq!(starts("let k from 2 to 3; ax = k"), Ok(2.0));
        assert_eq!(starts("let k = -1.5e-1; ax = k"), Ok(-0.15));
        assert!(declared("# a note; ay = 1\n let g = 2 # another\n ax = g + # and so on\n 1").is_ok());
        assert!(declared("ax = 0.3").is_ok_and(|l| l.parameters.is_empty()));
        let check = |text: &str, expected: &str| {
            let found = declared(text).expect_err(text);
            assert!(found.starts_with(expected), "{text}: {found}");
        };
        check("let speed; ax = 1", "line 1, column 5: parameter speed: is a name that is taken");
        check("ax = 1; let k; let k", "line 1, column 20: parameter k: is a name that is taken");
        check("let k = 3 from 0 to 1; ax = k", "line 1, column 5: parameter k: bounds must be finite");
        check("let k [1/m; ax = k", "line 1, column 8: expected ']', found the end");
        check("let = 3", "line 1, column 5: expected a name, found '='");
        check("let k = z", "line 1, column 9: expected a number, found 'z'");
        check("let k from 1; ax = k", "line 1, column 13: expected 'to', found ';'");
        check("ax = k; let k", "line 1, column 6: \"k\" is no name here");
        check("let k", "line 1, column 6: expected a formula, such as ax = -0.1*vx, found the end");
        check(
            "let k = 1; let n [ banana] = 1; ax = k",
            "line 1, column 20: \"banana\" is no unit; known: 1 m s kg",
        );
        assert!(declared("let k [(m/N)^0.5] = 1; let n [] = 1; fx = x / k^2").is_ok());
        // What an earlier build took is still read.
        let odd = Formula { text: "let k [deg] = 1; ax = k".into(), parameters: law.parameters.clone() };
        assert_eq!(
            odd.read().map_err(|e| e.to_string()),
            Err("parameter k: is not among the parameters".into())
        );
        let beside = FormulaParameter { unit: "banana".into(), ..law.parameters[0].clone() };
        let refused = Formula::new("ax = c", vec![beside]).expect_err("no unit").to_string();
        assert!(refused.starts_with("parameter c: \"banana\" is no unit; known: 1 m s kg"), "{refused}");
    }

    #[test]
    fn a_constant_without_a_finite_value_is_refused_when_it_is_given() {
        for text in [
            "ax = 9^9^9",
            "ax = x + exp(9^9)",
            "fx = vx / (1 - 1)",
            "torque = sqrt(-2)",
            "ay = 9^9",
            "ax = ln(0)*x",
        ] {
            let refused = Formula::new(text, vec![]).expect_err(text).to_string();
            assert!(
                refused.starts_with("line 1, column ") && refused.contains("constant"),
                "{text}: {refused}"
            );
        }
        for text in
            ["ax = 9^9 * x / 9^9", "ax = -(2^3)", "ay = 1/x", "fx = max(1, min(x, 2))", "ax = exp(-9^9) * vx"]
        {
            Formula::new(text, vec![]).expect(text);
        }
    }

    #[test]
    fn what_is_not_finite_is_no_value() {
        for text in ["1 / (x - 0.4)", "ln(y)", "sqrt(y)", "exp(1000)", "y ^ 0.5", "1e5 * 1e5", "0 / 0"] {
            let program = formula(&format!("fy = 3; fx = {text}")).read().expect(text);
            assert_eq!(wrench(&program, &AT), None, "{text}");
        }
        // A slope that is not finite is none.
        let program = formula("fx = sqrt(x - 0.4) + (x - 0.4)^0.5").read().expect("it is right");
        let mut at = AT.map(Jet::constant);
        at[0] = Jet::variable(AT[0], 0);
        assert_eq!(wrench(&program, &at).expect("it is zero")[0], Jet::constant(0.0));
    }

    /// Expressions of all kinds, defined nearly everywhere.
    fn expressions() -> impl Strategy<Value = String> {
        let leaf = prop_oneof![
            prop::sample::select([&VARIABLES[..], &["k", "n", "pi"]].concat()).prop_map(String::from),
            (0.1..3.0f64).prop_map(|v| format!("{v:.3}")),
        ];
        leaf.prop_recursive(4, 24, 2, |inner| {
            let two = (inner.clone(), prop::sample::select(vec!["+", "-", "*"]), inner.clone());
            let one = (prop::sample::select(vec!["sin", "cos", "tanh", "-"]), inner.clone());
            prop_oneof![
                two.prop_map(|(a, op, b)| format!("({a} {op} {b})")),
                one.prop_map(|(f, a)| format!("{f}({a})")),
                inner.clone().prop_map(|a| format!("sqrt(1 + ({a})^2)")),
                inner.clone().prop_map(|a| format!("exp(-({a})^2)")),
                (inner.clone(), inner).prop_map(|(a, b)| format!("({a}) / (1 + ({b})^2)")),
            ]
        })
    }

    proptest! {
        #[test]
        fn no_text_panics(text in "(ax|ay|fx) ?= ?[-+*/^()0-9a-z .,;=é\n]{0,40}", any in ".{0,40}") {
            for text in [&text, &any] {
                if let Ok(program) = formula(text).read() {
                    // Whatever it means, a value is finite.
                    let values = wrench(&program, &AT.map(Jet::constant));
                    prop_assert!(values.is_none_or(|v| v.iter().all(|v| v.is_finite())), "{text}");
                }
            }
        }

        #[test]
        fn derivatives_are_exact(text in expressions()) {
            let program = formula(&format!("fx = {text}")).read().expect("it is right");
            let Some(before) = wrench(&program, &AT) else { return Ok(()) };
            for first in (0..AT.len()).step_by(LANES) {
                let mut jets = AT.map(Jet::constant);
                for k in first..AT.len().min(first + LANES) {
                    jets[k] = Jet::variable(AT[k], k - first);
                }
                let exact = wrench(&program, &jets).expect("it has a value")[0];
                prop_assert!((exact.v - before[0]).abs() <= 1e-12 * before[0].abs());
                for k in first..AT.len().min(first + LANES) {
                    let moved = |h: f64| {
                        let mut at = AT;
                        at[k] += h;
                        wrench(&program, &at).expect("it has a value")[0]
                    };
                    let (numeric, slope) = ((moved(1e-6) - moved(-1e-6)) / 2e-6, exact.derivative(k - first));
                    let size = 1.0 + numeric.abs() + before[0].abs();
                    prop_assert!((slope - numeric).abs() < 1e-4 * size, "{text} by {k}: {slope} {numeric}");
                }
            }
        }
    }
}
