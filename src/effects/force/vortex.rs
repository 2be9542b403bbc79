//! A rotating fluid that drags bodies along.

use crate::body::{Body, Wrench};
use crate::effects::{CENTER, Effect, EffectSpec, Hook, ParamSpec, Scope, Seed, Seeds, Symmetry};
use crate::num::{Real, vec2};

pub struct Vortex;

impl Effect for Vortex {
    const SPEC: EffectSpec = EffectSpec {
        name: "vortex",
        doc: "A fluid that rotates about a point drags objects along: F = -c (v - u(x)), u = Omega z^ x (x - center).",
        source: "Stokes drag in a fluid that turns as one body",
        hooks: &[Hook::Force],
        params: &[
            ParamSpec {
                name: "c",
                unit: "kg/s",
                default: 0.0,
                min: 0.0,
                max: 10.0,
                scope: Scope::Setup,
                doc: "force per speed against the fluid",
            },
            ParamSpec {
                name: "Omega",
                unit: "rad/s",
                default: 0.0,
                min: -20.0,
                max: 20.0,
                scope: Scope::Setup,
                doc: "turn rate of the fluid",
            },
            CENTER[0],
            CENTER[1],
        ],
    };
    const SYMMETRY: Symmetry = Symmetry::About { center: 2, mirrors: false };
    const SEEDS: Seeds = &[
        ("Omega", Seed::Values(&[-2.0, -0.5, 0.5, 2.0])),
        ("center_x", Seed::PlaceX),
        ("center_y", Seed::PlaceY),
    ];

    fn force<T: Real>(p: &[T], _time: T, body: &Body<T>, out: &mut Wrench<T>) {
        let fluid = (body.position - vec2(p[2], p[3])).perp() * p[1];
        out.force -= (body.velocity - fluid) * p[0];
    }
}
