//! What a name or a sign that a formula cannot have most likely means.

use super::program::TARGETS;
use crate::effects::{alike, effect};
use std::cmp::Reverse;

/// Names that people write, and what stands for them here.
const SYNONYMS: [(&[&str], &str); 12] = [
    (&["v", "velocity"], "vx, vy or speed"),
    (&["v_x", "xdot", "dx"], "vx"),
    (&["v_y", "ydot", "dy"], "vy"),
    (&["v_abs", "absv", "vel", "norm"], "speed"),
    (&["omega", "w", "wz", "angular_velocity"], "spin"),
    (&["theta", "angle", "phi", "heading"], "yaw"),
    (&["mass"], "m"),
    (&["time"], "t"),
    (&["radius", "size"], "r, the radius of the circle around the shape"),
    (&["log"], "ln"),
    (&["pow"], "^, as in x^2"),
    (&["z"], "x or y: the plane is seen from above"),
];
/// Left sides that people write.
const LEFT_SIDES: [(&[&str], &str); 4] = [
    (&["a", "acc", "acceleration"], "ax and ay"),
    (&["f", "force"], "fx and fy"),
    (&["tau", "m", "t", "moment"], "torque"),
    (&["vx", "vy", "x", "y", "v", "speed"], "ax and ay: a formula gives an acceleration or a force"),
];

/// A name without case and underscores.
fn bare(name: &str) -> String {
    name.chars().filter(|c| *c != '_').collect::<String>().to_lowercase()
}

fn synonym(table: &[(&[&str], &'static str)], name: &str) -> Option<&'static str> {
    let lower = name.to_lowercase();
    table.iter().find(|(names, _)| names.contains(&lower.as_str())).map(|(_, meant)| *meant)
}

/// The known name that is nearest, if only a letter or two differ.
fn nearest<'a>(name: &str, known: impl Iterator<Item = &'a str>) -> Option<&'a str> {
    let wanted = bare(name);
    let errors = |known: &str| strsim::osa_distance(&bare(known), &wanted);
    let allowed = if wanted.len() > 4 { 2 } else { usize::from(wanted.len() > 1) };
    let close = |known: &&str| known.len() > 1 && errors(known) <= allowed;
    let same_start = |known: &str| known.chars().zip(name.chars()).take_while(|(a, b)| a == b).count();
    known.filter(close).min_by_key(|known| (errors(known), Reverse(same_start(known))))
}

/// After an unknown left side: ` (did you mean ax?)`, or nothing.
pub fn left_side(name: &str) -> String {
    let lower = name.to_lowercase();
    let meant = nearest(name, TARGETS.into_iter().filter(|t| bare(t) == bare(name)));
    let meant = meant.or_else(|| synonym(&LEFT_SIDES, name)).or_else(|| nearest(&lower, TARGETS.into_iter()));
    meant.map_or(String::new(), |meant| format!(" (did you mean {meant}?)"))
}

/// After an unknown name on the right: what it may mean, or how to declare it.
pub fn name<'a>(name: &str, known: impl Iterator<Item = &'a str> + Clone) -> String {
    if TARGETS.contains(&name) {
        return " (it may stand on the left of = only)".into();
    }
    let same = known.clone().find(|k| bare(k) == bare(name));
    let meant = same.or_else(|| synonym(&SYNONYMS, name)).or_else(|| nearest(name, known));
    match meant {
        Some(meant) => format!(" (did you mean {meant}?)"),
        None => {
            let meant = alike(name);
            let is_effect = effect(name).is_some() || meant.len() == 1;
            let effect = meant.first().filter(|_| is_effect);
            let effect = effect.map_or(String::new(), |e| format!(", or use the effect {e} (`--add {e}`)"));
            format!(" (declare a parameter with `let {name} = 0`{effect})")
        }
    }
}

/// After something unexpected where `wanted` was expected: what to write instead, or nothing.
pub fn sign(wanted: &str, rest: &str) -> &'static str {
    let is_complete = wanted.starts_with("an operator");
    let Some(next) = rest.chars().next() else { return "" };
    match next {
        '*' => "; write ^ for a power, as in x^2",
        '²' | '³' => "; write ^ for a power, as in x^2",
        '·' | '×' | '⋅' => "; write * between factors",
        '−' | '–' => "; write - as minus",
        '\'' => "; ax stands for the acceleration, vx for the velocity",
        '[' => "; a unit may stand in a declaration only, as in `let k [1/s] = 0.1`",
        '=' if wanted.starts_with("a number, a name") || is_complete => "; a formula has one =",
        ',' if is_complete => "; write ; or a new line between formulas",
        c if is_complete && (c.is_alphanumeric() || c == '(') => "; write * between factors, as in 2*x",
        _ => "",
    }
}

#[cfg(test)]
mod tests {
    use crate::effects::formula::Formula;

    #[test]
    fn what_people_type_gets_the_right_spelling() {
        for (text, hint) in [
            ("ax = x**2", "write ^ for a power"),
            ("ax = -0.1*v", "did you mean vx, vy or speed?"),
            ("ax = -0.1*v_x", "did you mean vx?"),
            ("ax = -0.1*Vy", "did you mean vy?"),
            ("a_x = 1", "did you mean ax?"),
            ("AX = 1", "did you mean ax?"),
            ("a = 1", "did you mean ax and ay?"),
            ("F_y = 1", "did you mean fy?"),
            ("ax = 0.1*wind", "declare a parameter with `let wind = 0`, or use the effect uniform_force"),
            ("ax = qqq", "declare a parameter with `let qqq = 0`); known"),
            ("ax = omega*vy", "did you mean spin?"),
            ("ax = sinn(x)", "did you mean sin?"),
            ("ax = 2x", "write * between factors"),
            ("ax = x²", "write ^ for a power"),
            ("ax = 1, ay = 2", "write ; or a new line"),
            ("ax == 1", "a formula has one ="),
            ("ax = ay", "it may stand on the left of = only"),
            ("vx = 1", "a formula gives an acceleration or a force"),
            ("x' = 1", "did you mean ax and ay"),
        ] {
            let message = Formula::new(text, vec![]).expect_err(text).to_string();
            assert!(message.contains(hint), "{text}: {message}");
        }
    }
}
