//! The laws of motion and contact: one file each, and one row each in [`EFFECTS`].
//!
//! `effect` says what an effect is, `profile` what other rooms know of it, `entry` is the row of the table.

mod alike;
mod effect;
mod entry;
pub mod formula;
mod param;
mod param_id;
mod profile;
mod report;
mod seed;
#[cfg(test)]
mod tests;

mod camera {
    pub mod axis_scale;
    pub mod frame_rate;
    pub mod lens_distortion;
    pub mod off_centre_marker;
    pub mod tilted_camera;
    pub mod wrong_scale;
}
mod contact {
    pub mod contact_distance;
    pub mod contact_friction;
    pub mod cushion;
    pub mod hidden_object;
    pub mod hidden_wall;
    pub mod hidden_walls;
    pub mod restitution;
    pub mod soft_contact;
    pub mod speed_dependent_restitution;
    pub mod sticky_contact;
}
mod force {
    pub mod attractor_inverse_square;
    pub mod attractor_spring;
    pub mod centrifugal;
    pub mod coriolis;
    pub mod cubic_drag;
    pub mod lateral;
    pub mod linear_drag;
    pub mod magnus;
    pub mod quadratic_drag;
    pub mod tilt;
    pub mod time_periodic;
    pub mod uniform_force;
    pub mod vortex;
}
mod friction {
    pub mod ball_spin;
    pub mod damping;
    pub mod friction_offset;
    pub mod friction_patch;
    pub mod gliding_friction;
    pub mod rolling_resistance;
    pub mod sliding_friction;
    pub mod spin_friction;
}
mod matter {
    pub mod mass_change;
    pub mod wrong_size;
}
mod pair {
    pub mod magnet_repulsion;
    pub mod pair_attraction;
    pub mod pair_repulsion;
}

pub use alike::alike;
pub use contact::contact_distance::MOST_MARGIN;
pub use effect::{Effect, EffectSpec, Hook, Symmetry};
pub use entry::{
    BodiesFn, ClockFn, ContactFn, EffectEntry, ForceFn, Hooks, MarginFn, MatterFn, ObserveFn, PaceFn, PairFn,
    Scalar,
};
pub use param::{CENTER, ParamSpec, Scope};
pub use param_id::ParamId;
pub use profile::{ActsOn, ObstacleForm, ParamRole, Profile, Role, SearchStart};
pub use report::{Quantity, joined};
pub use seed::{Region, Seed, Seeds};

/// Every effect there is. A new one is a file in the folder of its kind, and its two lines here: the module above, the row below.
pub static EFFECTS: &[EffectEntry] = &[
    EffectEntry::of::<friction::sliding_friction::SlidingFriction>(),
    EffectEntry::of::<friction::friction_offset::FrictionOffset>(),
    EffectEntry::of::<friction::rolling_resistance::RollingResistance>(),
    EffectEntry::of::<friction::ball_spin::BallSpin>(),
    EffectEntry::of::<friction::gliding_friction::GlidingFriction>(),
    EffectEntry::of::<friction::damping::Damping>(),
    EffectEntry::of::<force::linear_drag::LinearDrag>(),
    EffectEntry::of::<force::quadratic_drag::QuadraticDrag>(),
    EffectEntry::of::<force::cubic_drag::CubicDrag>(),
    EffectEntry::of::<contact::restitution::Restitution>(),
    EffectEntry::of::<contact::contact_friction::ContactFriction>(),
    EffectEntry::of::<contact::contact_distance::ContactDistance>(),
    EffectEntry::of::<contact::cushion::Cushion>(),
    EffectEntry::of::<friction::spin_friction::SpinFriction>(),
    EffectEntry::of::<force::tilt::Tilt>(),
    EffectEntry::of::<force::uniform_force::UniformForce>(),
    EffectEntry::of::<force::attractor_spring::AttractorSpring>(),
    EffectEntry::of::<force::attractor_inverse_square::AttractorInverseSquare>(),
    EffectEntry::of::<force::vortex::Vortex>(),
    EffectEntry::of::<force::coriolis::Coriolis>(),
    EffectEntry::of::<force::centrifugal::Centrifugal>(),
    EffectEntry::of::<force::lateral::Lateral>(),
    EffectEntry::of::<force::magnus::Magnus>(),
    EffectEntry::of::<pair::pair_attraction::PairAttraction>(),
    EffectEntry::of::<pair::pair_repulsion::PairRepulsion>(),
    EffectEntry::of::<pair::magnet_repulsion::MagnetRepulsion>(),
    EffectEntry::of::<friction::friction_patch::FrictionPatch>(),
    EffectEntry::of::<force::time_periodic::TimePeriodic>(),
    EffectEntry::of::<contact::hidden_wall::HiddenWall>(),
    EffectEntry::of::<contact::hidden_walls::HiddenWalls>(),
    EffectEntry::of::<contact::hidden_object::HiddenObject>(),
    EffectEntry::of::<contact::speed_dependent_restitution::SpeedDependentRestitution>(),
    EffectEntry::of::<contact::soft_contact::SoftContact>(),
    EffectEntry::of::<contact::sticky_contact::StickyContact>(),
    EffectEntry::of::<matter::mass_change::MassChange>(),
    EffectEntry::of::<matter::wrong_size::WrongSize>(),
    EffectEntry::of::<camera::wrong_scale::WrongScale>(),
    EffectEntry::of::<camera::axis_scale::AxisScale>(),
    EffectEntry::of::<camera::tilted_camera::TiltedCamera>(),
    EffectEntry::of::<camera::lens_distortion::LensDistortion>(),
    EffectEntry::of::<camera::off_centre_marker::OffCentreMarker>(),
    EffectEntry::of::<camera::frame_rate::FrameRate>(),
];

/// The first effect with this property.
pub fn effect_with(property: impl Fn(&EffectEntry) -> bool) -> Option<&'static EffectEntry> {
    EFFECTS.iter().find(|e| property(e))
}

/// The first effect that has a parameter with this meaning, and that parameter.
pub fn parameter_with(role: ParamRole) -> Option<(&'static EffectEntry, &'static ParamSpec)> {
    EFFECTS.iter().find_map(|e| Some((e, e.parameter(role)?)))
}

/// The entry of that name.
pub fn effect(name: &str) -> Option<&'static EffectEntry> {
    EFFECTS.iter().find(|e| e.spec.name == name)
}
