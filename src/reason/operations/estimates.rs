//! The operations that read what the fit knows: masses, coefficients, its quality; and those that compare quantities.

use super::machine::{Machine, Outcome};
use super::motion::{state, time};
use super::ops;
use crate::fit::{Estimate, Fit};
use crate::num::elementary;
use crate::reason::context::Halt;
use crate::reason::describe::event_words;
use crate::reason::events::{MOVING_SPEED, SceneEvent, SceneEventKind};
use crate::reason::units::{self, MeasureUnit};
use crate::reason::value::ProgramValue::{self, *};
use crate::reason::value::SpanKind;
use crate::world::{BodySpec, Model};

/// A ratio of masses whose logarithm has more than this share of its prior deviation is not determined. The deviation is of 32
/// draws and has itself a standard error of 13 %.
const DETERMINED: f64 = 0.75;

fn fit<'a>(m: &Machine<'a>) -> Result<(&'a Fit, usize), Halt> {
    m.context.fit.ok_or_else(no_model)
}

fn no_model() -> Halt {
    Halt::Undetermined("there is no fitted model".into())
}

/// Whether the scene gives the mass of an object.
fn is_given(m: &Machine, object: usize) -> bool {
    m.context.scene.objects.get(object).is_some_and(|o| o.mass.is_some())
}

/// Ids of the objects whose masses the video determines.
fn identified_masses(m: &Machine) -> Result<Vec<u32>, Halt> {
    let (fit, index) = fit(m)?;
    Ok(fit.objects(index).iter().filter(|o| o.mass.identified).map(|o| o.id).collect())
}

fn body<'a>(m: &Machine<'a>, model: &'a Model, object: usize) -> Result<&'a BodySpec, Halt> {
    let id = ops::id(m.context.scene, object)?;
    let absent = || Halt::Undetermined(format!("{} is not in the model", ops::name(m.context.scene, object)));
    model.bodies.iter().find(|b| b.id == id).ok_or_else(absent)
}

/// The model of this rollout.
fn model<'a>(m: &Machine<'a>) -> Result<&'a Model, Halt> {
    m.context.models.get(m.context.rollout).ok_or_else(no_model)
}

/// Why a property of contacts of an object is not determined.
fn met_nothing(m: &Machine, object: usize, what: &str) -> Halt {
    let who = ops::name(m.context.scene, object);
    let events = m.context.events(&[], SpanKind::Video).unwrap_or_default();
    let collides = !ops::filter_kind(&events, SceneEventKind::Collision, &[object]).is_empty();
    let why = if collides { "its collisions leave it open" } else { "it met nothing in the video" };
    Halt::Undetermined(format!("{what} of {who}: {why}"))
}

pub fn mass(m: &mut Machine) -> Outcome {
    let object = m.object()?;
    let known = identified_masses(m)?.contains(&ops::id(m.context.scene, object)?);
    let given = is_given(m, object);
    if !given && !known {
        // What the object meets decides which reason is given.
        m.context.rollout(&[], m.context.frames(SpanKind::Video))?;
        return Err(met_nothing(m, object, "the mass"));
    }
    let unit = if given { "kg" } else { "(relative: the scene gives no masses)" };
    Ok(Quantity(body(m, model(m)?, object)?.mass, unit))
}

