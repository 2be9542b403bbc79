//! Simulation: steps between known times, cut at every impact, stop and start of rolling.

use super::agenda::{Agenda, Next};
use super::encounter::{CUT_IN_SPEED, SAME_CONTACT};
use super::flight::{Flight, INSTANT};
use super::grid::Grid;
use super::impact::Path;
use super::model::{ActiveEffect, BODY_VALUES, BodySpec, Model};
use super::motion::{Change, Kinematics, Laws, Mode, REST_SPEED, Rates};
use super::obstacle::Static;
use super::pressing::Touching;
use super::rigid::Bond;
use super::trace::{Ending, Event, EventKind, State, Trace};
use crate::effects::{ContactFn, Hook, MarginFn, Scalar};
use crate::num::Vec2;
use crate::scene::Shape;
use smallvec::SmallVec;
use std::cell::RefCell;
use std::collections::BTreeMap;

/// Longest step (s): the integrator is of fourth order, and uneven stretches are halved.
pub(super) const MAX_STEP: f64 = 0.16;
/// The same under forces that change with time where a body is at rest: they may wake it.
const WAKING_STEP: f64 = 0.02;

/// A limit on the work of one simulation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SimulationLimits {
    /// Events (impacts, stops) in one simulation.
    pub events: usize,
}

impl Default for SimulationLimits {
    fn default() -> Self {
        SimulationLimits { events: 20_000 }
    }
}

/// States in the scalar that was simulated: `[frame][body]`, `None` before the body enters.
#[derive(Debug, Clone)]
pub struct Rollout<T> {
    pub states: Vec<Vec<Option<Kinematics<T>>>>,
    pub events: Vec<Event>,
    pub ending: Ending,
    /// Of the limit's events, how many it took; what bodies that press do counts too.
    pub steps: usize,
}

/// Simulates with the numbers `flat` (laid out as [`Model::flatten`]) and gives the states at `times` (s, increasing).
/// Deterministic; a run in [`Jet`](crate::num::Jet) has the events of the run in `f64`.
pub fn simulate<T: Scalar>(
    model: &Model,
    flat: &[T],
    times: &[f64],
    limits: &SimulationLimits,
) -> Rollout<T> {
    let mut run = Run::new(model, flat, times, limits);
    let cuts = model.cuts();
    let end = times.last().copied().unwrap_or(0.0);
    let mut now = cuts.first().copied().unwrap_or(0.0);
    for cut in cuts.into_iter().filter(|&c| c <= end) {
        run.advance(now, cut);
        now = cut;
        run.enter(cut);
        run.apply_corrections(cut);
    }
    run.advance(now, end);
    let steps = limits.events - run.budget;
    Rollout { states: run.states, events: run.events, ending: run.ending, steps }
}

/// Simulates the model as it is. Deterministic: the same input gives the same bits.
pub fn trace(model: &Model, times: &[f64]) -> Trace {
    let rollout = simulate::<f64>(model, &model.flatten(), times, &SimulationLimits::default());
    let energy = |row: &Vec<Option<Kinematics<f64>>>| -> f64 {
        let each = row.iter().zip(&model.bodies);
        each.filter_map(|(k, b)| k.as_ref().map(|k| kinetic_energy(k, b))).sum()
    };
    let state = |k: Kinematics<f64>| State {
        position: k.position,
        yaw: k.yaw,
        velocity: k.velocity,
        spin: k.spin,
        roll: k.roll,
    };
    Trace {
        ids: model.bodies.iter().map(|b| b.id).collect(),
        times: times.to_vec(),
        energy: rollout.states.iter().map(energy).collect(),
        states: rollout.states.iter().map(|row| row.iter().map(|k| k.map(state)).collect()).collect(),
        events: rollout.events,
        ending: rollout.ending,
    }
}

/// Kinetic energy of one body (J).
fn kinetic_energy(k: &Kinematics<f64>, body: &BodySpec) -> f64 {
    let turn = body.shape.unit_inertia() * (k.spin * k.spin + k.roll.norm_squared());
    0.5 * body.mass * (k.velocity.norm_squared() + turn)
}

/// Even steps, none longer than `longest`, as beginning and end (s).
fn steps(from: f64, to: f64, longest: f64) -> impl Iterator<Item = (f64, f64)> {
    let count = ((to - from) / longest - 1e-9).ceil().max(1.0) as usize;
    let at = move |k: usize| if k == count { to } else { from + (to - from) * k as f64 / count as f64 };
    (0..count).map(move |k| (at(k), at(k + 1)))
}

