//! A shaking table: an acceleration that comes and goes.

use crate::body::{Body, Wrench};
use crate::effects::{Effect, EffectSpec, Hook, ParamSpec, Quantity, Scope, Seed, Seeds, Symmetry};
use crate::num::{Real, elementary, vec2};

/// Share of a period in which a rhythm changes little.
const PACE: f64 = 1.0 / 16.0;

pub struct TimePeriodic;

impl Effect for TimePeriodic {
    const SPEC: EffectSpec = EffectSpec {
        name: "time_periodic",
        doc: "The table shakes in a rhythm: a = a cos(2 pi f t + phi), the same for all masses; t = 0 at the first frame.",
        source: "Inertial force of a table that is shaken",
        hooks: &[Hook::Force],
        params: &[
            ParamSpec {
                name: "a_x",
                unit: "m/s^2",
                default: 0.0,
                min: -20.0,
                max: 20.0,
                scope: Scope::Setup,
                doc: "greatest acceleration",
            },
            ParamSpec {
                name: "a_y",
                unit: "m/s^2",
                default: 0.0,
                min: -20.0,
                max: 20.0,
                scope: Scope::Setup,
                doc: "greatest acceleration",
            },
            ParamSpec {
                name: "f",
                unit: "Hz",
                default: 1.0,
                min: 0.0,
                max: 50.0,
                scope: Scope::Setup,
                doc: "frequency",
            },
            ParamSpec {
                name: "phi",
                unit: "rad",
                default: 0.0,
                min: -10.0,
                max: 10.0,
                scope: Scope::Setup,
                doc: "phase at t = 0",
            },
        ],
    };
    const AMPLITUDES: usize = 2;
    const SYMMETRY: Symmetry = Symmetry::Shifts;
    const SEEDS: Seeds =
        &[("f", Seed::Frequency), ("phi", Seed::Values(&[0.0, std::f64::consts::FRAC_PI_2]))];

    /// The direction points to positive x (or along y); the phase is in 0..2 pi.
    fn report(p: &[f64]) -> Vec<(&'static str, Quantity)> {
        let size = elementary::hypot(p[0], p[1]);
        let turned = if p[0] < 0.0 || (p[0] == 0.0 && p[1] < 0.0) { -1.0 } else { 1.0 };
        let phase = if turned < 0.0 { p[3] + std::f64::consts::PI } else { p[3] };
        let direction = if size > 0.0 { [turned * p[0] / size, turned * p[1] / size] } else { [1.0, 0.0] };
        vec![
            ("a", Quantity::Number(size)),
            ("f", Quantity::Number(p[2])),
            ("phi", Quantity::Number(phase.rem_euclid(std::f64::consts::TAU))),
            ("direction", Quantity::Vector(direction)),
        ]
    }

    fn pace<T: Real>(p: &[T]) -> f64 {
        PACE / p[2].value()
    }

    fn force<T: Real>(p: &[T], time: T, body: &Body<T>, out: &mut Wrench<T>) {
        let swing = (p[2] * time * std::f64::consts::TAU + p[3]).cos();
        out.force += vec2(p[0], p[1]) * (body.mass * swing);
    }
}
