//! The state of one simulation, and what its bodies are like at present.

use crate::effects::Scalar;
use crate::scene::Shape;
use crate::world::contact::bonds::Bonds;
use crate::world::contact::contact_law::ContactLaws;
use crate::world::contact::grid::Grid;
use crate::world::contact::impulse::CollisionBody;
use crate::world::contact::islands::Islands;
use crate::world::contact::persistent_contact::ContactSet;
use crate::world::contact::rigid_cluster::RigidCluster;
use crate::world::contact::static_body::StaticBody;
use crate::world::model::{BODY_VALUES, BodySpec, Model};
use crate::world::motion::dynamics::Dynamics;
use crate::world::motion::ground_friction::Mode;
use crate::world::motion::kinematics::Kinematics;
use crate::world::motion::moving_body::MovingBody;
use crate::world::simulation::event_queue::EventQueue;
use crate::world::simulation::recorder::Recorder;

/// Longest step (s): the integrator is of fourth order, and segments of uneven acceleration are halved.
pub(in crate::world) const MAX_STEP: f64 = 0.16;

/// All that changes in a simulation, and the laws by which it does. Indices of walls follow those of the bodies: wall `w` is
/// `bodies + w`. Each part is changed by the methods of its own file only.
pub(in crate::world) struct Simulation<'m, T: Scalar> {
    pub model: &'m Model,
    pub dynamics: Dynamics<T>,
    /// The dynamics without derivatives, for bodies that carry none.
    pub plain: Option<Dynamics<f64>>,
    pub contact_laws: ContactLaws<'m, T>,
    pub walls: Vec<StaticBody<T>>,
    pub bodies: Vec<MovingBody<T>>,
    pub islands: Islands,
    pub contacts: ContactSet<T>,
    pub bonds: Bonds<T>,
    pub queue: EventQueue<T>,
    pub grid: Grid,
    pub recorder: Recorder<'m, T>,
    /// s.
    pub step_end: f64,
    /// Longest next segment of bodies with pair forces, from the error of the last one (s); changed by `island_motion` only.
    pub segment_length: f64,
}

impl<'m, T: Scalar> Simulation<'m, T> {
    /// Before any body enters. `flat` is laid out as [`Model::flatten`]; states are recorded at `times` (s).
    pub fn new(model: &'m Model, flat: &'m [T], times: &'m [f64]) -> Self {
        let dynamics = Dynamics::new(model, flat);
        let body = |(i, spec): (usize, &BodySpec)| {
            let shape = dynamics.shapes[i];
            let mut state = Kinematics::starting(&flat[i * BODY_VALUES.len()..]);
            if spec.start.rolling {
                state.roll = state.velocity.perp().scaled(1.0 / shape.bounding_radius());
            }
            MovingBody::absent(shape, state, spec.start.time)
        };
        let bodies: Vec<MovingBody<T>> = model.bodies.iter().enumerate().map(body).collect();
        let real = || flat.iter().map(|v| v.value()).collect::<Vec<f64>>();
        Simulation {
            plain: T::DIFFERENTIATES.then(|| Dynamics::new(model, &real())),
            contact_laws: ContactLaws::new(model, flat),
            walls: StaticBody::all(model, flat),
            islands: Islands::apart(bodies.len()),
            recorder: Recorder::new(times, bodies.len()),
            bodies,
            contacts: ContactSet::new(),
            bonds: Bonds::new(),
            queue: EventQueue::new(),
            grid: Grid::default(),
            step_end: 0.0,
            segment_length: MAX_STEP,
            dynamics,
            model,
        }
    }

    /// Starts a step (s).
    pub fn begin_step(&mut self, start: f64, end: f64) {
        self.step_end = end;
        for body in &mut self.bodies {
            body.set_time(T::constant(start));
        }
    }

    /// Whether a formula had no finite value.
    pub fn is_undefined(&self) -> bool {
        self.dynamics.is_undefined() || self.plain.as_ref().is_some_and(|plain| plain.is_undefined())
    }

