//! Presets: the effects and priors with which a kind of scene starts, as data.

use crate::effects::{Scope, effect};
use crate::num::vec2;
use crate::scene::{Scene, Table, WorldKind};
use crate::world::model::{ActiveEffect, BodySpec, Model, Parameter, Prior, Start, Wall};
use crate::world::trace::State;

/// A named choice of effects with their priors.
#[derive(Debug, Clone, Copy)]
pub struct Preset {
    pub name: &'static str,
    pub doc: &'static str,
    /// Whether balls start rolling. Otherwise they glide until a torque makes them roll.
    pub balls_roll: bool,
    /// The alternative preset for the same kind of scene, if the data must decide between two.
    pub rival: Option<&'static str>,
    /// Prior standard deviation of a log mass that the scene does not give.
    pub mass_sd: f64,
    /// See [`Model::spin_sd`].
    pub spin_sd: f64,
    /// What is found if this preset explains videos that another does not.
    pub finds: Option<PresetFinding>,
    pub effects: &'static [PresetEffect],
}

/// The effect that a preset models by its bodies' states and effects of other names.
#[derive(Debug, Clone, Copy)]
pub struct PresetFinding {
    pub effect: &'static str,
    /// The preset's effect and parameter for each parameter of that effect, in the order of its spec.
    pub parameters: &'static [(&'static str, &'static str)],
}

#[derive(Debug, Clone, Copy)]
pub struct PresetEffect {
    pub name: &'static str,
    /// Parameters that differ from the effect's spec.
    pub params: &'static [PresetParam],
    /// Whether it is omitted in scenes without walls.
    pub at_walls: bool,
}

#[derive(Debug, Clone, Copy)]
pub struct PresetParam {
    pub name: &'static str,
    pub mean: f64,
    /// 0 keeps it fixed.
    pub sd: f64,
    pub scope: Scope,
}

const fn set(name: &'static str, mean: f64, sd: f64, scope: Scope) -> PresetParam {
    PresetParam { name, mean, sd, scope }
}

const fn with(name: &'static str, params: &'static [PresetParam]) -> PresetEffect {
    PresetEffect { name, params, at_walls: false }
}

const fn at_walls(name: &'static str, params: &'static [PresetParam]) -> PresetEffect {
    PresetEffect { name, params, at_walls: true }
}

/// Friction slightly off the centre and askew. The priors are tight, so that it absorbs no more than uneven contact patches cause.
/// The load is on rim and corners in one physics engine, on a point in another, and uniform in a third.
const UNEVEN_PATCH: &[PresetParam] = &[
    set("lever", 0.0, 0.003, Scope::Object),
    set("skew", 0.0, 0.02, Scope::Object),
    set("foot", 0.0, 0.5, Scope::Shape),
];

/// The edge of a stated table. Without it a wall is plastic, which no edge is: the restitution of wood, rubber and wire is 0.6 to 1 (rails of 0.6 to 0.9: Alciatore, see `billiards`).
const CUSHION: PresetEffect = at_walls("cushion", &[set("restitution", 0.8, 0.2, Scope::Setup)]);