/// A list that is mostly short: groups are.
pub(super) type Few<T> = SmallVec<[T; 4]>;

/// One body during a step: its state at `since`, and where its undisturbed motion leads.
#[derive(Clone)]
pub(super) struct Moving<T> {
    pub mode: Mode,
    pub since: T,
    pub from: Kinematics<T>,
    pub until: T,
    pub to: Kinematics<T>,
    pub change: Option<Change>,
    pub path: Path,
    /// Bodies that move together because forces join them; includes this one.
    pub group: Vec<usize>,
    /// Index of the next time at which the state is asked for.
    pub next: usize,
}

/// What an effect does at a contact, and where its parameters begin.
pub(super) struct AtContact<'m, F> {
    pub hook: F,
    pub active: &'m ActiveEffect,
    pub first: usize,
}

/// A soft contact's blow that is due.
#[derive(Clone, Copy)]
pub(super) struct Blow<T> {
    pub time: T,
    pub a: usize,
    pub b: usize,
}

pub(super) struct Run<'m, T: Scalar> {
    pub model: &'m Model,
    pub flat: &'m [T],
    pub laws: Laws<T>,
    pub contact_effects: Vec<AtContact<'m, ContactFn<T>>>,
    /// Of bodies that have met, what the contact effects' parameters are: one entry an effect, either way round.
    pub met: BTreeMap<(usize, usize), Vec<[Vec<T>; 2]>>,
    pub margin_effects: Vec<AtContact<'m, MarginFn<T>>>,
    /// What they give for pairs that came near each other.
    pub margins: RefCell<BTreeMap<(usize, usize), T>>,
    pub bodies: Vec<Moving<T>>,
    pub walls: Vec<Static<T>>,
    pub touching: Vec<Touching<T>>,
    pub bonds: Vec<Bond<T>>,
    /// Bodies that bonds make one.
    pub clusters: Vec<Vec<usize>>,
    /// Bodies inside an obstacle that lets them through.
    pub passing: Vec<(usize, usize)>,
    pub blows: Vec<Blow<T>>,
    pub agenda: Agenda,
    pub grid: Grid,
    /// The laws without derivatives, for bodies that carry none.
    pub plain: Option<Laws<f64>>,
    pub times: &'m [f64],
    pub states: Vec<Vec<Option<Kinematics<T>>>>,
    pub step_end: f64,
    /// How long a stretch of bodies that pull at each other may be, by the last one (s).
    pub stretch: f64,
    pub events: Vec<Event>,
    pub budget: usize,
    pub ending: Ending,
}

impl<'m, T: Scalar> Run<'m, T> {
    fn new(model: &'m Model, flat: &'m [T], times: &'m [f64], limits: &SimulationLimits) -> Self {
        let laws = Laws::new(model, flat);
        let contact_effects = model.active().filter(|(_, entry, _)| entry.uses(Hook::Contact));
        let contact_effects = contact_effects.map(|(active, entry, first)| AtContact {
            hook: T::hooks(entry).contact,
            active,
            first,
        });
        let margin_effects = model.active().filter(|(_, entry, _)| entry.uses(Hook::Margin));
        let margin_effects = margin_effects.map(|(active, entry, first)| AtContact {
            hook: T::hooks(entry).margin,
            active,
            first,
        });
        let bodies = model.bodies.iter().enumerate().map(|(i, b)| {
            let mut from = Kinematics::starting(&flat[i * BODY_VALUES.len()..]);
            if b.start.rolling {
                from.roll = from.velocity.perp().scaled(1.0 / laws.shapes[i].bounding_radius());
            }
            let still = from.value();
            Moving {
                mode: Mode::Absent,
                since: T::constant(b.start.time),
                from,
                until: T::constant(b.start.time),
                to: from,
                change: None,
                path: Path::new(laws.shapes[i], b.start.time, b.start.time, still, still),
                group: vec![i],
                next: 0,
            }
        });
        let bodies = bodies.collect();
        let real = || flat.iter().map(|v| v.value()).collect::<Vec<f64>>();
        Run {
            plain: T::DIFFERENTIATES.then(|| Laws::new(model, &real())),
            times,
            states: times.iter().map(|_| model.bodies.iter().map(|_| None).collect()).collect(),
            laws,
            contact_effects: contact_effects.collect(),
            met: BTreeMap::new(),
            margin_effects: margin_effects.collect(),
            margins: RefCell::default(),
            bodies,
            walls: Static::all(model, flat),
            touching: vec![],
            bonds: vec![],
            clusters: vec![],
            passing: vec![],
            blows: vec![],
            agenda: Agenda::default(),
            grid: Grid::default(),
            step_end: 0.0,
            stretch: MAX_STEP,
            events: vec![],
            budget: limits.events,
            ending: Ending::Completed,
            model,
            flat,
        }
    }