    /// State of a body or wall.
    pub fn kinematics(&self, i: usize) -> &Kinematics<T> {
        match self.bodies.get(i) {
            Some(body) => body.state(),
            None => &self.walls[i - self.bodies.len()].state,
        }
    }

    /// Shape of a body or wall.
    pub fn shape(&self, i: usize) -> &Shape {
        match self.dynamics.shapes.get(i) {
            Some(shape) => shape,
            None => &self.walls[i - self.bodies.len()].shape,
        }
    }

    /// Whether no other body acts on body `i`.
    pub fn is_free(&self, i: usize) -> bool {
        self.islands.of(i).len() == 1 && !self.dynamics.has_pair_forces() && !self.contacts.any_of(i)
    }

    /// The dynamics without derivatives, if the motion of body `i` carries none.
    pub fn without_derivatives(&self, i: usize) -> Option<&Dynamics<f64>> {
        let body = &self.bodies[i];
        let plain = self.plain.as_ref().filter(|_| self.dynamics.constant[i]);
        plain.filter(|_| body.since().is_constant() && body.state().is_constant())
    }

    /// Presence and restitution of an obstacle for body `a`; `None` for bodies and walls.
    pub fn obstacle(&self, a: usize, b: usize) -> Option<(T, T)> {
        let wall = b.checked_sub(self.bodies.len()).and_then(|w| self.walls.get(w))?;
        wall.obstacle.as_ref()?.get(a).copied()
    }

    /// The cluster of body `i` as one rigid body, with the states of its members.
    pub fn rigid_cluster(&self, i: usize, state: impl Fn(usize) -> Kinematics<T>) -> Option<RigidCluster<T>> {
        let one = T::constant(1.0);
        let part = |&j: &usize| (self.dynamics.mass[j], one / self.dynamics.inverse_inertia[j], state(j));
        self.bonds.cluster(i).map(|members| RigidCluster::of(members.iter().map(part)))
    }

    /// Response of body or wall `i`, with its cluster, to an impulse.
    pub fn collision_body(&self, i: usize) -> CollisionBody<T> {
        if let Some(cluster) = self.rigid_cluster(i, |j| *self.bodies[j].state()) {
            return cluster.collision_body();
        }
        match self.bodies.get(i) {
            Some(body) => CollisionBody {
                kinematics: *body.state(),
                inverse_mass: self.dynamics.inverse_mass[i],
                inverse_inertia: self.dynamics.inverse_inertia[i],
                ball: match self.dynamics.shapes[i] {
                    Shape::Ball { radius } => Some(radius),
                    _ => None,
                },
            },
            None => CollisionBody {
                kinematics: *self.kinematics(i),
                inverse_mass: T::zero(),
                inverse_inertia: T::zero(),
                ball: None,
            },
        }
    }

    /// Gives body `i`, with its cluster, the motion after an impulse, and a mode.
    pub fn set_motion(&mut self, i: usize, after: Kinematics<T>, mode: Option<Mode>) {
        let members = self.bonds.members(i);
        let single = members.len() == 1;
        let cluster = RigidCluster::moving(after);
        for j in members {
            let body = &mut self.bodies[j];
            if single {
                body.set_state(after);
            } else {
                let mut part = *body.state();
                cluster.carry(&mut part);
                body.set_state(part);
            }
            if let Some(mode) = mode {
                body.set_mode(mode);
            }
        }
    }

    /// Body `i`, with its cluster, comes to rest at `time` (s).
    pub fn stop(&mut self, i: usize, time: f64) {
        for j in self.bonds.members(i) {
            self.bodies[j].come_to_rest();
            let position = self.bodies[j].state().position.value();
            self.recorder.record_stop(self.model.bodies[j].id, time, position);
        }
    }
}

/// State of body `j`, a member of the island.
pub(in crate::world) fn member_state<T: Copy>(
    island: &[usize],
    k: &[Kinematics<T>],
    j: usize,
) -> Kinematics<T> {
    // A cluster lies within one island, so the body is found.
    k[island.iter().position(|&i| i == j).unwrap_or(0)]
}
