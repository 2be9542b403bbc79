//! Simulation: steps between known times, cut at every impact, stop and start of rolling.

use super::geometry::{Feature, Proximity};
use super::impact::{APPROACH, Path, Side, facing, point_velocity, resolve, time_of_impact};
use super::model::{BODY_VALUES, BodySpec, Model};
use super::motion::{Change, Kinematics, Laws, Mode, REST_SPEED, Rates};
use super::trace::{Ending, Event, EventKind, State, Trace};
use crate::body::{Contact, ContactLaw, Wrench};
use crate::effects::{ContactFn, Hook, Scalar, effect};
use crate::num::{Real, Vec2, vec2};
use crate::scene::Shape;

/// Longest step (s): one frame at 25 frames/s; the integrator is of fourth order.
const MAX_STEP: f64 = 0.04;
/// Contacts slower than this do not rebound (m/s): the hop would be under 0.2 mm.
const REBOUND_SPEED: f64 = 0.01;
/// Impacts of one pair within this time (s) are told as one event.
const SAME_CONTACT: f64 = 0.1;
/// Rate at which a kept contact corrects its gap (1/s).
const CONTACT_STIFFNESS: f64 = 60.0;
/// Sweeps over simultaneous kept contacts.
const CONTACT_SWEEPS: usize = 12;

/// Longest stretch of a group with kept contacts (s), the paper's time step.
const CONTACT_STEP: f64 = 0.004;
/// Rounds of blows among kept contacts at one impact, and the approach speed that still counts (m/s).
const BLOWS: usize = 64;
const BLOW_SPEED: f64 = 1e-8;
/// A change of mode is approached in stretches of this share of the time left, down to the shortest (s).
const APPROACH_SHARE: f64 = 0.9;
const SHORTEST_APPROACH: f64 = 1e-3;

/// A limit on the work of one simulation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Limits {
    /// Events (impacts, stops) in one simulation.
    pub events: usize,
}

impl Default for Limits {
    fn default() -> Self {
        Limits { events: 100_000 }
    }
}

/// States in the scalar that was simulated: `[frame][body]`, `None` before the body enters.
#[derive(Debug, Clone)]
pub struct Rollout<T> {
    pub states: Vec<Vec<Option<Kinematics<T>>>>,
    pub events: Vec<Event>,
    pub ending: Ending,
}

/// Simulates with the numbers `flat` (laid out as [`Model::flatten`]) and gives the states at `times` (s, increasing).
/// Deterministic; a run in [`Jet`](crate::num::Jet) has the events of the run in `f64`.
pub fn simulate<T: Scalar>(model: &Model, flat: &[T], times: &[f64], limits: &Limits) -> Rollout<T> {
    let mut states = Vec::with_capacity(times.len());
    let mut run = Run::new(model, flat, limits);
    let mut starts: Vec<f64> = model.bodies.iter().map(|b| b.start.time).collect();
    starts.sort_by(f64::total_cmp);
    let mut starts = starts.into_iter().peekable();
    let mut now = starts.peek().copied().unwrap_or(0.0);
    for &time in times {
        while let Some(start) = starts.next_if(|&s| s <= time) {
            run.advance(now, start);
            now = now.max(start);
            run.enter(start);
        }
        run.advance(now, time);
        now = now.max(time);
        let row = (0..model.bodies.len())
            .map(|i| (run.bodies[i].mode != Mode::Absent).then_some(run.bodies[i].from));
        states.push(row.collect());
    }
    Rollout { states, events: run.events, ending: run.ending }
}

/// Simulates the model as it is. Deterministic: the same input gives the same bits.
pub fn trace(model: &Model, times: &[f64]) -> Trace {
    let rollout = simulate::<f64>(model, &model.flatten(), times, &Limits::default());
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

/// One body during a step: its state at `since`, and where its undisturbed motion leads.
struct Moving<T> {
    mode: Mode,
    since: T,
    from: Kinematics<T>,
    until: T,
    to: Kinematics<T>,
    change: Option<Change>,
    path: Path,
    /// Bodies that move together because forces join them; includes this one.
    group: Vec<usize>,
}

/// A contact that lasts: bodies `a` and `b` (or wall `b - bodies`) press on each other.
#[derive(Clone, Copy, PartialEq)]
struct Touching {
    a: usize,
    b: usize,
    pressing: bool,
}

struct ContactEffect<'m, T> {
    hook: ContactFn<T>,
    parameters: &'m [super::model::Parameter],
    first: usize,
}