/// Mass of the first over that of the second.
pub fn mass_ratio(m: &mut Machine) -> Outcome {
    let (second, first) = (m.object()?, m.object()?);
    let models = m.context.models;
    let best = models.first().ok_or_else(no_model)?;
    let logs: Vec<f64> = models
        .iter()
        .skip(1)
        .map(|model| Ok(elementary::ln(body(m, model, first)?.mass / body(m, model, second)?.mass)))
        .collect::<Result<_, Halt>>()?;
    let mean = logs.iter().sum::<f64>() / logs.len().max(1) as f64;
    let square = logs.iter().map(|l| (l - mean) * (l - mean)).sum::<f64>() / logs.len().max(1) as f64;
    let free = [first, second].iter().filter(|o| !is_given(m, **o)).count() as f64;
    if free > 0.0 && square.sqrt() > DETERMINED * free.sqrt() * best.mass_sd {
        m.context.rollout(&[], m.context.frames(SpanKind::Video))?;
        let events = m.context.events(&[], SpanKind::Video)?;
        let alone = [first, second]
            .into_iter()
            .find(|o| ops::filter_kind(&events, SceneEventKind::Collision, &[*o]).is_empty());
        return Err(met_nothing(m, alone.unwrap_or(first), "the mass"));
    }
    let model = model(m)?;
    Ok(Quantity(body(m, model, first)?.mass / body(m, model, second)?.mass, "times"))
}

/// Whether the first is heavier.
pub fn is_heavier(m: &mut Machine) -> Outcome {
    match mass_ratio(m)? {
        Quantity(ratio, _) => Ok(Bool(ratio > 1.0)),
        other => Ok(other),
    }
}

/// The heaviest or lightest object; of none that met nothing.
pub fn by_mass(m: &mut Machine) -> Outcome {
    let sign = if m.token() == "heaviest" { 1.0 } else { -1.0 };
    let objects = m.objects()?;
    let known = identified_masses(m)?;
    let model = model(m)?;
    let mut scores = vec![];
    for object in objects {
        if !known.contains(&ops::id(m.context.scene, object)?) {
            let events = m.context.events(&[], SpanKind::Video)?;
            if ops::filter_kind(&events, SceneEventKind::Collision, &[object]).is_empty() {
                return Err(met_nothing(m, object, "the mass"));
            }
        }
        scores.push((object, sign * body(m, model, object)?.mass));
    }
    let most = scores.iter().map(|s| s.1).fold(f64::NEG_INFINITY, f64::max);
    let best: Vec<usize> = scores.into_iter().filter(|s| s.1 == most).map(|s| s.0).collect();
    match best[..] {
        [] => Err(Halt::Undetermined("there are no objects".into())),
        [one] => Ok(Object(one)),
        _ => {
            let names: Vec<String> = best.iter().map(|o| ops::name(m.context.scene, *o)).collect();
            Err(Halt::Undetermined(format!("{} have the same mass", names.join(" and "))))
        }
    }
}

pub fn restitution(m: &mut Machine) -> Outcome {
    let object = m.object()?;
    let (fit, index) = fit(m)?;
    let id = ops::id(m.context.scene, object)?;
    let found = fit.objects(index).into_iter().find(|o| o.id == id).map(|o| o.restitution);
    match found.filter(|e| e.identified) {
        Some(estimate) => Ok(drawn(m, &estimate, "")),
        None => {
            m.context.rollout(&[], m.context.frames(SpanKind::Video))?;
            Err(met_nothing(m, object, "the restitution"))
        }
    }
}

/// A value of the fit in this rollout: the estimate, moved by a deviation that alternates over the draws.
///
/// Draws 2k + 1 and 2k + 2 are one deviation above and below, so that the ensemble has the estimate's mean and deviation.
fn drawn(m: &Machine, estimate: &Estimate, unit: &'static str) -> ProgramValue {
    let sign = match m.context.rollout {
        0 => 0.0,
        k if k % 2 == 1 => 1.0,
        _ => -1.0,
    };
    Quantity(estimate.value + sign * estimate.sd, unit)
}