/// All presets.
pub static PRESETS: &[Preset] = &[
    // Friction and damping: means over sixty videos, each fitted alone (damping 0.040, 0.041 and 0.039). Two contact models
    // agree on them to 15 %. The standard deviations are 5 and 10 %, as another floor may differ. Restitution: one value for the
    // set-up and a wide deviation of each pair, as the two models rank pairs of shapes differently. A box on four corners: any
    // load of its diagonals is equally likely.
    Preset {
        name: "clevrer",
        doc: "Objects thrown over a floor: friction, damping, restitution by pair, balls that roll.",
        balls_roll: true,
        rival: None,
        mass_sd: 0.4,
        spin_sd: 0.0,
        finds: None,
        effects: &[
            with("sliding_friction", &[set("mu", 0.03, 0.0015, Scope::Setup)]),
            with(
                "friction_offset",
                &[
                    set("lever", 0.0, 0.006, Scope::Object),
                    set("skew", 0.0, 0.02, Scope::Object),
                    set("rock", 0.0, 0.58, Scope::Object),
                ],
            ),
            with(
                "damping",
                &[
                    set("linear", 0.04, 0.004, Scope::Setup),
                    set("quadratic", 0.04, 0.004, Scope::Setup),
                    set("spin", 0.04, 0.004, Scope::Setup),
                ],
            ),
            with(
                "restitution",
                &[set("coefficient", 0.3, 0.2, Scope::Setup), set("deviation", 1.0, 0.6, Scope::Pair)],
            ),
            with("contact_friction", &[set("mu", 0.04, 0.02, Scope::Pair)]),
            with("contact_distance", &[set("distance", 0.0, 0.002, Scope::Pair)]),
            CUSHION,
        ],
    },
    Preset {
        name: "paper",
        doc: "The published equations: sliding or rolling friction, quadratic drag, product law of restitution.",
        balls_roll: false,
        rival: None,
        mass_sd: 1.0,
        spin_sd: 0.0,
        finds: None,
        effects: &[
            with(
                "gliding_friction",
                &[set("sliding", 0.03, 0.03, Scope::Setup), set("rolling", 0.03, 0.03, Scope::Setup)],
            ),
            with(
                "damping",
                &[set("linear", 0.0, 0.0, Scope::Setup), set("quadratic", 0.06, 0.06, Scope::Setup)],
            ),
            with(
                "restitution",
                &[set("coefficient", 1.0, 0.0, Scope::Setup), set("object", 0.6, 0.3, Scope::Object)],
            ),
            CUSHION,
        ],
    },
    Preset {
        name: "table",
        doc: "Friction by material and restitution; balls roll, and slide after a hit until they roll again; cushions where the scene has a table.",
        balls_roll: true,
        rival: Some("table_glide"),
        mass_sd: 0.5,
        spin_sd: 0.0,
        finds: None,
        effects: &[
            with("gliding_friction", &[set("sliding", 0.03, 0.05, Scope::Material)]),
            with("friction_offset", UNEVEN_PATCH),
            with(
                "ball_spin",
                &[set("mu_slide", 0.1, 0.1, Scope::Setup), set("mu_roll", 0.02, 0.03, Scope::Material)],
            ),
            with(
                "restitution",
                &[set("coefficient", 0.7, 0.3, Scope::Setup), set("deviation", 1.0, 0.6, Scope::ShapePair)],
            ),
            CUSHION,
        ],
    },
    Preset {
        name: "table_glide",
        doc: "As `table`, but balls glide: nothing turns them about a horizontal axis.",
        balls_roll: false,
        rival: Some("table"),
        spin_sd: 0.0,
        finds: None,
        mass_sd: 0.5,
        effects: &[
            with(
                "gliding_friction",
                &[set("sliding", 0.03, 0.05, Scope::Material), set("rolling", 0.03, 0.05, Scope::Material)],
            ),
            with("friction_offset", UNEVEN_PATCH),
            with(
                "restitution",
                &[set("coefficient", 0.7, 0.3, Scope::Setup), set("deviation", 1.0, 0.6, Scope::ShapePair)],
            ),
            CUSHION,
        ],
    },
    // An air cushion damps speed and spin alike at 0.01 to 0.1 1/s (a disc under uniform shear), each puck by its own weight and
    // gap. A table levelled with a spirit level is off by 1 mm/m, 0.01 m/s^2. Plastics have a restitution of 0.3 to 0.9 and
    // friction of 0.1 to 0.3 (Bowden and Tabor, The Friction and Lubrication of Solids, part II), and a tangential restitution of
    // up to 0.5 (Foerster et al., 1994).
    Preset {
        name: "air_table",
        doc: "Pucks on an air cushion: weak drag, a table not quite level, restitution by pair, friction at contacts.",
        balls_roll: false,
        rival: None,
        mass_sd: 0.5,
        spin_sd: 0.0,
        finds: None,
        effects: &[
            with("damping", &[set("linear", 0.03, 0.03, Scope::Object)]),
            with("tilt", &[set("a_x", 0.0, 0.01, Scope::Setup), set("a_y", 0.0, 0.01, Scope::Setup)]),
            with("restitution", &[set("coefficient", 0.7, 0.3, Scope::Pair)]),
            with(
                "contact_friction",
                &[set("mu", 0.2, 0.1, Scope::Setup), set("tangential_restitution", 0.2, 0.3, Scope::Setup)],
            ),
            // Markers are centred by hand.
            with(
                "off_centre_marker",
                &[set("arm_x", 0.0, 0.001, Scope::Object), set("arm_y", 0.0, 0.001, Scope::Object)],
            ),
            CUSHION,
        ],
    },
    // Published values: cloth 0.15 to 0.4 sliding and 0.005 to 0.015 rolling, spin that falls by 5 to 15 rad/s^2, balls
    // 0.92 to 0.98 restitution and 0.03 to 0.08 friction, rails 0.6 to 0.9 (Alciatore, Illustrated Principles of Pool,
    // and his table of physical properties; Marlow, 1995). An edge's own restitution is up to 0.98 and its friction 0.14
    // (Mathavan et al., 2010). Its height is 0.27 radii above the centre by the rules of pool, 0.4 in snooker. Rubber has a
    // tangential restitution of 0.2 to 0.8 (Cross, 2002). A cue gives a surface speed of at most 5/4 of the ball's
    // (contact half a radius off the centre).
    Preset {
        name: "billiards",
        doc: "Balls on cloth between cushions, played with any spin.",
        balls_roll: true,
        rival: None,
        mass_sd: 0.1,
        spin_sd: 2.0,
        finds: Some(PresetFinding {
            effect: "ball_spin",
            parameters: &[("sliding_friction", "mu"), ("rolling_resistance", "mu")],
        }),
        effects: &[
            with("sliding_friction", &[set("mu", 0.2, 0.06, Scope::Setup)]),
            with("rolling_resistance", &[set("mu", 0.01, 0.004, Scope::Setup)]),
            with("spin_friction", &[set("mu", 0.012, 0.005, Scope::Setup)]),
            with("restitution", &[set("coefficient", 0.95, 0.03, Scope::Setup)]),
            with("contact_friction", &[set("mu", 0.06, 0.03, Scope::Setup)]),
            at_walls(
                "cushion",
                &[
                    set("restitution", 0.8, 0.15, Scope::Setup),
                    set("mu", 0.2, 0.1, Scope::Setup),
                    set("height", 0.3, 0.1, Scope::Setup),
                    set("tangential_restitution", 0.5, 0.25, Scope::Setup),
                ],
            ),
        ],
    },
];