    /// Bodies that start at `time` come in; one that friction holds has no velocity, nor a derivative by it.
    fn enter(&mut self, time: f64) {
        for (i, spec) in self.model.bodies.iter().enumerate() {
            if self.bodies[i].mode != Mode::Absent || spec.start.time > time {
                continue;
            }
            let k = self.bodies[i].from;
            let still =
                k.velocity.value() == Vec2::zero() && k.spin.value() == 0.0 && k.roll.value() == Vec2::zero();
            if still && self.laws.holds(i, &self.laws.wrench(i, &k, T::constant(time))) {
                self.rest(i);
            } else {
                self.bodies[i].mode = if spec.start.rolling { Mode::Roll } else { Mode::Slide };
            }
            self.bodies[i].next = self.times.partition_point(|&t| t < time);
            self.note(i, &k, T::constant(time), &k, T::constant(time));
        }
    }

    /// Notes the asked states of body `i` between `from` at `since` and `to` at `until`.
    pub(super) fn note(&mut self, i: usize, from: &Kinematics<T>, since: T, to: &Kinematics<T>, until: T) {
        let body = &mut self.bodies[i];
        while let Some(&time) = self.times.get(body.next).filter(|&&t| t <= until.value()) {
            let moves = matches!(body.mode, Mode::Slide | Mode::Roll);
            self.states[body.next][i] = Some(match moves {
                true if (until - since).value() > INSTANT => from.between(since, to, until, time),
                true => to.stepped(to, &Rates::zero(), -until + time),
                false => *to,
            });
            body.next += 1;
        }
    }

    /// Body `i` goes to the end of its stretch.
    fn arrive(&mut self, i: usize) {
        let Moving { from, since, to, until, .. } = self.bodies[i];
        if self.bodies[i].mode != Mode::Absent {
            self.note(i, &from, since, &to, until);
        }
        (self.bodies[i].from, self.bodies[i].since) = (to, until);
    }

    pub(super) fn rest(&mut self, i: usize) {
        let body = &mut self.bodies[i];
        body.mode = Mode::Rest;
        body.from.velocity = Vec2::zero();
        body.from.spin = T::zero();
        body.from.roll = Vec2::zero();
    }

    /// A body that is nudged again at once stops later, not twice.
    pub(super) fn note_stop(&mut self, i: usize, time: f64) {
        let objects = vec![self.model.bodies[i].id];
        let position = self.bodies[i].from.position.value();
        let recent = self.events.iter().rev().take_while(|e| time - e.time < SAME_CONTACT);
        let same = |e: &Event| e.kind == EventKind::Stop && e.objects == objects;
        if let Some(back) = recent.map(same).position(|same| same) {
            self.events.remove(self.events.len() - 1 - back);
        }
        let kind = EventKind::Stop;
        self.events.push(Event { kind, time, objects, position, normal: None, impulse: None, wall: None });
    }

    /// Moves everything from `now` to `end`.
    fn advance(&mut self, now: f64, end: f64) {
        if end <= now {
            return;
        }
        for (now, end) in steps(now, end, MAX_STEP) {
            let rests = self.bodies.iter().any(|b| b.mode == Mode::Rest);
            let pace = self.laws.pace;
            let longest = if rests && pace.is_finite() { pace.min(WAKING_STEP) } else { pace };
            steps(now, end, longest).for_each(|(now, end)| self.step(now, end));
        }
    }

    fn step(&mut self, start: f64, end: f64) {
        self.step_end = end;
        if self.ending != Ending::Completed {
            return;
        }
        for body in &mut self.bodies {
            body.since = T::constant(start);
        }
        self.regroup();
        let all: Few<usize> = (0..self.bodies.len()).collect();
        self.predict_all(&all);
        self.plan();
        while let Some((time, next)) = self.next_event() {
            if self.budget == 0 {
                self.ending = Ending::EventLimit;
                return;
            }
            self.budget -= 1;
            if self.is_undefined() {
                break;
            }
            match next {
                Next::Change(i) => self.change(i),
                Next::Impact(a, b) => self.impact(time, a, b),
                Next::Blow(which) => self.blow(which),
            }
        }
        if self.is_undefined() {
            self.ending = Ending::FormulaUndefined;
            return;
        }
        for i in 0..self.bodies.len() {
            self.arrive(i);
        }
    }