struct Run<'m, T: Scalar> {
    model: &'m Model,
    flat: &'m [T],
    laws: Laws<T>,
    contact_effects: Vec<ContactEffect<'m, T>>,
    bodies: Vec<Moving<T>>,
    walls: Vec<(Shape, Kinematics<f64>)>,
    touching: Vec<Touching>,
    impacts: Vec<(f64, usize, usize)>,
    order: Vec<usize>,
    step_end: f64,
    events: Vec<Event>,
    budget: usize,
    ending: Ending,
}

impl<'m, T: Scalar> Run<'m, T> {
    fn new(model: &'m Model, flat: &'m [T], limits: &Limits) -> Self {
        let mut contact_effects = vec![];
        let mut first = BODY_VALUES.len() * model.bodies.len();
        for active in &model.effects {
            if let Some(entry) = effect(&active.name).filter(|e| active.on && e.uses(Hook::Contact)) {
                let hook = T::hooks(entry).contact;
                contact_effects.push(ContactEffect { hook, parameters: &active.parameters, first });
            }
            first += active.parameters.iter().map(|p| p.values.len()).sum::<usize>();
        }
        let bodies = model.bodies.iter().enumerate().map(|(i, b)| {
            let p = &flat[i * BODY_VALUES.len()..];
            let mut from = Kinematics {
                position: vec2(p[0], p[1]),
                yaw: p[2],
                velocity: vec2(p[3], p[4]),
                spin: p[5],
                roll: vec2(p[6], p[7]),
            };
            if b.start.rolling {
                from.roll = from.velocity.perp().scaled(1.0 / b.shape.bounding_radius());
            }
            let still = from.value();
            Moving {
                mode: Mode::Absent,
                since: T::constant(b.start.time),
                from,
                until: T::constant(b.start.time),
                to: from,
                change: None,
                path: Path::new(b.shape, b.start.time, b.start.time, still, still),
                group: vec![i],
            }
        });
        let walls = model.walls.iter().map(|w| {
            let along = w.to - w.from;
            let shape = Shape::Rectangle { half_length: 0.5 * along.norm(), half_width: 0.0 };
            let still = Kinematics {
                position: (w.from + w.to).scaled(0.5),
                yaw: along.y.atan2(along.x),
                velocity: Vec2::zero(),
                spin: 0.0,
                roll: Vec2::zero(),
            };
            (shape, still)
        });
        Run {
            laws: Laws::new(model, flat),
            contact_effects,
            bodies: bodies.collect(),
            walls: walls.collect(),
            touching: vec![],
            impacts: vec![],
            order: (0..model.bodies.len()).collect(),
            step_end: 0.0,
            events: vec![],
            budget: limits.events,
            ending: Ending::Completed,
            model,
            flat,
        }
    }

    /// Bodies that start at `time` come in.
    fn enter(&mut self, time: f64) {
        for (i, spec) in self.model.bodies.iter().enumerate() {
            if self.bodies[i].mode == Mode::Absent && spec.start.time <= time {
                let k = self.bodies[i].from.value();
                let still = k.velocity == Vec2::zero() && k.spin == 0.0 && k.roll == Vec2::zero();
                self.bodies[i].mode = match spec.start.rolling {
                    _ if still => Mode::Rest,
                    true => Mode::Roll,
                    false => Mode::Slide,
                };
            }
        }
    }