impl Preset {
    pub fn named(name: &str) -> Option<&'static Preset> {
        PRESETS.iter().find(|p| p.name == name)
    }

    /// The preset for a kind of scene.
    pub fn for_world(world: WorldKind) -> &'static Preset {
        let name = match world {
            WorldKind::Clevrer => "clevrer",
            WorldKind::Table => "table",
            WorldKind::AirTable => "air_table",
            WorldKind::Billiards => "billiards",
        };
        PRESETS.iter().find(|p| p.name == name).unwrap_or(&PRESETS[0])
    }

    /// A model of the scene before any fit: bodies where they were first seen, at rest, effects at their prior means.
    pub fn model(&self, scene: &Scene) -> Model {
        let bodies: Vec<BodySpec> = scene
            .objects
            .iter()
            .zip(&scene.tracks)
            .map(|(object, track)| {
                let (time, position, yaw) = match track.samples.first() {
                    Some(s) => (scene.time_of(s.frame), s.position, s.yaw.unwrap_or(0.0)),
                    None => (0.0, vec2(0.0, 0.0), 0.0),
                };
                BodySpec {
                    id: object.id,
                    material: object.material.clone(),
                    shape: object.shape,
                    mass: object.mass.unwrap_or(1.0),
                    start: Start {
                        time,
                        state: State { position, yaw, ..State::default() },
                        rolling: self.balls_roll && object.shape.is_ball(),
                    },
                }
            })
            .collect();
        let walls = scene.table.map(cushions).unwrap_or_default();
        let chosen = self.effects.iter().filter(|e| !(e.at_walls && walls.is_empty()));
        let effects = chosen.filter_map(|chosen| {
            let mut active = ActiveEffect::new(&effect(chosen.name)?.spec, &bodies);
            for p in chosen.params {
                if let Some(slot) = active.parameters.iter_mut().find(|q| q.name == p.name) {
                    let prior = Prior { mean: p.mean, sd: p.sd };
                    *slot = Parameter::new(p.name, p.scope, prior, &bodies);
                }
            }
            Some(active)
        });
        let effects = effects.collect();
        let Preset { mass_sd, spin_sd, .. } = *self;
        Model {
            preset: self.name.to_string(),
            bodies,
            walls,
            effects,
            mass_sd,
            spin_sd,
            corrections: vec![],
            impulses: vec![],
        }
    }
}

/// The four sides of a table, named as seen from above with y upwards.
fn cushions(table: Table) -> Vec<Wall> {
    let ([x0, x1], [y0, y1]) = (table.x, table.y);
    let side = |name: &str, from, to| Wall { name: name.to_string(), from, to };
    vec![
        side("left", vec2(x0, y0), vec2(x0, y1)),
        side("right", vec2(x1, y0), vec2(x1, y1)),
        side("bottom", vec2(x0, y0), vec2(x1, y0)),
        side("top", vec2(x0, y1), vec2(x1, y1)),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A stated table counts in every world: each preset has a law of its edge that a fit can move.
    #[test]
    fn every_preset_has_a_law_of_the_edge_where_the_scene_has_a_table() {
        for preset in PRESETS {
            let edge = preset.effects.iter().find(|e| e.at_walls).expect(preset.name);
            assert!(edge.params.iter().any(|p| p.name == "restitution" && p.sd > 0.0), "{}", preset.name);
        }
    }

    #[test]
    fn every_preset_names_effects_and_parameters_that_exist() {
        for preset in PRESETS {
            for chosen in preset.effects {
                let spec = &effect(chosen.name).expect(chosen.name).spec;
                for p in chosen.params {
                    let known = spec.params.iter().find(|q| q.name == p.name).expect(p.name);
                    assert!(p.mean >= known.min && p.mean <= known.max, "{}.{}", chosen.name, p.name);
                }
            }
        }
        for world in [WorldKind::Clevrer, WorldKind::Table, WorldKind::AirTable, WorldKind::Billiards] {
            Preset::for_world(world);
        }
        for rival in PRESETS.iter().filter_map(|p| p.rival) {
            assert!(Preset::named(rival).is_some(), "{rival}");
        }
    }
}