    /// Whether a formula had no finite value.
    fn is_undefined(&self) -> bool {
        self.laws.undefined.get() || self.plain.as_ref().is_some_and(|plain| plain.undefined.get())
    }

    /// Whether nothing else enters the motion of body `i`.
    pub(super) fn is_alone(&self, i: usize) -> bool {
        self.bodies[i].group.len() == 1
            && !self.laws.has_pair_forces()
            && !self.touching.iter().any(|t| t.a == i || t.b == i)
    }

    /// Whether a body's motion carries no derivatives, so that it can be computed without.
    pub(super) fn plainly(&self, i: usize) -> Option<&Laws<f64>> {
        let body = &self.bodies[i];
        let plain = self.plain.as_ref().filter(|_| self.laws.constant[i]);
        plain.filter(|_| body.since.is_constant() && body.from.is_constant())
    }

    pub(super) fn fly(&mut self, i: usize) {
        let Moving { from, since, mode, .. } = self.bodies[i];
        let flight = match self.plainly(i) {
            Some(laws) => {
                let f = laws.flight(i, &from.value(), mode, since.value(), self.step_end);
                let (to, until) = (Kinematics::constant(&f.to), T::constant(f.until));
                Flight { mode: f.mode, to, until, change: f.change }
            }
            None => self.laws.flight(i, &from, mode, since, self.step_end),
        };
        let body = &mut self.bodies[i];
        (body.mode, body.to, body.until, body.change) = (flight.mode, flight.to, flight.until, flight.change);
        let (start, end) = (since.value(), body.until.value());
        body.path = Path::new(self.laws.shapes[i], start, end, from.value(), body.to.value());
    }

    /// State of a body, or of wall `i - bodies`.
    pub(super) fn kinematics(&self, i: usize) -> &Kinematics<T> {
        match self.bodies.get(i) {
            Some(body) => &body.from,
            None => &self.walls[i - self.bodies.len()].place,
        }
    }

    pub(super) fn shape(&self, b: usize) -> &Shape {
        match self.laws.shapes.get(b) {
            Some(shape) => shape,
            None => &self.walls[b - self.bodies.len()].shape,
        }
    }

    /// Friction stops a body, lets a ball roll, or ends its spin.
    fn change(&mut self, i: usize) {
        let group = self.bodies[i].group.clone();
        for &j in &group {
            self.arrive(j);
        }
        let time = self.bodies[i].since;
        let change = self.bodies[i].change.take();
        let k = self.bodies[i].from;
        let ball = self.laws.shapes[i].is_ball() && self.cluster(i).is_none();
        let radius = self.laws.shapes[i].bounding_radius();
        match change {
            Some(Change::Stop) => {
                let speed =
                    k.velocity.value().norm() + if ball { 0.0 } else { k.spin.value().abs() * radius };
                let states: Few<Kinematics<T>> = group.iter().map(|&j| self.bodies[j].from).collect();
                let wrenches = self.wrenches(&group, &states, time);
                if speed <= 10.0 * REST_SPEED && self.held(i, &group, &states, &wrenches) {
                    self.stop(i, time.value());
                }
            }
            Some(Change::StartRolling) if self.laws.slip(i, &k).value().norm() <= 10.0 * REST_SPEED => {
                // What is left of the slip (its derivatives, where a ball begins so) ends as friction would end it.
                let velocity = k.velocity - self.laws.slip(i, &k).scaled(2.0 / 7.0);
                self.bodies[i].mode = Mode::Roll;
                self.bodies[i].from.velocity = velocity;
                self.bodies[i].from.roll = velocity.perp().scaled(1.0 / radius);
            }
            Some(Change::StartRolling) | None => {}
            Some(Change::StopSpinning) => self.bodies[i].from.spin = T::zero(),
            // Another corner may have come to press meanwhile.
            Some(Change::Continue) => {
                self.pass_on(time.value(), &group, CUT_IN_SPEED);
            }
        }
        self.release(&group);
        self.part(&group);
        self.predict_all(&group);
        self.refresh(&group);
    }
}