    /// Moves everything from `now` to `end`.
    fn advance(&mut self, now: f64, end: f64) {
        if end <= now {
            return;
        }
        let steps = ((end - now) / MAX_STEP - 1e-9).ceil().max(1.0) as usize;
        for s in 0..steps {
            let at = |k: usize| if k == steps { end } else { now + (end - now) * k as f64 / steps as f64 };
            self.step(at(s), at(s + 1));
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
        for i in 0..self.bodies.len() {
            if self.bodies[i].group[0] == i {
                self.predict(i);
            }
        }
        self.find_impacts();
        while let Some(next) = self.next_event() {
            if self.budget == 0 {
                self.ending = Ending::EventLimit;
                return;
            }
            self.budget -= 1;
            match next {
                Next::Change(i) => self.change(i),
                Next::Impact(time, a, b) => self.impact(time, a, b),
            }
        }
        for body in &mut self.bodies {
            body.from = body.to;
        }
    }

    /// Bodies joined by kept contacts or pair forces move as one group; released contacts are forgotten.
    fn regroup(&mut self) {
        self.touching.retain(|t| t.pressing);
        for i in 0..self.bodies.len() {
            self.bodies[i].group.clear();
            self.bodies[i].group.push(i);
        }
        if self.laws.has_pair_forces() {
            let all: Vec<usize> =
                (0..self.bodies.len()).filter(|&i| self.bodies[i].mode != Mode::Absent).collect();
            for &i in &all {
                self.bodies[i].group.clone_from(&all);
            }
            return;
        }
        for k in 0..self.touching.len() {
            let Touching { a, b, .. } = self.touching[k];
            self.join(a, b);
        }
    }

    fn join(&mut self, a: usize, b: usize) {
        if b >= self.bodies.len() || self.bodies[a].group.contains(&b) {
            return;
        }
        let mut all = [self.bodies[a].group.as_slice(), self.bodies[b].group.as_slice()].concat();
        all.sort_unstable();
        for &i in &all {
            self.bodies[i].group.clone_from(&all);
        }
    }

    /// The undisturbed motion of the group of `i` to the end of the step, or to its next change of mode.
    fn predict(&mut self, i: usize) {
        let group = std::mem::take(&mut self.bodies[i].group);
        let start: Vec<Kinematics<T>> = group.iter().map(|&j| self.bodies[j].from).collect();
        let since = self.bodies[i].since;
        let h = T::constant(self.step_end) - since;
        let awake =
            |run: &Self| group.iter().any(|&j| matches!(run.bodies[j].mode, Mode::Slide | Mode::Roll));
        let mut wrenches = self.wrenches(&group, &start, since);
        for (x, &j) in group.iter().enumerate() {
            if self.bodies[j].mode == Mode::Rest && !self.laws.holds(j, &wrenches[x]) {
                self.bodies[j].mode = Mode::Slide;
            }
            let slips = self.bodies[j].mode == Mode::Roll
                && wrenches[x].grip.value() > 0.0
                && 2.0 / 7.0 * wrenches[x].force.value().norm() > wrenches[x].grip.value();
            if slips {
                self.bodies[j].mode = Mode::Slide;
            }
        }
        let mut end = start.clone();
        let mut until = T::constant(self.step_end);
        let mut change = None;
        if awake(self) && h.value() > 0.0 {
            let first = self.rates(&group, &start, &mut wrenches, true);
            for (x, &j) in group.iter().enumerate() {
                let next = self.laws.next_change(j, &start[x], self.bodies[j].mode, &wrenches[x], &first[x]);
                if let Some((kind, after)) = next
                    && matches!(self.bodies[j].mode, Mode::Slide | Mode::Roll)
                    && (since + after).value() < until.value()
                {
                    until = since + after;
                    change = Some((j, kind));
                }
            }
            let left = (until - since).value();
            if change.is_some() && left > SHORTEST_APPROACH {
                until = since + (until - since) * APPROACH_SHARE;
                change = Some((i, Change::Continue));
            }
            if left > CONTACT_STEP && self.touching.iter().any(|t| group.contains(&t.a)) {
                until = since + CONTACT_STEP;
                change = Some((i, Change::Continue));
            }
            let midpoint = change.is_some_and(|c| c.1 != Change::Continue);
            end = self.integrate(&group, &start, &first, since, until - since, midpoint);
        }
        for (x, &j) in group.iter().enumerate() {
            let shape = self.laws.shapes[j];
            let body = &mut self.bodies[j];
            body.since = since;
            body.until = until;
            body.to = end[x];
            body.change = change.filter(|c| c.0 == j).map(|c| c.1);
            body.path = Path::new(shape, since.value(), until.value(), body.from.value(), body.to.value());
        }
        self.bodies[i].group = group;
    }

    /// Fourth-order Runge-Kutta, or the midpoint rule on the way to a change of mode: friction has no
    /// direction at its end, and the midpoint never looks there.
    fn integrate(
        &mut self,
        group: &[usize],
        start: &[Kinematics<T>],
        k1: &[Rates<T>],
        since: T,
        h: T,
        midpoint: bool,
    ) -> Vec<Kinematics<T>> {
        let half = h * 0.5;
        let stage = |from: &[Kinematics<T>], rates: &[Rates<T>], h: T| -> Vec<Kinematics<T>> {
            start.iter().zip(from).zip(rates).map(|((s, k), r)| s.stepped(k, r, h)).collect()
        };
        let y2 = stage(start, k1, half);
        let k2 = self.rates_at(group, &y2, since + half);
        if midpoint {
            return stage(&y2, &k2, h);
        }
        let y3 = stage(&y2, &k2, half);
        let k3 = self.rates_at(group, &y3, since + half);
        let y4 = stage(&y3, &k3, h);
        let k4 = self.rates_at(group, &y4, since + h);
        let (third, sixth) = (h * (1.0 / 3.0), h * (1.0 / 6.0));
        let step = |x: usize| {
            start[x]
                .stepped(&start[x], &k1[x], sixth)
                .stepped(&y2[x], &k2[x], third)
                .stepped(&y3[x], &k3[x], third)
                .stepped(&y4[x], &k4[x], sixth)
        };
        (0..group.len()).map(step).collect()
    }

    fn wrenches(&self, group: &[usize], k: &[Kinematics<T>], time: T) -> Vec<Wrench<T>> {
        let mut out: Vec<Wrench<T>> =
            group.iter().zip(k).map(|(&j, k)| self.laws.wrench(j, k, time)).collect();
        if self.laws.has_pair_forces() {
            self.laws.add_pair_forces(group, k, &mut out);
        }
        out
    }

    fn rates_at(&mut self, group: &[usize], k: &[Kinematics<T>], time: T) -> Vec<Rates<T>> {
        let mut wrenches = self.wrenches(group, k, time);
        self.rates(group, k, &mut wrenches, false)
    }

    /// Accelerations of a group, kept contacts included; `mark` notes which of those still press.
    fn rates(
        &mut self,
        group: &[usize],
        k: &[Kinematics<T>],
        w: &mut [Wrench<T>],
        mark: bool,
    ) -> Vec<Rates<T>> {
        let free = |run: &Self, w: &[Wrench<T>]| -> Vec<Rates<T>> {
            (0..group.len())
                .map(|x| run.laws.rates(group[x], &k[x], run.bodies[group[x]].mode, &w[x]))
                .collect()
        };
        let mut rates = free(self, w);
        let joined: Vec<usize> =
            (0..self.touching.len()).filter(|&c| group.contains(&self.touching[c].a)).collect();
        if joined.is_empty() {
            return rates;
        }
        // Normal forces that keep the gaps closed: projected Gauss-Seidel on the accelerations.
        let still = |run: &Self, b: usize| constant(&run.walls[b - run.bodies.len()].1);
        let mut kept = vec![];
        for &c in &joined {
            let Touching { a, b, .. } = self.touching[c];
            let Some(x) = group.iter().position(|&j| j == a) else { continue };
            let y = group.iter().position(|&j| j == b);
            let kb = match y {
                Some(y) => k[y],
                None if b >= self.bodies.len() => still(self, b),
                None => continue,
            };
            let (near, rate) = facing(&k[x], &self.laws.shapes[a], &kb, self.shape(b));
            let point = (near.on_a + near.on_b).scaled(0.5);
            let (ra, rb) = (point - k[x].position, point - kb.position);
            let (ca, cb) = (
                self.laws.compliance(a, self.bodies[a].mode),
                match y {
                    Some(_) => self.laws.compliance(b, self.bodies[b].mode),
                    None => T::zero(),
                },
            );
            let turn = |j: usize, r: Vec2<T>| {
                if j < self.bodies.len() && matches!(self.bodies[j].mode, Mode::Slide | Mode::Roll) {
                    let arm = r.cross(near.normal);
                    (arm * self.laws.inverse_inertia[j], arm * arm * self.laws.inverse_inertia[j])
                } else {
                    (T::zero(), T::zero())
                }
            };
            let ((ta, ia), (tb, ib)) = (turn(a, ra), turn(b, rb));
            let response = ca + cb + ia + ib;
            if response.value() <= 0.0 {
                continue;
            }
            let bias = curvature(&near, &k[x], &self.laws.shapes[a], &kb, self.shape(b))
                + rate * (2.0 * CONTACT_STIFFNESS)
                + near.gap * (CONTACT_STIFFNESS * CONTACT_STIFFNESS);
            kept.push((c, x, y, near, [ca, cb], [ta, tb], [ra, rb], response, bias, T::zero()));
        }
        let sweeps = if kept.len() == 1 { 1 } else { CONTACT_SWEEPS };
        for _ in 0..sweeps {
            for (_, x, y, near, [ca, cb], [ta, tb], [ra, rb], response, bias, force) in &mut kept {
                let acceleration = |r: &Rates<T>, arm: Vec2<T>| r.velocity + arm.perp() * r.spin;
                let mut opening = *bias - near.normal.dot(acceleration(&rates[*x], *ra));
                if let Some(y) = y {
                    opening += near.normal.dot(acceleration(&rates[*y], *rb));
                }
                let total = (*force - opening / *response).max(T::zero());
                let more = total - *force;
                *force = total;
                let push = |r: &mut Rates<T>, c: T, t: T, radius: Option<f64>, rolls: bool| {
                    r.velocity += near.normal * (c * more);
                    r.spin += t * more;
                    if let (Some(radius), true) = (radius, rolls) {
                        r.roll += (near.normal * (c * more)).perp().scaled(1.0 / radius);
                    }
                };
                let ball = |j: usize| match self.laws.shapes[j] {
                    Shape::Ball { radius } => Some(radius),
                    _ => None,
                };
                let (a, rolls) = (group[*x], self.bodies[group[*x]].mode == Mode::Roll);
                push(&mut rates[*x], -*ca, -*ta, ball(a), rolls);
                if let Some(y) = y {
                    let (b, rolls) = (group[*y], self.bodies[group[*y]].mode == Mode::Roll);
                    push(&mut rates[*y], *cb, *tb, ball(b), rolls);
                }
            }
        }
        if mark {
            for c in &joined {
                self.touching[*c].pressing = kept.iter().any(|q| q.0 == *c && q.9.value() > 0.0);
            }
        }
        rates
    }

    fn shape(&self, b: usize) -> &Shape {
        match self.laws.shapes.get(b) {
            Some(shape) => shape,
            None => &self.walls[b - self.bodies.len()].0,
        }
    }

    fn next_event(&self) -> Option<Next> {
        let mut best: Option<(f64, Next)> = None;
        let mut offer = |time: f64, next: Next| {
            if best.as_ref().is_none_or(|(t, _)| time < *t) {
                best = Some((time, next));
            }
        };
        for (i, body) in self.bodies.iter().enumerate() {
            if body.change.is_some() {
                offer(body.until.value(), Next::Change(i));
            }
        }
        for &(time, a, b) in &self.impacts {
            offer(time, Next::Impact(time, a, b));
        }
        best.map(|(_, next)| next)
    }

    /// Friction stops a body, lets a ball roll, or ends its spin.
    fn change(&mut self, i: usize) {
        let group = self.bodies[i].group.clone();
        for &j in &group {
            let body = &mut self.bodies[j];
            body.from = body.to;
            body.since = body.until;
        }
        let time = self.bodies[i].since;
        let change = self.bodies[i].change.take();
        let k = self.bodies[i].from;
        let ball = self.laws.shapes[i].is_ball();
        let radius = self.laws.shapes[i].bounding_radius();
        match change {
            Some(Change::Stop) => {
                let speed =
                    k.velocity.value().norm() + if ball { 0.0 } else { k.spin.value().abs() * radius };
                let wrench = self.wrenches(
                    &group,
                    &group.iter().map(|&j| self.bodies[j].from).collect::<Vec<_>>(),
                    time,
                );
                let at = group.iter().position(|&j| j == i).unwrap_or(0);
                if speed <= 10.0 * REST_SPEED && self.laws.holds(i, &wrench[at]) {
                    let body = &mut self.bodies[i];
                    body.mode = Mode::Rest;
                    body.from.velocity = Vec2::zero();
                    body.from.spin = T::zero();
                    body.from.roll = Vec2::zero();
                    self.events.push(Event {
                        kind: EventKind::Stop,
                        time: time.value(),
                        objects: vec![self.model.bodies[i].id],
                        position: k.position.value(),
                        normal: None,
                        impulse: None,
                        wall: None,
                    });
                }
            }
            Some(Change::StartRolling) => {
                if self.laws.slip(i, &k).value().norm() <= 10.0 * REST_SPEED {
                    self.bodies[i].mode = Mode::Roll;
                    self.bodies[i].from.roll = k.velocity.perp().scaled(1.0 / radius);
                }
            }
            Some(Change::StopSpinning) => self.bodies[i].from.spin = T::zero(),
            Some(Change::Continue) | None => {}
        }
        self.release(&group);
        for &j in &group {
            if self.bodies[j].group[0] == j {
                self.predict(j);
            }
        }
        self.refresh(&group);
    }

    /// Splits a group whose contacts no longer press.
    fn release(&mut self, group: &[usize]) {
        let pressing = |t: &Touching| t.pressing || !group.contains(&t.a);
        if self.touching.iter().all(pressing) {
            return;
        }
        self.touching.retain(pressing);
        for &j in group {
            self.bodies[j].group = vec![j];
        }
        for k in 0..self.touching.len() {
            let Touching { a, b, .. } = self.touching[k];
            self.join(a, b);
        }
    }

    /// Candidate pairs by sweep and prune along x, then their times of impact.
    fn find_impacts(&mut self) {
        self.impacts.clear();
        let bodies = &self.bodies;
        self.order.sort_by(|&i, &j| bodies[i].path.low.x.total_cmp(&bodies[j].path.low.x).then(i.cmp(&j)));
        let mut found = vec![];
        for (x, &i) in self.order.iter().enumerate() {
            for &j in &self.order[x + 1..] {
                if self.bodies[j].path.low.x > self.bodies[i].path.high.x {
                    break;
                }
                found.extend(self.impact_of(i.min(j), i.max(j)));
            }
            found.extend((0..self.walls.len()).filter_map(|w| self.impact_of(i, self.bodies.len() + w)));
        }
        self.impacts = found;
    }

    /// New times of impact for bodies whose motion has changed.
    fn refresh(&mut self, changed: &[usize]) {
        let mut impacts = std::mem::take(&mut self.impacts);
        impacts.retain(|(_, a, b)| !changed.contains(a) && !changed.contains(b));
        for &i in changed {
            for j in 0..self.bodies.len() + self.walls.len() {
                if j != i && !(changed.contains(&j) && j < i) {
                    impacts.extend(self.impact_of(i.min(j), i.max(j)));
                }
            }
        }
        self.impacts = impacts;
    }

    fn impact_of(&self, a: usize, b: usize) -> Option<(f64, usize, usize)> {
        let body = &self.bodies[a];
        let still = |mode: Mode| matches!(mode, Mode::Rest | Mode::Absent);
        if body.mode == Mode::Absent || self.touching.iter().any(|t| t.a == a && t.b == b) {
            return None;
        }
        let other = match self.bodies.get(b) {
            Some(o) if o.mode == Mode::Absent || (still(o.mode) && still(body.mode)) => return None,
            Some(o) => o.path,
            None if still(body.mode) => return None,
            None => {
                let (shape, still) = self.walls[b - self.bodies.len()];
                Path::new(shape, body.path.start, body.path.end, still, still)
            }
        };
        if !body.path.overlaps(&other) {
            return None;
        }
        let (from, to) = (body.path.start.max(other.start), body.path.end.min(other.end));
        if from >= to {
            return None;
        }
        time_of_impact(&body.path, &other, from, to).map(|t| (t, a, b))
    }

    /// Moves the group of `i` to `time`; without a value, `time` may carry derivatives only.
    fn move_group(&mut self, i: usize, time: f64) {
        let group = self.bodies[i].group.clone();
        let since = self.bodies[i].since;
        let start: Vec<Kinematics<T>> = group.iter().map(|&j| self.bodies[j].from).collect();
        let h = T::constant(time) - since;
        if !group.iter().all(|&j| matches!(self.bodies[j].mode, Mode::Rest | Mode::Absent)) && h.value() > 0.0
        {
            let midpoint =
                group.iter().any(|&j| self.bodies[j].change.is_some_and(|c| c != Change::Continue));
            let first = self.rates_at(&group, &start, since);
            let end = self.integrate(&group, &start, &first, since, h, midpoint);
            for (x, &j) in group.iter().enumerate() {
                self.bodies[j].from = end[x];
            }
        }
        for &j in &group {
            self.bodies[j].since = T::constant(time);
            self.bodies[j].change = None;
        }
    }

    /// Moves the group of `i` by an infinitesimal time: values stay, derivatives change.
    fn shift_group(&mut self, i: usize, by: T) {
        let group = self.bodies[i].group.clone();
        let k: Vec<Kinematics<T>> = group.iter().map(|&j| self.bodies[j].from).collect();
        let time = self.bodies[i].since;
        let rates = self.rates_at(&group, &k, time);
        for (x, &j) in group.iter().enumerate() {
            if !matches!(self.bodies[j].mode, Mode::Rest | Mode::Absent) {
                self.bodies[j].from = k[x].stepped(&k[x], &rates[x], by);
            }
            self.bodies[j].since += by;
        }
    }

    fn facing_now(&self, a: usize, b: usize) -> (Proximity<T>, T) {
        let kb = match self.bodies.get(b) {
            Some(body) => body.from,
            None => constant(&self.walls[b - self.bodies.len()].1),
        };
        facing(&self.bodies[a].from, &self.laws.shapes[a], &kb, self.shape(b))
    }

    fn impact(&mut self, mut time: f64, a: usize, b: usize) {
        let solid = b < self.bodies.len();
        let together = solid && self.bodies[a].group.contains(&b);
        let earliest =
            self.bodies[a].path.start.max(if solid { self.bodies[b].path.start } else { f64::MIN });
        // The path's cubic is off by the step's fourth power: one Newton step on the true motion.
        let saved: Vec<(usize, Kinematics<T>, T, Option<Change>)> = self
            .involved(a, b)
            .iter()
            .map(|&j| (j, self.bodies[j].from, self.bodies[j].since, self.bodies[j].change))
            .collect();
        for attempt in 0..3 {
            self.move_group(a, time);
            if solid && !together {
                self.move_group(b, time);
            }
            let (near, rate) = self.facing_now(a, b);
            let (gap, rate) = (near.gap.value(), rate.value());
            let better = time - gap / rate;
            if attempt == 2
                || gap.abs() < 1e-11
                || rate > -1e-4
                || better < earliest
                || better > self.step_end
            {
                break;
            }
            for (j, from, since, change) in &saved {
                let body = &mut self.bodies[*j];
                (body.from, body.since, body.change) = (*from, *since, *change);
            }
            time = better;
        }
        if T::DIFFERENTIATES {
            // The time of impact moves with the parameters: implicit function theorem on gap = 0.
            let (near, rate) = self.facing_now(a, b);
            if rate.value() < -1e-6 {
                let shift = -(near.gap.infinitesimal() / rate).infinitesimal();
                self.shift_group(a, shift);
                if solid && !together {
                    self.shift_group(b, shift);
                }
            }
        }
        self.bounce(time, a, b);
        let (near, rate) = self.facing_now(a, b);
        if rate.value() < REBOUND_SPEED * 0.1 && near.gap.value() < 1e-6 && rate.value() > -APPROACH.sqrt() {
            self.touching.push(Touching { a, b, pressing: true });
            self.join(a, b);
        }
        self.pass_on(time, a, b);
        let changed = self.involved(a, b);
        self.predict(a);
        if solid && !self.bodies[a].group.contains(&b) {
            self.predict(b);
        }
        self.refresh(&changed);
    }

    /// An impact on a body that presses on others goes through to them, blow by blow.
    fn pass_on(&mut self, time: f64, a: usize, b: usize) {
        let group = self.involved(a, b);
        let kept: Vec<Touching> = self.touching.iter().filter(|t| group.contains(&t.a)).copied().collect();
        if kept.len() < 2 {
            return;
        }
        for _ in 0..BLOWS {
            let mut quiet = true;
            for t in &kept {
                if self.facing_now(t.a, t.b).1.value() < -BLOW_SPEED {
                    self.bounce(time, t.a, t.b);
                    quiet = false;
                }
            }
            if quiet {
                return;
            }
        }
    }

    fn involved(&self, a: usize, b: usize) -> Vec<usize> {
        let mut all = self.bodies[a].group.clone();
        if let Some(other) = self.bodies.get(b) {
            all.extend(other.group.iter().filter(|j| !self.bodies[a].group.contains(j)));
        }
        all
    }

    /// Applies the impulses of the contact and notes the event.
    fn bounce(&mut self, time: f64, a: usize, b: usize) {
        let (near, rate) = self.facing_now(a, b);
        let approach = -rate;
        let point = (near.on_a + near.on_b).scaled(0.5);
        let body = |run: &Self, i: usize| run.laws.body(i, &run.bodies[i].from);
        let other = (b < self.bodies.len()).then(|| body(self, b));
        let contact = Contact { a: body(self, a), b: other, normal: near.normal, point, approach };
        let mut law = ContactLaw::plain();
        for effect in &self.contact_effects {
            let (pa, pb) = (self.contact_values(effect, a, b), self.contact_values(effect, b, a));
            (effect.hook)(&pa, &pb, &contact, &mut law);
        }
        if approach.value() < REBOUND_SPEED {
            law.restitution = T::zero();
        }
        let mut side_a = self.side(a);
        let mut side_b = self.side(b);
        let impulse = resolve(&mut side_a, &mut side_b, &near, &law);
        for (i, side) in [(a, side_a), (b, side_b)] {
            if i < self.bodies.len() {
                self.bodies[i].from = side.kinematics;
                self.bodies[i].mode = Mode::Slide;
            }
        }
        let id = |i: usize| self.model.bodies.get(i).map(|body| body.id);
        let objects: Vec<u32> = [id(a), id(b)].into_iter().flatten().collect();
        let wall = self.model.walls.get(b.wrapping_sub(self.bodies.len())).map(|w| w.name.clone());
        let earlier = self.events.iter_mut().rev().take_while(|e| e.time > time - SAME_CONTACT);
        let same = earlier
            .filter(|e| e.kind == EventKind::Collision)
            .find(|e| e.objects == objects && e.wall == wall);
        if let Some(event) = same {
            event.impulse = event.impulse.map(|j| j + impulse.value());
            return;
        }
        self.events.push(Event {
            kind: EventKind::Collision,
            time,
            objects,
            position: point.value(),
            normal: Some(near.normal.value()),
            impulse: Some(impulse.value()),
            wall,
        });
    }

    fn side(&self, i: usize) -> Side<T> {
        match self.bodies.get(i) {
            Some(body) => Side {
                kinematics: body.from,
                inverse_mass: self.laws.inverse_mass[i],
                inverse_inertia: self.laws.inverse_inertia[i],
                ball: match self.laws.shapes[i] {
                    Shape::Ball { radius } => Some(radius),
                    _ => None,
                },
            },
            None => Side {
                kinematics: constant(&self.walls[i - self.bodies.len()].1),
                inverse_mass: T::zero(),
                inverse_inertia: T::zero(),
                ball: None,
            },
        }
    }

    /// Parameters of a contact effect as they apply to body `i` when it touches `j`.
    fn contact_values(&self, effect: &ContactEffect<T>, i: usize, j: usize) -> Vec<T> {
        let body = |k: usize| self.model.bodies.get(k);
        let (Some(this), other) = (body(i).or(body(j)), body(j).or(body(i))) else { return vec![] };
        let other = other.unwrap_or(this);
        let mut first = effect.first;
        let mut values = Vec::with_capacity(effect.parameters.len());
        for p in effect.parameters {
            values.push(match p.index(this, other) {
                Some(k) => self.flat[first + k],
                None => T::constant(p.prior.mean),
            });
            first += p.values.len();
        }
        values
    }
}

enum Next {
    Change(usize),
    Impact(f64, usize, usize),
}

/// Second derivative of the gap that comes from the velocities alone (m/s^2). A circle takes part with its
/// centre, a box with the corner or the face that touches.
fn curvature<T: Real>(
    near: &Proximity<T>,
    a: &Kinematics<T>,
    sa: &Shape,
    b: &Kinematics<T>,
    sb: &Shape,
) -> T {
    let round = |s: &Shape| matches!(s, Shape::Disc { .. } | Shape::Ball { .. });
    let point = |k: &Kinematics<T>, s: &Shape, on: Vec2<T>| if round(s) { k.position } else { on };
    let (pa, pb) = (point(a, sa, near.on_a), point(b, sb, near.on_b));
    let (va, vb) = (point_velocity(a, pa), point_velocity(b, pb));
    let n = near.normal;
    let centripetal = |k: &Kinematics<T>, p: Vec2<T>, n: Vec2<T>| -(n.dot(p - k.position) * k.spin * k.spin);
    let face = |host: &Kinematics<T>, guest: &Kinematics<T>, n: Vec2<T>, p: Vec2<T>, v: Vec2<T>| {
        let w = host.spin;
        centripetal(guest, p, n) + w * n.perp().dot(v - host.velocity) * 2.0
            - w * w * n.dot(p - host.position)
    };
    match near.feature {
        Feature::FaceOfA => face(a, b, n, pb, vb),
        Feature::FaceOfB => face(b, a, -n, pa, va),
        Feature::Points => {
            let across = n.perp().dot(vb - va);
            let span = (pb - pa).norm();
            let swing = if span.value() > 0.0 { across * across / span } else { T::zero() };
            swing + centripetal(b, pb, n) - centripetal(a, pa, n)
        }
    }
}

fn constant<T: Real>(k: &Kinematics<f64>) -> Kinematics<T> {
    Kinematics {
        position: Vec2::constant(k.position),
        yaw: T::constant(k.yaw),
        velocity: Vec2::constant(k.velocity),
        spin: T::constant(k.spin),
        roll: Vec2::constant(k.roll),
    }
}