/// The coefficient of friction on the ground, or of drag, that applies to an object.
pub fn coefficient(m: &mut Machine) -> Outcome {
    let law = if m.token() == "drag_of" { "drag" } else { "friction" };
    let object = m.object()?;
    let (fit, index) = fit(m)?;
    let body = body(m, model(m)?, object)?;
    let is_ball = body.shape.is_ball();
    let scene = fit.scenes.get(index).ok_or_else(no_model)?;
    let called =
        |name: &str| crate::effects::effect(name).is_some_and(|e| e.profile.common_name == Some(law));
    let of_law = fit.shared(index).into_iter().filter(|s| called(&s.effect));
    let mut found: Vec<(String, Estimate)> = vec![];
    for shared in of_law {
        let active = scene.model.effects.iter().find(|e| e.name == shared.effect);
        let parameter = active.and_then(|e| e.parameters.iter().find(|p| p.name == shared.parameter));
        let at = parameter.and_then(|p| p.index(body, body));
        if let Some(estimate) = at.and_then(|k| shared.values.get(k)) {
            found.push((format!("{} {}", shared.effect, shared.parameter), estimate.clone()));
        }
    }
    // Of several coefficients that of rolling is a ball's; one that the video leaves open is none.
    found.retain(|(_, e)| e.identified);
    let rolls = |name: &str| name.contains("roll");
    let best = found.iter().find(|(name, _)| rolls(name) == is_ball).or(found.first());
    let who = ops::name(m.context.scene, object);
    match best {
        Some((_, e)) => Ok(drawn(m, e, if law == "drag" { "1/s" } else { "" })),
        None => Err(Halt::Undetermined(format!("{law} of {who}: the video leaves it open"))),
    }
}

pub fn kinetic_energy(m: &mut Machine) -> Outcome {
    let (at, object) = (time(m)?, m.object()?);
    let state = state(m, object, at)?;
    let body = body(m, model(m)?, object)?;
    let spin = body.shape.unit_inertia() * (state.spin * state.spin + state.roll.norm_squared());
    let unit = if is_given(m, object) { "J" } else { "J (relative: the scene gives no masses)" };
    Ok(Quantity(0.5 * body.mass * (state.velocity.norm_squared() + spin), unit))
}

pub fn momentum(m: &mut Machine) -> Outcome {
    let (at, object) = (time(m)?, m.object()?);
    let velocity = state(m, object, at)?.velocity;
    let unit = if is_given(m, object) { "kg m/s" } else { "kg m/s (relative: the scene gives no masses)" };
    Ok(Vector(velocity * body(m, model(m)?, object)?.mass, unit))
}

/// Root mean square of the residuals.
pub fn fit_error(m: &mut Machine) -> Outcome {
    let (fit, index) = fit(m)?;
    let rmse = fit.scenes.get(index).map_or(0.0, |s| s.rmse);
    Ok(Quantity(rmse, "m"))
}

/// Whether the noise does not explain what the model leaves.
pub fn is_unexplained(m: &mut Machine) -> Outcome {
    let (fit, index) = fit(m)?;
    Ok(Bool(fit.scenes.get(index).is_some_and(|s| !s.adequate)))
}

/// What the model lacks: by a discovery if there is one, else whether the fit lacks something, with how to learn what.
pub fn missing_part(m: &mut Machine) -> Outcome {
    if let Some(known) = m.context.discovery {
        return known.answer().map(Text).map_err(Halt::Undetermined);
    }
    let (fit, index) = fit(m)?;
    let scene = fit.scenes.get(index).ok_or_else(no_model)?;
    Ok(Text(match scene.adequate {
        true => format!(
            "no: the noise explains what the model leaves (chi-square {:.2} for each measurement)",
            scene.reduced_chi_square
        ),
        false => format!(
            "yes: the model leaves {:.1} mm where the noise is {:.1} mm; `discover` on videos of this set-up finds what",
            1e3 * scene.rmse,
            1e3 * scene.noise_sigma
        ),
    }))
}

