//! One simulation: states at frame times and what happened when.

use crate::num::Vec2;
use serde::{Deserialize, Serialize};

/// States of all bodies at the requested times, and the events between.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Trace {
    /// Object ids, one per body.
    pub ids: Vec<u32>,
    /// s.
    pub times: Vec<f64>,
    /// `states[frame][body]`; `None` before the body enters.
    pub states: Vec<Vec<Option<State>>>,
    /// By time.
    pub events: Vec<Event>,
    /// Kinetic energy of all bodies at each time (J).
    pub energy: Vec<f64>,
    pub ending: Ending,
}

#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct State {
    /// m.
    pub position: Vec2,
    /// rad.
    pub yaw: f64,
    /// m/s.
    pub velocity: Vec2,
    /// rad/s about z.
    pub spin: f64,
    /// rad/s about the horizontal axes; balls only.
    pub roll: Vec2,
}

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Event {
    pub kind: EventKind,
    /// Exact time (s).
    pub time: f64,
    /// Ids of the objects involved: two in a collision of objects, one otherwise.
    pub objects: Vec<u32>,
    /// The contact point, or the position of the object (m).
    pub position: Vec2,
    /// Unit normal of a collision, from the first object.
    pub normal: Option<Vec2>,
    /// Normal impulse of a collision (N s).
    pub impulse: Option<f64>,
    /// Name of the wall, in a collision with one.
    pub wall: Option<String>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum EventKind {
    Collision,
    /// Comes into the camera's view.
    Enter,
    /// Leaves the camera's view.
    Exit,
    /// Comes to rest.
    Stop,
}

/// Why a simulation ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Ending {
    Completed,
    /// More events than a simulation may have; there are no states after.
    EventLimit,
    /// A formula has no finite value at the state of a body; there are no states after.
    FormulaUndefined,
}

impl std::fmt::Display for Ending {
    fn fmt(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
        f.write_str(match self {
            Ending::Completed => "it was completed",
            Ending::EventLimit => {
                "more impacts and stops than a simulation may have: request fewer frames or slower objects"
            }
            Ending::FormulaUndefined => {
                "a formula has no finite value there: change it, or request fewer frames"
            }
        })
    }
}