/// The first collision that set an object in motion.
pub fn why_moved(m: &mut Machine) -> Outcome {
    let object = m.object()?;
    let scene = m.context.scene;
    let who = ops::name(scene, object);
    let trace = m.context.trace(&m.supposed, m.context.frames(SpanKind::Video))?;
    let id = ops::id(scene, object)?;
    let column = trace.ids.iter().position(|i| *i == id);
    let speed = |frame: usize| {
        let state = trace.states.get(frame).and_then(|row| row.get(column?).copied().flatten());
        state.map(|s| s.velocity.norm())
    };
    let moves_at = (0..trace.states.len()).find(|f| speed(*f).is_some_and(|v| v > MOVING_SPEED));
    let Some(first) = moves_at else {
        return Ok(Text(format!("{who} does not move in the video")));
    };
    let events = m.context.events(&m.supposed, SpanKind::Video)?;
    let hits = ops::filter_kind(&events, SceneEventKind::Collision, &[object]);
    // The state of a frame is that after the events before it.
    let hit = hits.iter().rfind(|e| e.frame <= first && e.frame + 1 >= first);
    Ok(Text(match hit.and_then(|e| Some((e, ops::partner(e, object).ok()?))) {
        Some((event, partner)) => {
            format!("the collision with {} (frame {})", ops::name(scene, partner), event.frame)
        }
        None => format!("nothing in the video: {who} moves already when it is first seen"),
    }))
}

/// What a change makes of the events of the video.
pub fn difference_made(m: &mut Machine) -> Outcome {
    let events = m.events()?;
    let scene = m.context.scene;
    let actual = m.context.events(&[], SpanKind::Video)?;
    let missing = |from: &[SceneEvent], of: &[SceneEvent]| {
        let missing = ops::lacking(from, of);
        missing.iter().map(|e| event_words(scene, e)).collect::<Vec<_>>().join("; ")
    };
    let (lost, new) = (missing(&events, &actual), missing(&actual, &events));
    Ok(Text(match (lost.is_empty(), new.is_empty()) {
        (true, true) => "nothing: the same events happen".to_string(),
        (false, true) => format!("no longer: {lost}"),
        (true, false) => format!("new: {new}"),
        (false, false) => format!("no longer: {lost}; new: {new}"),
    }))
}

/// Two quantities of one kind, the first below the second.
fn two(m: &mut Machine) -> Result<[(f64, &'static str); 2], Halt> {
    match (m.pop()?, m.pop()?) {
        (Quantity(second, u), Quantity(first, v)) if u == v => Ok([(first, v), (second, u)]),
        (Quantity(_, u), Quantity(_, v)) => {
            Err(Halt::Undetermined(format!("a quantity in {v} cannot be compared with one in {u}")))
        }
        _ => Err(m.mismatch()),
    }
}

pub fn greater(m: &mut Machine) -> Outcome {
    let [first, second] = two(m)?;
    Ok(Bool(first.0 > second.0))
}

pub fn difference(m: &mut Machine) -> Outcome {
    let [first, second] = two(m)?;
    Ok(Quantity(first.0 - second.0, first.1))
}

pub fn ratio(m: &mut Machine) -> Outcome {
    let [first, second] = two(m)?;
    Ok(Quantity(first.0 / second.0, "times"))
}

/// A number of a unit as a quantity in SI units.
pub fn of_unit(m: &mut Machine) -> Outcome {
    let (unit, value) = (unit(m)?, m.factor()?);
    Ok(Quantity(unit.in_base(value), unit.base))
}

/// A quantity in another unit of its kind.
pub fn in_unit(m: &mut Machine) -> Outcome {
    let unit = unit(m)?;
    match m.pop()? {
        Quantity(value, own) if own == unit.base => Ok(Quantity(unit.of_base(value), unit.name)),
        Quantity(_, own) => {
            Err(Halt::Undetermined(format!("the answer is in {}, which is no {}", own, unit.name)))
        }
        _ => Err(m.mismatch()),
    }
}

fn unit(m: &mut Machine) -> Result<&'static MeasureUnit, Halt> {
    let name = m.word()?;
    units::named(&name).ok_or_else(|| m.mismatch())
}
